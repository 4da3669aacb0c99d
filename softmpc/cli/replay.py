"""`softmpc replay LOG`: a flight log through the controllers again."""

from __future__ import annotations

import logging
import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from softmpc.cli.common import OK, Answer, answering, notice, stages, table, write_text

if TYPE_CHECKING:
    from softmpc.codegen.replay import Comparison, Replayed
    from softmpc.codegen.replay_setup import Replay

__all__ = ["DIFFERENT", "command"]

STEPS = ("given", "u_before", "x")  # of a record: what a controller is given
DIFFERENT = 4  # exit status: the replay is not what the log says
TOLERANCE = {"N·m": 1e-8, "Pa": 1e-2}  # for another build than the log's, in numbers of 8 bytes
OF_FLOATS = 1e-3 / 1e-8  # more, in those of 4
LINES = 5  # of statuses that differ, for people


@click.command("replay")
@click.argument("log", type=click.Path(path_type=Path), metavar="LOG")
@click.option(
    "--scene", type=click.Path(path_type=Path), metavar="SCENE",
    help="The scene file that the log was made with; by default the one that the log names, here "
    "or beside it.",
)  # fmt: skip
@click.option(
    "--with", "players", metavar="LIST",
    help="Controllers, separated by commas: python, c, qemu. By default python, and c where C "
    "wrote the log or --code is given.",
)  # fmt: skip
@click.option(
    "--code", type=click.Path(path_type=Path), metavar="FOLDER",
    help="The folder of the controller in C that `softmpc codegen` has written; by default it is "
    "generated anew from the scene.",
)  # fmt: skip
@click.option(
    "--tolerance", type=click.FloatRange(0.0), metavar="T",
    help="Largest difference of an input that counts as none, N·m (or Pa). By default 0 for the "
    "build that wrote the log, and 1e-8 N·m for any other.",
)  # fmt: skip
@answering("replay")
def command(
    log: Path,
    scene: Path | None,
    code: Path | None,
    players: str | None,
    tolerance: float | None,
    out: Path | None,
) -> Answer:
    """Run the flight log LOG through the controllers again and compare step by step.

    Exit status 0: all inputs and statuses agree; 4: some do not.
    """
    from softmpc.codegen.flight_log import read_log
    from softmpc.codegen.replay_setup import players_of, replay_of

    if tolerance is not None and not math.isfinite(tolerance):
        raise click.BadParameter(
            f"{tolerance} is no finite number; give one such as 1e-6", param_hint="--tolerance"
        )
    read = read_log(log)
    names = players_of(read, "python,c" if code and players is None else players)
    if read.damage:
        notice(f"warning: {log}: {read.damage}; {len(read.steps)} steps before it are read")
    with stages("making the controller", "place") as stage:
        replay = replay_of(read, scene, code, stage("making the controller", "place"))
        done = [_played(replay, name, tolerance, stage) for name in names]
    found = [comparison for comparison, _ in done]
    data = _data(replay, found)
    if out:
        _write(out, replay, done)
    wrong = [one.name for one in found if not one.agrees]
    problem = f"{' and '.join(wrong)}: not what {log} says, see the table" if wrong else ""
    return Answer(data, _text(data), DIFFERENT if wrong else OK, problem)


def _played(
    replay: Replay, name: str, tolerance: float | None, stage: Any
) -> tuple[Comparison, Replayed]:
    from softmpc.codegen.replay import compare

    with _without_warnings():
        replayed = replay.by(name, stage(f"replay by {name}", "step"))
    other = TOLERANCE[_unit(replay)] * (OF_FLOATS if replay.log.header.real_bytes == 4 else 1.0)
    return compare(replay.log, replayed, tolerance, other), replayed


@contextmanager
def _without_warnings() -> Iterator[None]:
    """What the controller warned of when it was recorded is in the log."""
    logger = logging.getLogger("softmpc.control.mpc")
    before = logger.level
    logger.setLevel(logging.ERROR)
    try:
        yield
    finally:
        logger.setLevel(before)


def _unit(replay: Replay) -> str:
    return "N·m" if replay.torque else "Pa"


def _data(replay: Replay, found: Sequence[Comparison]) -> dict[str, Any]:
    log, unit = replay.log, _unit(replay)
    header = log.header
    return {
        "title": replay.title,
        "log": str(log.path),
        "written_by": header.writer,
        "version": header.version,
        "build": header.build,
        "bytes_a_number": header.real_bytes,
        "scene_hash": header.scene_hash,
        "step_s": header.step,
        "steps": len(log.steps),
        "damage": log.damage or None,
        "skipped_records": log.skipped,
        "agrees": all(one.agrees for one in found),
        "unit": unit,
        "replays": [_row(log, one) for one in found],
    }


