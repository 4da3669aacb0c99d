"""`softmpc track SCENE`: the tip on a path, by nonlinear MPC."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from softmpc.cli.common import (
    INTERRUPTED,
    NOT_CONVERGED,
    OK,
    Answer,
    animation_option,
    answering,
    load,
    progress,
    scene_argument,
    table,
)

if TYPE_CHECKING:
    from softmpc.control.track_result import TrackResult

__all__ = ["command"]


@click.command("track")
@scene_argument
@animation_option
@answering("track")
def command(scene: Path, animate: bool, out: Path | None) -> Answer:
    """Move the tip along the path of the table [track] of the scene file SCENE."""
    from softmpc.control.tracking import track_file

    with progress("tracking") as report:
        result = track_file(scene, report)
    data = {"title": result.title, **result.summary()}
    if out:
        result.save(out)
        if result.statuses:
            _draw(out, scene, result, animate and result.status != "interrupted")
    status, problem = _judge(result)
    return Answer(data, _text(data), status, problem)


def _judge(result: TrackResult) -> tuple[int, str]:
    """Exit status of a run, and why it is not 0."""
    if result.status == "interrupted":
        return INTERRUPTED, f"interrupted at t = {result.time[-1]:g} s"
    if result.status != "finished":
        return NOT_CONVERGED, f"{result.status} at t = {result.time[-1]:g} s"
    if result.failures:
        first = next(status for status in result.statuses if status != "solved")
        count = f"{result.failures} of {len(result.statuses)} steps of the controller failed"
        return NOT_CONVERGED, f"{count}; the first: {first}"
    return OK, ""


def _draw(out: Path, scene: Path, result: TrackResult, animate: bool) -> None:
    from softmpc.model.model import build
    from softmpc.view import time_plots
    from softmpc.view.animation import animate as write_animation
    from softmpc.view.style import save_figure
    from softmpc.view.tracking import tracking_figure

    model, title, time = build(load(scene)[1]), result.title, result.time
    save_figure(tracking_figure(model, result), out / "track.png")
    tips = time_plots.tips_figure(time, result.tips, result.reference, f"{title}: section tips")
    save_figure(tips, out / "tips.png")
    save_figure(
        time_plots.strains_figure(model, time, result.q, f"{title}: strains"), out / "strains.png"
    )
    times = result.control_time
    sampling = 1e3 * (times[1] - times[0]) if len(times) > 1 else None
    solves = time_plots.solve_times_figure(times, result.step_ms, sampling, f"{title}: solve times")
    save_figure(solves, out / "solve_times.png")
    if animate:
        with progress("animation", "frame") as report:
            write_animation(
                model, time, result.q, out / "track.gif", result.reference, title, report
            )


def _text(data: dict[str, Any]) -> str:
    rows: list[tuple[str, object]] = [("status", data["status"])]
    rows += [
        (name, f"{data[key]:.4g} {unit}")
        for name, key, unit in (
            ("RMS tip error", "rms_error_mm", f"mm after {data['settle_s']:g} s"),
            ("largest tip error", "max_error_mm", f"mm after {data['settle_s']:g} s"),
            ("time of a step, median", "step_ms_median", "ms"),
            ("time of a step, 95 %", "step_ms_p95", "ms"),
            ("clearance of the path", "clearance_mm", "mm to the edge of the workspace"),
        )
        if data[key] is not None
    ]
    rows.append(("steps", f"{data['steps']}, {data['failures']} failed"))
    return "\n".join([data["title"], table(rows)])
