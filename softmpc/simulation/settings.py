"""The table [simulate] of a scene file: how long, from where, and under which inputs.

    duration = 3.0            # s
    sample_time = 0.01        # s, of the results
    start = "rest"            # at rest under the input before t = 0, or "straight", or a file:
                              # a state of a simulation.npz, simulation.csv or plan.npz,
    start_time = 1.5          # s, the one at this time of the file, else the last
    method = "radau"          # or radau-2, gauss, gauss-2, idas, cvodes
    tip_tolerance = 1e-6      # m, error of a step at the tip (radau)
    step = 0.005              # s, instead: a step that is kept (radau, gauss)
    tolerance = 1e-8          # of the scaled states (idas, cvodes)
    steps = [{unit = 1, at = 0.0, torque = 1.5}]              # N·m, held afterwards
    ramps = [{unit = 5, from = 2.0, to = 3.0, slope = 1.5}]   # N·m/s, held afterwards
    table = "torques.csv"     # instead of steps and ramps: columns t, T_1, T_2, …
    hold = false              # keep each row of the table until the next, or go on linearly

Where the actuation takes pressures: `pressure` in MPa, slopes in MPa/s, columns P_1, P_2, … in MPa.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from softmpc.errors import InputError, SceneError, errors_in, unknown_name
from softmpc.model.model import Model
from softmpc.model.tables import Table
from softmpc.simulation.columns import read_columns
from softmpc.simulation.inputs import InputProfile, Ramp, Step
from softmpc.simulation.methods import METHODS, Method
from softmpc.simulation.state_file import SUFFIXES, read_state

__all__ = ["STARTS", "SimulationSettings", "read_method", "read_profile_table", "read_settings"]

STARTS = ("rest", "straight")
MPA = 1e6


@dataclass(frozen=True)
class SimulationSettings:
    """What `simulate` needs beside the model; times in s."""

    profile: InputProfile
    duration: float
    sample_time: float = 0.01
    start: str | np.ndarray = "rest"
    method: str = "radau"
    tip_tolerance: float | None = None
    tolerance: float | None = None
    step: float | None = None


def read_settings(document: dict[str, Any], model: Model, folder: Path) -> SimulationSettings:
    """Settings of a parsed scene file; a table of inputs is looked for in `folder`.

    Raises `SceneError` or `InputError` naming the key, what was given and what is allowed.
    """
    if "simulate" not in document:
        raise SceneError(
            "has no table [simulate]: it says how long to simulate, and under which inputs"
        )
    table = Table(document["simulate"], "[simulate]")
    duration = table.number("duration", unit="s", low=0.0, low_open=True, high=1e6)
    settings = SimulationSettings(
        profile=_read_profile(table, model, folder),
        duration=duration,
        sample_time=table.number("sample_time", 0.01, unit="s", low=1e-6, high=duration),
        start=_read_start(table, model, folder),
        **read_method(table),
    )
    table.finish()
    return settings


def _read_start(table: Table, model: Model, folder: Path) -> str | np.ndarray:
    """What `simulate` takes as its start: a word, or the state that a file has."""
    start = table.string("start", "rest")
    if start in STARTS:
        return start
    if Path(start).suffix not in SUFFIXES:
        known = *STARTS, *(f"a file {suffix}" for suffix in SUFFIXES)
        raise SceneError(f"{table.where} {unknown_name('start', start, known)}")
    at = table.number("start_time", unit="s", low=0.0, high=1e6) if "start_time" in table else None
    with errors_in("[simulate] start"):
        return read_state(folder / start, model, at)[0]


def read_method(table: Table) -> dict[str, Any]:
    """The method and its numbers, checked against each other."""
    ranges: dict[str, dict[str, Any]] = {
        "tip_tolerance": {"unit": "m", "low": 1e-12, "high": 0.1},
        "tolerance": {"low": 1e-12, "high": 1e-2},
        "step": {"unit": "s", "low": 1e-6, "high": 1.0},
    }
    given: dict[str, Any] = {
        key: table.number(key, **allowed) for key, allowed in ranges.items() if key in table
    }
    name = table.string("method", "radau", METHODS)
    with errors_in(table.where):
        Method(name, **given)
    return {"method": name, **given}


def _read_profile(table: Table, model: Model, folder: Path) -> InputProfile:
    hold = table.boolean("hold", False)
    moves = [_read_step(row, model) for row in _rows(table, "steps")]
    moves += [_read_ramp(row, model) for row in _rows(table, "ramps")]
    if "table" not in table:
        profile = InputProfile.of(model.scene.manipulator.units, moves)
    elif moves:
        raise SceneError("[simulate] table: leave out steps and ramps, or put them in the table")
    else:
        profile = read_profile_table(folder / table.string("table"), model, hold)
    with errors_in("[simulate]"):
        profile.check(model)
    return profile


def _rows(table: Table, key: str) -> list[Table]:
    value = table.raw(key, [])
    if not isinstance(value, list):
        raise table.error(key, value, "a list of tables, [{unit = 1, …}, …]")
    return [Table(row, f"[simulate] {key}[{i}]") for i, row in enumerate(value)]


def _read_step(row: Table, model: Model) -> Step | Ramp:
    unit = _read_unit(row, model)
    at = row.number("at", unit="s")
    kind, other = ("torque", "pressure")
    if model.scene.actuation.input == "pressure":
        kind, other = other, kind
    if other in row:
        raise SceneError(
            f"{row.where} {other}: the actuation {model.scene.actuation.name!r} takes "
            f"{kind}s, write {kind} = … in {_unit(model)}"
        )
    to = row.number(kind, unit=_unit(model)) * _size(model)
    row.finish()
    return Step(unit, at, to)


def _read_ramp(row: Table, model: Model) -> Step | Ramp:
    unit = _read_unit(row, model)
    start = row.number("from", unit="s")
    end = row.number("to", unit="s", low=start, low_open=True)
    slope = row.number("slope", unit=f"{_unit(model)}/s") * _size(model)
    row.finish()
    return Ramp(unit, start, end, slope)


def _read_unit(row: Table, model: Model) -> int:
    return row.integer("unit", low=1, high=model.scene.manipulator.units)


def _unit(model: Model) -> str:
    return "N·m" if model.scene.actuation.input == "torque" else "MPa"


def _size(model: Model) -> float:
    return 1.0 if model.scene.actuation.input == "torque" else MPA


def read_profile_table(path: Path, model: Model, hold: bool = False) -> InputProfile:
    """Profile of a CSV file with columns t and T_1, T_2, … (N·m) or P_1, P_2, … (MPa).

    A unit without a column gets zero. Raises `InputError` as `read_columns` does, and for columns
    that the arm does not have.
    """
    columns = read_columns(path)
    letter = "T" if model.scene.actuation.input == "torque" else "P"
    names = [f"{letter}_{j + 1}" for j in range(model.scene.manipulator.units)]
    for name in columns:
        if name not in ["t", *names]:
            raise InputError(f"{path}: {unknown_name('column', name, ['t', *names])}")
    times = columns["t"]
    values = [columns.get(name, np.zeros(len(times))) * _size(model) for name in names]
    return InputProfile.from_table(times, np.stack(values, axis=1), hold)
