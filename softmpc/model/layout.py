"""Names, units and scales: what solvers see scaled, people see in SI."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np

from softmpc.model.scene import STRAINS, Scene

__all__ = ["Layout", "Variables"]

ATMOSPHERE = 1e5  # Pa, the size of pressures where the limits leave none
UNITS = {
    **dict.fromkeys(STRAINS, "1/m"),
    "epsilon": "",
    "piston_speed": "m/s",
    "P_a": "Pa",
    "P_c": "Pa",
    "P_slow": "Pa",
    "Q": "m³/s",
}


@dataclass(frozen=True)
class Variables:
    """Some variables of a model: names, SI units, and the size each typically has."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    scale: np.ndarray

    def __add__(self, other: Variables) -> Variables:
        scale = np.concatenate([self.scale, other.scale])
        return Variables(self.names + other.names, self.units + other.units, scale)

    def __len__(self) -> int:
        return len(self.names)


@dataclass(frozen=True)
class Layout:
    """Variables of a model: strains, rates, accelerations, drive states, inputs, equations."""

    q: Variables
    dq: Variables
    ddq: Variables
    z: Variables
    u: Variables
    p: Variables
    r: Variables  # rows of the residual

    @property
    def x(self) -> Variables:
        """State of the whole system, (q, dq, z)."""
        return self.q + self.dq + self.z

    @classmethod
    def of(cls, scene: Scene) -> Layout:
        """Scales from the arm: full pressure sets the strains, stiffness and mass the rates."""
        names, units, strain, pace, row = (list(c) for c in zip(*_strains(scene), strict=True))
        q = np.array(strain)
        arm, drive = scene.manipulator, scene.actuation
        count, pressure = range(1, arm.units + 1), _full_pressure(scene)
        sizes = {"piston_speed": 0.05, "P_a": pressure, "P_c": pressure, "P_slow": pressure}
        sizes["Q"] = sizes["piston_speed"] * arm.hydraulics.piston_area
        kinds = drive.unit_states(scene.effects)
        torque = max(abs(arm.limits.torque_max), abs(arm.limits.torque_min)) or 1.0
        p = _column([(f"P_{j}", "Pa", pressure) for j in count])
        return cls(
            q=Variables(tuple(names), tuple(units), q),
            dq=_rates(names, units, q * pace, 1),
            ddq=_rates(names, units, q * np.square(pace), 2),
            z=_column([(f"{kind}_{j}", UNITS[kind], sizes[kind]) for kind in kinds for j in count]),
            u=_column([(f"T_{j}", "N·m", torque) for j in count]) if drive.input == "torque" else p,
            p=p,
            r=Variables(tuple(f"balance of {n}" for n in names), ("",) * len(names), np.array(row)),
        )


def _full_pressure(scene: Scene) -> float:
    limits = scene.manipulator.limits
    return max(abs(limits.pressure_max), abs(limits.pressure_min)) or ATMOSPHERE


def _strains(scene: Scene) -> Iterator[tuple[str, str, float, float, float]]:
    """Name, unit, size, pace (1/s) and size of its equation, of each strain that is a state."""
    for s, section in enumerate(scene.manipulator.sections):
        push = section.unit_area * _full_pressure(scene)
        stretch = section.units * push / section.axial_stiffness
        bend = push * max(section.unit_offset, 1e-3) / section.bending_stiffness
        pace = float(np.sqrt(section.bending_stiffness / (section.mass * section.length**3)))
        rest = section.length / scene.segments
        sizes = dict.fromkeys(STRAINS, (bend, rest * section.bending_stiffness * bend))
        sizes["epsilon"] = (stretch, rest * section.axial_stiffness * stretch)
        for i, kind in product(range(scene.segments), scene.strains):
            size, row = sizes[kind]
            yield f"{kind}_{s + 1}_{i + 1}", UNITS[kind], size, pace, row


def _rates(names: list[str], units: list[str], scale: np.ndarray, order: int) -> Variables:
    per = "/s" if order == 1 else "/s²"
    titles = tuple("d" * order + "_" + name for name in names)
    return Variables(titles, tuple((unit or "1") + per for unit in units), scale)


def _column(rows: list[tuple[str, str, float]]) -> Variables:
    return Variables(
        tuple(r[0] for r in rows), tuple(r[1] for r in rows), np.array([r[2] for r in rows])
    )
