"""How well the data determine the parameters: standard errors, and what cannot be told apart.

All of it is linear, at the estimate: J (N×P) are the derivatives of the residuals, in standard
deviations, by x.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc, ndtri, stdtrit

__all__ = [
    "RESOLVED",
    "Direction",
    "Uncertainty",
    "goodness",
    "quantile",
    "uncertainty",
    "undetermined",
]

LEVEL = 0.95
RESOLVED = 3e-6  # of the largest singular value: below, differences see only their own errors
SHARE = 1e-3  # of a direction, below which a parameter takes no part in it


@dataclass(frozen=True)
class Uncertainty:
    """Standard deviations of x (P): inf where nothing determines it, nan at a bound."""

    deviations: np.ndarray
    correlation: np.ndarray  # P×P, nan where one of the two has no deviation
    used: float  # how many parameters the data pay for, Σ (1 - share of the priors)


@dataclass(frozen=True)
class Direction:
    """A change of the parameters that the data cannot see.

    `x` (P) is scaled so that the largest of its changes, in sizes that matter, is 1; `effect` is by
    how many standard deviations the residuals then change.
    """

    x: np.ndarray
    effect: float


def uncertainty(J: np.ndarray, prior: np.ndarray, free: np.ndarray, scale: float) -> Uncertainty:
    """Standard errors from the active rows of J, with priors' deviations (P; inf: none).

    `free` (P) are the parameters that are not at a bound; the others stay there. `scale` is how
    many times as large as stated the sigmas are.
    """
    count = len(prior)
    kept = np.flatnonzero(free)
    rows = np.vstack([J[:, kept] / scale, np.diag(1 / prior[kept])])
    covariance = np.full((count, count), np.nan)
    used = 0.0
    if len(kept):
        _, s, v = np.linalg.svd(rows, full_matrices=False)
        seen = s > RESOLVED * max(s.max(), 1e-300)
        part = (v[seen].T / s[seen] ** 2) @ v[seen]
        blind = np.any(np.abs(v[~seen]) > SHARE, axis=0)
        used = float(np.trace(part @ (rows[: len(J)].T @ rows[: len(J)])))
        part[blind, :] = part[:, blind] = np.nan
        part[blind, blind] = np.inf
        covariance[np.ix_(kept, kept)] = part
    deviations = np.sqrt(np.diag(covariance))
    with np.errstate(invalid="ignore"):
        correlation = covariance / np.outer(deviations, deviations)
    return Uncertainty(deviations, correlation, used)


def undetermined(J: np.ndarray, size: np.ndarray) -> tuple[list[Direction], np.ndarray]:
    """Directions that the data alone cannot see, and which parameters they determine (P).

    `size` (P) are changes of x that matter: the prior's standard deviation, or all of the parameter
    where there is none. A direction is not seen where the data do not know it to within these.
    """
    effects = np.linalg.norm(J * size, axis=0)
    alone = effects < np.maximum(1.0, RESOLVED * effects.max(initial=0.0))
    directions = [
        Direction(size * (np.arange(len(size)) == k), float(effects[k]))
        for k in np.flatnonzero(alone)
    ]
    determined = np.zeros(len(size), bool)
    if not alone.all():
        others, determined[~alone] = _together(J[:, ~alone], size[~alone])
        for direction in others:
            x = np.zeros(len(size))
            x[~alone] = direction.x
            directions.append(Direction(x, direction.effect))
    return directions, determined


def _together(J: np.ndarray, size: np.ndarray) -> tuple[list[Direction], np.ndarray]:
    """The same for parameters each of which the data see when it alone changes."""
    padded = np.vstack([J * size, np.zeros((len(size), len(size)))])
    _, s, v = np.linalg.svd(padded, full_matrices=False)
    s = np.where(s > RESOLVED * max(s.max(), 1e-300), s, 0.0)
    directions = []
    for row in _plain(v[s < 1]):
        unit = np.where(np.abs(row) > SHARE, row, 0.0)
        directions.append(Direction(unit * size, float(np.linalg.norm(J @ (row * size)))))
    with np.errstate(divide="ignore", invalid="ignore"):
        shares = np.where(np.abs(v) > SHARE, v**2, 0.0) / (s**2)[:, None]
    shares = np.where(np.isnan(shares), 0.0, shares)
    return directions, np.asarray(shares.sum(axis=0) < 1)


def _plain(rows: np.ndarray) -> np.ndarray:
    """The same space from rows with as few entries as elimination gives, the largest being 1."""
    rows = rows.copy()
    for i in range(len(rows)):
        k = int(np.argmax(np.abs(rows[i])))
        rows[i] /= rows[i, k]
        for j in range(len(rows)):
            if j != i:
                rows[j] -= rows[j, k] * rows[i]
    return np.array([row / row[np.argmax(np.abs(row))] for row in rows]).reshape(rows.shape)


def quantile(freedom: float | None) -> float:
    """Half the 95 % interval in standard errors: Student's t where sigma was estimated."""
    if freedom is None:
        return float(ndtri((1 + LEVEL) / 2))
    return float(stdtrit(freedom, (1 + LEVEL) / 2)) if freedom > 0 else float("inf")


def goodness(chi2: float, freedom: float) -> float:
    """Probability of residuals at least as large if the stated sigmas are right; nan for none."""
    return float(chdtrc(freedom, chi2)) if freedom >= 0.5 else float("nan")
