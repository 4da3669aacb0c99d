"""The path of a [track] table, and the time law along it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from softmpc.control.paths import (
    Circle,
    FigureEight,
    Helix,
    Line,
    Point,
    Reference,
    TimeLaw,
    TipPath,
    read_waypoints,
)
from softmpc.control.planned import planned_reference, read_planned
from softmpc.errors import SceneError
from softmpc.model.tables import Table

__all__ = ["read_reference"]

PATHS = ("circle", "figure-eight", "helix", "line", "point", "waypoints", "plan")
LAPS = ("lap_time", "laps", "smooth_start")
DOWN = (0.0, 0.0, 1.0)


def read_reference(table: Table, folder: Path) -> Reference:
    """Path and time law; files that the table names are looked for in `folder`."""
    kind = table.string("path", allowed=PATHS, doc="the kind of path")
    if kind == "plan":
        return _read_plan(table, folder)
    path = _read_path(kind, table, folder)
    law = TimeLaw(
        table.number("lap_time", 4.0, unit="s", low=0.05, high=3600.0),
        table.number("laps", 2.0, low=0.01, high=1e4),
        table.number("smooth_start", 1.0, unit="s", low=0.0, high=60.0),
    )
    return Reference(path, law)


def _read_plan(table: Table, folder: Path) -> Reference:
    for key in LAPS:
        if key in table:
            raise SceneError(
                f"{table.where} {key}: a plan has its own times and is run once; leave it out"
            )
    file = table.string("file", "plan.npz")
    hold = table.number("hold", 1.0, unit="s", low=0.0, high=3600.0)
    return planned_reference(read_planned(folder / file), hold)


def _read_path(kind: str, table: Table, folder: Path) -> TipPath:
    if kind == "waypoints":
        file = table.string("file", doc="a CSV file with columns x, y, z in m")
        return read_waypoints(folder / file, table.boolean("closed", False))
    if kind == "line":
        ends = (
            table.vector(key, 3, unit="m", doc=f"the place where the line {key}s")
            for key in ("start", "end")
        )
        return Line(*ends)
    center = table.vector("center", 3, unit="m", doc="the middle of the path")
    if kind == "point":
        return Point(center)
    normal = table.vector("normal", 3, DOWN)
    size: dict[str, Any] = {"unit": "m", "low": 0.0, "low_open": True, "high": 100.0}
    if kind == "figure-eight":
        width = table.number("width", doc="how wide the eight is", **size)
        height = table.number("height", doc="how high the eight is", **size)
        return FigureEight(center, width, height, normal)
    diameter = table.number("diameter", doc=f"that of the {kind}", **size)
    if kind == "circle":
        return Circle(center, diameter, normal)
    pitch = table.number("pitch", unit="m", low=-100.0, high=100.0, doc="the rise in a lap")
    return Helix(center, diameter, pitch, normal)
