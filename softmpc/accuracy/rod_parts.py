"""What the reference rod is made of: its sections, its loads, and a posture of it.

Shares no code with the model. SI; the base frame has the base at the origin and the undeformed arm
along +z.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from softmpc.errors import InputError, SoftmpcError

__all__ = ["RodError", "RodLoad", "RodSection", "RodSolution", "by_section"]

Array = NDArray[np.float64]


class RodError(SoftmpcError):
    """The rod has no equilibrium on the load path, or none that oscillates about itself."""


@dataclass(frozen=True)
class RodSection:
    """One section of the rod: uniform, straight and unstretched without load.

    Lengths in m, moduli in Pa, areas in m² (of one unit), masses in kg, angles in rad.
    `disc_radius` is that of its cross-sections as thin discs, whose rotary inertia counts in
    motion (0: none); `displaced` the mass of the fluid whose lift it has, `added` the mass of the
    fluid that moves along when it moves across itself. `coupled` says whether tension knows of
    bending, as an elastic law must that has an energy.
    """

    length: float
    young_modulus: float
    shear_modulus: float
    bending_radius: float
    unit_offset: float
    unit_area: float
    wall_area: float
    mass: float
    unit_angles: tuple[float, ...]
    disc_radius: float = 0.0
    displaced: float = 0.0
    added: float = 0.0
    coupled: bool = True

    @property
    def axial_stiffness(self) -> float:
        """`n E A_s` (N) of all units together."""
        return len(self.unit_angles) * self.young_modulus * self.wall_area

    @property
    def stiffness(self) -> Array:
        """Diagonal of K (N·m²): bending, bending, twist."""
        fourth = np.pi * self.bending_radius**4
        bending = self.young_modulus * fourth / 4
        return np.array([bending, bending, self.shear_modulus * fourth / 2])

    @property
    def heavy(self) -> float:
        """Mass (kg) that has weight."""
        return self.mass - self.displaced

    def drive(self, pressures: Array) -> tuple[float, Array]:
        """Axial force `A_d sum P` (N) and body moment (N·m) that the pressures (Pa) exert."""
        thrust = self.unit_area * pressures
        angles = np.asarray(self.unit_angles, dtype=float)
        moment_x = self.unit_offset * float(thrust @ np.sin(angles))
        moment_y = -self.unit_offset * float(thrust @ np.cos(angles))
        return float(thrust.sum()), np.array([moment_x, moment_y, 0.0])


@dataclass(frozen=True)
class RodLoad:
    """What acts on the rod: pressures by section (Pa), gravity (m/s²), dead force and moment."""

    pressures: tuple[Array, ...]
    gravity: Array
    tip_force: Array
    tip_moment: Array

    def scaled(self, factor: float) -> RodLoad:
        """All of it, times a factor."""
        return replace(self, pressures=tuple(factor * pressure for pressure in self.pressures),
                       gravity=factor * self.gravity, tip_force=factor * self.tip_force,
                       tip_moment=factor * self.tip_moment)  # fmt: skip

    def forces(self, sections: Sequence[RodSection]) -> list[Array]:
        """Rows (internal force at the end of the section, weight of the section), both in N."""
        rows = []
        force = self.tip_force
        for section in reversed(sections):
            weight = section.heavy * self.gravity
            rows.append(np.stack((force, weight)))
            force = force + weight
        return rows[::-1]


@dataclass(frozen=True)
class RodSolution:
    """An equilibrium of the rod; vectors in the base frame.

    Attributes:
        section_tips: position (m) of the end of every section, (n, 3).
        section_rotations: orientation of the end of every section, (n, 3, 3).
        base_force: internal force n(0) (N): what the arm exerts on its base.
        base_moment: internal moment m(0) (N·m), likewise.
        residual: largest component of m(L) − M (N·m).
        moment_jacobian: d m(L) / d m(0), (3, 3). Its determinant is 1 without load; at zero the
            equilibrium loses its uniqueness (buckling).
        load: what holds it there.
    """

    section_tips: Array
    section_rotations: Array
    base_force: Array
    base_moment: Array
    residual: float
    moment_jacobian: Array
    load: RodLoad

    @property
    def tip(self) -> Array:
        """Position (m) of the tip of the last section."""
        return np.asarray(self.section_tips[-1])

    @property
    def tip_rotation(self) -> Array:
        """Orientation of the tip of the last section, (3, 3)."""
        return np.asarray(self.section_rotations[-1])


def by_section(sections: Sequence[RodSection], pressures: Iterable[float]) -> tuple[Array, ...]:
    """Pressures (Pa) section by section; raises `InputError` where it is not one a unit."""
    flat = np.asarray(list(pressures), dtype=float)
    counts = [len(section.unit_angles) for section in sections]
    if flat.shape != (sum(counts),):
        raise InputError(f"got {flat.size} pressures for {sum(counts)} units: give one for each")
    return tuple(np.split(flat, np.cumsum(counts)[:-1]))
