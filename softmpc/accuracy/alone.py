"""What is timed: one case after the other, each in a fresh process on a core of its own."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import Any

from softmpc.accuracy.work import Case, Measure
from softmpc.errors import SweepError
from softmpc.sweep_processes import Processes
from softmpc.sweeps import sweep

__all__ = ["measured_alone"]


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

    A fresh process, so that what it builds is built cold and its memory is its own.
    """
    pool = Processes(1)
    try:
        return dict(sweep(_Staying(work), [case], executor=pool)[0])
    except SweepError as error:
        return {"status": f"its process ended: {error}"}
    finally:
        pool.kill()
