"""What is timed: one case after the other, each in a fresh process on a core of its own."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import Any

from softmpc.accuracy.work import Case, Measure
from softmpc.errors import WorkerKilledError
from softmpc.sweeps import sweep

__all__ = ["KILLED", "measured_alone"]

KILLED = "its process was killed each time: is there too little memory, or does a library crash?"
FRESH = 2  # processes a sweep may start: of a single case it starts one, and 1 would be this one


@dataclass(frozen=True)
class _Staying:
    """The same work by a process that stays on one core where the system lets it (Linux)."""

    work: Measure

    def __call__(self, case: Case) -> dict[str, Any]:
        if hasattr(os, "sched_setaffinity"):
            os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
        return self.work(case)


def measured_alone(work: Measure, case: Case) -> dict[str, Any]:
    """The result of one case; nothing else of this study may run meanwhile.

    A fresh process, so that what it builds is built cold and its memory is its own. Where that is
    killed every time, the status says so. Raises `SweepError` where no process can be started.
    """
    try:
        return dict(sweep(_Staying(work), [case], executor=FRESH)[0])
    except WorkerKilledError:
        return {"status": KILLED}
