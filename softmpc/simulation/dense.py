"""A motion between the ends of steps: Hermite polynomials of what is known there."""

from __future__ import annotations

import numpy as np

__all__ = ["cubic", "quintic"]

Array = np.ndarray


def quintic(s: Array, h: Array, left: tuple[Array, ...], right: tuple[Array, ...]) -> Array:
    """Values and rates (2×K×n) at shares s (K) of steps h (K); value, rate, acceleration given."""
    s, h = s[:, None], h[:, None]
    q0, v0, a0 = left
    q1, v1, a1 = right
    # Newton's form: what the start's Taylor polynomial misses at the end of the step.
    gap = q1 - q0 - h * v0 - h**2 / 2 * a0
    slope = h * (v1 - v0 - h * a0)
    bend = h**2 * (a1 - a0)
    c3, c4, c5 = (
        10 * gap - 4 * slope + bend / 2,
        -15 * gap + 7 * slope - bend,
        6 * gap - 3 * slope + bend / 2,
    )
    value = q0 + h * s * v0 + (h * s) ** 2 / 2 * a0 + s**3 * (c3 + s * (c4 + s * c5))
    rate = v0 + h * s * a0 + s**2 * (3 * c3 + s * (4 * c4 + s * 5 * c5)) / h
    return np.stack([value, rate])


def cubic(s: Array, h: Array, left: tuple[Array, ...], right: tuple[Array, ...]) -> Array:
    """Values and rates (2×K×n) at shares s (K) of steps h (K); value and rate given."""
    s, h = s[:, None], h[:, None]
    (q0, v0), (q1, v1) = left, right
    gap, slope = q1 - q0 - h * v0, h * (v1 - v0)
    c2, c3 = 3 * gap - slope, slope - 2 * gap
    value = q0 + h * s * v0 + s**2 * (c2 + s * c3)
    rate = v0 + s * (2 * c2 + s * 3 * c3) / h
    return np.stack([value, rate])
