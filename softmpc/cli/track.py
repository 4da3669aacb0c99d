"""`softmpc track SCENE`: the tip on a path, by nonlinear MPC."""

from __future__ import annotations

from collections.abc import Mapping
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
    as_json,
    progress,
    scene_argument,
    stages,
    table,
    write_text,
)

if TYPE_CHECKING:
    from softmpc.codegen.in_the_loop import InTheLoop
    from softmpc.control.track_result import TrackResult

__all__ = ["command"]

LINES = 6  # of what is infeasible, for people
ROUNDING = 1e-9  # mm, or of an input
CHECKING = "checking the path", "place"


@click.command("track")
@scene_argument
@click.option(
    "--on-infeasible", type=click.Choice(("stop", "project")),
    help="What to do where the path cannot be followed: stop before the run, or follow the "
    "nearest places in reach. By default what the scene file says, else stop.",
)  # fmt: skip
@click.option(
    "--compare", "against", is_flag=True,
    help="Run feed-forward, LQR and IPOPT to convergence as well, and print one table. IPOPT "
    "may take minutes; Ctrl-C keeps what is done until then.",
)  # fmt: skip
@click.option(
    "--ideal", is_flag=True,
    help="Leave the table [rig] out: the state is known, and nothing fails.",
)  # fmt: skip
@click.option(
    "--controller", "language", type=click.Choice(("python", "c")), default="python",
    help="Who controls: the controller in Python, or the one that `softmpc codegen` writes, "
    "compiled for this machine and driven in the same loop.",
)  # fmt: skip
@click.option(
    "--precision", type=click.Choice(("double", "float")), default="double",
    help="Numbers of the controller in C.",
)  # fmt: skip
@click.option(
    "--record", type=click.Path(path_type=Path), metavar="LOG",
    help="Write a flight log, which `softmpc replay` runs again.",
)  # fmt: skip
@animation_option
@answering("track")
def command(
    scene: Path,
    on_infeasible: str | None,
    against: bool,
    ideal: bool,
    language: str,
    precision: str,
    record: Path | None,
    animate: bool,
    out: Path | None,
) -> Answer:
    """Move the tip along the path of the table [track] of the scene file SCENE.

    With a table [rig] the state is estimated from sensors, and faults may strike.
    """
    from softmpc.rig.rigging import read_rig_file

    by = _deputy(scene, language, precision, record)
    if by is not None and against:
        raise click.UsageError(
            "--compare runs controllers of its own: leave it out, or --controller and --record"
        )
    if not ideal and read_rig_file(scene) is not None:
        if against:
            raise click.UsageError("--compare knows the state: add --ideal, or leave it out")
        return _on_rig(scene, on_infeasible, by, animate, out)
    return _ideal(scene, on_infeasible, against, by, animate, out)


def _deputy(scene: Path, language: str, precision: str, record: Path | None) -> InTheLoop | None:
    """Who controls instead of the controller in Python, if anyone does."""
    if language == "python" and precision != "double":
        raise click.UsageError("--precision float is for --controller c: Python works in double")
    if language == "python" and record is None:
        return None
    from softmpc.codegen.in_the_loop import InTheLoop

    return InTheLoop(language == "c", precision == "float", record, scene)


def _on_rig(
    scene: Path, on_infeasible: str | None, by: InTheLoop | None, animate: bool, out: Path | None
) -> Answer:
    from softmpc.cli.track_rig import answer, draw_rig, run_on_rig

    result = run_on_rig(scene, on_infeasible, by)
    if out:
        result.save(out)
        if result.track.statuses:
            _draw(out, scene, result.track, animate and result.track.status != "interrupted")
            draw_rig(out, result)
    return answer(result, _text({"title": result.track.title, **result.summary()}))


def _ideal(
    scene: Path,
    on_infeasible: str | None,
    against: bool,
    by: InTheLoop | None,
    animate: bool,
    out: Path | None,
) -> Answer:
    from softmpc.control.compare import compare_file
    from softmpc.control.tracking import track_file

    others: dict[str, TrackResult] = {}
    with stages(*CHECKING) as stage:
        checking, tracking = stage(*CHECKING), stage("tracking", "step")
        if against:
            others = compare_file(scene, tracking, on_infeasible, checking)
            result = next(iter(others.values()))
        else:
            result = track_file(scene, tracking, on_infeasible, checking, by)
    data = {"title": result.title, **result.summary()}
    if out:
        result.save(out)
        if result.statuses:
            _draw(out, scene, result, animate and result.status != "interrupted")
    text = _text(data)
    if others:
        data["controllers"] = _compared(others, out)
        text += "\n\n" + _comparison(data["controllers"])
    status, problem = _judge(result)
    if status == OK and _cut_short(others):
        status, problem = INTERRUPTED, f"interrupted in the run of {list(others)[-1]} or after it"
    return Answer(data, text, status, problem)


