"""What is timed: one case after the other, in a process with a core of its own."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from softmpc.accuracy.work import Case, Measure
from softmpc.errors import SweepError, WorkerKilledError
from softmpc.sweep_processes import Processes
from softmpc.sweeps import sweep

__all__ = ["KILLED", "measure_alone", "measured_alone"]

KILLED = "its process was killed each time: is there too little memory, or does a library crash?"
FRESH = 2  # processes a sweep may start: of a single case it starts one, and 1 would be this one

Arrived = Callable[[Case, dict[str, Any]], None]


@dataclass(frozen=True)
class _Staying:
    """The same work by a process that stays on one core where the system lets it (Linux)."""

    work: Measure

    def __call__(self, case: Case) -> dict[str, Any]:
        if hasattr(os, "sched_setaffinity"):
            os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
        return self.work(case)


def measure_alone(work: Measure, cases: Sequence[Case], arrived: Arrived) -> None:
    """Measure cases one after the other; nothing else of this study may run meanwhile.

    Each in a fresh process, so that what it builds is built cold and its memory is its own. In
    quick mode they share one, and how much memory each takes is not told.
    """
    left = list(cases)
    if work.task.quick:
        left = _measured_by_one(work, left, arrived)
    for case in left:
        arrived(case, measured_alone(work, case))


def _measured_by_one(work: Measure, cases: list[Case], arrived: Arrived) -> list[Case]:
    """Measure cases by one process; returns those that are left where it does not survive them."""
    done: set[int] = set()

    def told(i: int, result: dict[str, Any]) -> None:
        done.add(i)  # of those that end at the same time, in any order
        arrived(cases[i], {key: value for key, value in result.items() if key != "memory_mib"})

    pool = Processes(1)
    try:
        sweep(_Staying(work), cases, executor=pool, chunk=1, arrived=told)
    except SweepError:
        pass  # each of the others has a process of its own then
    finally:
        pool.kill()
    return [case for i, case in enumerate(cases) if i not in done]


def measured_alone(work: Measure, case: Case) -> dict[str, Any]:
    """The result of one case, in a fresh process.

    Where that is killed every time, the status says so. Raises `SweepError` where no process can be
    started.
    """
    try:
        return dict(sweep(_Staying(work), [case], executor=FRESH)[0])
    except WorkerKilledError:
        return {"status": KILLED}
