"""What `choosing` measures of a scene: scores to calibrate with, and a choice beside its truth."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from softmpc.accuracy.bound import score
from softmpc.accuracy.choose import choose
from softmpc.accuracy.choose_families import COUNTS
from softmpc.accuracy.choose_loop import doubted_error
from softmpc.accuracy.configuration import Configuration, Task, changed
from softmpc.accuracy.environment import environment
from softmpc.accuracy.motion_reference import COARSER, FINE, limit, weights
from softmpc.accuracy.motion_task import model_of, moved, settings_of
from softmpc.errors import InputError, SoftmpcError
from tests.benchmarks.choosing_scenes import SCENES
from tests.benchmarks.choosing_truth import (
    motion_truth,
    rest_errors,
    true_loop_error,
    true_motion_error,
)

__all__ = ["Judged", "Scores"]

PATIENCE = 3000.0  # s
INTEGRATION = {"simulate.method": "radau", "simulate.tip_tolerance": 1e-4}
CONTROLLER = "track.controller.scene.model.segments"
# What is calibrated with: models as coarse as those that a choice ends with.
COARSE = {
    "rest": [{"model.segments": n, "model.mass": "gauss-2"} for n in (1, 2)],
    "motion": [{"model.segments": n, "model.mass": "gauss-2"} | INTEGRATION for n in (1, 2)],
    "loop": [{CONTROLLER: 2}],
}  # fmt: skip


@dataclass(frozen=True)
class Scores:
    """Scores of the coarse models of a scene; the work of a sweep over seeds."""

    family: str

    def __call__(self, seed: int) -> list[dict[str, Any]]:
        task = Task(SCENES[self.family](seed)[0])
        errors = {"rest": _rest_errors, "motion": _motion_errors, "loop": _loop_errors}
        found = []
        with environment(SOFTMPC_COMPILE="never"):
            try:
                for error in errors[self.family](task):
                    told = score(error, error["true_m"])
                    found.append({"seed": seed, **error, "score": told})
            except SoftmpcError as error:  # such as a path out of reach: no tool could choose
                return [{"seed": seed, "failed": str(error)}]
        return found


def _rest_errors(task: Task) -> Iterator[dict[str, Any]]:
    for changes in COARSE["rest"]:
        yield rest_errors(task, Configuration("calibration", str(changes), changes))


def _motion_errors(task: Task) -> Iterator[dict[str, Any]]:
    """As a choice measures them; runs that several references share are made once."""
    runs = {
        n: np.array(limit(task, [n], PATIENCE)["tips"]) for n in {*COUNTS[FINE], *COUNTS[COARSER]}
    }
    fine, coarser = (
        np.sum([w * runs[n] for w, n in zip(weights(COUNTS[name]), COUNTS[name], strict=True)], 0)
        for name in (FINE, COARSER)
    )
    truth = motion_truth(task)
    for changes in COARSE["motion"]:
        document = changed(task.document, changes)
        model = model_of(document)
        tips = moved(model, settings_of(task, document, model), PATIENCE).tips
        error, doubt, true = (
            float(np.linalg.norm(one - other, axis=2).max())
            for one, other in ((tips, fine), (fine, coarser), (tips, truth))
        )
        yield {"error_m": error, "doubt_m": doubt, "true_m": true}


def _loop_errors(task: Task) -> Iterator[dict[str, Any]]:
    for changes in COARSE["loop"]:
        own = Configuration("calibration", str(changes), changes)
        measured = doubted_error(task, own)
        kept = {key: measured[key] for key in ("error_m", "doubt_m")}
        yield kept | {"true_m": true_loop_error(task, own)}


@dataclass(frozen=True)
class Judged:
    """What is chosen for a scene with its bound (m), and its true error (m); work of a sweep."""

    family: str

    def __call__(self, seed: int) -> dict[str, Any]:
        document, tolerance_m = SCENES[self.family](seed)
        task, began = Task(document), time.process_time()
        found = {"seed": seed, "title": document["title"], "tolerance_m": tolerance_m}
        try:
            choice = choose(task, tolerance_m, goal=self.family, executor=1)
        except InputError as error:
            return found | {"chosen": None, "reasons": [str(error)]}
        tried = [one for one in choice.evidence if one.point.error_m is not None]
        found |= {"tried": len(tried), "cpu_s": time.process_time() - began}
        if choice.chosen is None:
            return found | {"chosen": None, "reasons": list(choice.reasons)}
        own = choice.chosen.configuration
        with environment(SOFTMPC_COMPILE="never"):
            true_m = (
                true_loop_error(task, own)
                if self.family == "loop"
                else true_motion_error(task, own, motion_truth(task))
            )
        error = {key: choice.chosen.point.error[key] for key in ("error_m", "doubt_m")}
        told = {"chosen": own.name, "changes": dict(own.changes), "true_m": true_m}
        return found | told | error | {"bound_m": choice.chosen.bound_m}
