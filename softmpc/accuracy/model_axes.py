"""The axes of the model: segments, mass, formulation, kinematics, elasticity."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from softmpc.accuracy.configuration import Configuration, Task

__all__ = ["AS_GIVEN", "model_axes", "segment_counts"]

AS_GIVEN = "as given"
MASSES = {"lumped": 1.0, "gauss-1": 2.0, "gauss-2": 2.0, "gauss-3": 2.0}  # theoretical orders
SPELT = {"lumped": "lumped mass", "gauss-1": "1 Gauss point", "gauss-2": "2 Gauss points",
         "gauss-3": "3 Gauss points"}  # fmt: skip
VIRTUAL = {"model.formulation": "virtual-power", "model.elasticity": "energy"}


def segment_counts(task: Task) -> list[int]:
    """Numbers of segments a section along an axis."""
    return [1, 2, 4, 8] if task.quick else [1, 2, 4, 8, 16]


def model_axes(task: Task) -> Iterator[Configuration]:
    """All of them, the scene as given first."""
    yield Configuration(AS_GIVEN, "as given")
    for mass, theory in MASSES.items():
        own = VIRTUAL | {"model.mass": mass}
        yield from _series(task, "segments and mass", SPELT[mass], own, theory)
    # With the elastic law of the others, so that only the balance differs.
    for form, name in (("newton-euler", "as printed"), ("newton-euler-full", "full wrench")):
        order = None if form == "newton-euler" else 1.0
        changes: dict[str, Any] = {"model.formulation": form, "model.mass": None}
        changes |= {"model.elasticity": "energy"}
        yield from _series(task, "formulation", f"Newton-Euler, {name}", changes, order)
    arc = VIRTUAL | {"model.mass": "gauss-2", "model.kinematics": "paper-arc"}
    yield from _series(task, "kinematics", "paper arc, 2 Gauss points", arc, 2.0)
    for law in ("strain", "printed"):
        yield Configuration("elasticity", f"elasticity {law}", {"model.elasticity": law})


def _series(
    task: Task, axis: str, series: str, changes: dict[str, Any], order: float | None
) -> Iterator[Configuration]:
    for count in segment_counts(task):
        name = f"{series}, {count} segment{'s' if count > 1 else ''}"
        own = changes | {"model.segments": count}
        yield Configuration(axis, name, own, series, 1.0 / count, order)
