"""Costs of a choice measured by the process of the test: a fresh one takes seconds to start."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from softmpc.accuracy.work import Case, Measure

__all__ = ["measured_here"]


def measured_here(
    work: Measure, cases: Sequence[Case], arrived: Callable[[Case, dict[str, Any]], None]
) -> None:
    """In place of `measure_alone`."""
    for case in cases:
        arrived(case, work(case))
