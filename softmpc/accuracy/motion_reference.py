"""What motions are measured against: the arm with segments without end, and tight integrations."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from softmpc.accuracy.configuration import Task, changed
from softmpc.accuracy.motion_task import PATIENCE, about_motion, model_of, moved, settings_of
from softmpc.errors import SoftmpcError
from softmpc.model.chain import Chain
from softmpc.model.model import Model
from softmpc.model.scene_file import scene_from_dict
from softmpc.simulation.result import Simulation

__all__ = ["AS_GIVEN", "COARSER", "FINE", "REFERENCES", "TIGHT_RUNS", "distances", "reference"]

FINE, COARSER, AS_GIVEN = "fine", "coarser", "as given"
TIGHT_RUNS = {  # independent of each other: neither shares its formulas with the other
    "tight, IDAS": {"method": "idas", "tolerance": 1e-12},
    "tight, Radau": {"method": "radau", "tip_tolerance": 1e-11},
}
REFERENCES = (FINE, COARSER, AS_GIVEN, *TIGHT_RUNS)
BEST = {
    "model.formulation": "virtual-power",
    "model.elasticity": "energy",
    "model.mass": "gauss-3",
    "model.kinematics": "constant-strain",
}
TIP_TOLERANCE = 1e-7  # m, of a step
# Errors of a scene of n segments are a n⁻² + b n⁻⁴ + …: of n, 2n and 4n these leave neither.
WEIGHTS = (1 / 45, -20 / 45, 64 / 45)
WAITING = 10.0  # times the patience of a configuration
DIGITS = 12  # of metres

Numbers = dict[str, Any]


def reference(task: Task, name: str) -> Numbers:
    """Section tips (K×S×3, m) at times (K, s), and "about"; raises `SoftmpcError` without."""
    if name in (FINE, COARSER):
        return _limit(task, name)
    document = dict(task.document)
    model = model_of(document)
    settings = settings_of(task, document, model)
    patience = WAITING * PATIENCE[task.quick]
    if name == AS_GIVEN:
        motion = moved(model, settings, patience)
        about = f"the scene as given, {about_motion(task)}"
        return _told(motion, about) | {"strains": _largest_strains(model, motion)}
    numbers: Numbers = {"tolerance": None, "step": None, "tip_tolerance": None}
    tight = replace(settings, **(numbers | TIGHT_RUNS[name]))
    try:
        motion = moved(model, tight, patience)
    except (SoftmpcError, RuntimeError) as error:  # other axes do not need it
        return {"about": f"the scene as given, {name}: cannot be had", "why": str(error)}
    return _told(motion, f"the scene as given, {name}")


def distances(tips: np.ndarray, reference: Mapping[str, Any]) -> np.ndarray:
    """Distances (K×S, m) of section tips from those of a reference at the same times."""
    return np.asarray(np.linalg.norm(tips - np.asarray(reference["tips"]), axis=2))


def _limit(task: Task, name: str) -> Numbers:
    """The motion that those of more and more segments go to."""
    finest = _finest(task) // (1 if name == FINE else 2)
    counts = [finest // 4, finest // 2, finest]
    motions = [_of_segments(task, count) for count in counts]
    tips = sum(w * one.tips for w, one in zip(WEIGHTS, motions, strict=True))
    about = (
        f"the arm with ever more segments: {counts[0]}, {counts[1]} and {counts[2]} a section, "
        f"virtual power, 3 Gauss points, extrapolated; Radau IIA, {TIP_TOLERANCE:g} m a step; "
        f"{about_motion(task)}"
    )
    return _told(motions[-1], about, np.asarray(tips))


def _of_segments(task: Task, count: int) -> Simulation:
    document = changed(task.document, BEST | {"model.segments": count})
    model = model_of(document)
    settings = settings_of(task, document, model)
    numbers: Numbers = {"tolerance": None, "step": None, "tip_tolerance": TIP_TOLERANCE}
    tight = replace(settings, method="radau", **numbers)
    return moved(model, tight, WAITING * PATIENCE[task.quick])


def _finest(task: Task) -> int:
    """Segments a section of the finest; fewer where CasADi differentiates the whole chain."""
    whole = Chain(scene_from_dict(dict(task.document))).beyond() is not None
    finest = 16 if task.quick else 32
    return finest // 4 if whole else finest


def _largest_strains(model: Model, motion: Simulation) -> Numbers:
    """The largest of each kind of strain (1/m, 1) by name."""
    kinds = model.scene.strains
    largest = np.abs(motion.q.reshape(-1, len(kinds))).max(axis=0)
    return dict(zip(kinds, largest.tolist(), strict=True))


def _told(motion: Simulation, about: str, tips: np.ndarray | None = None) -> Numbers:
    tips = motion.tips if tips is None else tips
    return {"about": about, "time": motion.time.tolist(), "tips": np.round(tips, DIGITS).tolist()}
