"""`softmpc track`: from the [track] table of a scene file to a closed-loop run."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from softmpc.control.closed_loop import close_loop, start_at
from softmpc.control.costs import Cost, StrainRate, TipPosition, Torque, TorqueRate
from softmpc.control.ipopt import Ipopt
from softmpc.control.mpc import Mpc
from softmpc.control.ocp import tracking_problem
from softmpc.control.paths import (
    Circle,
    FigureEight,
    Helix,
    Line,
    Reference,
    TimeLaw,
    TipPath,
    read_waypoints,
)
from softmpc.control.track_result import TrackResult
from softmpc.control.transcription import Transcription
from softmpc.errors import SceneError, errors_in
from softmpc.interrupts import InterruptLater
from softmpc.model.model import build
from softmpc.model.scene import Scene
from softmpc.model.scene_file import read_document, scene_from_dict
from softmpc.model.tables import Table
from softmpc.simulation.idas import Idas
from softmpc.statics.clearance import Clearance, find_clearance
from softmpc.statics.inverse import InverseStatics
from softmpc.statics.targets import Position

__all__ = ["Tracking", "read_tracking", "track", "track_file"]

PATHS = ("circle", "figure-eight", "helix", "line", "waypoints")
DOWN = (0.0, 0.0, 1.0)
CLEARANCE_POINTS = 12  # places along a lap

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Tracking:
    """A tracking task: the path, the controller's and the plant's settings."""

    reference: Reference
    settle: float
    step: float
    horizon: int
    stages: int
    hessian: Literal["gauss-newton", "exact"]
    tolerance: float
    max_iterations: int
    costs: tuple[Cost, ...]
    plant_tolerance: float


def track_file(path: str | os.PathLike[str], progress: Progress | None = None) -> TrackResult:
    """Run the scene file's tracking task: its path, by NMPC, on its plant."""
    document = read_document(path)
    with errors_in(path):
        scene = scene_from_dict(document)
        if "track" not in document:
            raise SceneError("[track] is missing: it says which path the tip shall follow")
        task = read_tracking(document["track"], Path(path).parent)
    result = track(scene, task, progress)
    return replace(result, title=document.get("title", Path(path).stem))


def track(scene: Scene, task: Tracking, progress: Progress | None = None) -> TrackResult:
    """Follow the reference from rest at its start; the plant is the same scene, integrated tightly.

    Raises `SceneError` where the path leaves the workspace, before any control is computed.
    """
    with InterruptLater() as interrupt:
        model = build(scene)
        ocp = tracking_problem(model, task.horizon, task.step, task.costs)
        plant = Idas(model, task.plant_tolerance)
        inverse = InverseStatics(model)
        clearance = _clearance(inverse, task.reference)
        begin = inverse.solve(Position(tuple(task.reference.position([0.0])[0])))
        if not (begin.solved and begin.stable):
            raise SceneError("[track]: no stable posture holds the tip at the start of the path")
        transcription = Transcription(ocp, task.stages)
        solver = Ipopt(transcription, task.hessian, task.tolerance, task.max_iterations)
        mpc, start = Mpc(transcription, solver), start_at(model, begin.posture)
    if interrupt.asked:
        raise KeyboardInterrupt
    result = close_loop(mpc, plant, task.reference, start, settle=task.settle, progress=progress)
    return replace(result, clearance_m=clearance.distance)


def _clearance(inverse: InverseStatics, reference: Reference) -> Clearance:
    lap = reference.path.position(np.arange(CLEARANCE_POINTS) / CLEARANCE_POINTS)
    clearance = find_clearance(inverse, lap)
    if clearance is None:
        misses = [found.distance for found in inverse.solve_path([Position(tuple(x)) for x in lap])]
        worst = int(np.argmax(misses))
        place = ", ".join(f"{x:.3f}" for x in lap[worst])
        raise SceneError(
            f"[track]: the path is out of reach, at ({place}) m by {1e3 * misses[worst]:.1f} mm: "
            "move its center towards the arm's tip at half pressure, or make it smaller"
        )
    return clearance


def read_tracking(data: object, folder: Path) -> Tracking:
    """The [track] table; files it names are looked for in `folder`."""
    table = Table(data, "[track]")
    path = _read_path(table, folder)
    law = TimeLaw(
        table.number("lap_time", 4.0, unit="s", low=0.05, high=3600.0),
        table.number("laps", 2.0, low=0.01, high=1e4),
        table.number("smooth_start", 1.0, unit="s", low=0.0, high=60.0),
    )
    settle = table.number("settle", 1.0, unit="s", low=0.0, high=3600.0)
    if settle >= law.duration:
        raise SceneError(
            f"[track] settle = {settle:g} s: must be below the duration of the run, "
            f"{law.duration:g} s, or no error is left to count"
        )
    controller, plant = table.table("controller"), table.table("plant")
    table.finish()
    task = _read_controller(controller, Reference(path, law), settle, plant)
    controller.finish()
    plant.finish()
    return task


def _read_controller(table: Table, reference: Reference, settle: float, plant: Table) -> Tracking:
    hessian = table.string("hessian", "gauss-newton", ("gauss-newton", "exact"))
    return Tracking(
        reference=reference,
        settle=settle,
        step=table.number("step", 0.025, unit="s", low=1e-3, high=1.0),
        horizon=table.integer("horizon", 20, low=1, high=500),
        stages=table.integer("stages", 2, low=1, high=5),
        hessian="exact" if hessian == "exact" else "gauss-newton",
        tolerance=table.number("tolerance", 1e-6, low=1e-10, high=1e-2),
        max_iterations=table.integer("max_iterations", 50, low=1, high=10_000),
        costs=(
            TipPosition(_deviation(table, "tip_deviation", TipPosition.deviation, "m")),
            Torque(_deviation(table, "torque_deviation", Torque.deviation)),
            TorqueRate(_deviation(table, "torque_rate_deviation", TorqueRate.deviation)),
            StrainRate(_deviation(table, "strain_rate_deviation", StrainRate.deviation)),
        ),
        plant_tolerance=plant.number("tolerance", 1e-8, low=1e-13, high=1e-2),
    )


def _deviation(table: Table, key: str, default: float, unit: str = "") -> float:
    return table.number(key, default, unit=unit, low=1e-9, high=1e9)


def _read_path(table: Table, folder: Path) -> TipPath:
    kind = table.string("path", allowed=PATHS)
    if kind == "waypoints":
        return read_waypoints(folder / table.string("file"), table.boolean("closed", False))
    if kind == "line":
        return Line(table.vector("start", 3, unit="m"), table.vector("end", 3, unit="m"))
    center = table.vector("center", 3, unit="m")
    normal = table.vector("normal", 3, DOWN)
    size: dict[str, Any] = {"unit": "m", "low": 0.0, "low_open": True, "high": 100.0}
    if kind == "figure-eight":
        width, height = table.number("width", **size), table.number("height", **size)
        return FigureEight(center, width, height, normal)
    diameter = table.number("diameter", **size)
    if kind == "circle":
        return Circle(center, diameter, normal)
    pitch = table.number("pitch", unit="m", low=-100.0, high=100.0)
    return Helix(center, diameter, pitch, normal)
