"""The families of a choice: those of a study, against references that take less time."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from softmpc.accuracy.candidates_loop import PREFIX
from softmpc.accuracy.choose_loop import doubted_error, loop_error, plant_of
from softmpc.accuracy.configuration import Configuration, Task
from softmpc.accuracy.environment import environment
from softmpc.accuracy.family import Family, Numbers
from softmpc.accuracy.loop import DOUBT, Loop
from softmpc.accuracy.loop_task import coarser
from softmpc.accuracy.motion import Motion
from softmpc.accuracy.motion_reference import AS_GIVEN, COARSER, FINE, limit, reference
from softmpc.accuracy.rest import Rest
from softmpc.accuracy.rest_references import posture_names
from softmpc.accuracy.work import COST, REFERENCE, Case, Measure

__all__ = ["CONFIRM", "CONFIRMED", "FINEST", "GOALS", "Choosing"]

COUNTS = {FINE: (3, 4, 6), COARSER: (2, 3, 4)}  # segments a section that are extrapolated from
FINEST = 6  # of any model that a choice runs
PATIENCE = 1200.0  # s that one of the references may take
TYPICAL = {f"{PREFIX}model.segments": 2}  # the controller whose doubt others have at first
CONFIRM = "confirm"  # the part of a case that measures an error with a doubt of its own


class _Rest(Rest):
    """The postures alone, without frequencies."""

    def references(self, task: Task) -> Sequence[str]:
        return posture_names(task)


class _Motion(Motion):
    """The whole motion, against fewer segments."""

    def references(self, task: Task) -> Sequence[str]:
        return FINE, COARSER, AS_GIVEN

    def reference(self, task: Task, name: str) -> Numbers:
        if name in COUNTS:
            return limit(task, COUNTS[name], PATIENCE)
        return reference(task, name)


class _Loop(Loop):
    """The whole path, on a plant of fewer segments.

    Errors have the doubt of one controller, which each would take two more runs to find of its own.
    What is chosen has its own, see `CONFIRMED`.
    """

    def reference(self, task: Task, name: str) -> Numbers:
        plant = plant_of(task)
        less = coarser(plant).segments
        if name == DOUBT:
            own = Configuration("reference", name, TYPICAL)
            about = (
                f"the doubt of others than the one chosen is that of a controller with 2 segments "
                f"a section: what a plant with {less} makes of its error"
            )
            return doubted_error(task, own) | {"about": about}
        mass = plant.formulation.mass.name
        about = (
            f"a plant with {plant.segments} segments a section, {mass} mass; its doubt is what one "
            f"with {less} makes of the error of what is chosen"
        )
        return {"about": about}

    def error(
        self, task: Task, configuration: Configuration, references: Mapping[str, Numbers]
    ) -> Numbers:
        return loop_error(task, configuration) | {"doubt_m": references[DOUBT]["doubt_m"]}


GOALS: dict[str, Family] = {family.name: family for family in (_Rest(), _Motion(), _Loop())}
# What is chosen is measured again by these, with a doubt of its own where errors share one.
CONFIRMED: dict[str, Callable[[Task, Configuration], Numbers]] = {"loop": doubted_error}


@dataclass(frozen=True)
class Choosing(Measure):
    """The work of a choice. Errors are found in CasADi's virtual machine: one run of each model
    takes less time than its compiler would."""

    def __call__(self, case: Case) -> dict[str, Any]:
        if case.part == COST:
            return super().__call__(case)
        with environment(SOFTMPC_COMPILE="never"):
            return super().__call__(case)

    def _numbers(self, case: Case) -> dict[str, Any]:
        family = GOALS[case.family]
        if case.part == REFERENCE:
            return family.reference(self.task, case.name)
        if case.part == COST:
            return family.cost(self.task, case.configuration)
        if case.part == CONFIRM:
            return CONFIRMED[case.family](self.task, case.configuration)
        return family.error(self.task, case.configuration, self.references[case.family])
