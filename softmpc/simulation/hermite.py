"""Piecewise polynomials with given derivatives at both ends of each piece."""

from __future__ import annotations

from dataclasses import dataclass
from math import factorial

import numpy as np

__all__ = ["Hermite"]

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Hermite:
    """Polynomials on I pieces of given `lengths` (I, s), of degree 2d - 1.

    `coefficients` (I×2d×n) belong to powers of the share of a piece that has passed.
    """

    lengths: Array
    coefficients: Array

    @classmethod
    def of(cls, lengths: Array, starts: list[Array], ends: list[Array]) -> Hermite:
        """From derivatives 0 … d-1 (I×n each) at the start and at the end of each piece."""
        scale = lengths[:, None, None] ** np.arange(len(starts))[:, None]
        known = [scale * np.stack(side, axis=1) for side in (starts, ends)]
        return cls(lengths, np.linalg.solve(_osculation(len(starts)), np.concatenate(known, 1)))

    def __call__(self, piece: Array, since: Array) -> tuple[Array, Array]:
        """Values and their rates (N×G×n) at times (N×G, s) since the start of the pieces (N)."""
        length = self.lengths[piece, None, None]
        share, c = since[..., None] / length, self.coefficients[piece]
        power = np.arange(c.shape[1])
        slopes = power[1:] * share ** power[:-1] / length
        return share**power @ c, slopes @ c[:, 1:]


def _osculation(count: int) -> Array:
    """Matrix (2d×2d) from coefficients to derivatives 0 … d-1 at 0 and at 1."""
    rows = np.zeros((2 * count, 2 * count))
    for j in range(count):
        rows[j, j] = factorial(j)
        for k in range(j, 2 * count):
            rows[count + j, k] = factorial(k) / factorial(k - j)
    return rows
