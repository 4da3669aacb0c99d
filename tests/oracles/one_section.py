"""One weightless section in closed form: which places its tip can have, and its limits.

Written from the energy of the arm, not from the package: units of area A at c_j from the axis
lengthen with the section, so they work A P_j on l_j = l (1 + k·c_j) (k: curvature as a vector in
the cross-section, towards the longer side), and the wall stores
U = l_0 [½ n E A_s ε² + ½ (1 + ε) K k²]. At rest K k = A Σ P_j c_j and n E A_s ε = A Σ P_j + ½ K k².
The centre line is an arc that bends away from the longer side.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class OneSection:
    """Lengths in m, moduli and pressures in Pa, angles of the units in rad."""

    length: float
    young_modulus: float
    bending_radius: float
    unit_offset: float
    unit_area: float
    wall_area: float
    unit_angles: tuple[float, ...]
    highest: float  # pressure; the lowest is none

    @property
    def arms(self) -> Array:
        """c_j (units×2)."""
        angles = np.asarray(self.unit_angles)
        return self.unit_offset * np.stack([np.cos(angles), np.sin(angles)], axis=1)

    @property
    def bending(self) -> float:
        return self.young_modulus * np.pi * self.bending_radius**4 / 4

    @property
    def axial(self) -> float:
        return len(self.unit_angles) * self.young_modulus * self.wall_area

    def shape(self, pressures: ArrayLike) -> tuple[Array, Array]:
        """Length (K) and curvature vector (K×2) at pressures (K×units)."""
        p = np.atleast_2d(np.asarray(pressures, float))
        k = self.unit_area * p @ self.arms / self.bending
        stretch = self.unit_area * p.sum(axis=1) + 0.5 * self.bending * np.sum(k**2, axis=1)
        return self.length * (1 + stretch / self.axial), k

    def tips(self, pressures: ArrayLike) -> Array:
        """Places of the tip (K×3)."""
        length, k = self.shape(pressures)
        curvature = np.linalg.norm(k, axis=1)
        half = np.maximum(curvature * length / 2, 1e-12)
        chord = length * np.sin(half) / half
        side = -k / np.maximum(curvature, 1e-12)[:, None]
        return np.column_stack([side * (chord * np.sin(half))[:, None], chord * np.cos(half)])

    def pressures_at(self, places: ArrayLike) -> Array:
        """The only pressures (K×3) of three units that could hold the tip at places (K×3)."""
        x = np.atleast_2d(np.asarray(places, float))
        across, chord = np.hypot(x[:, 0], x[:, 1]), np.linalg.norm(x, axis=1)
        half = np.maximum(np.arctan2(across, x[:, 2]), 1e-12)
        length = chord * half / np.sin(half)
        curvature = 2 * half / length
        k = -x[:, :2] / np.maximum(across, 1e-12)[:, None] * curvature[:, None]
        push = self.axial * (length / self.length - 1) - 0.5 * self.bending * curvature**2
        rows = np.vstack([np.ones(3), self.arms.T])
        right = np.column_stack([push, self.bending * k]) / self.unit_area
        return np.linalg.solve(rows, right.T).T

    def holds(self, places: ArrayLike, slack: float = 0.0) -> NDArray[np.bool_]:
        """Whether places (K×3) are in reach, by pressures allowed to be beyond by `slack` (Pa)."""
        p = self.pressures_at(places)
        return np.all((p >= -slack) & (p <= self.highest + slack), axis=1)
