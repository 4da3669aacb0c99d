"""Scene files: a `Scene` read from TOML and written to it."""

import os
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

from softmpc.errors import SceneError, errors_in, nearest
from softmpc.files import replacing
from softmpc.model.actuation import (
    Actuation,
    FrictionDrive,
    HydraulicDrive,
    PressureDrive,
    SlowDrive,
    StaticDrive,
)
from softmpc.model.effect_tables import read_effects, write_effects
from softmpc.model.effects import Effect, TipLoad
from softmpc.model.elasticity import (
    Elasticity,
    EnergyElasticity,
    PrintedElasticity,
    StrainElasticity,
)
from softmpc.model.formulations import Formulation, FullNewtonEuler, NewtonEuler, VirtualPower
from softmpc.model.kinematics import Arc, ConstantStrainArc, PaperArc
from softmpc.model.manipulator_tables import manipulator_from_dict, manipulator_to_dict
from softmpc.model.mass import GaussMass, LumpedMass, MassDistribution
from softmpc.model.scene import MAX_SEGMENTS, SCHEMA_VERSION, STRAINS, Scene
from softmpc.model.tables import Table

__all__ = [
    "check_document",
    "load_scene",
    "read_document",
    "read_toml",
    "save_scene",
    "scene_from_dict",
    "scene_to_dict",
    "write_document",
]

KINEMATICS: dict[str, Arc] = {arc.name: arc for arc in (ConstantStrainArc(), PaperArc())}
FORMULATIONS: dict[str, type[Formulation]] = {
    kind.name: kind for kind in (VirtualPower, NewtonEuler, FullNewtonEuler)
}
MASSES: dict[str, MassDistribution] = {
    mass.name: mass for mass in (LumpedMass(), GaussMass(1), GaussMass(2), GaussMass(3))
}
ELASTICITIES: dict[str, Elasticity] = {
    law.name: law for law in (EnergyElasticity(), StrainElasticity(), PrintedElasticity())
}
ACTUATIONS: dict[str, Actuation] = {
    drive.name: drive
    for drive in (HydraulicDrive(), FrictionDrive(), SlowDrive(), StaticDrive(), PressureDrive())
}
TABLES = ("manipulator", "hydraulics", "limits", "model", "effects", "actuation", "load")
OTHER_TABLES = ("track", "rig", "simulate", "plan")  # checked by the modules that use them
MISPLACED = {  # what belongs below one of them
    "controller": "[track.controller]",
    "plant": "[track.plant]",
    "sensors": "[rig.section_tips], [rig.unit_pressures] and the like",
    "estimator": "[rig.estimator]",
    "supervision": "[rig.supervision]",
    "faults": "[[rig.faults]]",
    "goals": "[[plan.goals]]",
    "obstacles": "[[plan.obstacles]], or obstacles = [...] of contact in [effects]",
}
ZERO = (0.0, 0.0, 0.0)

T = TypeVar("T")


def load_scene(path: str | os.PathLike[str]) -> Scene:
    """Return the scene of a TOML file."""
    document = read_document(path)
    with errors_in(path):
        return scene_from_dict(document)


def save_scene(scene: Scene, path: str | os.PathLike[str]) -> None:
    """Write a scene to a TOML file, every value spelt out."""
    write_document(scene_to_dict(scene), path)


