"""The table [plan] of a scene file: start, goals, obstacles and limits of a planned motion."""

from __future__ import annotations

import os
from collections.abc import Mapping
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from softmpc.control.limits import Limit, StrainLimit, TipBox, TipCone
from softmpc.control.stage import Stage
from softmpc.control.transcription import require_linear_drive
from softmpc.errors import SceneError, errors_in
from softmpc.model.contact import Contact
from softmpc.model.effect_tables import read_record
from softmpc.model.model import Model, build
from softmpc.model.obstacles import OBSTACLES, Obstacle, obstacle_names
from softmpc.model.scene import STRAINS, Scene
from softmpc.model.scene_file import read_document, scene_from_dict
from softmpc.model.tables import Table
from softmpc.planning.goal_tables import MPA, GoalTable, Posture, read_goal, read_start
from softmpc.planning.planner import PlanSettings, Progress, plan
from softmpc.planning.problem import LEAST, PlanProblem, arm_limits, check_times
from softmpc.planning.result import PlanResult

__all__ = ["LIMITS", "Planning", "plan_file", "read_plan_file", "read_planning"]

LIMITS = ("tip_box", "tip_cone", "strain")
AXES = ("x", "y", "z")
INSIDE = 1e-6  # scaled, by which a limit may be broken at the start

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Planning:
    """What a table [plan] asks for, before postures are sought."""

    model: Model
    start: Posture
    goals: tuple[GoalTable, ...]
    least: str
    duration: float | None
    rate: float | None  # N·m/s or Pa/s
    limits: tuple[Limit, ...]
    obstacles: tuple[Obstacle, ...]
    margin: float
    back_off: float
    settings: PlanSettings

    def problem(self) -> PlanProblem:
        """With postures from inverse statics and equilibria; `SceneError` where there are none."""
        start = self.start.find(self.model)
        problem = PlanProblem(
            self.model,
            start,
            tuple(goal.find(self.model) for goal in self.goals),
            self.least,
            self.duration,
            self.rate,
            (*arm_limits(self.model), *self.limits),
            self.obstacles,
            self.margin,
            self.back_off,
        )
        _check_limits(problem, len(self.limits))
        return problem


def plan_file(
    path: str | os.PathLike[str],
    *,
    executor: Executor | int | None = None,
    progress: Progress | None = None,
    **changes: Any,
) -> PlanResult:
    """Plan what the table [plan] of a scene file asks for; see `softmpc.planning.planner.plan`.

    `changes` replace its keys, for instance `least="effort", duration=1.5`.
    """
    title, planning = read_plan_file(path, changes)
    with errors_in(path):
        problem = planning.problem()
        result = plan(problem, planning.settings, executor=executor, progress=progress)
    return replace(result, title=title)


def read_plan_file(
    path: str | os.PathLike[str], changes: Mapping[str, Any] | None = None
) -> tuple[str, Planning]:
    """Title and task of a scene file; `changes` go before what its table [plan] says."""
    document = read_document(path)
    with errors_in(path):
        scene = scene_from_dict(document)
        if "plan" not in document:
            raise SceneError("[plan] is missing: it says where the motion starts and ends")
        data = {**document["plan"], **(changes or {})}
        planning = read_planning(data, scene, Path(path).parent)
    return document.get("title") or Path(path).stem, planning


def read_planning(data: object, scene: Scene, folder: Path) -> Planning:
    """The [plan] table; files that it names are looked for in `folder`.

    Raises `SceneError` naming the key, what was given and what is allowed, before any solver.
    """
    table, model = Table(data, "[plan]"), build(scene)
    with errors_in("[plan]"):
        require_linear_drive(model)
    least = table.string("least", "time", LEAST)
    duration = None
    if "duration" in table:
        duration = table.number("duration", unit="s", low=0.0, low_open=True, high=3600.0)
    planning = Planning(
        model,
        read_start(table.raw("start", {}), model, folder),
        _read_goals(table, model, folder),
        least,
        duration,
        _read_rate(table, model),
        tuple(_read_limit(row, model) for row in _rows(table, "limits")),
        _read_obstacles(table, scene),
        table.number("margin", 0.0, unit="m", low=-0.1, high=1.0),
        table.number("back_off", 0.0, low=0.0, high=0.4),
        _read_settings(table),
    )
    table.finish()
    with errors_in("[plan]"):
        check_times(least, [goal.after for goal in planning.goals], duration)
    _check_count(planning)
    return planning


def _rows(table: Table, key: str) -> list[Table]:
    """The tables [[plan.…]] of a list."""
    given = table.raw(key, [])
    if not isinstance(given, list):
        raise table.error(key, given, f"a list of tables, [[plan.{key}]]")
    return [Table(row, f"[[plan.{key}]] {i}") for i, row in enumerate(given, 1)]


def _read_goals(table: Table, model: Model, folder: Path) -> tuple[GoalTable, ...]:
    given = table.raw("goals", [])
    if not isinstance(given, list) or not given:
        raise table.error("goals", given, "a list of tables, [[plan.goals]], at least one")
    count = len(given)
    return tuple(read_goal(one, i, i == count, model, folder) for i, one in enumerate(given, 1))


