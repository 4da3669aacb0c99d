"""True errors of what `softmpc choose` measured: twice its segments, other integrators.

A rod at rest is solved more tightly: it has no segments, and is its own truth.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from softmpc.accuracy.choose_families import FINEST, GOALS
from softmpc.accuracy.choose_loop import largest_error, plant_of
from softmpc.accuracy.configuration import Configuration, Task, changed
from softmpc.accuracy.loop_task import on_plant, prepared, tracking
from softmpc.accuracy.motion_task import model_of, moved, settings_of
from softmpc.accuracy.rest_references import posture_names, reference
from softmpc.accuracy.rod_of_scene import rod_of_scene
from softmpc.model.scene_file import scene_from_dict
from softmpc.simulation.methods import Method

__all__ = ["motion_truth", "rest_errors", "true_loop_error", "true_motion_error"]

COUNTS = (8, 2 * FINEST)  # segments a section, whose error of second order is taken out
TRUE = {"model.formulation": "virtual-power", "model.elasticity": "energy",
        "model.mass": "gauss-3"}  # fmt: skip
IDAS = {"method": "idas", "tolerance": 1e-7, "tip_tolerance": None, "step": None}
RADAU = Method("radau", tip_tolerance=1e-6)
ROD = 1e-13  # relative, of the integration along the rod
PATIENCE = 3000.0  # s


def rest_errors(task: Task, configuration: Configuration) -> dict[str, float]:
    """Error, doubt and true error (m) of a model at the postures of a choice."""
    references = {name: reference(task, name) for name in posture_names(task)}
    known = {name: one for name, one in references.items() if "tips" in one}
    rod = rod_of_scene(scene_from_dict(dict(task.document)))
    tight = {
        name: one | {"tips": rod.rest(one["pressures"], ROD).section_tips.tolist()}
        for name, one in known.items()
    }
    measured, true = (
        GOALS["rest"].error(task, configuration, references | told) for told in (known, tight)
    )
    kept = {key: measured[key] for key in ("error_m", "doubt_m")}
    return kept | {"true_m": true["error_m"]}


def motion_truth(task: Task) -> np.ndarray:
    """Section tips (K×S×3, m) of the arm with segments without end."""
    fewer, more = (_moved(task, count) for count in COUNTS)
    share = 1 / (1 - (COUNTS[0] / COUNTS[1]) ** 2)
    return share * more + (1 - share) * fewer


def _moved(task: Task, count: int) -> np.ndarray:
    document = changed(task.document, TRUE | {"model.segments": count})
    model = model_of(document)
    settings: Any = replace(settings_of(task, document, model), **IDAS)
    return np.asarray(moved(model, settings, PATIENCE).tips)


def true_motion_error(task: Task, configuration: Configuration, truth: np.ndarray) -> float:
    """Largest distance (m) of any section tip from the truth."""
    document = configuration.document(task)
    model = model_of(document)
    tips = moved(model, settings_of(task, document, model), PATIENCE).tips
    return float(np.linalg.norm(tips - truth, axis=2).max())


def true_loop_error(task: Task, configuration: Configuration) -> float:
    """Largest error (m) of the loop on a plant with twice the segments, by Radau IIA."""
    scene, asked = tracking(task, configuration)
    plant = plant_of(task)
    asked = replace(asked, plant=replace(asked.plant, scene=plant))
    setup = prepared(scene, asked)
    setup = replace(setup, task=replace(setup.task, plant=replace(asked.plant, method=RADAU)))
    return largest_error(on_plant(setup, plant.with_(segments=2 * plant.segments), scene))[0]
