"""A study: all configurations of a scene along all axes, measured and put together."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from softmpc.accuracy.alone import KILLED, measure_alone
from softmpc.accuracy.configuration import Configuration, Task
from softmpc.accuracy.families import FAMILIES
from softmpc.accuracy.machine import describe_machine, fingerprint
from softmpc.accuracy.points import FamilyResult, Point, Study
from softmpc.accuracy.store import Store
from softmpc.accuracy.work import COST, ERROR, MEASURED, REFERENCE, Case, Measure
from softmpc.errors import InputError, WorkerKilledError, errors_in, unknown_name
from softmpc.model.scene_file import read_document, scene_from_dict
from softmpc.sweeps import sweep

if TYPE_CHECKING:
    from concurrent.futures import Executor

__all__ = ["Progress", "Run", "Stage", "read_task", "run_study"]

Progress = Callable[[float, float], None]
Stage = Callable[[str], Progress]


def read_task(path: str | os.PathLike[str], quick: bool = False) -> Task:
    """The task of a scene file, checked as far as its scene goes."""
    document = read_document(path)
    with errors_in(path):
        scene_from_dict(document)
    return Task(document | {"title": document.get("title") or Path(path).stem},
                str(Path(path).resolve().parent), quick)  # fmt: skip


def run_study(
    task: Task,
    *,
    families: Iterable[str] | None = None,
    axes: Iterable[str] | None = None,
    keep: str | os.PathLike[str] | None = None,
    fresh: bool = False,
    executor: Executor | int | None = None,
    stage: Stage | None = None,
) -> Study:
    """Measure a scene along all its axes, or some.

    `families` and `axes` by name choose what is measured; all by default. `keep` is a file of
    finished measurements: the same study goes on from there and repeats none, unless it is to start
    `fresh`. References and errors are measured on `executor` as in `sweep`, costs on this machine
    alone, one after the other, when nothing else of the study runs. `stage(what)` gives the
    progress report of each part.

    Ctrl-C ends it with the status "interrupted" and what was measured until then. What cannot be
    measured has the reason for its status; where a worker was killed for it every time, the same
    study tries it again. Raises `InputError` for unknown names, a family by name that the scene
    does not have, nothing to measure, and a `keep` file of another study.
    """
    plans = _plans(task, families, axes)
    run = Run(task, Store(keep, task, fresh), executor, stage or _nobody)
    status = "finished"
    try:
        run.measure({name: plan.configurations for name, plan in plans.items()})
    except KeyboardInterrupt:
        status = "interrupted"
    results = tuple(
        run.result(name, plan.configurations, plan.missing) for name, plan in plans.items()
    )
    machine = describe_machine()
    return Study(task.title, status, task.quick, machine, results, dict(task.document))


@dataclass(frozen=True)
class _Plan:
    """What is measured of a family, the scene as given first; or why nothing is."""

    configurations: list[Configuration]
    missing: str = ""

    def along(self, axes: Iterable[str]) -> _Plan:
        """What is left of it along some axes."""
        kept = [one for one in self.configurations[1:] if one.axis in axes]
        if kept or self.missing:
            return replace(self, configurations=[*self.configurations[:1], *kept])
        return _Plan([], "has none of the axes asked for")


def _plans(
    task: Task, families: Iterable[str] | None, axes: Iterable[str] | None
) -> dict[str, _Plan]:
    """The plan of each family asked for, or of all."""
    plans = {}
    for name in _chosen("family", families, FAMILIES):
        missing = FAMILIES[name].missing(task)
        if missing and families is not None:
            raise InputError(f"family {name!r} cannot be measured: {missing}")
        plans[name] = _Plan([] if missing else [*FAMILIES[name].configurations(task)], missing)
    if not any(plan.configurations for plan in plans.values()):
        reasons = "; ".join(f"{name}: {plan.missing}" for name, plan in plans.items())
        raise InputError(f"nothing of this scene can be measured: {reasons}")
    if axes is None:
        return plans
    known = (one.axis for plan in plans.values() for one in plan.configurations[1:])
    measured = [name for name, plan in plans.items() if plan.configurations]
    what = "axis" if len(measured) == len(FAMILIES) else f"axis of {' and '.join(measured)}"
    wanted = _chosen(what, axes, dict.fromkeys(known))
    return {name: plan.along(wanted) for name, plan in plans.items()}


def _chosen(what: str, names: Iterable[str] | None, known: Iterable[str]) -> list[str]:
    known = list(known)
    asked = known if names is None else list(names)
    for name in asked:
        if name not in known:
            raise InputError(unknown_name(what, name, known))
    return [name for name in known if name in asked]


class Run:
    """The measurements of one study or choice, as far as they are there."""

    def __init__(
        self, task: Task, store: Store, executor: Executor | int | None, stage: Stage
    ) -> None:
        self.task, self.store, self.executor, self.stage = task, store, executor, stage
        self.here = fingerprint()

    def measure(self, plans: dict[str, list[Configuration]]) -> None:
        """Everything that is not there yet; raises `KeyboardInterrupt` when interrupted.

        A family without one of its references is left out.
        """
        references = [
            Case(name, REFERENCE, one)
            for name, plan in plans.items()
            for one in (FAMILIES[name].references(self.task) if plan else ())
        ]
        self.sweep_cases("references", references, Measure(self.task))
        plans = {name: plan for name, plan in plans.items() if plan and not self.unknown(name)}
        work = Measure(self.task, {name: self.known(name) for name in plans})
        self.sweep_cases("errors", self._cases(plans, ERROR), work)
        self.time_cases(self._cases(plans, COST), Measure(self.task))

    def _cases(self, plans: dict[str, list[Configuration]], part: str) -> list[Case]:
        cases = [
            Case(name, part, configuration=one) for name, plan in plans.items() for one in plan
        ]
        return list({case.key: case for case in cases}.values())

    def known(self, family: str) -> dict[str, Any]:
        """The references of a family, raises `InputError` where one could not be had."""
        if reason := self.unknown(family):
            raise InputError(f"{family}: {reason}")
        names = FAMILIES[family].references(self.task)
        return {name: self.store[Case(family, REFERENCE, name).key] for name in names}

    def unknown(self, family: str) -> str:
        """Why a reference of a family could not be had; empty where there is none such."""
        for name in FAMILIES[family].references(self.task):
            status = self.found(Case(family, REFERENCE, name).key).get("status", MEASURED)
            if status != MEASURED:
                return f"there is no reference {name!r}: {status}"
        return ""

    def sweep_cases(self, what: str, cases: Sequence[Case], work: Measure) -> None:
        """Measure those cases that are not there yet, on the executor."""
        report = self.stage(what)
        while True:
            # The last families take longest: begun last, they would leave cores idle at the end.
            left = [case for case in reversed(cases) if case.key not in self.store]
            try:
                self._sweep(left, work, partial(_shifted, report, len(cases) - len(left)))
                return
            except WorkerKilledError as error:
                self.keep(left[error.case], {"status": KILLED})

    def _sweep(self, cases: Sequence[Case], work: Measure, progress: Progress) -> None:
        def arrived(i: int, result: Any) -> None:
            self.keep(cases[i], result)

        sweep(work, cases, executor=self.executor, chunk=1, progress=progress, arrived=arrived)

    def keep(self, case: Case, result: dict[str, Any]) -> None:
        """Keep a result, for this run only where it was killed: another run may have luck."""
        key = self.cost_key(case) if case.part == COST else case.key
        if result["status"] == KILLED:
            self.store.results[key] = result
        else:
            self.store.add(key, result)

    def time_cases(self, cases: Sequence[Case], work: Measure) -> None:
        """Measure costs, one after the other and alone."""
        report = self.stage("times")
        left = [case for case in cases if self.cost_key(case) not in self.store]
        done = len(cases) - len(left)
        report(done, len(cases))

        def arrived(case: Case, result: dict[str, Any]) -> None:
            nonlocal done
            self.keep(case, result)
            done += 1
            report(done, len(cases))

        measure_alone(work, left, arrived)

    def cost_key(self, case: Case) -> str:
        """Under which a cost is kept: times are those of this machine."""
        return f"{case.key} on {self.here}"

    def result(self, name: str, plan: Sequence[Configuration], missing: str = "") -> FamilyResult:
        """What is known of a family; `missing` says why nothing is."""
        family = FAMILIES[name]
        missing = missing or self.unknown(name)
        points = []
        for one in plan if not missing else ():
            error = Case(name, ERROR, configuration=one).key
            cost = self.cost_key(Case(name, COST, configuration=one))
            points.append(Point(one, self.found(error), self.found(cost)))
        about = {
            one: str(self.found(Case(name, REFERENCE, one).key).get("about", ""))
            for one in (family.references(self.task) if plan else ())
        }
        return FamilyResult(name, about, tuple(points), missing)

    def found(self, key: str) -> dict[str, Any]:
        """A result by its key, empty where it is not there."""
        return dict(self.store[key]) if key in self.store else {}


def _shifted(report: Progress, before: int, done: float, total: float) -> None:
    report(before + done, before + total)


def _nobody(_: str) -> Progress:
    return lambda done, total: None
