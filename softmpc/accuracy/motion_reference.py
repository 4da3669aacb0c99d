"""What motions are measured against: the arm with segments without end, and tight integrations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from softmpc.accuracy.configuration import Task, changed
from softmpc.accuracy.model_axes import reference_law
from softmpc.accuracy.motion_task import PATIENCE, Moved, about_motion, model_of, moved, settings_of
from softmpc.errors import SoftmpcError
from softmpc.model.chain import Chain
from softmpc.model.model import Model

__all__ = [
    "AS_GIVEN", "COARSER", "FINE", "REFERENCES", "TIGHT_RUNS", "distances", "limit", "reference",
    "weights",
]  # fmt: skip

FINE, COARSER, AS_GIVEN = "fine", "coarser", "as given"
TIGHT_RUNS = {  # independent of each other: neither shares its formulas with the other
    "tight, IDAS": {"method": "idas", "tolerance": 1e-12},
    "tight, Radau": {"method": "radau", "tip_tolerance": 1e-11},
}
REFERENCES = (FINE, COARSER, AS_GIVEN, *TIGHT_RUNS)
BEST = {
    "model.formulation": "virtual-power",
    "model.mass": "gauss-3",
    "model.kinematics": "constant-strain",
}
TIP_TOLERANCE = 1e-7  # m, of a step
COUNTS = {True: (6, 8, 12), False: (12, 16, 24)}  # segments a section of "fine", by `quick`
FEWER = {True: (2, 4, 6), False: (4, 6, 8)}  # where CasADi differentiates the whole chain
WAITING = 10.0  # times the patience of a configuration
DIGITS = 12  # of metres

Numbers = dict[str, Any]


def reference(task: Task, name: str) -> Numbers:
    """Section tips (K×S×3, m) at times (K, s), and "about"; raises `SoftmpcError` without."""
    patience = WAITING * PATIENCE[task.quick]
    if name in (FINE, COARSER):
        each = [count // (1 if name == FINE else 2) for count in _counts(task)]
        return limit(task, each, patience)
    document = dict(task.document)
    model = model_of(document)
    settings = settings_of(task, document, model)
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


def limit(task: Task, counts: Sequence[int], patience: float) -> Numbers:
    """The motion that those of more and more segments go to, from runs with `counts` of them."""
    motions = [_of_segments(task, count, patience) for count in counts]
    pairs = zip(weights(counts), motions, strict=True)
    tips = np.sum([weight * one.tips for weight, one in pairs], axis=0)
    told = f"{', '.join(map(str, counts[:-1]))} and {counts[-1]}"
    about = (
        f"the arm with ever more segments, extrapolated from {told} a section; virtual power, 3 "
        f"Gauss points, Radau IIA within {TIP_TOLERANCE:g} m a step; {about_motion(task)}"
    )
    return _told(motions[-1], about, tips)


def weights(counts: Sequence[int]) -> np.ndarray:
    """Of motions of n segments each with errors a/n² + b/n⁴ + …, of which their sum has neither.

    Source: Richardson's extrapolation; of three, what is left is of order n⁻⁶.
    """
    squares = np.array(counts, float) ** 2
    others = [np.delete(squares, i) / square for i, square in enumerate(squares)]
    return np.array([np.prod(1 / (1 - other)) for other in others])


def _of_segments(task: Task, count: int, patience: float) -> Moved:
    law = {"model.elasticity": reference_law(task)}
    document = changed(task.document, BEST | law | {"model.segments": count})
    model = model_of(document)
    settings = settings_of(task, document, model)
    numbers: Numbers = {"tolerance": None, "step": None, "tip_tolerance": TIP_TOLERANCE}
    tight = replace(settings, method="radau", **numbers)
    return moved(model, tight, patience)


def _counts(task: Task) -> tuple[int, ...]:
    whole = Chain(task.scene).beyond() is not None
    return (FEWER if whole else COUNTS)[task.quick]


def _largest_strains(model: Model, motion: Moved) -> Numbers:
    """The largest of each kind of strain (1/m, 1) by name."""
    kinds = model.scene.strains
    largest = np.abs(motion.q.reshape(-1, len(kinds))).max(axis=0)
    return dict(zip(kinds, largest.tolist(), strict=True))


def _told(motion: Moved, about: str, tips: np.ndarray | None = None) -> Numbers:
    tips = motion.tips if tips is None else tips
    return {"about": about, "time": motion.time.tolist(), "tips": np.round(tips, DIGITS).tolist()}
