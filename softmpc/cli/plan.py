"""`softmpc plan SCENE`: the motion of least time, effort or jerk through goals."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from softmpc.cli.common import (
    INTERRUPTED,
    NOT_CONVERGED,
    OK,
    Answer,
    Progress,
    animation_option,
    answering,
    progress,
    scene_argument,
    stages,
    table,
)
from softmpc.cli.sweep_options import executor_for, sweep_options

if TYPE_CHECKING:
    from softmpc.planning.result import PlanResult

__all__ = ["command"]

SEARCHING, REFINING = ("starts", "start"), ("refining", "mesh")
MISSING = "-"


@click.command("plan")
@scene_argument
@click.option(
    "--least", type=click.Choice(("time", "effort", "jerk")),
    help="What the motion is least in.  [default: what the scene file says]",
)  # fmt: skip
@click.option("--duration", type=float, metavar="S", help="How long the whole motion takes.")
@click.option(
    "--intervals", type=int, metavar="N",
    help="Intervals of constant input from goal to goal to begin with.",
)  # fmt: skip
@click.option(
    "--sensitivity", metavar="NAMES",
    help="Tell what errors of numbers of the scene do to the plan, such as sections.mass, with "
    "commas between them; 'default' for stiffness, mass and payload.",
)  # fmt: skip
@sweep_options
@animation_option
@answering("plan")
def command(
    scene: Path,
    least: str | None,
    duration: float | None,
    intervals: int | None,
    sensitivity: str | None,
    workers: int | None,
    dask: str | None,
    animate: bool,
    out: Path | None,
) -> Answer:
    """Plan the motion that the table [plan] of the scene file SCENE asks for.

    Where no motion meets all of it the nearest one is found, and the exit status is 3.
    """
    from softmpc.planning.plan_files import plan_summary, save_plan
    from softmpc.planning.scene_table import plan_file

    names = _numbers(scene, sensitivity)
    given = {"least": least, "duration": duration, "intervals": intervals}
    changes = {key: value for key, value in given.items() if value is not None}
    with executor_for(workers, dask) as executor, stages(*SEARCHING) as stage:
        tell = _Told(stage(*SEARCHING), stage(*REFINING))
        result = plan_file(scene, executor=executor, progress=tell, **changes)
    if out:
        save_plan(result, out)
        if result.found is not None:
            _draw(out, result, animate and result.status != "interrupted")
    data = plan_summary(result)
    text = _text(data)
    if names and result.solved:
        from softmpc.planning.sensitivity import find_sensitivities

        found = find_sensitivities(result, names)
        data["sensitivities"] = found.summary()
        text = f"{text}\n\n{found.text()}"
    elif names:
        text = f"{text}\n\nno sensitivities: they are those of a plan that is solved"
    return Answer(data, text, *_judge(result))


def _numbers(scene: Path, sensitivity: str | None) -> tuple[str, ...]:
    """The names that were asked for, looked up before anything is planned."""
    if sensitivity is None:
        return ()
    from softmpc.model.scene_file import load_scene
    from softmpc.planning.sensitivity import default_numbers
    from softmpc.planning.sensitivity_scene import Numbers

    given = load_scene(scene)
    if sensitivity == "default":
        return default_numbers(given)
    names = tuple(name.strip() for name in sensitivity.split(","))
    for name in names:
        Numbers.of(given, name)
    return names


class _Told:
    """Splits the planner's progress into starts and rounds of refinement."""

    def __init__(self, searching: Progress, refining: Progress) -> None:
        self._searching, self._refining = searching, refining

    def __call__(self, done: int, total: int) -> None:
        from softmpc.planning.planner import ROUNDS

        starts = total - ROUNDS
        if done <= starts:
            self._searching(done, starts)
        else:
            self._refining(done - starts, ROUNDS)


def _judge(result: PlanResult) -> tuple[int, str]:
    """Exit status, and why it is not 0."""
    from softmpc.planning.result import FAILED, INFEASIBLE, SOLVED
    from softmpc.planning.result import INTERRUPTED as CUT

    if result.status == SOLVED:
        return OK, ""
    if result.status == CUT:
        kept = "; the best motion until then is kept" if result.found is not None else ""
        return INTERRUPTED, f"interrupted{kept}"
    if result.status == INFEASIBLE:
        worst = f"; gives way: {result.gives_way[0]}" if result.gives_way else ""
        held = f"; in the way: {result.held_by[0]}" if result.held_by else ""
        return NOT_CONVERGED, f"no motion meets all that is asked{worst}{held}"
    if result.status == FAILED:
        return NOT_CONVERGED, f"none of {len(result.starts)} starts led to a motion"
    said = {
        "not least": "the motion meets all that is asked, but the least was not found for sure",
        "not verified": "the simulation does not confirm the motion on the finest mesh: raise "
        "most_intervals, or tolerance, in [plan]",
    }
    return NOT_CONVERGED, said[result.status]