def _cut_short(others: Mapping[str, TrackResult]) -> bool:
    """Whether a comparison was interrupted."""
    from softmpc.control.compare import BASELINES

    cut = any(result.status == "interrupted" for result in others.values())
    return bool(others) and (cut or len(others) <= len(BASELINES))


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
    from softmpc.control.tracking import read_track_file
    from softmpc.model.model import build
    from softmpc.view import time_plots
    from softmpc.view.animation import animate as write_animation
    from softmpc.view.control import control_figure
    from softmpc.view.style import save_figure
    from softmpc.view.tracking import tracking_figure

    _, own, task = read_track_file(scene)
    model = build(task.plant.scene or own)
    title, time = result.title, result.time
    save_figure(tracking_figure(model, result), out / "track.png")
    save_figure(control_figure(model, result), out / "control.png")
    tips = time_plots.tips_figure(time, result.tips, result.reference, f"{title}: section tips")
    save_figure(tips, out / "tips.png")
    save_figure(
        time_plots.strains_figure(model, time, result.q, f"{title}: strains"), out / "strains.png"
    )
    if animate:
        with progress("animation", "frame") as report:
            write_animation(
                model, time, result.q, out / "track.gif", result.reference, title, report
            )


def _compared(others: Mapping[str, TrackResult], out: Path | None) -> dict[str, Any]:
    """One line for each controller; with `out` also as files."""
    from softmpc.control.compare import COLUMNS, row_of

    rows = {name: row_of(result) for name, result in others.items()}
    if out:
        lines = [",".join(["controller", "status", *(key for key, _ in COLUMNS)])]
        for name, row in rows.items():
            cells = [row["status"].split(":")[0], *(row[key] for key, _ in COLUMNS)]
            lines.append(",".join([name, *("" if cell is None else str(cell) for cell in cells)]))
        write_text(out / "compare.csv", "\n".join(lines))
        write_text(out / "compare.json", as_json(rows, indent=2))
    return rows


def _comparison(rows: Mapping[str, Mapping[str, Any]]) -> str:
    """The table for people."""
    from softmpc.control.compare import COLUMNS

    titles = ["controller", *(title for _, title in COLUMNS)]
    lines = [titles]
    for name, row in rows.items():
        cells = ["-" if row[key] is None else f"{row[key]:.4g}" for key, _ in COLUMNS]
        lines.append([name if row["status"] == "finished" else f"{name} (cut short)", *cells])
    widths = [max(len(line[k]) for line in lines) for k in range(len(titles))]
    return "\n".join(
        "  ".join(
            cell.ljust(width) if k == 0 else cell.rjust(width)
            for k, (cell, width) in enumerate(zip(line, widths, strict=True))
        )
        for line in lines
    )


def _text(data: dict[str, Any]) -> str:
    settled = f"mm after {data['settle_s']:g} s"
    rows: list[tuple[str, object]] = [("status", data["status"])]
    rows += [
        (name, f"{data[key] if abs(data[key]) > ROUNDING else 0:.4g} {unit}")
        for name, key, unit in (
            ("RMS tip error", "rms_error_mm", settled),
            ("largest tip error", "max_error_mm", settled),
            ("RMS error in reach", "rms_reachable_error_mm", "mm from the nearest place in reach"),
            ("largest error in reach", "max_reachable_error_mm", "mm, but for 0.5 s after jumps"),
            ("time of a step, median", "step_ms_median", "ms"),
            ("time of a step, 95 %", "step_ms_p95", "ms"),
            ("time of a step, 100 %", "step_ms_max", "ms"),
            ("variation of input", "input_variation", "in all"),
            ("the same at rest", "input_variation_at_rest", "in all"),
            ("clearance of the path", "clearance_mm", "mm to the edge of the workspace"),
        )
        if data.get(key) is not None
    ]
    rows.append(("steps", f"{data['steps']}, {data['failures']} failed"))
    used = (f"{name} {share:.2g}" for name, share in data.get("deviations", {}).items())
    rows.append(("RMS over what costs ½", ", ".join(used) or "not known"))
    found = data.get("infeasible", [])
    infeasible = [f"infeasible: {line}" for line in found[:LINES]]
    if len(found) > LINES:
        infeasible.append(f"infeasible: and {len(found) - LINES} more, see --json")
    return "\n".join([data["title"], table(rows), *infeasible])
