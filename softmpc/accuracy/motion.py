"""The arm in motion: section tips over the scene's motion against a fine model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np

from softmpc.accuracy.configuration import Configuration, Task
from softmpc.accuracy.family import Family, Numbers
from softmpc.accuracy.motion_axes import motion_axes
from softmpc.accuracy.motion_cost import motion_cost
from softmpc.accuracy.motion_integrator import INTEGRATOR
from softmpc.accuracy.motion_reference import (
    AS_GIVEN,
    COARSER,
    FINE,
    REFERENCES,
    TIGHT_RUNS,
    distances,
    reference,
)
from softmpc.accuracy.motion_task import PATIENCE, moved, settings_of, why_no_motion
from softmpc.accuracy.motion_variants import model_with
from softmpc.errors import InputError, SceneError, SoftmpcError, unknown_name
from softmpc.model.scene import Scene
from softmpc.model.scene_file import scene_from_dict

__all__ = ["Motion"]

STRAIGHT = 1e-6  # of the largest strain: one that stays below does not take part


class Motion(Family):
    """The arm in motion: section tips over the scene's motion against a fine model.

    The motion is that of [simulate]; of a scene with [track] alone it is run open loop under the
    torques that its tracking task applied. In quick mode 2 s of it are run at most, from where the
    inputs begin to change on.
    """

    name: ClassVar[str] = "motion"
    about: ClassVar[str] = "Tip error over the scene's motion; time to simulate it."
    error_label: ClassVar[str] = "largest tip error in motion (m)"
    cost_label: ClassVar[str] = "wall time a simulated second (s)"

    def fitted(self, axis: str) -> tuple[str, ...]:
        """Of integrators it is the error of the integration alone that has an order."""
        return ("integration_m",) if axis == INTEGRATOR else ("error_m",)

    def missing(self, task: Task) -> str:
        return why_no_motion(task) or _wrong(task)

    def configurations(self, task: Task) -> Sequence[Configuration]:
        return list(motion_axes(task))

    def references(self, task: Task) -> Sequence[str]:
        return REFERENCES

    def reference(self, task: Task, name: str) -> Numbers:
        if name not in REFERENCES:
            raise InputError(unknown_name("reference", name, REFERENCES))
        return reference(task, name)

    def error(
        self, task: Task, configuration: Configuration, references: Mapping[str, Numbers]
    ) -> Numbers:
        """Distances of section tips, largest over the motion and RMS, from those of "fine".

        With more than the scene as given has, `change_m` from that instead; where something is left
        out, or the elastic law is another one, it stands beside. On the axis of integrators also
        `integration_m`: how far the motion is from that of the same model integrated tightly by
        another method.
        """
        document = configuration.document(task)
        scene, given = scene_from_dict(document), task.scene
        _check_strains(scene, given, references[AS_GIVEN]["strains"])
        model = model_with(scene, configuration.variant)
        settings = settings_of(task, document, model)
        tips = moved(model, settings, PATIENCE[task.quick]).tips
        change = {"change_m": float(distances(tips, references[AS_GIVEN]).max())}
        if _adds(scene, given):
            return change
        found = _errors(tips, references)
        if _leaves_out(scene, given):
            found |= change
        if configuration.axis == INTEGRATOR:
            found |= _integration(tips, settings.method, references)
        return found

    def cost(self, task: Task, configuration: Configuration) -> Numbers:
        return motion_cost(task, configuration)


def _wrong(task: Task) -> str:
    """Why the scene's motion cannot be run, as far as its file tells; [track] is read later."""
    if "simulate" not in task.document:
        return ""
    try:
        document = dict(task.document)
        settings_of(task, document, model_with(scene_from_dict(document), ""))
    except SoftmpcError as error:
        return str(error)
    return ""


def _errors(tips: np.ndarray, references: Mapping[str, Numbers]) -> Numbers:
    gaps = distances(tips, references[FINE])
    fine = np.asarray(references[FINE]["tips"])
    return {
        "error_m": float(gaps.max()),
        "rms_m": float(np.sqrt(np.mean(gaps[:, -1] ** 2))),
        "by_section_m": gaps.max(axis=0).tolist(),
        "doubt_m": float(distances(fine, references[COARSER]).max()),
    }


def _integration(tips: np.ndarray, method: str, references: Mapping[str, Numbers]) -> Numbers:
    """By SUNDIALS the other one is Radau IIA, else IDAS; the doubt is the distance of both."""
    idas, radau = (references[name] for name in TIGHT_RUNS)
    for one in (idas, radau):
        if "tips" not in one:
            raise SceneError(f"{one['about']}: {one['why']}")
    other = radau if method in ("idas", "cvodes") else idas
    return {
        "integration_m": float(distances(tips, other).max()),
        "integration_doubt_m": float(distances(np.asarray(idas["tips"]), radau).max()),
    }


def _adds(scene: Scene, given: Scene) -> bool:
    """Whether the scene has physics that the one as given leaves out."""
    known = {effect.name for effect in given.effects}
    friction = scene.manipulator.hydraulics.friction > given.manipulator.hydraulics.friction
    return (
        any(effect.name not in known for effect in scene.effects)
        or len(scene.actuation.states) > len(given.actuation.states)
        or friction
    )


def _leaves_out(scene: Scene, given: Scene) -> bool:
    """Whether it lacks physics, or has another elastic law; balance, mass, arcs do not count."""
    other_law = scene.formulation.elasticity != given.formulation.elasticity
    same = replace(scene, segments=given.segments, formulation=given.formulation)
    return other_law or replace(same, kinematics=given.kinematics) != given


def _check_strains(scene: Scene, given: Scene, largest: Mapping[str, Any]) -> None:
    """Raise `SceneError` where a plane is left that the motion does not stay in."""
    most = max(largest.get("kappa_x", 0.0), largest.get("kappa_y", 0.0))
    for strain in [s for s in given.strains if s not in scene.strains]:
        if strain in ("kappa_x", "kappa_y") and largest[strain] > STRAIGHT * most:
            raise SceneError(f"the motion is not planar: {strain} up to {largest[strain]:.3g} 1/m")
