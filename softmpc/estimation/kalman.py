"""The two halves of an extended Kalman filter on an augmented state, and what an update reports."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

__all__ = ["Innovation", "gate", "predicted", "updated"]

Array = np.ndarray


@dataclass(frozen=True)
class Innovation:
    """A reading less what was expected (SI), its standard deviation, and the normalised square."""

    sensor: int
    stamp: int  # ticks
    value: Array
    spread: Array
    nis: float
    accepted: bool


@lru_cache(maxsize=32)
def gate(size: int, miss: float) -> float:
    """The square that one in 1/miss good innovations of `size` numbers exceeds (χ²)."""
    from scipy.special import chdtri  # scipy.stats takes a second to import

    return float(chdtri(size, miss))


def predicted(P: Array, A: Array, Q: Array) -> Array:
    """Covariance after a step with slope A and the diagonal Q."""
    after = A @ P @ A.T
    after[np.diag_indices_from(after)] += Q
    return np.asarray(0.5 * (after + after.T))


def updated(s: Array, P: Array, e: Array, H: Array, R: Array, S: Array) -> tuple[Array, Array]:
    """State and covariance after an innovation e with slope H, noise R (diagonal) and spread S.

    Joseph's form: symmetric and positive whatever the rounding of the gain.
    """
    K = np.linalg.solve(S, H @ P).T
    rest = np.eye(len(s)) - K @ H
    after = rest @ P @ rest.T + (K * R) @ K.T
    return s + K @ e, 0.5 * (after + after.T)
