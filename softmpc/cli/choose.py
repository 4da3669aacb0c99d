"""`softmpc choose SCENE`: the cheapest configuration within a tolerance and a rate."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from softmpc.cli.common import (
    INTERRUPTED,
    NOT_CONVERGED,
    OK,
    Answer,
    answering,
    log,
    scene_argument,
    stages,
)
from softmpc.cli.sweep_options import executor_for, sweep_options

if TYPE_CHECKING:
    from softmpc.accuracy.choose_result import Choice, Evidence

__all__ = ["command"]

GOALS = ("rest", "motion", "loop")
KEPT = "choose.jsonl"  # in the folder of results


class Quantity(click.ParamType):
    """A number with its unit: a length in m, or a rate in Hz."""

    def __init__(self, name: str) -> None:
        self.name = name

    def convert(self, value: Any, param: Any, ctx: Any) -> float:
        """The number of a text such as 5mm or 100Hz, in SI units."""
        from softmpc.accuracy.choose_rate import rate_hz
        from softmpc.errors import InputError
        from softmpc.study.lengths import length_m

        try:
            return length_m(value) if self.name == "length" else rate_hz(value)
        except InputError as error:
            self.fail(str(error), param, ctx)


@click.command("choose")
@scene_argument
@click.option(
    "--tolerance", type=Quantity("length"), metavar="LENGTH", required=True,
    help="The bound on the error has to be within this length, such as 5mm.",
)  # fmt: skip
@click.option(
    "--rate", type=Quantity("rate"), metavar="RATE",
    help="A step has to fit into 1/rate, such as 100Hz.  [default: any time will do]",
)  # fmt: skip
@click.option(
    "--for",
    "goal",
    type=click.Choice(GOALS),
    help="What it is for.  [default: loop with a table [track], motion with [simulate], else rest]",
)
@click.option("--fresh", is_flag=True, help="Measure anew what an earlier run left in --out.")
@sweep_options
@answering("choose")
def command(
    scene: Path,
    tolerance: float,
    rate: float | None,
    goal: str | None,
    fresh: bool,
    workers: int | None,
    dask: str | None,
    out: Path | None,
) -> Answer:
    """Choose the cheapest configuration of SCENE that is accurate and fast enough.

    With --out it is written as chosen.toml, with the evidence; measurements are kept there, so that
    an interrupted choice goes on, and another tolerance costs less.
    """
    from softmpc.accuracy.choose import choose
    from softmpc.accuracy.choose_file import check_place, clear_place, write_choice
    from softmpc.accuracy.study import read_task

    task = read_task(scene)
    if out:
        check_place(scene, out)
    with executor_for(workers, dask) as executor, stages("references", "case") as stage:
        choice = choose(
            task,
            tolerance,
            rate_hz=rate,
            goal=goal,
            keep=out / KEPT if out else None,
            fresh=fresh,
            executor=executor,
            stage=lambda what: stage(what, "case"),
        )
    told = _told(scene.name, choice)
    if out and choice.status == "refused":
        clear_place(out)
    if out and choice.chosen:
        log.info("wrote %s", write_choice(choice, scene.parent, out, told))
    data = {**choice.summary(), "command": told}
    return Answer(data, _text(choice, out), *_judge(choice))


def _told(scene: str, choice: Choice) -> str:
    """The command that chooses so."""
    goal = choice.goal
    words = ["softmpc", "choose", scene, "--tolerance", f"{1e3 * goal.tolerance_m:g}mm"]
    words += [] if goal.rate_hz is None else ["--rate", f"{goal.rate_hz:g}Hz"]
    return shlex.join([*words, "--for", goal.family])


def _judge(choice: Choice) -> tuple[int, str]:
    """Exit status, and why it is not 0."""
    if choice.status == "interrupted":
        return INTERRUPTED, "interrupted; with --out the same command goes on from here"
    if choice.chosen is None:
        return NOT_CONVERGED, "no candidate will do; why, and what to try, is told on stdout"
    return OK, ""


# ---------------------------------------------------------------- for people


def _text(choice: Choice, out: Path | None) -> str:
    """The table of candidates, and the one chosen or why there is none."""
    from softmpc.accuracy.choose_file import evidence_lines

    lines = [choice.title, *_table(choice), ""]
    if choice.chosen:
        lines += evidence_lines(choice)
        lines += ["Give --out DIR to have it as a scene file."] if out is None else []
    elif choice.reasons:
        *why, advice = choice.reasons
        lines += ["nothing to choose:", *(f"  {line}" for line in why), f"  try: {advice}"]
    else:
        lines.append("interrupted")
    return "\n".join(lines)


def _table(choice: Choice) -> list[str]:
    """What was timed, the fastest first; without any, the most accurate ones."""
    from softmpc.study.lengths import length_text

    known = [one for one in choice.evidence if one.bound_m is not None]
    nearest = sorted(known, key=lambda one: one.bound_m or 0.0)
    shown = choice.timed or nearest[:6]
    if not shown:
        return []
    rows = [("candidate", "measured", "bound", "time", "ratio", "")]
    for one in shown:
        ratio = one.point.cost.get("ratio")
        rows.append((
            one.point.name,
            "-" if one.point.error_m is None else length_text(one.point.error_m),
            "-" if one.bound_m is None else length_text(one.bound_m),
            _time(one),
            "-" if ratio is None else f"{ratio:.2f}",
            _verdict(choice, one),
        ))  # fmt: skip
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [_line(row, widths) for row in rows] + [_rest(choice, len(shown))]


def _line(row: tuple[str, ...], widths: list[int]) -> str:
    first, *numbers, last = (cell for cell in row)
    cells = [cell.rjust(width) for cell, width in zip(numbers, widths[1:-1], strict=True)]
    return "  ".join([first.ljust(widths[0]), *cells, last]).rstrip()


def _time(one: Evidence) -> str:
    from softmpc.accuracy.choose_file import time_text

    return "-" if one.point.time_s is None else time_text({"time_s": one.point.time_s})


def _verdict(choice: Choice, one: Evidence) -> str:
    if one is choice.chosen:
        return "chosen"
    if not one.within:
        return "beyond the tolerance"
    if one.point.time_s is None:
        return "within the tolerance"
    return "within, but dearer" if one.fast else "too slow"


def _rest(choice: Choice, shown: int) -> str:
    tried = len(choice.evidence)
    within = sum(one.within for one in choice.evidence)
    return f"{tried} candidates tried, {within} of them within the tolerance, {shown} shown"
