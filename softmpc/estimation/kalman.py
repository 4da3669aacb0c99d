"""The two halves of an extended Kalman filter on an augmented state, and what an update reports."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg.lapack import dposv
from scipy.special import chdtri  # scipy.stats takes a second to import

__all__ = ["Expected", "Innovation", "expected", "gate", "predicted", "updated"]

Array = np.ndarray


@dataclass(frozen=True, slots=True)
class Innovation:
    """A reading less what was expected (SI), its standard deviation, and the normalised square."""

    sensor: int
    stamp: int  # ticks
    value: Array
    spread: Array
    nis: float
    accepted: bool


@dataclass(frozen=True, slots=True)
class Expected:
    """An innovation e beside its covariance S, and what an update needs of both."""

    e: Array
    H: Array
    HP: Array
    S: Array
    gain: Array  # n×m
    R: Array

    def nis(self, rows: slice) -> float:
        """Normalised square of some of its values, whatever the others are."""
        e = self.e[rows]
        return float(e @ dposv(self.S[rows, rows], e)[1])


def gate(size: int, miss: float) -> float:
    """The square that one in 1/miss good innovations of `size` numbers exceeds (χ²)."""
    return float(chdtri(size, miss))


def predicted(P: Array, A: Array, Q: Array, bent: float = 0.0) -> Array:
    """Covariance after a step with slope A and the diagonal Q.

    `bent` is the variance that linearising leaves of each change, as a share: the model is not
    straight over what P spans.
    """
    AP = A @ P
    after = AP @ A.T
    after += after.T
    after *= 0.5
    diagonal = after.reshape(-1)[:: len(after) + 1]
    if bent:
        change = diagonal - 2.0 * AP.diagonal() + P.diagonal()
        diagonal += bent * np.maximum(change, 0.0)
    diagonal += Q
    return np.asarray(after)


def expected(P: Array, e: Array, H: Array, R: Array) -> Expected:
    """What an innovation e with slope H and noise R (diagonal) means before covariance P.

    Raises `LinAlgError` where its covariance is not positive definite.
    """
    HP = H @ P
    S = HP @ H.T
    S.reshape(-1)[:: len(S) + 1] += R
    _, gain, wrong = dposv(S, HP)
    if wrong:
        raise np.linalg.LinAlgError("the covariance of an innovation is not positive definite")
    return Expected(e, H, HP, S, gain.T, R)


def updated(s: Array, P: Array, of: Expected) -> tuple[Array, Array]:
    """State and covariance after an innovation.

    Joseph's form, (I - K H) P (I - K H)ᵀ + K R Kᵀ, one factor after the other: symmetric and
    positive whatever the rounding of the gain K, and as cheap as the plain one.
    """
    K = of.gain
    once = K @ of.HP
    np.subtract(P, once, out=once)
    other = once @ of.H.T
    other -= K * of.R
    after = other @ K.T
    np.subtract(once, after, out=after)
    after += after.T
    after *= 0.5
    return s + K @ of.e, after
