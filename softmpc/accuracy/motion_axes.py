"""The axes of a motion: the model's, strains, effects, drive, integrator, derivatives."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from softmpc.accuracy.configuration import Configuration, Task
from softmpc.accuracy.model_axes import model_axes
from softmpc.accuracy.motion_integrator import integrator_axis
from softmpc.accuracy.motion_variants import COMPILE, DERIVATIVES
from softmpc.errors import BuildError, SceneError
from softmpc.model.actuation import FrictionDrive, HydraulicDrive
from softmpc.model.drive_effects import DriveEffect
from softmpc.model.effects import EFFECTS, TipLoad
from softmpc.model.scene import Scene
from softmpc.model.scene_file import scene_to_dict
from softmpc.study.changes import ADDED, Change
from softmpc.study.variants import additions, variants

__all__ = ["ADDED_EFFECTS", "DRIVE", "STRAINS", "changes_of", "motion_axes"]

STRAINS, EFFECTS_OUT, ADDED_EFFECTS = "strains", "effects", "effects added"
DRIVE, INTEGRATOR = "drive", "integrator"
FRICTION = 100.0  # N, where the scene has none: a fifteenth of what would explain the efficiency
PRINTED, KINEMATICS = "formulation", "kinematics"
# Quick studies have these series alone, with so many segments at most.
QUICK = {"lumped mass": 8, "2 Gauss points": 8, "paper arc, 2 Gauss points": 4}
MOST_PRINTED = {True: 1, False: 2}  # segments a section, by `quick`
COUNTS = {True: (1,), False: (1, 2, 4)}  # of derivatives and compilation
RARE = ("rotor_inertia", "cavitation", "end_stops", "back_driving")  # effects of the drive


def motion_axes(task: Task) -> Iterator[Configuration]:
    """All configurations, the scene as given first."""
    scene = task.scene
    yield from (one for one in model_axes(task) if _affordable(task, one))
    yield from _scene_axes(scene, task.quick)
    yield from integrator_axis(task)
    for count in COUNTS[task.quick]:
        for variant in DERIVATIVES:
            yield _counted("derivatives", count, variant, variant=variant)
    for count in COUNTS[task.quick]:
        for name, mode in COMPILE.items():
            yield _counted("compilation", count, name, compile=mode)


def _affordable(task: Task, one: Configuration) -> bool:
    """Whether a motion can be run so in the time that a study has.

    The Newton-Euler formulations are differentiated as a whole: at 2 segments a section of two
    sections that takes 9 s, at 4 more than 5 minutes.
    """
    if one.axis == PRINTED:
        return bool(one.changes["model.segments"] <= MOST_PRINTED[task.quick])
    if not task.quick or not one.series:
        return True
    return bool(one.changes["model.segments"] <= QUICK.get(one.series, 0))


def _counted(
    axis: str, count: int, name: str, *, compile: str = "never", variant: str = ""
) -> Configuration:
    told = f"{name}, {count} segment{'s' if count > 1 else ''}"
    return Configuration(axis, told, {"model.segments": count}, compile=compile, variant=variant)


def _scene_axes(scene: Scene, quick: bool) -> Iterator[Configuration]:
    """Strains and effects left out, effects added, and other drives."""
    for change in [*variants(scene), *additions(scene)]:
        axis = _axis(scene, change)
        if axis is None or (quick and _is_special(change)):
            continue
        try:
            yield Configuration(axis, change.name, changes_of(scene, change))
        except (SceneError, BuildError):
            continue  # this scene does not allow it
    if scene.manipulator.hydraulics.friction == 0 and scene.actuation.name == HydraulicDrive.name:
        rubbing = {"actuation.kind": FrictionDrive.name, "hydraulics.friction": FRICTION}
        yield Configuration(DRIVE, f"with friction, {FRICTION:g} N", rubbing)


def _axis(scene: Scene, change: Change) -> str | None:
    """The axis of a change; None for those of `model_axes`, and for what changes nothing.

    By default a tip load is zero, and so is Coulomb friction.
    """
    if change.slot == "strains":
        return STRAINS
    if change.slot == "actuation":
        rubs = scene.manipulator.hydraulics.friction > 0
        return DRIVE if rubs or not change.name.startswith(FrictionDrive.name) else None
    kind, _, name = change.slot.partition(" ")
    if kind != "effect" or (name == TipLoad.name and change.kind == ADDED):
        return None
    if issubclass(next(k for k in EFFECTS if k.name == name), DriveEffect):
        return DRIVE
    return ADDED_EFFECTS if change.kind == ADDED else EFFECTS_OUT


def _is_special(change: Change) -> bool:
    """What a quick study does without: it says where the arm is, or is seldom seen in a motion."""
    name = change.slot.partition(" ")[2]
    added = next((kind for kind in EFFECTS if kind.name == name and change.kind == ADDED), None)
    planar = change.slot == "strains" and change.name.startswith("planar")
    return planar or name in RARE or (added is not None and added.surroundings)


def changes_of(scene: Scene, change: Change) -> dict[str, Any]:
    """A change as keys of a scene file; raises `SceneError` or `BuildError` where it cannot be."""
    after = scene_to_dict(change.apply(scene))
    changes = dict(_differences(scene_to_dict(scene), after))
    if "model.strains" in changes:  # which effects are there by default depends on them
        changes |= {f"effects.{name}": value for name, value in after["effects"].items()}
    return changes


def _differences(
    before: dict[str, Any], after: dict[str, Any], above: str = ""
) -> Iterator[tuple[str, Any]]:
    """Dotted keys with other values; None for those that are gone."""
    for key in dict.fromkeys([*before, *after]):
        old, new = before.get(key), after.get(key)
        if isinstance(old, dict) and isinstance(new, dict):
            yield from _differences(old, new, f"{above}{key}.")
        elif old != new:
            yield f"{above}{key}", new
