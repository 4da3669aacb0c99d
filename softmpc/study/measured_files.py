"""Measured data in CSV files: poses at rest, inputs over time, and what was seen meanwhile."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from softmpc.errors import InputError, errors_in, unknown_name
from softmpc.model.scene import Scene
from softmpc.simulation.columns import name_of, read_columns, read_rows
from softmpc.simulation.inputs import InputProfile
from softmpc.study.observations import StaticPose, coordinates_of

__all__ = ["read_inputs", "read_measured", "read_poses"]

MPA = 1e6


def read_poses(
    path: Path, scene: Scene, sigma: float, about: Mapping[str, Any]
) -> list[StaticPose]:
    """A pose for each line: columns P_1, … (MPa) or T_1, … (N·m), and x_1, … (m), some empty.

    A unit without a column has zero. Raises `InputError` naming line and column.
    """
    header, lines = read_rows(path)
    names = [name_of(cell) for cell in header]
    coordinates = [name for name in names if name[:1] in "xyz"]
    letter = "T" if any(n.startswith("T_") for n in names) else "P"
    inputs = [f"{letter}_{j}" for j in range(1, scene.manipulator.units + 1)]
    _check_header(path, names, [*inputs, *coordinates_of(scene)])
    poses = []
    for line, cells in lines:
        values = _cells(path, line, names, cells)
        given = [values.get(name, 0.0) for name in inputs]
        what: dict[str, Any] = (
            {"torques": given} if letter == "T" else {"pressures": [MPA * p for p in given]}
        )
        tips = {name: values[name] for name in coordinates if name in values}
        name = f"{about['name'] or path.stem} line {line}"
        poses.append(StaticPose(tips=tips, sigma=sigma, **what, **{**about, "name": name}))
        with errors_in(f"{path}, line {line}"):
            poses[-1].check(scene)
    return poses


def _check_header(path: Path, names: list[str], allowed: Sequence[str]) -> None:
    for name in names:
        if name not in allowed:
            raise InputError(f"{path}, line 1: {unknown_name('column', name, allowed)}")
        if names.count(name) > 1:
            raise InputError(f"{path}, line 1: column {name!r} is there twice")


def _cells(path: Path, line: int, names: list[str], cells: list[str]) -> dict[str, float]:
    """The numbers of a line that are there."""
    if len(cells) != len(names):
        raise InputError(f"{path}, line {line}: {len(cells)} values, the header has {len(names)}")
    found = {}
    for name, cell in zip(names, cells, strict=True):
        if not cell.strip():
            continue
        try:
            found[name] = float(cell)
        except ValueError:
            raise InputError(
                f"{path}, line {line}, {name} = {cell.strip()!r}: must be a number, or empty"
            ) from None
    return found


def read_inputs(path: Path, scene: Scene, hold: bool) -> InputProfile:
    """Inputs from the columns T_1, … (N·m), or P_1, … (MPa); other columns are not for this."""
    letter = _input_letter(scene)
    size = MPA if letter == "P" else 1.0
    columns = read_columns(path, blanks=True)
    names = [f"{letter}_{j}" for j in range(1, scene.manipulator.units + 1)]
    if not any(name in columns for name in names):
        raise InputError(f"{path}: has no column of {', '.join(names)}")
    time = columns["t"]
    values = np.stack([columns.get(name, np.zeros(len(time))) for name in names], axis=1)
    there = ~np.any(np.isnan(values), axis=1)
    if not there.any():
        raise InputError(f"{path}: no row has all inputs")
    with errors_in(path):
        return InputProfile.from_table(time[there], size * values[there], hold)


def read_measured(path: Path, scene: Scene) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Times (s), and what was measured by name, nan where nothing was; not the inputs."""
    columns = read_columns(path, blanks=True)
    time = columns.pop("t")
    letter = _input_letter(scene)
    inputs = [f"{letter}_{j}" for j in range(1, scene.manipulator.units + 1)]
    return time, {name: column for name, column in columns.items() if name not in inputs}


def _input_letter(scene: Scene) -> str:
    return "T" if scene.actuation.input == "torque" else "P"
