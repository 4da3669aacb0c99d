"""`softmpc study SCENE`: what accuracy costs in time, along every axis there is."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from softmpc.cli.common import (
    INTERRUPTED,
    NOT_CONVERGED,
    OK,
    Answer,
    answering,
    is_interrupt,
    scene_argument,
    stages,
    write_text,
)
from softmpc.cli.sweep_options import executor_for, sweep_options

if TYPE_CHECKING:
    from softmpc.accuracy.points import Study

__all__ = ["command"]

KEPT = "measurements.jsonl"  # in the folder of results


@click.command("study")
@scene_argument
@click.option("--quick", is_flag=True, help="Less of everything, for a first look in minutes.")
@click.option(
    "--family", "families", multiple=True, metavar="NAME",
    help="Measure this alone: rest, motion or loop. May be given again.",
)  # fmt: skip
@click.option(
    "--axis", "axes", multiple=True, metavar="NAME",
    help="Vary this alone, such as kinematics. May be given again.",
)  # fmt: skip
@click.option("--fresh", is_flag=True, help="Start anew, and forget what DIR has of this study.")
@sweep_options
@answering("study")
def command(
    scene: Path,
    quick: bool,
    families: tuple[str, ...],
    axes: tuple[str, ...],
    fresh: bool,
    workers: int | None,
    dask: str | None,
    out: Path | None,
) -> Answer:
    """Measure errors and times of SCENE along all axes of model, solver and controller.

    With --out each measurement is on the disk as soon as it is there: after Ctrl-C or a crash the
    same command goes on, and repeats none. Without --out nothing is kept.
    """
    from softmpc.accuracy.study import read_task, run_study
    from softmpc.accuracy.tables import conclusions, terminal

    task = read_task(scene, quick)
    with executor_for(workers, dask) as executor, stages("study", "measurement") as stage:
        found = run_study(
            task,
            families=families or None,
            axes=axes or None,
            keep=out / KEPT if out else None,
            fresh=fresh,
            executor=executor,
            stage=lambda what: stage(what, "measurement"),
        )
    data, text, judged = conclusions(found), terminal(found), _judge(found, out)
    if out:
        try:
            _write(out, found, _again(scene, quick, families, axes))
        except BaseException as error:
            if not is_interrupt(error):
                raise
            problem = "interrupted while drawing; the numbers are kept"
            return Answer(data, text, INTERRUPTED, problem)
    return Answer(data, text, *judged)


def _again(scene: Path, quick: bool, families: Sequence[str], axes: Sequence[str]) -> str:
    """The command that gives the same report."""
    words = ["softmpc", "study", scene.name, *(["--quick"] if quick else [])]
    for option, names in (("--family", families), ("--axis", axes)):
        words += [word for name in names for word in (option, name)]
    return shlex.join([*words, "--out", "DIR"])


def _judge(found: Study, out: Path | None) -> tuple[int, str]:
    """Exit status, and why it is not 0."""
    from softmpc.accuracy.work import MEASURED

    if found.status == "interrupted":
        done = sum(point.status == MEASURED for point in found.points)
        more = "the same command goes on from there" if out else "nothing was kept without --out"
        return INTERRUPTED, f"interrupted with {done} of {len(found.points)} points; {more}"
    lost = [f"{one.name}: {one.missing}" for one in found.families if one.lost]
    given = {one.name: one.as_given for one in found.families}
    lost += [
        f"{name}: the scene as given: {point.status}"
        for name, point in given.items()
        if point and point.status != MEASURED
    ]
    return (NOT_CONVERGED, "; ".join(lost)) if lost else (OK, "")


def _write(out: Path, found: Study, command: str) -> None:
    """All files but study.json, which every command has; pictures take longest and come last."""
    from softmpc.accuracy.tables import columns, markdown
    from softmpc.simulation.columns import write_columns
    from softmpc.view.accuracy import KINDS, study_figures
    from softmpc.view.accuracy_report import report_html
    from softmpc.view.style import save_figure

    if found.points:
        write_columns(out / "study.csv", columns(found))
    write_text(out / "study.md", markdown(found))
    figures = study_figures(found)
    for name, figure in figures.items():
        save_figure(figure, out / name)
    for old in {path for kind in KINDS for path in out.glob(f"{kind}-*.png")}:
        if old.name not in figures:  # of a study with other families or axes
            old.unlink()
    write_text(out / "report.html", report_html(found, command, figures))
