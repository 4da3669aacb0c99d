"""The cheapest configuration of a scene that is within a tolerance and keeps a rate."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from softmpc.accuracy.candidates import (
    Candidate,
    Option,
    Space,
    motion_space,
    rest_space,
    undominated,
    valid,
)
from softmpc.accuracy.candidates_loop import loop_space
from softmpc.accuracy.choose_families import CONFIRM, CONFIRMED, GOALS, Choosing
from softmpc.accuracy.choose_loop import plant_changes
from softmpc.accuracy.choose_rate import AtRate, at_rate, step_time_s
from softmpc.accuracy.choose_reasons import reasons
from softmpc.accuracy.choose_result import Choice, Evidence, Goal
from softmpc.accuracy.configuration import Configuration, Task, changed
from softmpc.accuracy.machine import describe_machine
from softmpc.accuracy.points import Point
from softmpc.accuracy.store import Store
from softmpc.accuracy.study import Progress, Run, Stage
from softmpc.accuracy.work import COST, ERROR, MEASURED, REFERENCE, Case
from softmpc.errors import InputError, unknown_name

if TYPE_CHECKING:
    from concurrent.futures import Executor

__all__ = ["choose", "goal_of"]

BY_TABLE = {"track": "loop", "simulate": "motion"}  # table of a scene -> what it is for
MOST_TIMED = {"rest": 8, "motion": 6, "loop": 3}  # of those within the tolerance
MOST_FAILED = {"rest": 3, "motion": 3, "loop": 1}  # cheaper ones, to show what they would save
EQUAL = 1.05  # two ratios that differ by less are the same
MODES = {"rest": "never", "motion": "never", "loop": "auto"}  # of compilation, of times


def choose(
    task: Task,
    tolerance_m: float,
    *,
    rate_hz: float | None = None,
    goal: str | None = None,
    keep: str | os.PathLike[str] | None = None,
    fresh: bool = False,
    executor: Executor | int | None = None,
    stage: Stage | None = None,
) -> Choice:
    """The cheapest candidate whose bound on the error is within `tolerance_m` (m).

    `goal` is "rest", "motion" or "loop"; by default what the scene has, [track] before [simulate].
    With `rate_hz` (Hz) what it is for has to fit into 1/rate: a step of the controller, advancing
    the motion by that time, a call at rest. Errors are measured on `executor` as in `sweep`, then
    the times of those that can win on this machine alone. `keep` is a file of measurements as of a
    study, from which a choice goes on unless it is to start `fresh`. `stage(what)` gives the
    progress report of each part.

    Ctrl-C ends it with the status "interrupted". Raises `InputError` for numbers out of range, and
    where the scene lacks what the goal needs.
    """
    if not tolerance_m > 0:
        raise InputError(f"tolerance = {tolerance_m!r} m: must be above 0")
    if rate_hz is not None and not rate_hz > 0:
        raise InputError(f"rate = {rate_hz!r} Hz: must be above 0")
    asked = Goal(goal_of(task, goal), tolerance_m, rate_hz)
    search = _Search(task, asked, Run(task, Store(keep, task, fresh), executor, stage or _nobody))
    try:
        search.measure()
        return search.choice()
    except KeyboardInterrupt:
        return search.choice("interrupted")


def goal_of(task: Task, asked: str | None = None) -> str:
    """The family of measurements that decides: the one asked for, or what the scene has.

    Raises `InputError` for unknown names, and where the family cannot be measured with the scene.
    """
    if asked is not None and asked not in GOALS:
        raise InputError(unknown_name("goal", asked, GOALS))
    has = [goal for table, goal in BY_TABLE.items() if table in task.document]
    goal = asked or [*has, "rest"][0]
    missing = GOALS[goal].missing(task)
    if missing:
        raise InputError(f"nothing can be chosen for {goal!r}: {missing}")
    return goal


class _Search:
    """Candidates tried so far, with their errors and times."""

    def __init__(self, task: Task, goal: Goal, run: Run) -> None:
        self.task, self.goal, self.run = task, goal, run
        self.space = _space(task, goal)
        self.tried: list[Candidate] = []
        self.references: dict[str, Any] = {}
        self.base: Candidate | None = None  # the cheapest with nothing left out

    def measure(self) -> None:
        """Errors round by round, then times; raises `KeyboardInterrupt` when interrupted."""
        family = self.goal.family
        cases = [Case(family, REFERENCE, name) for name in GOALS[family].references(self.task)]
        self.run.sweep_cases("references", cases, Choosing(self.task))
        self.references = {case.name: self.run.found(case.key) for case in cases}
        for name, found in self.references.items():
            if found["status"] != MEASURED:
                raise InputError(f"there is no reference {name!r}: {found['status']}")
        for candidates in self.space.rounds:
            self._try(candidates)
            if self._within():
                self.base = min(undominated(self._within()), key=_weight)
                self._combine(self.base)
                break
        self._time()
        self._confirm()

    def _try(self, candidates: Iterable[Candidate]) -> None:
        """Measure the errors of candidates; those that are the same scene only once."""
        family, known = self.goal.family, [one.configuration.identity for one in self.tried]
        fresh = {one.configuration.identity: one for one in candidates}
        new = [one for identity, one in fresh.items() if identity not in known]
        self.tried += new
        work = Choosing(self.task, {family: self.references})
        cases = [Case(family, ERROR, configuration=one.configuration) for one in new]
        self.run.sweep_cases("errors", cases, work)

    def _combine(self, base: Candidate) -> None:
        """Make the base coarser in everything that it bears, those first that save most."""
        extras = valid(self.task, self.space.extras)
        self._try(base.with_(extra) for extra in extras)
        good = [extra for extra in extras if self._evidence(base.with_(extra)).within]
        left = _one_a_slot(sorted(good, key=lambda extra: extra.share))
        kept: list[Option] = []
        while left:
            count = self._most(base, extras, kept, left)
            kept, left = kept + left[:count], left[count + 1 :]

    def _most(
        self, base: Candidate, extras: list[Option], kept: list[Option], left: list[Option]
    ) -> int:
        """How many of what is left go with what is kept: all of them, or found by halving."""
        low, high = 0, len(left)
        count = high
        while low < high:
            together = [*kept, *left[:count]]
            one = base.with_(*(extra for extra in extras if extra in together))
            self._try([one])
            low, high = (count, high) if self._evidence(one).within else (low, count - 1)
            count = (low + high + 1) // 2
        return low

    def _time(self) -> None:
        """Times of those that can be the cheapest, and of some cheaper ones that failed.

        Also of the base: where what is left out of it saves nothing it is better left in.
        """
        family = self.goal.family
        light = sorted(undominated(self._within()), key=_weight)[: MOST_TIMED[family]]
        light += [self.base] if self.base and self.base not in light else []
        cases = [_cost(family, one.configuration) for one in (*light, *self._nearly(light))]
        quick = replace(self.task, quick=True)  # the first seconds, all by one process
        self.run.time_cases(cases, Choosing(quick))
        if self.goal.rate_hz is not None and family == "motion":
            cases = [at_rate(case, self.goal.rate_hz) for case in cases[: len(light)]]
            self.run.time_cases(cases, AtRate(quick, rate_hz=self.goal.rate_hz))

    def _confirm(self) -> None:
        """Measure what is the best with a doubt of its own, until it is the best with that too."""
        if self.goal.family not in CONFIRMED:
            return
        while best := _best(map(self._evidence, self.tried)):
            case = Case(self.goal.family, CONFIRM, configuration=best.configuration)
            if self.run.found(case.key):
                return
            self.run.sweep_cases("confirmation", [case], Choosing(self.task))

    def _nearly(self, light: Sequence[Candidate]) -> list[Candidate]:
        """Cheaper ones that are not within the tolerance, those first that nearly are."""
        least = min(map(_weight, light), default=0.0)
        found = [one for one in self.tried if one.weight < least]
        bounds = [self._evidence(one).bound_m for one in found]
        near = sorted((bound, i) for i, bound in enumerate(bounds) if bound is not None)
        return [found[i] for _, i in near[: MOST_FAILED[self.goal.family]]]

    def _within(self) -> list[Candidate]:
        return [one for one in self.tried if self._evidence(one).within]

    def _evidence(self, candidate: Candidate) -> Evidence:
        family, own = self.goal.family, candidate.configuration
        parts = (self.run.found(Case(family, part, configuration=own).key)
                 for part in (CONFIRM, ERROR))  # fmt: skip
        error = next(filter(None, parts), {})
        case = _cost(family, own)
        cost = self.run.found(self.run.cost_key(case))
        if self.goal.rate_hz is not None and family == "motion":
            case = at_rate(case, self.goal.rate_hz)
        step = step_time_s(family, self.run.found(self.run.cost_key(case)))
        return Evidence(self.goal, Point(own, error, cost), step)

    def choice(self, status: str = "") -> Choice:
        """What there is to choose, or why there is nothing."""
        evidence = tuple(map(self._evidence, self.tried))
        chosen = None if status == "interrupted" else _best(evidence)
        return Choice(
            title=self.task.title,
            status=status or ("chosen" if chosen else "refused"),
            goal=self.goal,
            evidence=evidence,
            references={name: str(one["about"]) for name, one in self.references.items()},
            machine=describe_machine(),
            chosen=chosen,
            reasons=() if chosen or status else reasons(self.goal, evidence),
            document={} if chosen is None else self._document(chosen),
        )

    def _document(self, chosen: Evidence) -> dict[str, Any]:
        """The scene file of what is chosen; a loop's has the plant of the evidence."""
        document = chosen.configuration.document(self.task)
        plant = plant_changes(self.task) if self.goal.family == "loop" else {}
        return changed(document, plant)


def _nobody(_: str) -> Progress:
    return lambda done, total: None


def _space(task: Task, goal: Goal) -> Space:
    if goal.family == "loop":
        return loop_space(task, goal.rate_hz)
    return (rest_space if goal.family == "rest" else motion_space)(task, goal.tolerance_m)


def _best(evidence: Iterable[Evidence]) -> Evidence | None:
    """Of those that are equally fast, but for what nobody can tell, the most accurate one."""
    fit = sorted((one for one in evidence if one.within and one.fast), key=lambda one: one.order)
    equal = [one for one in fit if one.order <= EQUAL * fit[0].order]
    return min(equal, key=lambda one: one.bound_m or 0.0, default=None)


def _weight(candidate: Candidate) -> float:
    return candidate.weight


def _cost(family: str, configuration: Configuration) -> Case:
    return Case(family, COST, configuration=replace(configuration, compile=MODES[family]))


def _one_a_slot(options: Iterable[Option]) -> list[Option]:
    """The first option of each slot."""
    found: dict[str, Option] = {}
    for option in options:
        found.setdefault(option.slot, option)
    return list(found.values())
