"""`softmpc track`: from the [track] table of a scene file to a closed-loop run."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from softmpc.control.closed_loop import Controller, Start, close_loop, start_at
from softmpc.control.controller_table import ControllerSettings
from softmpc.control.guide import Guide, PlanGuide
from softmpc.control.mpc import Mpc
from softmpc.control.ocp import Ocp
from softmpc.control.paths import Reference
from softmpc.control.planned import PlannedMotion, motion_of
from softmpc.control.planned_start import check_plan, start_of
from softmpc.control.preflight import Finding, Preflight, check_reach, find_preflight
from softmpc.control.rest_path import RestPath, part_of
from softmpc.control.state_map import StateMap
from softmpc.control.terminal import terminal_cost
from softmpc.control.track_result import TrackResult
from softmpc.control.track_scene import ON_INFEASIBLE, Tracking, read_tracking
from softmpc.control.transcription import Transcription
from softmpc.errors import InputError, SceneError, errors_in, unknown_name
from softmpc.interrupts import InterruptLater
from softmpc.model.disturbance import Disturbance
from softmpc.model.model import Model, build
from softmpc.model.scene import Scene
from softmpc.model.scene_file import read_document, scene_from_dict
from softmpc.simulation.integrator import Integrator
from softmpc.statics.clearance import find_clearance
from softmpc.statics.equilibrium import find_equilibrium
from softmpc.statics.inverse import InverseStatics

__all__ = [
    "Deputy", "Setup", "Tracking", "deputy", "model_of", "plant_of", "read_track_file",
    "read_tracking", "ready", "set_up", "track", "track_file", "without_feed_forward",
]  # fmt: skip

CLEARANCE_POINTS = 6  # places along a lap
STARTS = 6  # of inverse statics, before a place counts as out of reach: a path has many
LINES = 4  # of what is infeasible, in an error
SLOWER = "give it more time (lap_time)"
FASTER = f"{SLOWER}, or raise torque_rate in [track.controller]"
STRONGER = f"{SLOWER}, or allow more torque (torque_max in [limits])"
ADVICE = {
    "reach": "move it towards the arm's tip at half pressure, or make it smaller",
    "tip box": "move it into the box, or widen tip_box in [track.controller]",
    "torque": "move it, or allow more torque (torque_max in [limits])",
    "torque rate": FASTER,
    "bandwidth": f"{SLOWER}, or raise tip_deviation in [track.controller]",
    "torque at speed": STRONGER,
    "torque rate at speed": FASTER,
    "controller": "give the controller's scene what it lacks for this path, such as strains",
    "planned torque": "allow as much as the plan was made with, or plan within these limits",
    "planned torque rate": "raise torque_rate in [track.controller], or plan within it",
    "start": "plan from a place that the plant can hold",
}

Progress = Callable[[int, int], None]
Deputy = Callable[["Setup"], AbstractContextManager[Any]]
T = TypeVar("T")


def read_track_file(
    path: str | os.PathLike[str], on_infeasible: str | None = None
) -> tuple[str, Scene, Tracking]:
    """Title, scene and task of a scene file; `on_infeasible` goes before the file's own."""
    document = read_document(path)
    with errors_in(path):
        scene = scene_from_dict(document)
        if "track" not in document:
            raise SceneError("[track] is missing: it says which path the tip shall follow")
        task = read_tracking(document["track"], Path(path).parent, document)
    if on_infeasible is not None:
        if on_infeasible not in ON_INFEASIBLE:
            raise InputError(unknown_name("on_infeasible", on_infeasible, ON_INFEASIBLE))
        task = replace(task, on_infeasible=on_infeasible)
    return document.get("title", Path(path).stem), scene, task


def track_file(
    path: str | os.PathLike[str],
    progress: Progress | None = None,
    on_infeasible: str | None = None,
    checking: Progress | None = None,
    by: Deputy | None = None,
) -> TrackResult:
    """Run the scene file's tracking task: its path, by NMPC, on its plant.

    `checking` is told of the checks before the run, `progress` of the run. `by(setup)` is a context
    with a controller that does it instead of the task's own.
    """
    title, scene, task = read_track_file(path, on_infeasible)
    with errors_in(path):
        setup = ready(lambda report: set_up(scene, task, progress=report), checking)
    with deputy(by, setup) as controller:
        return replace(setup.run(controller, progress), title=title)