def read_document(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Return a whole scene file as parsed, its top level checked."""
    document = read_toml(path)
    with errors_in(path):
        check_document(document)
    return document


def read_toml(path: str | os.PathLike[str], kind: str = "scene") -> dict[str, Any]:
    """Return any TOML file as parsed; raises `SceneError` with its line where it is none.

    `kind` is what a missing file would be.
    """
    path = Path(path)
    try:
        text = path.read_bytes().decode("utf-8-sig")
        return tomllib.loads(text)
    except FileNotFoundError:
        raise SceneError(f"{path}: no such file; {_files_beside(path, kind)}") from None
    except OSError as error:
        raise SceneError(f"{path}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError as error:
        raise SceneError(f"{path}: is not UTF-8 text (byte {error.start})") from None
    except ValueError as error:  # syntax, with its line; also integers too long for Python
        end = f"at the end of the file, line {len(text.splitlines())}"
        reason = str(error).replace("at end of document", end)
        raise SceneError(f"{path}: is not valid TOML: {reason}") from None


def write_document(document: Mapping[str, Any], path: str | os.PathLike[str]) -> None:
    """Write a TOML file beside its place, then rename: a crash leaves the last good one."""
    import tomli_w  # here, because reading does not need it

    with replacing(path) as beside:
        beside.write_bytes(tomli_w.dumps(document).encode())


def check_document(document: dict[str, Any]) -> None:
    """Check the schema version and the names of the tables; those of commands stay raw."""
    top = Table(document, "the scene file")
    schema = top.raw("schema", SCHEMA_VERSION)
    if type(schema) is not int or schema != SCHEMA_VERSION:
        raise top.error("schema", schema, f"{SCHEMA_VERSION}, the only version known here")
    top.string("title", "")
    for name in TABLES + OTHER_TABLES:
        top.table(name)
    for name in document:
        if name in MISPLACED:
            raise SceneError(f"[{name}] at the top of the file: write {MISPLACED[name]}")
    top.finish()


def scene_from_dict(document: dict[str, Any]) -> Scene:
    """Return the scene of a parsed scene file."""
    check_document(document)
    top = Table(document, "the scene file")
    model, actuation = top.table("model"), top.table("actuation")
    strains = model.strings("strains", STRAINS, allowed=STRAINS)
    slots: dict[str, Any] = {
        "manipulator": manipulator_from_dict(document),
        "segments": model.integer("segments", 1, low=1, high=MAX_SEGMENTS),
        "kinematics": _pick(model, "kinematics", KINEMATICS, ConstantStrainArc.name),
        "formulation": _read_formulation(model),
        "effects": read_effects(top.table("effects"), strains) + _read_load(top.table("load")),
        "actuation": _pick(actuation, "kind", ACTUATIONS, HydraulicDrive.name),
    }
    model.finish()
    actuation.finish()
    return Scene(strains=strains, **slots)


def scene_to_dict(scene: Scene) -> dict[str, Any]:
    """Return a scene as the tables of a scene file; `scene_from_dict` gives an equal scene.

    Unit angles given in radians may move by one rounding, because the file has degrees.
    """
    formulation, load = scene.formulation, scene.effect(TipLoad)
    model = {"segments": scene.segments, "kinematics": scene.kinematics.name}
    model |= {"formulation": formulation.name, "mass": formulation.mass.name}
    model |= {"elasticity": formulation.elasticity.name, "strains": list(scene.strains)}
    document: dict[str, Any] = {"schema": SCHEMA_VERSION, **manipulator_to_dict(scene.manipulator)}
    document |= {"model": model, "effects": write_effects(scene.effects)}
    document["actuation"] = {"kind": scene.actuation.name}
    if load:
        document["load"] = {"tip_force": list(load.force), "tip_moment": list(load.moment)}
    with errors_in("this scene has a part that scene files do not know"):
        read_back = scene_from_dict(document).with_(manipulator=scene.manipulator)
    if read_back != scene:
        raise SceneError("this scene has a part that scene files do not know: save its own code")
    return document


def _pick(table: Table, key: str, options: Mapping[str, T], default: str) -> T:
    return options[table.string(key, default, options)]


def _read_formulation(model: Table) -> Formulation:
    """Read the formulation and those of its parts that are given."""
    kind = _pick(model, "formulation", FORMULATIONS, VirtualPower.name)
    given: dict[str, Any] = {}
    if "elasticity" in model:
        given["elasticity"] = ELASTICITIES[model.string("elasticity", allowed=ELASTICITIES)]
    if "mass" in model:
        given["mass"] = MASSES[model.string("mass", allowed=MASSES)]
    if issubclass(kind, NewtonEuler) and given.pop("mass", LumpedMass()) != LumpedMass():
        wanted = "'lumped' (or left out) with newton-euler: use virtual-power for Gauss points"
        raise model.error("mass", model.raw("mass"), wanted)
    return kind(**given)


def _read_load(table: Table) -> tuple[Effect, ...]:
    force = table.vector("tip_force", 3, ZERO, unit="N")
    moment = table.vector("tip_moment", 3, ZERO, unit="N·m")
    table.finish()
    return (TipLoad(force, moment),) if "tip_force" in table or "tip_moment" in table else ()


def _files_beside(path: Path, kind: str) -> str:
    """Say which files of the kind may be in the folder of a missing one."""
    names = sorted(item.name for item in path.parent.glob("*.toml"))
    names = [name for name in names if name != "pyproject.toml"]
    if not names:
        return f"the folder {path.parent} has no {kind} file"
    by_stem = {Path(name).stem: name for name in names}  # all names are alike in .toml
    near = nearest(path.stem, by_stem)
    hint = f"did you mean {by_stem[near]!r}? " if near else ""
    shown = ", ".join(names[:10]) + (", …" if len(names) > 10 else "")
    return f"{hint}{kind} files there: {shown}"
