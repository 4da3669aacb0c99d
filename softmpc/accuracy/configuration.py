"""What a study varies: a scene file with some of its keys changed."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass, field
from typing import Any

from softmpc.errors import SceneError
from softmpc.model.scene import Scene
from softmpc.model.scene_file import scene_from_dict

__all__ = ["AS_GIVEN", "Configuration", "Task", "changed"]

DIGITS = 16  # of a hash


@dataclass(frozen=True)
class Task:
    """The scene a study is about: its file as parsed, and the folder of the files it names.

    `quick`: fewer postures, parts of motions and coarser references, for a first look.
    """

    document: Mapping[str, Any]
    folder: str = "."
    quick: bool = False

    @property
    def title(self) -> str:
        return str(self.document.get("title", ""))

    @property
    def scene(self) -> Scene:
        """The scene of the file as given."""
        return scene_from_dict(dict(self.document))


@dataclass(frozen=True)
class Configuration:
    """One choice along an axis.

    `changes` are keys of the scene file, dotted, with their new values; None takes a key out.
    `variant` names what scene files cannot say, and `compile` is the mode of `softmpc.compiled`.
    Along a `series` something goes to zero, its `size`: the error does so with size^`order`, where
    theory says that (0: it does not converge).
    """

    axis: str
    name: str
    changes: Mapping[str, Any] = field(default_factory=dict)
    series: str = ""
    size: float | None = None
    order: float | None = None
    compile: str = "never"
    variant: str = ""

    @property
    def identity(self) -> str:
        """The same for configurations that are the same scene run in the same way."""
        told = json.dumps([dict(self.changes), self.compile, self.variant], sort_keys=True)
        return hashlib.sha256(told.encode()).hexdigest()[:DIGITS]

    def document(self, task: Task) -> dict[str, Any]:
        """The scene file with the changes."""
        return changed(task.document, self.changes)


AS_GIVEN = Configuration("", "")


def changed(document: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """A parsed scene file with other values of some dotted keys; None takes a key out.

    Raises `SceneError` where a part of the key before its last dot is no table.
    """
    made = deepcopy(dict(document))
    for key, value in changes.items():
        *tables, last = key.split(".")
        place: Any = made
        for name in tables:
            place = place.setdefault(name, {})
            if not isinstance(place, dict):
                raise SceneError(f"{key}: {name} is no table")
        if value is None:
            place.pop(last, None)
        else:
            place[last] = deepcopy(value)
    return made
