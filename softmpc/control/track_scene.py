"""The table [track] of a scene file: path, controller and plant."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from softmpc.control.controller_table import ControllerSettings, read_controller
from softmpc.control.paths import Reference
from softmpc.control.planned import motion_of
from softmpc.control.track_paths import read_reference
from softmpc.errors import SceneError, errors_in
from softmpc.model.model import Model
from softmpc.model.scene import Scene
from softmpc.model.scene_file import TABLES, read_document, scene_from_dict
from softmpc.model.tables import Table
from softmpc.simulation.integrator import Integrator
from softmpc.simulation.methods import METHODS, Method

__all__ = ["ON_INFEASIBLE", "Plant", "Tracking", "read_tracking"]

ON_INFEASIBLE = ("stop", "project")
PLANT_TOLERANCE = 1e-8


@dataclass(frozen=True)
class Plant:
    """What the controller acts on: a scene (None: that of the file) and its integration."""

    scene: Scene | None = None
    method: Method = field(default_factory=lambda: Method("idas", tolerance=PLANT_TOLERANCE))

    def integrator(self, model: Model) -> Integrator:
        return self.method.integrator(model)


@dataclass(frozen=True)
class Tracking:
    """A tracking task. `settle` (s): errors before it do not count."""

    reference: Reference
    settle: float = 1.0
    controller: ControllerSettings = field(default_factory=ControllerSettings)
    plant: Plant = field(default_factory=Plant)
    on_infeasible: str = "stop"


def read_tracking(
    data: object, folder: Path, document: Mapping[str, Any] | None = None
) -> Tracking:
    """The [track] table; files it names are looked for in `folder`.

    `document` is the scene file around it, which the scenes of controller and plant change; for a
    scene made in Python it is `scene_to_dict(scene)`.
    """
    table = Table(data, "[track]")
    reference = read_reference(table, folder)
    planned = motion_of(reference) is not None
    settle = table.number("settle", 0.0 if planned else 1.0, unit="s", low=0.0, high=3600.0)
    if settle >= reference.duration:
        raise SceneError(
            f"[track] settle = {settle:g} s: must be below the duration of the run, "
            f"{reference.duration:g} s, or no error is left to count"
        )
    on_infeasible = table.string("on_infeasible", "stop", ON_INFEASIBLE)
    controller, plant = (
        Table(table.raw(name, {}), f"[track.{name}]") for name in ("controller", "plant")
    )
    table.finish()
    own = None
    if document is not None:
        own = {name: part for name, part in document.items() if name in TABLES}
    settings = read_controller(controller, _other_scene(controller, own, folder))
    controller.finish()
    if "feed_forward" in controller and not planned:
        raise SceneError(
            "[track.controller] feed_forward: only a plan has torques to feed forward; leave it "
            'out, or set path = "plan" in [track]'
        )
    method = _read_method(plant)
    scene = _other_scene(plant, own, folder)
    plant.finish()
    return Tracking(reference, settle, settings, Plant(scene, method), on_infeasible)


def _read_method(table: Table) -> Method:
    name = table.string("method", "idas", METHODS)
    ranges: dict[str, dict[str, Any]] = {
        "tip_tolerance": {"unit": "m", "low": 1e-12, "high": 0.1},
        "tolerance": {"low": 1e-13, "high": 1e-2},
        "step": {"unit": "s", "low": 1e-6, "high": 1.0},
    }
    given = {key: table.number(key, **span) for key, span in ranges.items() if key in table}
    if not given and "tolerance" in METHODS[name]:
        given = {"tolerance": PLANT_TOLERANCE}
    with errors_in(table.where):
        return Method(name, **given)


def _other_scene(table: Table, own: Mapping[str, Any] | None, folder: Path) -> Scene | None:
    """Another file, or changes of this one; None where the table has neither."""
    given = table.raw("scene", None)
    if given is None:
        return None
    where = f"{table.where} scene"
    if isinstance(given, str):
        path = folder / given
        document = read_document(path)
        with errors_in(path):
            return scene_from_dict(document)
    if not isinstance(given, dict):
        raise table.error(
            "scene", given, "a file in quotes or a table of changes, {model = {segments = 1}}"
        )
    if own is None:
        raise SceneError(
            f"{where} changes a scene that is not known here: give read_tracking the document, "
            "such as scene_to_dict(scene)"
        )
    with errors_in(where):
        return scene_from_dict(_changed(own, given))


def _changed(own: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Tables with some keys changed, in tables below as well."""
    merged = dict(own)
    for key, value in changes.items():
        before = merged.get(key)
        both = isinstance(value, dict) and isinstance(before, dict)
        merged[key] = _changed(before, value) if both else value  # type: ignore[arg-type]
    return merged
