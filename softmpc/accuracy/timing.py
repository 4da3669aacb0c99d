"""Times that can be compared: two pieces of work by turns, medians and spreads."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

__all__ = ["by_turns", "memory_mib", "spread"]

Work = Callable[[], Any]
# Processor time, which other programs do not change so much; of Windows it comes in 16 ms.
clock = time.perf_counter if sys.platform == "win32" else time.process_time


def by_turns(
    one: Work, other: Work, repeats: int, calls: int = 1, first: bool = True
) -> dict[str, float]:
    """Times of `one`, and how they compare with those of `other`, run by turns.

    By turns, because a busy machine then slows both, and in processor time. `time_s` and `spread_s`
    are the median and the distance between quartiles of `repeats` runs, each of `calls` calls, a
    call; `ratio` is the median of `one` over that of `other`. What is made on the `first` run is
    no part of it; without, both have run before.
    """
    if first:
        one(), other()
    times = np.array([[_seconds(work, calls) for work in (one, other)] for _ in range(repeats)])
    own, beside = times.T
    return {
        "time_s": median(own),
        "spread_s": spread(own),
        "beside_s": median(beside),
        "ratio": median(own) / median(beside),
    }


def spread(times: Any) -> float:
    """Distance between quartiles."""
    low, high = np.percentile(times, [25, 75])
    return float(high - low)


def memory_mib() -> float | None:
    """The most memory this process has had; None where the system does not tell (Windows)."""
    try:  # of Linux by the kernel: `resource` counts what the parent had when it started this one
        lines = Path("/proc/self/status").read_text(encoding="utf-8").splitlines()
        return float(next(line for line in lines if line.startswith("VmHWM")).split()[1]) / 2**10
    except (OSError, StopIteration):
        pass
    try:
        import resource
    except ImportError:
        return None
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return float(most) / (2**20 if sys.platform == "darwin" else 2**10)  # bytes, or KiB


def _seconds(work: Work, calls: int) -> float:
    began = clock()
    for _ in range(calls):
        work()
    return (clock() - began) / calls