def _row(log: Any, one: Comparison) -> dict[str, Any]:
    numbers = [step.number for step in log.steps]
    return {
        "by": one.name,
        "steps": one.steps,
        "left_out": one.left_out,
        "same_build": one.same_build,
        "same_bits": one.same_bits,
        "largest_difference": one.largest,
        "tolerance": one.tolerance,
        "steps_that_differ": len(one.differing),
        "first_that_differs": numbers[one.differing[0]] if one.differing else None,
        "statuses_that_differ": [
            {"step": numbers[place], "recorded": was, "replayed": is_now}
            for place, was, is_now in one.statuses
        ],
        "agrees": one.agrees,
    }


def _text(data: dict[str, Any]) -> str:
    rows: list[tuple[str, object]] = [
        (
            "log",
            f"{data['steps']} steps of {data['step_s']:g} s, {8 * data['bytes_a_number']} bits",
        ),
        ("written by", f"{data['written_by']}, softmpc {data['version']}"),
        ("damage", data["damage"] or "none"),
    ]
    lines = [data["title"], table(rows), "", *_columns(data)]
    for one in data["replays"]:
        for status in one["statuses_that_differ"][:LINES]:
            lines.append(
                f"{one['by']}, step {status['step']}: {status['recorded']} in the log, "
                f"{status['replayed']} now"
            )
    return "\n".join(lines)


def _columns(data: dict[str, Any]) -> list[str]:
    unit = data["unit"]
    titles = ("replay", "build", "steps", "left out", "same bits", f"largest difference ({unit})",
              f"tolerance ({unit})", "first beyond", "statuses that differ")  # fmt: skip
    cells = [titles]
    for one in data["replays"]:
        first = one["first_that_differs"]
        cells.append((
            one["by"], "same" if one["same_build"] else "other",
            str(one["steps"]), str(one["left_out"]), str(one["same_bits"]),
            f"{one['largest_difference']:.3g}", f"{one['tolerance']:g}",
            "none" if first is None else f"step {first}", str(len(one["statuses_that_differ"])),
        ))  # fmt: skip
    widths = [max(len(row[k]) for row in cells) for k in range(len(titles))]
    return [
        "  ".join(c.ljust(w) for c, w in zip(row, widths, strict=True)).rstrip() for row in cells
    ]


# ---------------------------------------------------------------- files


def _write(out: Path, replay: Replay, done: Sequence[tuple[Comparison, Replayed]]) -> None:
    import numpy as np

    from softmpc.codegen.emulate import Steps
    from softmpc.files import replacing
    from softmpc.view.replay import replay_figure
    from softmpc.view.style import save_figure

    steps = replay.log.steps
    recorded = np.array([step.u for step in steps])
    time = np.array([step.number for step in steps]) * replay.log.header.step
    inputs = {}
    for comparison, replayed in done:
        u = np.full_like(recorded, np.nan)
        for place, outcome in replayed.outcomes.items():
            u[place] = outcome.u
        inputs[comparison.name] = u
    found = [comparison for comparison, _ in done]
    made = replay_figure(replay.title, time, recorded, inputs, found, replay.torque)
    save_figure(made, out / "replay.png")
    write_text(out / "replay.csv", _csv(replay, done))
    given = (np.array([getattr(step, part) for step in steps]) for part in STEPS)
    with replacing(out / "steps.bin") as beside:  # what the programs of `board` read
        Steps(*given).numbers().tofile(beside)


def _csv(replay: Replay, done: Sequence[tuple[Comparison, Replayed]]) -> str:
    """A line a step: what was recorded, and by how much each replay differs."""
    from softmpc.codegen.flight_format import STATUSES

    names = [comparison.name for comparison, _ in done]
    lines = [",".join(["step", "status", *(f"{name} {what}" for name in names
                                           for what in ("difference", "status"))])]  # fmt: skip
    for place, step in enumerate(replay.log.steps):
        cells = [str(step.number), STATUSES[step.status]]
        for comparison, replayed in done:
            outcome = replayed.outcomes.get(place)
            cells += ["", ""] if outcome is None else [
                repr(float(comparison.difference[place])), STATUSES[outcome.status]
            ]  # fmt: skip
        lines.append(",".join(cells))
    return "\n".join(lines)
