"""The error of a controller for a choice: the whole path, on a plant that takes less time."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from softmpc.accuracy.configuration import Configuration, Task
from softmpc.accuracy.loop_task import (
    coarser,
    fine_scene,
    on_plant,
    prepared,
    run_through,
    tracking,
)
from softmpc.control.tracking import Setup
from softmpc.errors import SceneError
from softmpc.model.scene import Scene

__all__ = ["doubted_error", "largest_error", "loop_error", "plant_changes", "plant_of"]

PATIENCE = 900.0  # s that one run may take
PLANT = "track.plant.scene"

Numbers = dict[str, Any]


def plant_of(task: Task) -> Scene:
    """The plant of a choice: as a study's in quick mode, with fewer segments than in full mode."""
    return fine_scene(replace(task, quick=True))


def plant_changes(task: Task) -> dict[str, Any]:
    """Keys that make the plant of a scene file that one; none where it names another file."""
    if isinstance(task.document["track"].get("plant", {}).get("scene"), str):
        return {}
    plant = plant_of(task)
    model = {"segments": plant.segments, "kinematics": plant.kinematics.name}
    model |= {"formulation": plant.formulation.name, "mass": plant.formulation.mass.name}
    return {f"{PLANT}.model.{key}": value for key, value in model.items()}


def loop_error(task: Task, configuration: Configuration) -> Numbers:
    """The largest distance of the tip from its reference once settled (m)."""
    error, failures = largest_error(_setup(task, configuration))
    return {"error_m": error, "failures": failures}


def doubted_error(task: Task, configuration: Configuration) -> Numbers:
    """The same with its doubt: how much it differs on a plant with three quarters of the segments.

    The rest path that guides the controller stays that of the plant with all of them.
    """
    setup = _setup(task, configuration)
    error, failures = largest_error(setup)
    scene = task.scene
    other, _ = largest_error(on_plant(setup, coarser(plant_of(task)), scene))
    return {"error_m": error, "doubt_m": abs(error - other), "failures": failures}


def _setup(task: Task, configuration: Configuration) -> Setup:
    """Raises `SceneError` where the controller has as many segments as the plant."""
    scene, asked = tracking(task, configuration)
    plant, model = plant_of(task), asked.controller.scene
    if model is not None and model.segments >= plant.segments:
        raise SceneError(
            f"the controller has {model.segments} segments a section and the plant {plant.segments}"
        )
    return prepared(scene, replace(asked, plant=replace(asked.plant, scene=plant)))


def largest_error(setup: Setup) -> tuple[float, int]:
    """Of a run of the loop (m), once settled, and how many steps failed."""
    run = run_through(setup, setup.controller, PATIENCE)
    return float(run.error[run.time >= run.settle].max()), run.failures
