"""The axes of the model: segments, mass, formulation, kinematics, elasticity."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from softmpc.accuracy.configuration import Configuration, Task
from softmpc.model.elasticity import EnergyElasticity, PrintedElasticity, StrainElasticity

__all__ = ["AS_GIVEN", "model_axes", "reference_law", "segment_counts", "series"]

AS_GIVEN = "as given"
MASSES = {"lumped": 1.0, "gauss-1": 2.0, "gauss-2": 2.0, "gauss-3": 2.0}  # theoretical orders
QUICK_MASSES = ("lumped", "gauss-2")
SPELT = {"lumped": "lumped mass", "gauss-1": "1 Gauss point", "gauss-2": "2 Gauss points",
         "gauss-3": "3 Gauss points"}  # fmt: skip
LAWS = (EnergyElasticity.name, StrainElasticity.name, PrintedElasticity.name)


def segment_counts(task: Task) -> list[int]:
    """Numbers of segments a section along an axis."""
    return [1, 2, 4, 8] if task.quick else [1, 2, 4, 8, 16]


def reference_law(task: Task) -> str:
    """The elastic law of all series: that of the scene, where it has one for any segments."""
    law = task.scene.formulation.elasticity.name
    return EnergyElasticity.name if law == PrintedElasticity.name else law


def model_axes(task: Task) -> Iterator[Configuration]:
    """All of them, the scene as given first."""
    yield Configuration(AS_GIVEN, "as given")
    law = {"model.elasticity": reference_law(task)}  # the same, so that only the balance differs
    virtual = {"model.formulation": "virtual-power", **law}
    for mass in QUICK_MASSES if task.quick else MASSES:
        own = virtual | {"model.mass": mass}
        yield from series(task, "segments and mass", SPELT[mass], own, MASSES[mass])
    for form, name in (("newton-euler", "as printed"), ("newton-euler-full", "full wrench")):
        order = None if form == "newton-euler" else 1.0
        changes: dict[str, Any] = {"model.formulation": form, "model.mass": None, **law}
        yield from series(task, "formulation", f"Newton-Euler, {name}", changes, order)
    arc = virtual | {"model.mass": "gauss-2", "model.kinematics": "paper-arc"}
    # It bends before it twists, a splitting: its order depends on how much it twists.
    yield from series(task, "kinematics", "paper arc, 2 Gauss points", arc, None)
    for other in LAWS:
        if other != reference_law(task):
            yield Configuration("elasticity", f"elasticity {other}", {"model.elasticity": other})


def series(
    task: Task,
    axis: str,
    name: str,
    changes: dict[str, Any],
    order: float | None,
    variant: str = "",
) -> Iterator[Configuration]:
    """The same with ever more segments a section; the size is that of one."""
    for count in segment_counts(task):
        said = f"{name}, {count} segment{'s' if count > 1 else ''}"
        own = changes | {"model.segments": count}
        yield Configuration(axis, said, own, name, 1.0 / count, order, variant=variant)