def deputy(by: Deputy | None, setup: Setup) -> AbstractContextManager[Any]:
    """The controller that runs a task: its own where `by` is None."""
    return nullcontext(setup.controller) if by is None else by(setup)


def track(
    scene: Scene,
    task: Tracking,
    progress: Progress | None = None,
    checking: Progress | None = None,
) -> TrackResult:
    """Follow the reference from rest at its start; progress as for `track_file`.

    Raises `SceneError` where the path is infeasible and the task says stop, before any control is
    computed.
    """
    setup = ready(lambda report: set_up(scene, task, progress=report), checking)
    return setup.run(setup.controller, progress)


def ready(make: Callable[[Progress], T], progress: Progress | None) -> T:
    """What `make(report)` makes; Ctrl-C ends it where it reports next, outside of CasADi."""
    with InterruptLater() as interrupt:

        def report(done: int, total: int) -> None:
            if interrupt.asked:
                raise KeyboardInterrupt
            if progress is not None:
                progress(done, total)

        made = make(report)
    if interrupt.asked:
        raise KeyboardInterrupt
    return made


@dataclass(frozen=True, eq=False)
class Setup:
    """A tracking task ready to run: plant, what was found before the run, controller and start."""

    task: Tracking
    plant: Integrator
    preflight: Preflight
    guide: Guide
    controller: Mpc
    start: Start
    clearance: float | None  # m

    @property
    def ocp(self) -> Ocp:
        return self.controller.ocp

    def run(self, controller: Controller, progress: Progress | None = None) -> TrackResult:
        """Close the loop with this controller, or with another one of the same step."""
        settle = self.task.settle
        result = close_loop(
            controller, self.plant, self.guide, self.start, settle=settle, progress=progress
        )
        about = self.about()
        if controller is not self.controller:
            about["controller"] = getattr(controller, "name", "")
        return replace(result, **about)

    def about(self) -> dict[str, Any]:
        """What a record of a run says of its task."""
        settings = self.task.controller
        budget = settings.step if settings.budget is None else settings.budget
        return {
            "clearance_m": self.clearance,
            "controller": settings.solver,
            "budget_ms": 1e3 * budget,
            "rate_limit": settings.torque_rate,
            "findings": tuple(self.preflight.lines),
        }


def set_up(
    scene: Scene,
    task: Tracking,
    disturbance: Callable[[Scene], Disturbance] | None = None,
    progress: Progress | None = None,
    clearance: bool = True,
    known: Sequence[Model] = (),
) -> Setup:
    """Models, checks before the run, controller and start of a task.

    `disturbance` makes, of the controller's scene, what its problem is told of in each step.
    Without `clearance` nobody looks for the distance to the edge, which takes most of the time.
    Models that are `known` are taken for scenes that are theirs.
    """
    plant, motion = plant_of(scene, task, *known), motion_of(task.reference)
    inverse = InverseStatics(plant, starts=STARTS)
    settings = task.controller
    with errors_in("[track.controller]"):
        model = model_of(scene if settings.scene is None else settings.scene, plant, *known)
        ocp = settings.problem(model, motion is not None)
        if disturbance is not None:
            ocp = replace(ocp, disturbance=disturbance(model.scene))
        to_state = StateMap(plant, model)
    if motion is not None:
        return _set_up_plan(task, motion, model_of(scene, plant, model, *known), plant, ocp)
    with errors_in("[track]"):
        far = check_reach(inverse, task.reference, task.on_infeasible == "project")
    if far is not None:
        _stop_where_infeasible([far])
    looking = part_of(progress, after=CLEARANCE_POINTS)
    preflight = find_preflight(inverse, task.reference, ocp, progress=looking)
    if task.on_infeasible == "stop":
        _stop_where_infeasible(preflight.findings)
    rest = preflight.rest
    assert rest is not None
    if not rest.found[0].stable:
        raise SceneError("[track]: no stable posture holds the tip at the start of the path")
    guide = Guide(
        task.reference,
        rest,
        project=task.on_infeasible == "project",
        to_state=None if to_state.is_identity else to_state,
    )
    with errors_in("[track.controller]"):
        mpc = make_mpc(ocp, settings, rest, guide.project)
    return Setup(
        task,
        task.plant.integrator(plant),
        preflight,
        guide,
        mpc,
        start_at(plant, rest.found[0].posture),
        _clearance(inverse, task.reference, rest, part_of(progress, len(rest.found)))
        if clearance
        else None,
    )


