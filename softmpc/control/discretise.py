"""Exact discretisation of the linear hydraulics."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

__all__ = ["held_input", "held_inputs"]


def held_input(A: np.ndarray, B: np.ndarray, time: float) -> tuple[np.ndarray, np.ndarray]:
    """Φ, Γ of z(t) = Φ z(0) + Γ u for a constant input, by the matrix exponential."""
    phi, gamma = held_inputs(A, B, [time])
    return phi[0], gamma[0]


def held_inputs(
    A: np.ndarray, B: np.ndarray, times: Sequence[float] | np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The same for several times (T): Φ (T×n×n), Γ (T×n×m).

    States and inputs that have nothing to do with each other, as those of different units, are
    apart in the exponential too, and units that are alike have one.
    """
    from scipy.linalg import expm
    from scipy.sparse.csgraph import connected_components

    n, m = B.shape
    rates = np.zeros((n + m, n + m))
    rates[:n, :n], rates[:n, n:] = A, B
    found = np.zeros((len(times), n + m, n + m))
    _, part = connected_components(rates != 0, directed=False)
    known: dict[bytes, np.ndarray] = {}
    for k in np.unique(part):
        own = np.ix_(part == k, part == k)
        key = rates[own].tobytes()
        if key not in known:
            known[key] = expm(rates[own] * np.reshape(times, (-1, 1, 1)))
        found[:, *own] = known[key]
    return found[:, :n, :n], found[:, :n, n:]
