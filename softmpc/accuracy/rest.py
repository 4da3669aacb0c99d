"""The arm at rest: postures and frequencies against a rod that shares no code with the model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar

from softmpc.accuracy.configuration import Configuration, Task
from softmpc.accuracy.family import Family, Numbers
from softmpc.errors import SceneError

__all__ = ["Rest"]


class Rest(Family):
    """The arm at rest: postures and frequencies against a rod without segments."""

    name: ClassVar[str] = "rest"
    about: ClassVar[str] = (
        "error of the tip at rest and of frequencies, against a rod; cost of the model's functions"
    )
    error_label: ClassVar[str] = "largest tip error at rest (m)"
    cost_label: ClassVar[str] = "residual and its Jacobian, one call (s)"

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
