"""The arm in motion: section tips over the scene's motion against a fine model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar

from softmpc.accuracy.configuration import Configuration, Task
from softmpc.accuracy.family import Family, Numbers
from softmpc.errors import SceneError

__all__ = ["Motion"]


class Motion(Family):
    """The arm in motion: section tips over the scene's motion against a fine model."""

    name: ClassVar[str] = "motion"
    about: ClassVar[str] = "Tip error over the scene's motion; time to simulate it."
    error_label: ClassVar[str] = "largest tip error in motion (m)"
    cost_label: ClassVar[str] = "wall time a simulated second (s)"

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
