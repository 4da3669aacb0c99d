"""A study: all configurations of a scene along all axes, measured and put together."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from softmpc.accuracy.alone import measured_alone
from softmpc.accuracy.configuration import Configuration, Task
from softmpc.accuracy.families import FAMILIES
from softmpc.accuracy.machine import describe_machine, fingerprint
from softmpc.accuracy.points import FamilyResult, Point, Study
from softmpc.accuracy.store import Store
from softmpc.accuracy.work import COST, ERROR, MEASURED, REFERENCE, Case, Measure
from softmpc.errors import InputError, errors_in, unknown_name
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
    executor: Executor | int | None = None,
    stage: Stage | None = None,
) -> Study:
    """Measure a scene along all its axes, or some.

    `families` and `axes` by name choose what is measured; all by default. `keep` is a file of
    finished measurements: the same study goes on from there and repeats none. References and errors
    are measured on `executor` as in `sweep`, costs on this machine alone, one after the other, when
    nothing else of the study runs. `stage(what)` gives the progress report of each part.

    Ctrl-C ends it with the status "interrupted" and what was measured until then. Raises
    `InputError` for unknown names, and for a `keep` file of another study.
    """
    work = Run(task, Store(keep, task), executor, stage or _nobody)
    chosen = _chosen("family", families, FAMILIES)
    plans = _plans(task, chosen, axes)
    status = "finished"
    try:
        work.measure(plans)
    except KeyboardInterrupt:
        status = "interrupted"
    results = tuple(work.result(name, plans[name]) for name in chosen)
    machine = describe_machine()
    return Study(task.title, status, task.quick, machine, results, dict(task.document))


def _chosen(what: str, names: Iterable[str] | None, known: Iterable[str]) -> list[str]:
    known = list(known)
    asked = known if names is None else list(names)
    for name in asked:
        if name not in known:
            raise InputError(unknown_name(what, name, known))
    return [name for name in known if name in asked]


def _plans(
    task: Task, families: Iterable[str], axes: Iterable[str] | None
) -> dict[str, list[Configuration]]:
    """What is measured of each family: the scene as given first, then the axes asked for."""
    plans: dict[str, list[Configuration]] = {}
    for name in families:
        plans[name] = [] if FAMILIES[name].missing(task) else [*FAMILIES[name].configurations(task)]
    if axes is None:
        return plans
    known = {one.axis for plan in plans.values() for one in plan[1:]}
    wanted = _chosen("axis", axes, sorted(known))
    return {
        name: plan[:1] + [one for one in plan[1:] if one.axis in wanted]
        for name, plan in plans.items()
    }


class Run:
    """The measurements of one study or choice, as far as they are there."""

    def __init__(
        self, task: Task, store: Store, executor: Executor | int | None, stage: Stage
    ) -> None:
        self.task, self.store, self.executor, self.stage = task, store, executor, stage
        self.here = fingerprint()

    def measure(self, plans: dict[str, list[Configuration]]) -> None:
        """Everything that is not there yet; raises `KeyboardInterrupt` when interrupted."""
        references = [
            Case(name, REFERENCE, one)
            for name, plan in plans.items()
            for one in (FAMILIES[name].references(self.task) if plan else ())
        ]
        self.sweep_cases("references", references, Measure(self.task))
        known = {name: self.known(name) for name, plan in plans.items() if plan}
        work = Measure(self.task, known)
        self.sweep_cases("errors", self._cases(plans, ERROR), work)
        self.time_cases(self._cases(plans, COST), Measure(self.task))

    def _cases(self, plans: dict[str, list[Configuration]], part: str) -> list[Case]:
        cases = [
            Case(name, part, configuration=one) for name, plan in plans.items() for one in plan
        ]
        return list({case.key: case for case in cases}.values())

    def known(self, family: str) -> dict[str, Any]:
        """The references of a family, raises `InputError` where one could not be had."""
        found = {}
        for name in FAMILIES[family].references(self.task):
            found[name] = self.store[Case(family, REFERENCE, name).key]
            if found[name]["status"] != MEASURED:
                raise InputError(f"reference {name!r} of {family!r}: {found[name]['status']}")
        return found

    def sweep_cases(self, what: str, cases: Sequence[Case], work: Measure) -> None:
        """Measure those cases that are not there yet, on the executor."""
        left = [case for case in cases if case.key not in self.store]
        report, before = self.stage(what), len(cases) - len(left)

        def arrived(i: int, result: Any) -> None:
            self.store.add(left[i].key, result)

        def progress(done: float, _: float) -> None:
            report(before + done, len(cases))

        sweep(work, left, executor=self.executor, chunk=1, progress=progress, arrived=arrived)

    def time_cases(self, cases: Sequence[Case], work: Measure) -> None:
        """Measure costs, one after the other and alone."""
        report = self.stage("times")
        for done, case in enumerate(cases):
            report(done, len(cases))
            key = self.cost_key(case)
            if key not in self.store:
                self.store.add(key, measured_alone(work, case))
        report(len(cases), len(cases))

    def cost_key(self, case: Case) -> str:
        """Under which a cost is kept: times are those of this machine."""
        return f"{case.key} on {self.here}"

    def result(self, name: str, plan: list[Configuration]) -> FamilyResult:
        """What is known of a family."""
        family = FAMILIES[name]
        points = []
        for one in plan:
            error = Case(name, ERROR, configuration=one).key
            cost = self.cost_key(Case(name, COST, configuration=one))
            points.append(Point(one, self.found(error), self.found(cost)))
        about = {
            one: str(self.found(Case(name, REFERENCE, one).key).get("about", ""))
            for one in (family.references(self.task) if plan else ())
        }
        return FamilyResult(name, about, tuple(points), family.missing(self.task))

    def found(self, key: str) -> dict[str, Any]:
        """A result by its key, empty where it is not there."""
        return dict(self.store[key]) if key in self.store else {}


def _nobody(_: str) -> Progress:
    return lambda done, total: None
