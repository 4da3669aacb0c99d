"""The controller of a scene and its baselines on one path, in one table."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from softmpc.control.baselines import FeedForward, Regulated, converged
from softmpc.control.closed_loop import Controller
from softmpc.control.guide import PlanGuide
from softmpc.control.track_result import TrackResult
from softmpc.control.tracking import (
    Setup,
    read_track_file,
    ready,
    set_up,
    without_feed_forward,
)
from softmpc.errors import errors_in
from softmpc.interrupts import InterruptLater

__all__ = ["BASELINES", "COLUMNS", "compare_file", "controllers_of", "row_of"]

# What the table shows: key and title.
COLUMNS = (
    ("rms_error_mm", "RMS error (mm)"),
    ("max_error_mm", "largest error (mm)"),
    ("cost", "cost"),
    ("step_ms_median", "step, median (ms)"),
    ("step_ms_p95", "95 % (ms)"),
    ("step_ms_max", "100 % (ms)"),
    ("variation", "variation of input"),
    ("failures", "failed steps"),
)

BASELINES = ("feed-forward", "LQR", "IPOPT to convergence")
PLAIN = "without feed-forward"
OF_PLAN = ("plan's torque alone", PLAIN, "IPOPT to convergence")

Progress = Callable[[int, int], None]


def controllers_of(setup: Setup) -> dict[str, Callable[[], Controller]]:
    """Makers of the scene's own controller and of the baselines, by name."""
    settings, ocp, planned = setup.task.controller, setup.ocp, isinstance(setup.guide, PlanGuide)

    def second() -> Controller:
        return without_feed_forward(setup) if planned else Regulated(ocp, setup.guide)

    baselines: tuple[Callable[[], Controller], ...] = (
        lambda: FeedForward(ocp, setup.guide),
        second,
        lambda: converged(ocp, settings.stages),
    )
    names = OF_PLAN if planned else BASELINES
    if settings.blocks is not None:  # what it costs to share moves shows in the costs
        names = (*names[:-1], f"{names[-1]}, a move each interval")
    makers = dict(zip(names, baselines, strict=True))
    return {settings.solver: lambda: setup.controller, **makers}


def compare_file(
    path: str | os.PathLike[str],
    progress: Progress | None = None,
    on_infeasible: str | None = None,
    checking: Progress | None = None,
) -> dict[str, TrackResult]:
    """Run each controller on the scene file's path, by name; stops early where interrupted.

    Progress as for `track_file`.
    """
    title, scene, task = read_track_file(Path(path), on_infeasible)
    with errors_in(path):
        setup = ready(lambda report: set_up(scene, task, progress=report), checking)
    makers = controllers_of(setup)
    results: dict[str, TrackResult] = {}
    for k, (name, make) in enumerate(makers.items()):

        def report(done: int, total: int, before: int = k) -> None:
            if progress is not None:
                progress(before * total + done, len(makers) * total)

        with InterruptLater() as interrupt:  # CasADi is at work
            controller = make()
        if interrupt.asked:
            break
        result = replace(setup.run(controller, report), title=title, controller=name)
        if name == PLAIN:  # its costs are others
            result = replace(result, costs={})
        results[name] = result
        if results[name].status == "interrupted":
            break
    return results


def row_of(result: TrackResult) -> dict[str, Any]:
    """One line of the table; errors from what is in reach."""
    off = 1e3 * result.reachable_error[result.counted]
    summary = result.summary()
    return {
        "status": result.status,
        "rms_error_mm": float(np.sqrt(np.mean(off**2))) if len(off) else None,
        "max_error_mm": float(off.max()) if len(off) else None,
        "cost": result.cost,
        **{key: summary[key] for key in ("step_ms_median", "step_ms_p95", "step_ms_max")},
        "variation": result.variation,
        "failures": result.failures,
    }
