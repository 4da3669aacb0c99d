"""The axes of a controller: how far, how finely, with which model, and by what it is solved."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from softmpc.accuracy.configuration import Configuration, Task
from softmpc.accuracy.loop_task import IN_C
from softmpc.control.controller_table import ControllerSettings
from softmpc.control.track_scene import read_tracking
from softmpc.model.scene import Scene
from softmpc.model.scene_file import scene_from_dict

__all__ = ["loop_axes"]

CONTROLLER = "track.controller."
SCENE = f"{CONTROLLER}scene."
HORIZONS = {True: (10, 20), False: (5, 10, 20, 40)}  # steps, by `quick`
STEPS = {True: (0.025, 0.05), False: (0.0125, 0.025, 0.05)}  # s
SEGMENTS = {True: (1, 2), False: (1, 2, 4)}  # a section of the controller's model
STAGES = {True: (1, 2), False: (1, 2, 3)}
SOLVERS = {True: ("real-time", "sqp"), False: ("real-time", "sqp", "ipopt", "fatrop")}
ITERATIONS = {True: (), False: (2, 3, 5)}  # of SQP; 1 is real-time iteration
DRIVES = {
    "hydraulic": "whole drive",
    "slow-mode": "slow mode of the drive",
    "static": "static drive",
}
_FREE: dict[str, Any] = {"grid": None, "blocks": None}
TIP_DEVIATIONS = {True: (1e-3,), False: (1e-3, 5e-3, 2e-2)}  # m that cost ½


def loop_axes(task: Task) -> Iterator[Configuration]:
    """All of them, the scene as given first."""
    yield Configuration("as given", "as given")
    document = dict(task.document)
    settings = read_tracking(document["track"], Path(task.folder), document).controller
    scene = scene_from_dict(document) if settings.scene is None else settings.scene
    yield from _ahead(task, settings)
    yield from _model(task, scene)
    yield from _solved(task, settings)
    yield from _blocked(task, settings)
    for deviation in TIP_DEVIATIONS[task.quick]:
        given = settings.costs[0].deviation
        changes = _unless(deviation == given, {"tip_deviation": deviation})
        yield Configuration("softness", f"{1e3 * deviation:g} mm of the tip cost ½", changes)
    yield from _run_as(task, settings)


def _unless(same: bool, changes: Mapping[str, Any], prefix: str = CONTROLLER) -> dict[str, Any]:
    """Dotted keys; none where the scene has it so already, to be measured once."""
    return {} if same else {f"{prefix}{key}": value for key, value in changes.items()}


def _ahead(task: Task, given: ControllerSettings) -> Iterator[Configuration]:
    """Horizon and step, with equal intervals."""
    equal = not given.grid
    for horizon in HORIZONS[task.quick]:
        same = equal and horizon == given.horizon and given.blocks is None
        changes = _unless(same, _FREE | {"horizon": horizon})
        yield Configuration("horizon", f"horizon of {horizon} steps", changes)
    ahead = given.step * (sum(given.grid) if given.grid else given.horizon)
    for step in STEPS[task.quick]:
        horizon = max(1, round(ahead / step))
        same = equal and step == given.step and given.blocks is None
        changes = _unless(same, _FREE | {"step": step, "horizon": horizon})
        yield Configuration("step", f"step of {1e3 * step:g} ms", changes)


def _model(task: Task, scene: Scene) -> Iterator[Configuration]:
    """What the controller takes the arm for."""
    for count in SEGMENTS[task.quick]:
        changes = _unless(count == scene.segments, {"model.segments": count}, SCENE)
        name = f"controller with {count} segment{'s' if count > 1 else ''} a section"
        yield Configuration("controller segments", name, changes)
    if scene.actuation.input != "torque":
        return
    for kind, name in [*DRIVES.items()][: 2 if task.quick else None]:
        changes = _unless(kind == scene.actuation.name, {"actuation.kind": kind}, SCENE)
        yield Configuration("controller's drive", name, changes)


def _solved(task: Task, given: ControllerSettings) -> Iterator[Configuration]:
    """Stages, solvers, iterations."""
    for stages in STAGES[task.quick]:
        changes = _unless(stages == given.stages, {"stages": stages})
        yield Configuration("stages", f"{stages} stage{'s' if stages > 1 else ''}", changes)
    for solver in SOLVERS[task.quick]:
        own: dict[str, Any] = {"solver": solver}
        if solver in ("ipopt", "fatrop") and given.blocks is not None:
            own["blocks"] = None
        yield Configuration("solver", solver, _unless(solver == given.solver, own))
    one = _unless(given.solver == "real-time", {"solver": "real-time"})
    yield Configuration("iterations", "1 iteration", one)
    for most in ITERATIONS[task.quick]:
        several = _unless(False, {"solver": "sqp", "max_iterations": most})
        yield Configuration("iterations", f"at most {most} iterations", several)


def _blocked(task: Task, given: ControllerSettings) -> Iterator[Configuration]:
    """As far ahead with growing intervals, and with moves that last longer and longer."""
    steps = round(sum(given.grid)) if given.grid else given.horizon
    equal = _unless(not given.grid and given.blocks is None, {"horizon": steps} | _FREE)
    yield Configuration("grid and blocks", "equal intervals", equal)
    grown = _growing(steps, 4)
    grid = {"horizon": None, "blocks": None, "grid": [float(one) for one in grown]}
    yield Configuration("grid and blocks", f"{len(grown)} growing intervals", _unless(False, grid))
    if task.quick:
        return
    moves = _growing(steps, 2)
    blocks = {"horizon": steps, "grid": None, "blocks": moves}
    yield Configuration("grid and blocks", f"{len(moves)} moves", _unless(False, blocks))


def _growing(total: int, alone: int) -> list[int]:
    """Whole numbers with that sum: some ones, then each twice the one before."""
    found = [1] * min(alone, total)
    while (left := total - sum(found)) > 0:
        found.append(min(left, 2 * found[-1]))
    return found


def _run_as(task: Task, given: ControllerSettings) -> Iterator[Configuration]:
    """Whether its functions are compiled, and the whole controller in C."""
    if not task.quick:
        yield Configuration("compilation", "never compiled")
        yield Configuration("compilation", "compiled", compile="require")
    own = _unless(given.solver == "real-time", {"solver": "real-time"})
    yield Configuration("in C", "in Python", own)
    yield Configuration("in C", "in C", own, variant=IN_C)
