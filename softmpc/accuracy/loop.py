"""The arm under control: the tip on its path, on a fine plant."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar

from softmpc.accuracy.configuration import Configuration, Task
from softmpc.accuracy.family import Family, Numbers
from softmpc.errors import SceneError

__all__ = ["Loop"]


class Loop(Family):
    """The arm under control: the tip on its path, on a fine plant."""

    name: ClassVar[str] = "loop"
    about: ClassVar[str] = (
        "closed-loop error of the tip on a plant with more segments; time of a controller step"
    )
    error_label: ClassVar[str] = "largest tip error in closed loop (m)"
    cost_label: ClassVar[str] = "controller step, 95 % (s)"

    def missing(self, task: Task) -> str:
        return "not written yet"

    def configurations(self, task: Task) -> Sequence[Configuration]:
        return []

    def references(self, task: Task) -> Sequence[str]:
        return []

    def reference(self, task: Task, name: str) -> Numbers:
        raise SceneError(self.missing(task))

    def error(
        self, task: Task, configuration: Configuration, references: Mapping[str, Numbers]
    ) -> Numbers:
        raise SceneError(self.missing(task))

    def cost(self, task: Task, configuration: Configuration) -> Numbers:
        raise SceneError(self.missing(task))
