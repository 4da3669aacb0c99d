"""A small arm to plan for: one section, pressures that follow the torques at once."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from softmpc.model.scene import Scene
from softmpc.model.scene_file import scene_from_dict, write_document
from softmpc.planning.scene_table import Planning, read_planning

SCENE: dict[str, Any] = {
    "title": "Small swing",
    "manipulator": {"sections": 1},
    "effects": {"gravity": [0.0, 0.0, 9.81]},
    "actuation": {"kind": "static"},
}
GOAL: dict[str, Any] = {"tip": [0.03, 0.02, "-"]}
PLAN: dict[str, Any] = {
    "least": "time",
    "torque_rate": 20.0,
    "intervals": 6,
    "change": 0.2,
    "start": {"torques": [0.5, 0.0, 0.0]},
    "goals": [GOAL],
}


def scene(**tables: Any) -> Scene:
    return scene_from_dict({**SCENE, **tables})


def read(folder: Path, tables: dict[str, Any] | None = None, **plan: Any) -> Planning:
    """The small plan with other keys; those that are None are left out."""
    return read_planning(_given(plan), scene(**(tables or {})), folder)


def write(folder: Path, tables: dict[str, Any] | None = None, **plan: Any) -> Path:
    """The same as a scene file."""
    path = folder / "scene.toml"
    write_document({**SCENE, **(tables or {}), "plan": _given(plan)}, path)
    return path


def _given(plan: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in {**PLAN, **plan}.items() if value is not None}
