"""The arm at rest: postures and frequencies against a rod that shares no code with the model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np

from softmpc.accuracy.configuration import Configuration, Task
from softmpc.accuracy.family import Family, Numbers
from softmpc.accuracy.model_axes import model_axes, reference_law, series
from softmpc.accuracy.motion_variants import PRINTED_RATES, model_with
from softmpc.accuracy.rest_cost import rest_cost
from softmpc.accuracy.rest_references import frequencies, names, posture_names, reference
from softmpc.errors import SoftmpcError
from softmpc.model.elasticity import PrintedElasticity
from softmpc.model.model import Model
from softmpc.model.scene_file import scene_from_dict
from softmpc.statics.equilibrium import Equilibrium, find_equilibrium
from softmpc.study.rests import farthest

__all__ = ["Rest"]

GROWING = 1e-6  # of a frequency, the imaginary part that is more than rounding


class Rest(Family):
    """The arm at rest: postures and frequencies against a rod without segments.

    Postures are those at seeded random pressures within the scene's limits, and the one that the
    last inputs of [simulate] hold; frequencies those without pressure and at the first posture.
    Where the rod does not know the scene, a model finer than all that are measured stands for it,
    and the references say so.
    """

    name: ClassVar[str] = "rest"
    about: ClassVar[str] = (
        "Error of section tips at rest and of frequencies; time of a call of residual and Jacobian."
    )
    error_label: ClassVar[str] = "largest error of a section tip at rest (m)"
    cost_label: ClassVar[str] = "residual and Jacobian, a call (s)"

    def fitted(self, axis: str) -> tuple[str, ...]:
        """Errors of tips and of frequencies."""
        return ("error_m", "frequency_error")

    def missing(self, task: Task) -> str:
        scene = task.scene
        if isinstance(scene.formulation.elasticity, PrintedElasticity):
            return (
                "elasticity 'printed' depends on the number of segments, so there is nothing that "
                "it comes close to: set [model] elasticity to 'energy' or 'strain'"
            )
        return ""

    def configurations(self, task: Task) -> Sequence[Configuration]:
        law = {"model.elasticity": reference_law(task)}
        own = {"model.formulation": "virtual-power", "model.mass": "gauss-2", **law}
        rates = "printed, passed on by virtual power"
        printed = series(task, "angular velocity", rates, own, 1.0, PRINTED_RATES)
        exact = series(task, "angular velocity", "exact", own, 2.0)
        return [*model_axes(task), *printed, *exact]

    def references(self, task: Task) -> Sequence[str]:
        return names(task)

    def reference(self, task: Task, name: str) -> Numbers:
        return reference(task, name)

    def error(
        self, task: Task, configuration: Configuration, references: Mapping[str, Numbers]
    ) -> Numbers:
        """Distances of section tips over all postures (m), and relative errors of frequencies.

        `error_m` is the largest, `median_m` over the postures, `tip_m` the largest of the arm's
        tip. `frequency_error` is the largest of `frequency_errors`, a list a rest;
        `growing` counts frequencies that are not real. With another elastic law than that of the
        references, `change_m` from the scene as given instead. Raises `SoftmpcError` where the
        configuration has no rest at a posture.
        """
        scene = scene_from_dict(configuration.document(task))
        model = model_with(scene, configuration.variant)
        wanted = {name: references[name] for name in posture_names(task)}
        wanted = {name: one for name, one in wanted.items() if "tips" in one}
        if not wanted:
            raise SoftmpcError("there is no posture to compare with, see the references")
        found = {name: _rest(model, one, name) for name, one in wanted.items()}
        if scene.formulation.elasticity.name != reference_law(task):
            changes = [farthest(found[k].tips, np.array(one["given"])) for k, one in wanted.items()]
            return {"change_m": max(changes)}
        errors = _tip_errors(found, wanted)
        modes = {k: one for k, one in references.items() if "frequencies" in one}
        return errors | (_frequency_errors(model, modes) if modes else {})

    def cost(self, task: Task, configuration: Configuration) -> Numbers:
        return rest_cost(task, configuration)


def _rest(model: Model, wanted: Mapping[str, Any], name: str) -> Equilibrium:
    found = find_equilibrium(model, wanted["pressures"])
    if not found.converged:
        raise SoftmpcError(f"no rest found at {name}: {found.status}")
    return found


def _tip_errors(
    found: Mapping[str, Equilibrium], wanted: Mapping[str, Mapping[str, Any]]
) -> Numbers:
    gaps = {
        name: np.linalg.norm(found[name].tips - np.array(one["tips"]), axis=1)
        for name, one in wanted.items()
    }
    largest = {name: float(gap.max()) for name, gap in gaps.items()}
    return {
        "error_m": max(largest.values()),
        "median_m": float(np.median([*largest.values()])),
        "tip_m": max(float(gap[-1]) for gap in gaps.values()),
        "by_posture_m": largest,
        "unstable": [name for name, rest in found.items() if not rest.stable],
        "doubt_m": max(float(one["doubt_m"]) for one in wanted.values()),
    }


def _frequency_errors(model: Model, wanted: Mapping[str, Mapping[str, Any]]) -> Numbers:
    errors, values, growing = {}, {}, 0
    for name, one in wanted.items():
        p = one["pressures"]
        own = frequencies(model, _rest(model, one, name).q, p, len(one["frequencies"]))
        known = np.array(one["frequencies"])[: len(own)]
        errors[name] = np.abs(own / known - 1).tolist()
        values[name] = np.abs(own).tolist()
        growing += int(np.sum(np.abs(own.imag) > GROWING * np.abs(own)))
    return {
        "frequency_error": max(max(each) for each in errors.values()),
        "frequency_errors": errors,
        "frequencies_rad_s": values,  # absolute values
        "growing": growing,
        "frequency_doubt": max(float(one["frequency_doubt"]) for one in wanted.values()),
    }
