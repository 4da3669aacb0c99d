"""The families of a choice: those of a study, against references that take less time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from softmpc.accuracy.choose_loop import loop_error, plant_of
from softmpc.accuracy.configuration import Configuration, Task
from softmpc.accuracy.family import Family, Numbers
from softmpc.accuracy.loop import Loop
from softmpc.accuracy.loop_task import coarser
from softmpc.accuracy.motion import Motion
from softmpc.accuracy.motion_reference import AS_GIVEN, COARSER, FINE, limit, reference
from softmpc.accuracy.rest import Rest
from softmpc.accuracy.work import COST, REFERENCE, Case, Measure

__all__ = ["FINEST", "GOALS", "Choosing"]

COUNTS = {FINE: (3, 4, 6), COARSER: (2, 3, 4)}  # segments a section that are extrapolated from
FINEST = 6  # of any model that a choice runs
PATIENCE = 1200.0  # s that one of the references may take


class _Motion(Motion):
    """The whole motion, against fewer segments; times of its first seconds."""

    def references(self, task: Task) -> Sequence[str]:
        return FINE, COARSER, AS_GIVEN

    def reference(self, task: Task, name: str) -> Numbers:
        if name in COUNTS:
            return limit(task, COUNTS[name], PATIENCE)
        return reference(task, name)

    def cost(self, task: Task, configuration: Configuration) -> Numbers:
        return super().cost(replace(task, quick=True), configuration)


class _Loop(Loop):
    """The whole path, on a plant of fewer segments; times of the first steps."""

    def reference(self, task: Task, name: str) -> Numbers:
        plant = plant_of(task)
        return {
            "about": f"a plant with {plant.segments} segments a section, "
            f"{plant.formulation.mass.name} mass; in doubt by the difference from one with "
            f"{coarser(plant).segments}"
        }

    def error(
        self, task: Task, configuration: Configuration, references: Mapping[str, Numbers]
    ) -> Numbers:
        return loop_error(task, configuration)

    def cost(self, task: Task, configuration: Configuration) -> Numbers:
        return super().cost(replace(task, quick=True), configuration)


GOALS: dict[str, Family] = {family.name: family for family in (Rest(), _Motion(), _Loop())}


@dataclass(frozen=True)
class Choosing(Measure):
    """The work of a choice."""

    def _numbers(self, case: Case) -> dict[str, Any]:
        family = GOALS[case.family]
        if case.part == REFERENCE:
            return family.reference(self.task, case.name)
        if case.part == COST:
            return family.cost(self.task, case.configuration)
        return family.error(self.task, case.configuration, self.references[case.family])
