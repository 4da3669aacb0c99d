"""Exact discretisation of the linear hydraulics."""

from __future__ import annotations

import numpy as np

__all__ = ["held_input"]


def held_input(A: np.ndarray, B: np.ndarray, time: float) -> tuple[np.ndarray, np.ndarray]:
    """Φ, Γ of z(t) = Φ z(0) + Γ u for a constant input, by the matrix exponential."""
    from scipy.linalg import expm

    n, m = B.shape
    if n == 0:
        return np.zeros((0, 0)), np.zeros((0, m))
    block = np.zeros((n + m, n + m))
    block[:n, :n], block[:n, n:] = A * time, B * time
    whole = expm(block)
    return whole[:n, :n], whole[:n, n:]
