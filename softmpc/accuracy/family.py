"""A family of measurements: configurations whose errors and costs can be compared."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

from softmpc.accuracy.configuration import Configuration, Task

__all__ = ["Family"]

Numbers = dict[str, Any]  # plain data, for it is kept as JSON


class Family(ABC):
    """What is compared with what, and how.

    References come first, then errors against them, each configuration in any process; costs come
    last, one after the other in a process with a core of its own. All raise `SoftmpcError` where
    something cannot be done, which becomes the status of the point.
    """

    name: ClassVar[str]  # "rest"
    about: ClassVar[str]  # one sentence for people: what the error and the cost are
    error_label: ClassVar[str]  # of axes, with its unit
    cost_label: ClassVar[str]

    def fitted(self, axis: str) -> tuple[str, ...]:
        """Keys of `error` that have an order of convergence along the series of an axis."""
        return ("error_m",)

    @abstractmethod
    def missing(self, task: Task) -> str:
        """Why this family cannot be measured with the scene; empty where it can."""

    @abstractmethod
    def configurations(self, task: Task) -> Sequence[Configuration]:
        """All there is to measure; the first one is the scene as given."""

    @abstractmethod
    def references(self, task: Task) -> Sequence[str]:
        """Names of what errors are measured against; those of one study are found in any order."""

    @abstractmethod
    def reference(self, task: Task, name: str) -> Numbers:
        """One of them. An entry "about" is shown to people."""

    @abstractmethod
    def error(
        self, task: Task, configuration: Configuration, references: Mapping[str, Numbers]
    ) -> Numbers:
        """How far off a configuration is.

        `error_m` (m) is the one in pictures: everything that differs from the reference, the
        configuration's own integration included. `doubt_m` is how far the reference itself moves
        when it is one step coarser. What cannot be called an error, like an effect added, has
        `change_m` from the scene as given instead. Others may stand beside.
        """

    @abstractmethod
    def cost(self, task: Task, configuration: Configuration) -> Numbers:
        """What it takes: `time_s` (median), `spread_s` (between quartiles), `ratio` to the scene as
        given in the same process and by turns, and others beside. Called in a fresh process."""
