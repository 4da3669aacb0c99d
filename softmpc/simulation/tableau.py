"""Runge-Kutta tableaus as data."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

__all__ = ["Tableau", "gauss_legendre", "radau_iia"]


@dataclass(frozen=True)
class Tableau:
    """Coefficients of an implicit collocation method with s stages."""

    name: str
    A: np.ndarray
    b: np.ndarray
    c: np.ndarray

    @property
    def stages(self) -> int:
        return len(self.c)

    @property
    def stiffly_accurate(self) -> bool:
        """Whether the last stage is the end of the step."""
        return bool(abs(self.c[-1] - 1.0) < 1e-12)

    @cached_property
    def order(self) -> int:
        """Order at the end of a step: as many moments of [0, 1] as the quadrature has right."""
        k = 1
        while abs(self.b @ self.c ** (k - 1) - 1 / k) < 1e-10:
            k += 1
        return k - 1

    def lagrange(self, times: np.ndarray) -> np.ndarray:
        """Values at `times` (K) of the polynomials that are one at a stage (K×s)."""
        c = self.c
        parts = [
            np.prod([(times - c[k]) / (c[j] - c[k]) for k in range(len(c)) if k != j], axis=0)
            for j in range(len(c))
        ]
        return np.stack([np.broadcast_to(part, np.shape(times)) for part in parts], axis=-1)

    @cached_property
    def embedded(self) -> tuple[float, np.ndarray]:
        """Weights (of the start, of the stages) of the error that a formula of order s would make.

        The formula takes the start with a weight γ (Hairer and Wanner, Solving ODEs II, IV.8:
        the real eigenvalue of A, here the one nearest to the real axis).
        """
        eigenvalues = np.linalg.eigvals(self.A)
        gamma = float(eigenvalues[np.argmin(np.abs(eigenvalues.imag))].real)
        k = np.arange(1, self.stages + 1)
        moments = 1 / k - gamma * (k == 1)
        weights = np.linalg.solve(self.c ** (k[:, None] - 1), moments)
        return gamma, weights - self.b


def radau_iia(stages: int) -> Tableau:
    """Radau IIA: L-stable, order 2s - 1, its last stage is the end of the step."""
    return _collocation(f"radau-iia-{stages}", stages, ends=1)


def gauss_legendre(stages: int) -> Tableau:
    """Gauss-Legendre: symmetric, order 2s, keeps energy over long times; not L-stable."""
    return _collocation(f"gauss-legendre-{stages}", stages, ends=0)


def _collocation(name: str, stages: int, ends: int) -> Tableau:
    """Collocation at the zeros of dˢ⁻ᵉ/dxˢ⁻ᵉ xˢ⁻ᵉ (x - 1)ˢ, where e = `ends` is 0 or 1."""
    x = np.polynomial.Polynomial([0.0, 1.0])
    polynomial = x ** (stages - ends) * (x - 1.0) ** stages
    c = np.sort(polynomial.deriv(stages - ends).roots().real)
    powers = np.arange(1, stages + 1)
    vandermonde = np.linalg.inv(c[:, None] ** (powers - 1))
    A = (c[:, None] ** powers / powers) @ vandermonde
    return Tableau(name, A, (1 / powers) @ vandermonde, c)