def _set_up_plan(
    task: Tracking, motion: PlannedMotion, planner: Model, plant: Model, ocp: Ocp
) -> Setup:
    """The same along a plan, whose states are those of the model `planner`."""
    with errors_in("[track] plan"):
        motion.check_fits(planner)
        start, findings = start_of(motion, planner, plant, task.reference)
    findings += check_plan(motion, task.reference, ocp)
    if task.on_infeasible == "stop":
        _stop_where_infeasible(findings)
    guide = PlanGuide(
        task.reference, motion=motion, step=ocp.step, planner=planner, model=ocp.model
    )
    with errors_in("[track.controller]"):
        mpc = _mpc(ocp, task.controller, _pressures_at_end(task.controller, motion))
    preflight = Preflight(None, tuple(findings), {"largest_input": float(motion.u.max())})
    return Setup(task, task.plant.integrator(plant), preflight, guide, mpc, start, None)


def _pressures_at_end(settings: ControllerSettings, motion: PlannedMotion) -> np.ndarray | None:
    return motion.samples_p[-1] if settings.terminal == "rest" else None


def without_feed_forward(setup: Setup) -> Mpc:
    """The controller of a plan that is told of its tip alone."""
    settings, motion = (
        replace(setup.task.controller, feed_forward=False),
        motion_of(setup.guide.path),
    )
    assert motion is not None
    ocp = replace(setup.ocp, costs=settings.costs)
    return _mpc(ocp, settings, _pressures_at_end(settings, motion))


def model_of(scene: Scene, *known: Model) -> Model:
    """The model of a scene, one of those that are there if it is of that scene."""
    return next((model for model in known if model.scene == scene), None) or build(scene)


def plant_of(scene: Scene, task: Tracking, *known: Model) -> Model:
    """The model of a task's plant; `scene` is that of the file."""
    if task.plant.scene is None:
        return model_of(scene, *known)
    with errors_in("[track.plant] scene"):
        return model_of(task.plant.scene, *known)


def make_mpc(ocp: Ocp, settings: ControllerSettings, rest: RestPath, project: bool) -> Mpc:
    """The controller of these settings, with its cost at the end near the middle of the path.

    Where the nearest places in reach jump the tip alone does not say which way to go; that cost
    leads the whole posture.
    """
    jumps = project and len(rest.transits) > 0
    led = settings.terminal == "rest" or (settings.terminal == "auto" and jumps)
    return _mpc(ocp, settings, rest.middle.pressures if led else None)


def _mpc(ocp: Ocp, settings: ControllerSettings, pressures: np.ndarray | None) -> Mpc:
    """The controller; with pressures (m) it has the cost at the end of coming to rest near them."""
    if pressures is not None:
        start = start_at(ocp.model, find_equilibrium(ocp.model, pressures))
        ocp = terminal_cost(ocp, start.x, start.u, settings.stages).problem
    transcription = Transcription(ocp, settings.stages)
    return Mpc(transcription, settings.make_solver(transcription), settings.budget)


def _stop_where_infeasible(findings: Sequence[Finding]) -> None:
    if not findings:
        return
    lines, kinds = [one.text for one in findings], {one.kind for one in findings}
    more = f"\n  and {len(lines) - LINES} more" if len(lines) > LINES else ""
    said = "".join(f"\n  {line}" for line in lines[:LINES]) + more
    advice = "; ".join(dict.fromkeys(what for kind, what in ADVICE.items() if kind in kinds))
    raise SceneError(
        f"[track]: the path is infeasible:{said}\n  {advice}; or run it as far as it goes with "
        '--on-infeasible project, or on_infeasible = "project" in [track]'
    )


def _clearance(
    inverse: InverseStatics, reference: Reference, rest: RestPath, progress: Progress
) -> float | None:
    """Distance of the path to the edge of the workspace (m); None where it is beyond."""
    if rest.distance.max() > 1e-5:
        return None
    lap = reference.path.position(np.arange(CLEARANCE_POINTS) / CLEARANCE_POINTS)
    clearance = find_clearance(inverse, lap, progress)
    return None if clearance is None else clearance.distance
