"""`softmpc simulate SCENE`: the motion under the inputs of a scene."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from softmpc.cli.common import (
    INTERRUPTED,
    NOT_CONVERGED,
    Answer,
    animation_option,
    answering,
    load,
    progress,
    row,
    scene_argument,
    table,
)

if TYPE_CHECKING:
    from softmpc.simulation.result import Simulation

__all__ = ["command"]


@click.command("simulate")
@scene_argument
@click.option(
    "--duration", type=float, metavar="S", help="Simulate this long, not what the scene says."
)
@animation_option
@answering("simulate")
def command(scene: Path, duration: float | None, animate: bool, out: Path | None) -> Answer:
    """Simulate the motion that the table [simulate] of the scene file SCENE describes."""
    from softmpc.simulation.run import simulate_file

    changes = {} if duration is None else {"duration": duration}
    with progress("simulating", "ms") as report:
        done = simulate_file(
            scene, lambda t, end: report(round(1e3 * t), round(1e3 * end)), **changes
        )
    data = {"title": done.title, **done.summary()}
    if out:
        done.save(out)
        _draw(out, scene, done, animate and done.status != "interrupted")
    if done.finished:
        return Answer(data, _text(data))
    status = INTERRUPTED if done.status == "interrupted" else NOT_CONVERGED
    return Answer(data, _text(data), status, f"{done.status} at t = {done.duration_s:g} s")


def _draw(out: Path, scene: Path, done: Simulation, animate: bool) -> None:
    from softmpc.model.model import build
    from softmpc.view import time_plots
    from softmpc.view.animation import animate as write_animation
    from softmpc.view.style import save_figure

    model = build(load(scene)[1])
    tips = time_plots.tips_figure(done.time, done.tips, title=f"{done.title}: section tips")
    strains = time_plots.strains_figure(model, done.time, done.q, f"{done.title}: strains")
    drive = time_plots.inputs_figure(model, done.time, done.u, done.p, f"{done.title}: drive")
    save_figure(tips, out / "tips.png")
    save_figure(strains, out / "strains.png")
    save_figure(drive, out / "pressures_torques.png")
    if animate:
        with progress("animation", "frame") as report:
            target = out / "simulation.gif"
            write_animation(model, done.time, done.q, target, title=done.title, progress=report)


def _text(data: dict[str, Any]) -> str:
    rows: list[tuple[str, object]] = [
        ("status", data["status"]),
        ("duration", f"{data['duration_s']:g} s in {data['wall_s']:.2f} s"),
        ("faster than real time", f"{data['realtime_factor']:.2f} times"),
    ]
    for i, tip in enumerate(data["final_tips_m"], 1):
        rows.append((f"final tip of section {i} (m)", row(tip)))
    return "\n".join([data["title"], table(rows)])
