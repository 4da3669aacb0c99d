"""`softmpc reproduce`: the paper's numbers beside ours."""

from __future__ import annotations

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
    progress,
    write_text,
)

if TYPE_CHECKING:
    from softmpc.study.reproduce import Reproduction

__all__ = ["command"]


@click.command("reproduce")
@click.option("--preset", metavar="NAME", help="Parameter set, such as chen2022-v2.")
@click.option("--only", metavar="TOPIC,…", help="Only these topics, such as limit+x,fig6.")
@answering("reproduce")
def command(preset: str | None, only: str | None, out: Path | None) -> Answer:
    """Put every number that the paper prints beside what the model gives, and say why.

    With --out the figures 5 to 8 and 10 to 14 are drawn from the model as well.
    """
    from softmpc.model.presets import DEFAULT_PRESET
    from softmpc.study.reproduce import reproduce
    from softmpc.view.paper_tables import terminal

    topics = [key.strip() for key in (only or "").split(",") if key.strip()]
    if only is not None and not topics:
        topics = [only]  # is unknown, and said to be
    with progress("reproducing", "topic") as report:
        found = reproduce(preset or DEFAULT_PRESET, topics, report)
    if out and found.topics:
        try:
            _write(out, found)
        except BaseException as error:
            if not is_interrupt(error):
                raise
            problem = "interrupted while drawing; the numbers are complete"
            return Answer(found.summary(), terminal(found), INTERRUPTED, problem)
    return Answer(found.summary(), terminal(found), *_judge(found))


def _judge(found: Reproduction) -> tuple[int, str]:
    """Exit status, and why it is not 0."""
    if found.status == "interrupted":
        return INTERRUPTED, f"interrupted after {len(found.topics)} topics"
    if found.lost:
        return NOT_CONVERGED, "; ".join(f"{key}: {reason}" for key, reason in found.lost.items())
    return OK, ""


def _write(out: Path, found: Reproduction) -> None:
    from softmpc.simulation.columns import write_columns
    from softmpc.view.paper_figures import paper_figures
    from softmpc.view.paper_tables import markdown
    from softmpc.view.style import save_figure

    write_columns(out / "reproduce.csv", found.columns())
    write_text(out / "reproduce.md", "\n\n".join(markdown(found).values()))
    for name, figure in paper_figures(found):
        save_figure(figure, out / f"{name}.png")
