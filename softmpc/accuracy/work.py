"""One measurement of a study, wherever it is done."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from softmpc.accuracy.configuration import AS_GIVEN, Configuration, Task
from softmpc.accuracy.environment import environment
from softmpc.accuracy.families import FAMILIES
from softmpc.errors import SoftmpcError, is_interrupt
from softmpc.study.measure import reason

__all__ = ["MEASURED", "Case", "Measure"]

MEASURED = "measured"
REFERENCE, ERROR, COST = "reference", "error", "cost"
EXPECTED = SoftmpcError, RuntimeError, ArithmeticError, ValueError


@dataclass(frozen=True)
class Case:
    """A measurement: of a reference by its name, or the error or cost of a configuration."""

    family: str
    part: str
    name: str = ""
    configuration: Configuration = AS_GIVEN

    @property
    def key(self) -> str:
        """Under which its result is kept: the same for what gives the same result."""
        last = self.name if self.part == REFERENCE else self.configuration.identity
        return f"{self.family} {self.part} {last}"


@dataclass(frozen=True)
class Measure:
    """The work of a sweep: results are plain data with a `status`, never an exception."""

    task: Task
    references: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)  # family -> name

    def __call__(self, case: Case) -> dict[str, Any]:
        try:
            # Compiled or not, errors are the same; a quick study ends before a compiler has paid.
            if case.part != COST and not self.task.quick:
                return {"status": MEASURED, **self._numbers(case)}
            with environment(SOFTMPC_COMPILE=case.configuration.compile):
                return {"status": MEASURED, **self._numbers(case)}
        except Exception as error:  # one that cannot be measured leaves the others alone
            if is_interrupt(error):  # CasADi turns Ctrl-C into a RuntimeError
                raise KeyboardInterrupt from None
            known = isinstance(error, EXPECTED)
            return {"status": f"{'' if known else f'{type(error).__name__}: '}{reason(error)}"}

    def _numbers(self, case: Case) -> dict[str, Any]:
        family = FAMILIES[case.family]
        if case.part == REFERENCE:
            return family.reference(self.task, case.name)
        if case.part == COST:
            return family.cost(self.task, case.configuration)
        return family.error(self.task, case.configuration, self.references[case.family])
