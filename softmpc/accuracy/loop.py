"""The arm under control: the tip on its path, on a fine plant."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np

from softmpc.accuracy.configuration import AS_GIVEN, Configuration, Task
from softmpc.accuracy.family import Family, Numbers
from softmpc.accuracy.loop_axes import loop_axes
from softmpc.accuracy.loop_cost import loop_cost
from softmpc.accuracy.loop_task import (
    LONGEST,
    coarser,
    controlled,
    fine_scene,
    on_plant,
    prepared,
    run_through,
    tracking,
    why_no_loop,
)
from softmpc.accuracy.made_once import made_once
from softmpc.control.track_result import TrackResult
from softmpc.control.track_scene import Tracking
from softmpc.control.tracking import Setup
from softmpc.errors import InputError, unknown_name
from softmpc.model.model import build
from softmpc.model.scene import Scene

__all__ = ["DOUBT", "Loop"]

PLANT, DOUBT = "plant", "its doubt"
PATIENCE = {True: 180.0, False: 900.0}  # s that one run may take, by `quick`
FAR = 3.0  # times the error of the scene as given


class Loop(Family):
    """The arm under control: the tip on its path, on a fine plant.

    The plant is that of the scene with more segments, the same for all configurations; those change
    the controller alone, and what it takes the arm for. The controller knows the plant's state and
    nothing of what its model lacks. So its accuracy ends where its model does: `own_plant_m` is the
    error of the same controller on its own model.
    """

    name: ClassVar[str] = "loop"
    about: ClassVar[str] = (
        "closed-loop error of the tip on a plant with more segments, where accuracy ends where the "
        "controller's model does; time of a controller step on its own model"
    )
    error_label: ClassVar[str] = "largest tip error in closed loop (m)"
    cost_label: ClassVar[str] = "controller step, 95 % (s)"

    def fitted(self, axis: str) -> tuple[str, ...]:
        """None: what is left is the model's error, and no theory says how it falls."""
        return ()

    def missing(self, task: Task) -> str:
        return why_no_loop(task)

    def configurations(self, task: Task) -> Sequence[Configuration]:
        return list(loop_axes(task))

    def references(self, task: Task) -> Sequence[str]:
        return (PLANT, DOUBT)

    def reference(self, task: Task, name: str) -> Numbers:
        """What the plant is; and its doubt, by one with three quarters of its segments."""
        if name not in (PLANT, DOUBT):
            raise InputError(unknown_name("reference", name, [PLANT, DOUBT]))
        scene, asked = tracking(task, AS_GIVEN)
        if name == DOUBT:
            return _doubt(task, scene, asked)
        less, method = coarser(fine_scene(task)).segments, asked.plant.method
        plant = asked.plant.scene or scene
        seconds = asked.reference.duration
        part = "the first " if np.isclose(seconds, LONGEST[task.quick]) else ""
        about = (
            f"a plant with {plant.segments} segments a section by {method.name}, for "
            f"{part}{seconds:g} s of the path; its doubt is what one with {less} makes of the "
            "error of the scene as given"
        )
        return {"segments": plant.segments, "coarser": less, "about": about}

    def error(
        self, task: Task, configuration: Configuration, references: Mapping[str, Numbers]
    ) -> Numbers:
        """The largest distance of the tip from its reference once settled, `error_m`.

        `rms_m` with it; `variation` of all inputs; `failures`, steps that are not solved; `cost` of
        the closed loop by the deviations of the scene as given, a step as long as there.
        `own_plant_m` is the error on the controller's own model. `doubt_m` is the plant's, and for
        a controller that is far worse than the scene's, for it may swing, one of its own.
        """
        scene, asked = tracking(task, configuration)
        setup = prepared(scene, asked, made_once("plant", task, lambda: build(_plant(asked))))
        model = asked.controller.scene
        assert model is not None
        own, patience = on_plant(setup, model, scene), PATIENCE[task.quick]
        with controlled(setup, configuration.variant) as controller:
            run, ideal = (run_through(one, controller, patience) for one in (setup, own))
            found, doubt_m = _errors(run), float(references[DOUBT]["doubt_m"])
            if found["error_m"] > FAR * references[DOUBT]["error_m"]:
                less = on_plant(setup, coarser(_plant(asked)), scene)
                again = _errors(run_through(less, controller, patience))
                doubt_m = abs(found["error_m"] - again["error_m"])
        return found | {
            "doubt_m": doubt_m,
            "own_plant_m": _errors(ideal)["error_m"],
            "cost": _cost(run, setup, task),
            "failures": run.failures,
            "variation": run.variation,
        }

    def cost(self, task: Task, configuration: Configuration) -> Numbers:
        return loop_cost(task, configuration)


def _doubt(task: Task, scene: Scene, asked: Tracking) -> Numbers:
    """How much the error of the scene as given differs on a coarser plant."""
    setup, patience = prepared(scene, asked), PATIENCE[task.quick]
    plants = setup, on_plant(setup, coarser(_plant(asked)), scene)
    fine, less = (
        _errors(run_through(one, setup.controller, patience))["error_m"] for one in plants
    )
    return {"doubt_m": abs(fine - less), "error_m": fine, "about": ""}


def _plant(asked: Tracking) -> Scene:
    assert asked.plant.scene is not None  # `tracking` gives it one
    return asked.plant.scene


def _errors(run: TrackResult) -> Numbers:
    """Largest and RMS, m."""
    off = run.error[run.time >= run.settle]
    return {"error_m": float(off.max()), "rms_m": float(np.sqrt(np.mean(off**2)))}


def _cost(run: TrackResult, setup: Setup, task: Task) -> float | None:
    """By the deviations of the scene as given: each cost is a square over its own squared."""
    given = tracking(task, AS_GIVEN)[1].controller
    theirs = {cost.name: cost.deviation for cost in given.costs}
    own = {cost.name: cost.deviation for cost in setup.ocp.costs}
    if not run.costs:
        return None
    paid = sum(
        value * (own[name] / theirs.get(name, own[name])) ** 2 for name, value in run.costs.items()
    )
    return float(paid * setup.ocp.step / given.step)