def _draw(out: Path, result: PlanResult, animate: bool) -> None:
    from softmpc.view.plan import animate_plan, draw_plan, draw_refinement
    from softmpc.view.style import save_figure

    save_figure(draw_plan(result), out / "plan.png")
    save_figure(draw_refinement(result), out / "refinement.png")
    if animate:
        with progress("animation", "frame") as report:
            animate_plan(result, out / "plan.gif", progress=report)


# ---------------------------------------------------------------- for people


def _text(data: dict[str, Any]) -> str:
    rows: list[tuple[str, object]] = [("status", f"{data['status']}, in {data['seconds']:.3g} s")]
    if "time_s" in data:
        rows += _motion_rows(data)
    rows += [("gives way", _gives_way(one)) for one in data.get("gives_way", ())]
    if data.get("held_by"):
        rows.append(("held by", ", ".join(data["held_by"])))
    parts = [data["title"], table(rows)]
    if data["starts"]:
        parts += ["", *_starts(data["starts"])]
    if data.get("levels"):
        parts += ["", *_levels(data["levels"])]
    return "\n".join(parts)


def _motion_rows(data: dict[str, Any]) -> list[tuple[str, object]]:
    error, time = data["cost_error"], data["time_s"]
    phases = " + ".join(f"{each:.4g}" for each in data["durations_s"])
    sums = f" = {phases}" if len(data["durations_s"]) > 1 else ""
    settled = f" ± {error:.2g}" if error == error else ", on one mesh only"
    rows: list[tuple[str, object]] = [("time", f"{time:.4g} s{sums}")]
    rows.append((f"least {data['least']}", f"{data['cost']:.5g} {data['cost_unit']}{settled}"))
    rows.append(("plan and simulation", f"{data['defect_mm']:.2g} mm apart at section tips"))
    for i, (miss, turn) in enumerate(zip(data["misses_mm"], data["turns_deg"], strict=True), 1):
        angle = f", {turn:.2g} deg" if turn else ""
        rows.append((f"misses goal {i} by", f"{miss:.2g} mm{angle}"))
    rows.append(("drift after arrival", f"{data['drift_mm']:.2g} mm"))
    rows += [(f"clearance of {name}", f"{d:.2f} mm") for name, d in data["clearance_mm"].items()]
    for name, one in data["beyond"].items():
        if one["scaled"] > 0:
            beyond = f"{one['amount']:.2g} {one['unit']}".rstrip()
            rows.append((f"{name} beyond its limit", f"by {beyond} between nodes"))
    return rows


def _gives_way(one: dict[str, Any]) -> str:
    amount = f"{one['amount']:.3g} {one['unit']}".rstrip()
    return f"{one['name']}, by {amount} at {one['time']:.3g} s"


def _starts(starts: Sequence[dict[str, Any]]) -> list[str]:
    lines = [("start", "", "status", "cost", "iterations", "s")]
    lines += [
        (
            one["name"], "won" if one["won"] else "", one["status"], _number(one["cost"]),
            str(one["iterations"]), f"{one['seconds']:.1f}",
        )
        for one in starts
    ]  # fmt: skip
    return _aligned(lines, 3)


def _levels(levels: Sequence[dict[str, Any]]) -> list[str]:
    lines = [("intervals", "cost", "defect (mm)", "clearance (mm)", "iterations", "s")]
    lines += [
        (
            str(one["intervals"]), _number(one["cost"]), _number(1e3 * one["defect"], 2),
            _number(1e3 * one["clearance"], 3), str(one["iterations"]), f"{one['seconds']:.1f}",
        )
        for one in levels
    ]  # fmt: skip
    return _aligned(lines, 0)


def _number(value: float, digits: int = 5) -> str:
    return f"{value:.{digits}g}" if abs(value) < float("inf") else MISSING


def _aligned(lines: Sequence[Sequence[str]], texts: int) -> list[str]:
    """Columns of equal width, the first `texts` of them to the left."""
    widths = [max(len(line[k]) for line in lines) for k in range(len(lines[0]))]
    return [
        "  ".join(
            cell.ljust(width) if k < texts else cell.rjust(width)
            for k, (cell, width) in enumerate(zip(line, widths, strict=True))
        ).rstrip()
        for line in lines
    ]
