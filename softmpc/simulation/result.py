"""What a simulation returns: a motion whose numbers have names, and its files."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from softmpc.errors import InputError, unknown_name
from softmpc.model.layout import Variables
from softmpc.model.model import Model
from softmpc.simulation.columns import name_of, write_columns
from softmpc.simulation.inputs import InputProfile
from softmpc.simulation.result_files import read_csv, read_npz, write_npz
from softmpc.simulation.settling import overshoot, settling_time
from softmpc.simulation.validity import MotionWarning

__all__ = ["Simulation", "titles_of"]

STATES = ("q", "dq", "z", "u", "p")


@dataclass(frozen=True, eq=False)
class Simulation:
    """A motion at K times, SI. `status` is "finished", "interrupted" or "stopped: …".

    What was reached is kept whatever the status. `titles` are the column names of q, dq, z, u, p,
    with units. `motion["kappa_y_1_1"]` is one column; `units` has the names and units of all.
    """

    title: str
    status: str
    wall_s: float  # time the integration took
    time: np.ndarray  # s (K)
    q: np.ndarray  # strains (K×n)
    dq: np.ndarray  # their rates (K×n)
    z: np.ndarray  # drive states (K×h)
    u: np.ndarray  # inputs (K×k), N·m or Pa; at a jump the new value
    p: np.ndarray  # unit pressures, Pa (K×m)
    tips: np.ndarray  # section tips, base first, m (K×S×3)
    tip_speeds: np.ndarray  # m/s (K×S)
    energies: dict[str, np.ndarray] = field(default_factory=dict)  # J (K), by name
    titles: dict[str, tuple[str, ...]] = field(default_factory=dict)
    profile: InputProfile | None = None  # the inputs over time, None where only `u` is known
    warnings: tuple[MotionWarning, ...] = ()  # where the motion left the model's range
    setup_s: float = float("nan")  # time it took to make the functions and find the start

    @property
    def finished(self) -> bool:
        return self.status == "finished"

    @property
    def x(self) -> np.ndarray:
        """States (q, dq, z) (K×nx)."""
        return np.hstack([self.q, self.dq, self.z])

    @property
    def units(self) -> dict[str, str]:
        """Unit of each column by name: `{"t": "s", "x_1": "m", "kappa_y_1_1": "1/m", …}`."""
        return {
            name_of(title): title[len(name_of(title)) :].strip(" []") for title in self.columns()
        }

    def __getitem__(self, name: str) -> np.ndarray:
        """The column (K) of that name; raises `InputError` with the nearest one."""
        columns = {name_of(title): column for title, column in self.columns().items()}
        if name not in columns:
            raise InputError(unknown_name("column", name, columns))
        return columns[name]

    @property
    def duration_s(self) -> float:
        """Time reached."""
        return float(self.time[-1])

    @property
    def realtime_factor(self) -> float:
        """Simulated time over the time it took."""
        return self.duration_s / self.wall_s if self.wall_s > 0 else float("inf")

    @property
    def final_tips(self) -> np.ndarray:
        """Section tips at the end (S×3), m."""
        return np.asarray(self.tips[-1])

    def summary(self) -> dict[str, Any]:
        """What a program wants to know, ready for JSON."""
        summary: dict[str, Any] = {
            "status": self.status,
            "duration_s": self.duration_s,
            "setup_s": self.setup_s,
            "wall_s": self.wall_s,
            "realtime_factor": self.realtime_factor,
            "final_tips_m": self.final_tips.tolist(),
        }
        if len(self.tips):
            summary |= {"settling_s": settling_time(self), "overshoot": overshoot(self)}
        if self.warnings:
            summary["warnings"] = [vars(warning) for warning in self.warnings]
        if self.energies:
            summary["final_energy_j"] = {k: float(v[-1]) for k, v in self.energies.items()}
        return summary

    def columns(self) -> dict[str, np.ndarray]:
        """Every number of the motion as a column, titles with units."""
        columns = {"t [s]": self.time}
        for i in range(self.tips.shape[1]):
            for axis, letter in enumerate("xyz"):
                columns[f"{letter}_{i + 1} [m]"] = self.tips[:, i, axis]
        for i, speeds in enumerate(self.tip_speeds.T, 1):
            columns[f"tip_speed_{i} [m/s]"] = speeds
        for name in STATES:
            columns |= dict(zip(self.titles[name], getattr(self, name).T, strict=True))
        return columns | {f"{name}_energy [J]": e for name, e in self.energies.items()}

    def save(self, directory: str | os.PathLike[str]) -> tuple[Path, Path]:
        """Write simulation.csv and simulation.npz there; a crash leaves the last good ones."""
        folder = Path(directory)
        write_columns(folder / "simulation.csv", self.columns())
        write_npz(folder / "simulation.npz", vars(self))
        return folder / "simulation.csv", folder / "simulation.npz"

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Simulation:
        """Read a simulation.npz, or a simulation.csv, which knows less.

        A CSV file has every number of the motion, but no title, no status ("unknown"), no time
        the integration took (nan) and no `profile`. Raises `InputError` for a file that is none.
        """
        return cls(**(read_csv if Path(path).suffix == ".csv" else read_npz)(Path(path)))


def titles_of(model: Model) -> dict[str, tuple[str, ...]]:
    """Column names with units of q, dq, z, u, p."""
    return {name: _titled(getattr(model.layout, name)) for name in STATES}


def _titled(variables: Variables) -> tuple[str, ...]:
    pairs = zip(variables.names, variables.units, strict=True)
    return tuple(f"{name} [{unit}]" if unit else name for name, unit in pairs)