def _read_rate(table: Table, model: Model) -> float | None:
    """The largest change of an input a second, SI."""
    keys, unit = ("torque_rate", "pressure_rate"), "N·m/s"
    if model.scene.actuation.input == "pressure":
        keys, unit = (keys[1], keys[0]), "MPa/s"
    if keys[1] in table:
        raise SceneError(
            f"{table.where} {keys[1]}: the actuation {model.scene.actuation.name!r} takes "
            f"{model.scene.actuation.input}s, write {keys[0]} = … in {unit}"
        )
    if keys[0] not in table:
        return None
    rate = table.number(keys[0], unit=unit, low=0.0, low_open=True, high=1e9)
    return rate * (1.0 if unit == "N·m/s" else MPA)


def _read_settings(table: Table) -> PlanSettings:
    default = PlanSettings()
    return PlanSettings(
        table.number("tolerance", default.tolerance, unit="m", low=1e-7, high=0.1),
        table.number("change", default.change, low=1e-6, high=1.0),
        table.integer("intervals", default.intervals, low=2, high=2000),
        table.integer("most_intervals", default.most_intervals, low=2, high=10_000),
    )


def _check_count(planning: Planning) -> None:
    first = planning.settings.intervals * len(planning.goals)
    if first > planning.settings.most_intervals:
        raise SceneError(
            f"[plan] intervals = {planning.settings.intervals} for each of {len(planning.goals)} "
            f"goals: more than most_intervals = {planning.settings.most_intervals} in all"
        )


# ---------------------------------------------------------------- obstacles


def _read_obstacles(table: Table, scene: Scene) -> tuple[Obstacle, ...]:
    """Those of the table, and those of contact unless the arm may touch them."""
    rows = _rows(table, "obstacles")
    found = [read_record(OBSTACLES[row.string("kind", allowed=OBSTACLES)], row) for row in rows]
    contact = scene.effect(Contact)
    if not table.boolean("touch", False) and contact is not None:
        found += contact.obstacles
    for i, (obstacle, name) in enumerate(zip(found, obstacle_names(found), strict=True)):
        if float(ca.evalf(ca.SX(obstacle.depth(ca.SX(3, 1), 0.0)[0]))) > 0:
            where = rows[i].where if i < len(rows) else "[effects] contact"
            raise SceneError(
                f"{where}: the base of the arm, (0, 0, 0), is inside of {name}: it can never be "
                "clear of it; move the obstacle, or make it smaller"
            )
    return tuple(found)


# ---------------------------------------------------------------- limits along the way


def _read_limit(row: Table, model: Model) -> Limit:
    kind = row.string("kind", allowed=LIMITS)
    if kind == "strain":
        strain = row.string("strain", allowed=STRAINS)
        if strain not in model.scene.strains:
            known = ", ".join(model.scene.strains)
            raise row.error("strain", strain, f"one that this scene has: {known}")
        limit: Limit = StrainLimit(*_read_range(row, "" if strain == "epsilon" else "1/m"), strain)
    else:
        section = None
        if "section" in row:
            count = len(model.scene.manipulator.sections)
            section = row.integer("section", low=1, high=count)
        if kind == "tip_box":
            axis = row.string("axis", allowed=AXES)
            limit = TipBox(*_read_range(row, "m"), axis, section)
        else:
            angle = row.number("angle", unit="deg", low=0.0, low_open=True, high=179.0)
            axes = row.vector("axis", 3)
            with errors_in(row.where):
                limit = TipCone(float(np.radians(angle)), axes, section)
    row.finish()
    return limit


def _read_range(row: Table, unit: str) -> tuple[float, float]:
    """The keys low and high, one of which may be left out."""
    ends = [
        row.number(key, unit=unit) if key in row else end
        for key, end in (("low", -np.inf), ("high", np.inf))
    ]
    if not np.isfinite(ends).any():
        raise SceneError(f"{row.where} has no low and no high: give at least one of them")
    if not ends[0] < ends[1]:
        raise row.error("low", ends[0], f"below high = {ends[1]:g}")
    return ends[0], ends[1]


def _check_limits(problem: PlanProblem, own: int) -> None:
    """Raise `SceneError` for a limit that the start breaks.

    The last `own` are those of the table; the others, of the arm, count where they are backed off.
    """
    first = len(problem.limits or ()) - own
    for i, limit in enumerate(problem.all_limits[: first + own]):
        if i >= first or problem.back_off > 0:
            _check_limit(problem, limit, i - first + 1)


def _check_limit(problem: PlanProblem, limit: Limit, place: int) -> None:
    stage = Stage.of(problem.model)
    rows = limit.rows(stage)
    if ca.depends_on(rows.value, stage.u):
        return  # what follows from the input alone changes at once
    value = ca.Function("limit", [stage.x], [rows.value])(problem.start.x)
    for name, unit, number, low, high, scale in zip(
        rows.names, rows.units, np.asarray(value).ravel(), rows.low, rows.high, rows.scale,
        strict=True,
    ):  # fmt: skip
        if not low - INSIDE * scale <= number <= high + INSIDE * scale:
            back_off = f"[plan] back_off = {problem.back_off:g}"
            where = back_off if place < 1 else f"[[plan.limits]] {place}"
            wider = "widen the limit" if place > 0 else "take a smaller back_off"
            hint = 'with posture = "greatest-margin", ' if place < 1 else ""
            raise SceneError(
                f"{where}: the arm starts with {name} = {f'{number:.4g} {unit}'.strip()}, "
                f"outside of {low:.4g} to {high:.4g}: start elsewhere, {hint}or {wider}"
            )
