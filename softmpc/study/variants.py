"""The changes of a scene that an ablation runs, all derived from the scene and the registries."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, replace
from functools import partial
from typing import Any

from softmpc.errors import BuildError, SceneError
from softmpc.model.actuation import Actuation
from softmpc.model.drive_effects import DriveEffect
from softmpc.model.effects import EFFECTS
from softmpc.model.mass import GaussMass, MassDistribution
from softmpc.model.scene import MAX_SEGMENTS, Scene
from softmpc.model.scene_file import ACTUATIONS, ELASTICITIES, FORMULATIONS, KINEMATICS, MASSES
from softmpc.study.changes import (
    ADDED,
    COARSER,
    FINER,
    LEFT_OUT,
    OTHER,
    Change,
    adding,
    driving,
    without,
)

__all__ = ["additions", "variants"]

MOST_IN_ALL = 32  # segments of the arm in a finer variant
STRAIN_SETS = {
    "no twist": ("kappa_z",),
    "no stretch": ("epsilon",),
    "planar, bending about y only": ("kappa_x", "kappa_z"),
    "planar, bending about x only": ("kappa_y", "kappa_z"),
}


def variants(scene: Scene) -> list[Change]:
    """Everything that can be left out or made coarser, and what is finer; in the order shown."""
    return [
        *_effects_left_out(scene),
        *_drives(scene),
        *_strains(scene),
        *_segments(scene),
        *_masses(scene),
        *_others(scene),
    ]


def additions(scene: Scene) -> list[Change]:
    """Every registered effect, and every drive with more states, that the scene does not have."""
    have = {effect.name for effect in scene.effects}
    missing = [kind for kind in EFFECTS if kind.name not in have]
    rows = [
        Change(f"with {kind.name}", ADDED, f"effect {kind.name}", partial(adding, kind=kind))
        for kind in missing
    ]
    size = len(scene.actuation.states)
    richer = [drive for drive in _other_drives(scene) if len(drive.states) > size]
    return rows + [_drive(scene, drive, ADDED) for drive in richer]


# ---------------------------------------------------------------- effects and drives


def _effects_left_out(scene: Scene) -> Iterator[Change]:
    for effect in scene.effects:
        leave = partial(without, left_out=(effect.name,))
        name = f"without {effect.name}{_also(scene, leave, {effect.name})}"
        yield Change(name, LEFT_OUT, f"effect {effect.name}", leave)
    of_drive = [e.name for e in scene.effects if isinstance(e, DriveEffect)]
    if len(of_drive) > 1:
        name = f"plain {scene.actuation.name} drive (without {', '.join(of_drive)})"
        yield Change(name, COARSER, "actuation", partial(without, left_out=of_drive))


def _drives(scene: Scene) -> Iterator[Change]:
    """Drives with the same input and no more states, the richest first."""
    size = len(scene.actuation.states)
    for drive in _other_drives(scene):
        if len(drive.states) <= size:
            yield _drive(scene, drive, COARSER if len(drive.states) < size else OTHER)


def _drive(scene: Scene, drive: Actuation, kind: str) -> Change:
    change = partial(driving, actuation=drive)
    name = f"{drive.name} drive{_also(scene, change, set())}"
    return Change(name, kind, "actuation", change)


def _other_drives(scene: Scene) -> list[Actuation]:
    own = scene.actuation
    same = [a for a in ACTUATIONS.values() if a.input == own.input and a.name != own.name]
    return sorted(same, key=lambda a: -len(a.states))


def _lost(scene: Scene, change: Any) -> list[str]:
    """Names of the effects and strains that a change takes along."""
    try:
        after = change(scene)
    except (SceneError, BuildError):
        return []
    left = [e.name for e in after.effects]
    lost = [e.name for e in scene.effects if e.name not in left]
    return lost + [s for s in scene.strains if s not in after.strains]


def _also(scene: Scene, change: Any, named: set[str]) -> str:
    more = [name for name in _lost(scene, change) if name not in named]
    return f" (nor {', '.join(more)})" if more else ""


# ---------------------------------------------------------------- strains, segments, slots


def _strains(scene: Scene) -> Iterator[Change]:
    done = set()
    for name, gone in STRAIN_SETS.items():
        left = tuple(s for s in scene.strains if s not in gone)
        if left and left != scene.strains and left not in done:
            done.add(left)
            yield Change(name, COARSER, "strains", partial(_keep_strains, gone=gone))


def _keep_strains(scene: Scene, gone: tuple[str, ...]) -> Scene:
    return scene.with_(strains=tuple(s for s in scene.strains if s not in gone))


def _segments(scene: Scene) -> Iterator[Change]:
    now, sections = scene.segments, len(scene.manipulator.sections)
    for count in sorted({now // 2, 1} - {0, now}, reverse=True):
        yield _with("segments", count, f"segments {count} a section", COARSER)
    for count in (2 * now, 4 * now):
        if count <= MAX_SEGMENTS and count * sections <= MOST_IN_ALL:
            yield _with("segments", count, f"segments {count} a section", FINER)


def _masses(scene: Scene) -> Iterator[Change]:
    form = scene.formulation
    if "mass" not in {f.name for f in fields(form)}:  # type: ignore[arg-type]  # dataclasses all
        return
    now = _detail(form.mass)
    for mass in sorted(MASSES.values(), key=_detail, reverse=True):
        if _detail(mass) != now:
            kind = COARSER if _detail(mass) < now else FINER
            change = partial(_keep_mass, mass=mass)
            yield Change(f"mass {mass.name}", kind, "mass", change)


def _detail(mass: MassDistribution) -> tuple[int, bool]:
    return len(mass.quadrature()), isinstance(mass, GaussMass)


def _keep_mass(scene: Scene, mass: MassDistribution) -> Scene:
    return scene.with_(formulation=replace(scene.formulation, mass=mass))  # type: ignore[type-var]


def _others(scene: Scene) -> Iterator[Change]:
    """The other choices of slots in which none is coarser by itself."""
    for arc in KINEMATICS.values():
        if arc != scene.kinematics:
            yield _with("kinematics", arc, f"kinematics {arc.name}", OTHER)
    for name, form in FORMULATIONS.items():
        if name != scene.formulation.name:
            yield _with("formulation", form(), f"formulation {name}", OTHER)
    for law in ELASTICITIES.values():
        if law != scene.formulation.elasticity:
            change = partial(_keep_elasticity, law=law)
            yield Change(f"elasticity {law.name}", OTHER, "elasticity", change)


def _keep_elasticity(scene: Scene, law: Any) -> Scene:
    return scene.with_(formulation=replace(scene.formulation, elasticity=law))  # type: ignore[type-var]


def _with(slot: str, value: Any, name: str, kind: str) -> Change:
    return Change(name, kind, slot, partial(_replaced, slot=slot, value=value))


def _replaced(scene: Scene, slot: str, value: Any) -> Scene:
    return scene.with_(**{slot: value})
