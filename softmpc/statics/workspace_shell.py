"""The geometry of a shell: inner and outer radius over direction, between nodes and as a whole.

Directions are in half-planes through an axis, at even azimuths; in each the polar angle goes from
one rim to the other, at the nodes of Clenshaw-Curtis quadrature: ends included, and every second
node is a rule of its own, which gives the error estimate. Between nodes all is linear.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

__all__ = ["Shell", "clenshaw_curtis"]


def clenshaw_curtis(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes from 0 to 1 and weights, `count` of them, odd: exact for polynomials below `count`."""
    n = count - 1
    angle = np.pi * np.arange(count) / n
    weights = np.ones(count)
    for k in range(1, n // 2 + 1):
        part = 1.0 if 2 * k == n else 2.0
        weights -= part * np.cos(2 * k * angle) / (4 * k * k - 1)
    weights *= 2 / n
    weights[[0, -1]] /= 2
    return (1 - np.cos(angle)) / 2, weights / 2


@dataclass(frozen=True, eq=False)
class Shell:
    """Radii (m) in A half-planes at M nodes; NaN where nothing is in reach."""

    frame: np.ndarray  # (3×3): the axis is its last column, azimuths begin at its first
    azimuths: np.ndarray  # (A), rad
    rims: np.ndarray  # smallest and largest polar angle (A×2), rad
    nodes: np.ndarray  # (M), 0 at the first rim and 1 at the second
    outer: np.ndarray  # (A×M)
    inner: np.ndarray  # (A×M)
    flat: bool  # two opposite half-planes, and nothing between them

    @property
    def known(self) -> np.ndarray:
        """Numbers of the half-planes that have both rims and places between them."""
        rims = np.isfinite(self.rims).all(axis=1)
        return np.flatnonzero(np.isfinite(self.outer).any(axis=1) & rims)

    @property
    def polars(self) -> np.ndarray:
        """Polar angles of the nodes (A×M), rad."""
        low, high = self.rims.T
        return np.asarray(low[:, None] + (high - low)[:, None] * self.nodes)

    def directions(self) -> np.ndarray:
        """Unit vectors of the nodes (A×M×3)."""
        return self._turned(self.azimuths[:, None], self.polars)

    @property
    def volume(self) -> tuple[float, float]:
        """Volume between the surfaces (m³) and its error estimate, by half the nodes."""
        if self.flat:
            return 0.0, 0.0
        fine = self._integral(self.outer**3 - self.inner**3, 3)
        coarse = self._coarse()._integral(self._coarse().outer ** 3 - self._coarse().inner ** 3, 3)
        return fine, abs(fine - coarse)

    @property
    def area(self) -> float | None:
        """Area between the curves of a flat set (m²)."""
        if not self.flat:
            return None
        _, weights = clenshaw_curtis(len(self.nodes))
        span = np.nan_to_num(self.rims[:, 1] - self.rims[:, 0])
        parts = np.nan_to_num(self.outer**2 - self.inner**2) @ weights
        return float(np.sum(span * parts) / 2)

    def _integral(self, powers: np.ndarray, power: int) -> float:
        _, weights = clenshaw_curtis(len(self.nodes))
        span = np.nan_to_num(self.rims[:, 1] - self.rims[:, 0])
        parts = np.nan_to_num(powers * np.sin(self.polars)) @ weights
        gaps = np.diff(np.append(self.azimuths, self.azimuths[0] + 2 * np.pi))
        shares = (gaps + np.roll(gaps, 1)) / 2  # trapezoids; all the same mostly
        return float(np.sum(shares * span * parts) / power)

    def _coarse(self) -> Shell:
        some = np.s_[::2, ::2]
        return Shell(
            self.frame, self.azimuths[::2], self.rims[::2], self.nodes[::2],
            self.outer[some], self.inner[some], self.flat,
        )  # fmt: skip

    def _turned(self, azimuths: np.ndarray, polars: np.ndarray) -> np.ndarray:
        out = np.sin(polars)
        own = np.stack(
            np.broadcast_arrays(out * np.cos(azimuths), out * np.sin(azimuths), np.cos(polars)), -1
        )
        return np.asarray(own @ self.frame.T)

    # --- between the nodes ---------------------------------------------------------------------

    def outside(self, points: np.ndarray) -> np.ndarray:
        """Distance (K) of points (K×3) from the shell, about, m; 0 for points in it.

        Measured to the place at the same azimuth whose polar angle and radius come nearest.
        """
        own = np.asarray(points, float).reshape(-1, 3) @ self.frame
        beside = own[:, 1].copy() if self.flat else np.zeros(len(own))
        own[:, 1] -= beside
        azimuth = np.arctan2(own[:, 1], own[:, 0])
        radius = np.linalg.norm(own, axis=1)
        polar = np.arctan2(np.hypot(own[:, 0], own[:, 1]), own[:, 2])
        low, high, outer, inner = self._at(azimuth, polar)
        closest = self._turned(azimuth, np.clip(polar, low, high))
        way = np.einsum("ki,ki->k", closest @ self.frame, own)
        there = np.clip(way, np.minimum(inner, outer), outer)[:, None] * (closest @ self.frame)
        distance = np.hypot(np.linalg.norm(own - there, axis=1), beside)
        return np.asarray(np.where(distance < 1e-12 * radius, 0.0, distance))

    def between(self, azimuths: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Rims (K×2), outer and inner radii at the nodes (K×M) at any azimuths (K)."""
        rims, outer, inner, known = self._filled
        before, share = _bracket(known, np.asarray(azimuths, float), self.flat)
        after, t = (before + 1) % len(known), share[:, None]
        found = [(1 - t) * a[before] + t * a[after] for a in (rims, outer, inner)]
        return found[0], found[1], found[2]

    def places(self, azimuths: np.ndarray, rims: np.ndarray, radii: np.ndarray) -> np.ndarray:
        """Places (K×M×3) at these azimuths (K), rims (K×2) and radii (K×M)."""
        polars = rims[:, :1] + (rims[:, 1:] - rims[:, :1]) * self.nodes
        return np.asarray(self._turned(np.asarray(azimuths)[:, None], polars) * radii[..., None])

    def _at(self, azimuth: np.ndarray, polar: np.ndarray) -> tuple[np.ndarray, ...]:
        """Rims and radii (K each) at these angles, the nearest where these are not in reach."""
        rims, outer, inner, azimuths = self._filled
        before, share = _bracket(azimuths, azimuth, self.flat)
        after = (before + 1) % len(azimuths)
        low, high = ((1 - share) * rims[before, e] + share * rims[after, e] for e in (0, 1))
        width = np.maximum(high - low, 1e-12)
        u = np.clip((polar - low) / width, 0.0, 1.0)
        j = np.clip(np.searchsorted(self.nodes, u, side="right") - 1, 0, len(self.nodes) - 2)
        t = (u - self.nodes[j]) / (self.nodes[j + 1] - self.nodes[j])

        def value(radii: np.ndarray) -> np.ndarray:
            ends = [(1 - t) * radii[i, j] + t * radii[i, j + 1] for i in (before, after)]
            return np.asarray((1 - share) * ends[0] + share * ends[1])

        return low, high, value(outer), value(inner)

    @cached_property
    def _filled(self) -> tuple[np.ndarray, ...]:
        """Rims and radii without gaps, of those half-planes that have any."""
        full, radii = self.known, []
        for surface in (self.outer, self.inner):
            rows = [
                np.interp(self.nodes, self.nodes[good], row[good])
                for row in surface[full]
                for good in [np.isfinite(row)]
            ]
            radii.append(np.array(rows))
        return self.rims[full], *radii, self.azimuths[full]


def _bracket(azimuths: np.ndarray, wanted: np.ndarray, flat: bool) -> tuple[np.ndarray, np.ndarray]:
    """The half-plane before each azimuth, and the share of the way to the one after it."""
    turn = 2 * np.pi
    count = len(azimuths)
    if flat or count == 1:  # the nearest half-plane, and none between
        away = np.abs(np.angle(np.exp(1j * (wanted[:, None] - azimuths[None, :]))))
        return np.argmin(away, axis=1), np.zeros(len(wanted))
    on = np.mod(wanted - azimuths[0], turn)
    starts = azimuths - azimuths[0]
    before = np.clip(np.searchsorted(starts, on, side="right") - 1, 0, count - 1)
    gap = np.diff(np.append(starts, turn))[before]
    return before, (on - starts[before]) / gap
