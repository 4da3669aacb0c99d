"""Runge-Kutta tableaus as data."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

__all__ = ["Tableau", "radau_iia"]


@dataclass(frozen=True)
class Tableau:
    """Coefficients of an implicit Runge-Kutta method with s stages."""

    name: str
    A: np.ndarray
    b: np.ndarray
    c: np.ndarray


def radau_iia(stages: int) -> Tableau:
    """Radau IIA: L-stable, order 2s - 1, its last stage is the end of the step."""
    polynomial = np.polynomial.Polynomial([1.0])
    for _ in range(stages - 1):
        polynomial = polynomial * np.polynomial.Polynomial([0.0, 1.0])
    for _ in range(stages):
        polynomial = polynomial * np.polynomial.Polynomial([-1.0, 1.0])
    c = np.sort(polynomial.deriv(stages - 1).roots().real)
    powers = np.arange(1, stages + 1)
    vandermonde = c[:, None] ** (powers - 1)
    A = (c[:, None] ** powers / powers) @ np.linalg.inv(vandermonde)
    return Tableau(f"radau-iia-{stages}", A, A[-1].copy(), c)
