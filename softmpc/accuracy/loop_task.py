"""The tracking task of a study: the scene's path, a configuration's controller, a fine plant."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from softmpc.accuracy.configuration import Configuration, Task
from softmpc.codegen.in_the_loop import InTheLoop
from softmpc.control.closed_loop import Controller, start_at
from softmpc.control.paths import Reference
from softmpc.control.planned import motion_of
from softmpc.control.planned_start import start_of
from softmpc.control.track_result import TrackResult
from softmpc.control.track_scene import Plant, Tracking, read_tracking
from softmpc.control.tracking import STARTS, Setup, model_of, set_up
from softmpc.errors import SceneError, unknown_name
from softmpc.model.formulations import VirtualPower
from softmpc.model.kinematics import ConstantStrainArc
from softmpc.model.mass import GaussMass
from softmpc.model.model import Model, build
from softmpc.model.scene import MAX_SEGMENTS, Scene
from softmpc.model.scene_file import scene_from_dict
from softmpc.simulation.integrator import IntegrationError
from softmpc.statics.equilibrium import find_equilibrium
from softmpc.statics.inverse import InverseStatics
from softmpc.statics.targets import Position

__all__ = [
    "IN_C", "coarser", "controlled", "fine_scene", "on_plant", "prepared", "run_through",
    "shortened", "tracking", "why_no_loop",
]  # fmt: skip

IN_C = "in C"  # the variant whose controller is generated and compiled
SEGMENTS = {True: 4, False: 8}  # a section of the plant, at least, by `quick`
LONGEST = {True: 1.5, False: 10.0}  # s of the path, by `quick`
BEGINNING = 0.4  # of the time, at most, for the smooth start, and before errors count


def why_no_loop(task: Task) -> str:
    """What a scene lacks to have a closed loop; empty where it has one."""
    if "track" in task.document:
        return ""
    return (
        "the scene has no path to follow: add a table [track], such as "
        '[track] path = "circle", center = [0.12, 0, 0.57], diameter = 0.08'
    )


def tracking(task: Task, configuration: Configuration) -> tuple[Scene, Tracking]:
    """The scene as given, and the task: its path, the configuration's controller, the fine plant.

    What a configuration changes of the arm is what its controller takes the arm for. A budget of
    time is left out: what a controller does shall not depend on the machine. Raises `SceneError`
    where there is no path, for an unknown variant, and where the controller has as many segments as
    the plant.
    """
    if reason := why_no_loop(task):
        raise SceneError(reason)
    if configuration.variant not in ("", IN_C):
        raise SceneError(unknown_name("variant of a controller", configuration.variant, [IN_C]))
    document = configuration.document(task)
    scene, own = task.scene, scene_from_dict(document)
    asked = read_tracking(document["track"], Path(task.folder), document)
    settings = asked.controller
    model = own if settings.scene is None else settings.scene
    plant = Plant(fine_scene(task), _given(task).plant.method)
    assert plant.scene is not None
    if model.segments >= plant.scene.segments:
        raise SceneError(
            f"the controller's model has {model.segments} segments a section and the plant of the "
            f"study {plant.scene.segments}: its errors are not those of a model; take fewer"
        )
    part = shortened(asked, LONGEST[task.quick])
    settings = replace(settings, scene=model, budget=None)
    return scene, replace(part, controller=settings, plant=plant)


def _given(task: Task) -> Tracking:
    """The task of the scene file as given."""
    return read_tracking(task.document["track"], Path(task.folder), dict(task.document))


def fine_scene(task: Task) -> Scene:
    """The plant of a study: that of the scene, of virtual power on exact arcs with more segments.

    They are twice those of the scene's own plant and controller, or more.
    """
    given, scene = _given(task), task.scene
    plant = scene if given.plant.scene is None else given.plant.scene
    model = scene if given.controller.scene is None else given.controller.scene
    wanted = max(SEGMENTS[task.quick], 2 * plant.segments, 2 * model.segments)
    return _with_segments(plant, min(wanted, MAX_SEGMENTS))


def coarser(plant: Scene) -> Scene:
    """The same with three quarters of its segments.

    Halves could be those of the controller, which has no model error there.
    """
    return _with_segments(plant, math.ceil(0.75 * plant.segments))


def _with_segments(scene: Scene, segments: int) -> Scene:
    form = VirtualPower(GaussMass(2), scene.formulation.elasticity)
    return scene.with_(segments=segments, kinematics=ConstantStrainArc(), formulation=form)


def shortened(task: Tracking, seconds: float) -> Tracking:
    """The beginning of a path, with a smooth start that leaves time for full speed.

    A plan has times of its own and stays as it is.
    """
    reference = task.reference
    if reference.duration <= seconds or motion_of(reference) is not None:
        return task
    most, law = BEGINNING * seconds, reference.law
    smooth = min(law.smooth_start, most)
    law = replace(law, smooth_start=smooth, laps=(seconds - smooth / 2) / law.lap_time)
    return replace(task, reference=Reference(reference.path, law), settle=min(task.settle, most))


def prepared(scene: Scene, task: Tracking, *known: Model) -> Setup:
    """The task ready to run; models that are `known` are taken for scenes that are theirs."""
    return set_up(scene, task, clearance=False, known=known)


def on_plant(setup: Setup, scene: Scene, planner: Scene) -> Setup:
    """The same controller, at the start of the same path, on another plant.

    `planner` is the scene that a plan was made with.
    """
    plant = model_of(scene, setup.ocp.model)
    reference, motion = setup.task.reference, motion_of(setup.task.reference)
    if motion is not None:
        start, _ = start_of(motion, build(planner), plant, reference)
    else:
        place = setup.guide.followed([0.0])[0]
        near = find_equilibrium(plant, plant.drive.static_gain @ setup.start.u)
        found = InverseStatics(plant, starts=STARTS).solve(Position(tuple(place.tolist())), near)
        start = start_at(plant, found.posture)
    return replace(setup, plant=setup.task.plant.integrator(plant), start=start)


@contextmanager
def controlled(setup: Setup, variant: str) -> Iterator[Controller]:
    """The controller of a task, in Python or in C."""
    if variant == IN_C:
        with InTheLoop()(setup) as controller:
            yield controller
    else:
        yield setup.controller


def run_through(setup: Setup, controller: Controller, patience: float) -> TrackResult:
    """The loop to its end; raises `IntegrationError` where it does not come there."""
    run = setup.run(controller, _waiting(time.perf_counter() + patience))
    if run.status == "interrupted":
        raise KeyboardInterrupt
    if run.status != "finished":
        raise IntegrationError(run.status)
    return run


def _waiting(until: float) -> Callable[[int, int], None]:
    def waiting(done: int, steps: int) -> None:
        if time.perf_counter() > until:
            raise IntegrationError(f"takes too long, {done} of {steps} steps are done")

    return waiting
