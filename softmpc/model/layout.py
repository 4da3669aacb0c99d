"""Names, units and scales: what solvers see scaled, people see in SI."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softmpc.model.scene import STRAINS, Scene

__all__ = ["Layout", "Variables"]

UNITS = {
    **dict.fromkeys(STRAINS, "1/m"),
    "epsilon": "",
    "piston_speed": "m/s",
    "P_a": "Pa",
    "P_c": "Pa",
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
        arm, drive = scene.manipulator, scene.actuation
        names, units, strain, rate, rows = [], [], [], [], []
        for s, section in enumerate(arm.sections):
            pressure = max(abs(arm.limits.pressure_max), abs(arm.limits.pressure_min))
            push = section.unit_area * pressure
            stretch = section.units * push / section.axial_stiffness
            bend = push * max(section.unit_offset, 1e-3) / section.bending_stiffness
            pace = np.sqrt(section.bending_stiffness / (section.mass * section.length**3))
            rest = section.length / scene.segments
            for i in range(scene.segments):
                for kind in scene.strains:
                    size = stretch if kind == "epsilon" else bend
                    names.append(f"{kind}_{s + 1}_{i + 1}")
                    units.append(UNITS[kind])
                    strain.append(size)
                    rate.append(size * pace)
                    stiff = (
                        section.axial_stiffness if kind == "epsilon" else section.bending_stiffness
                    )
                    rows.append(rest * stiff * size)
        q, dq = np.array(strain), np.array(rate)
        count = range(1, arm.units + 1)
        pressure = arm.limits.pressure_max
        sizes = {"piston_speed": 0.05, "P_a": pressure, "P_c": pressure}
        z = [(f"{kind}_{j}", UNITS[kind], sizes[kind]) for kind in drive.states for j in count]
        letter, unit, size = (
            ("T", "N·m", max(abs(arm.limits.torque_max), abs(arm.limits.torque_min)))
            if drive.input == "torque"
            else ("P", "Pa", pressure)
        )
        return cls(
            q=Variables(tuple(names), tuple(units), q),
            dq=_rates(names, units, dq, 1),
            ddq=_rates(names, units, dq * dq / q, 2),
            z=_column(z),
            u=_column([(f"{letter}_{j}", unit, size) for j in count]),
            p=_column([(f"P_{j}", "Pa", pressure) for j in count]),
            r=Variables(
                tuple(f"balance of {n}" for n in names), ("",) * len(names), np.array(rows)
            ),
        )


def _rates(names: list[str], units: list[str], scale: np.ndarray, order: int) -> Variables:
    per = "/s" if order == 1 else "/s²"
    titles = tuple("d" * order + "_" + name for name in names)
    return Variables(titles, tuple((unit or "1") + per for unit in units), scale)


def _column(rows: list[tuple[str, str, float]]) -> Variables:
    return Variables(
        tuple(r[0] for r in rows), tuple(r[1] for r in rows), np.array([r[2] for r in rows])
    )
