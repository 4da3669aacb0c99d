"""What `softmpc track` does where the scene file has a table [rig]."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from softmpc.cli.common import INTERRUPTED, NOT_CONVERGED, OK, Answer, stages, table

if TYPE_CHECKING:
    from softmpc.rig.result import RigResult
    from softmpc.rig.rigging import RigDeputy

__all__ = ["answer", "draw_rig", "run_on_rig"]


def run_on_rig(scene: Path, on_infeasible: str | None, by: RigDeputy | None = None) -> RigResult:
    """The run, with progress."""
    from softmpc.cli.track import CHECKING
    from softmpc.rig.rigging import run_rig_file

    with stages(*CHECKING) as stage:
        checking, tracking = stage(*CHECKING), stage("tracking on the rig", "step")
        return run_rig_file(scene, tracking, on_infeasible, checking, by)


def draw_rig(out: Path, result: RigResult) -> None:
    """The pictures that only a rig has."""
    from softmpc.view.rig import estimate_figure, rig_figure
    from softmpc.view.style import save_figure

    save_figure(rig_figure(result), out / "rig.png")
    save_figure(estimate_figure(result), out / "estimate.png")


def _judged(result: RigResult) -> tuple[int, str]:
    """Exit status: steps may fail on a rig, but it must not end in fall-back."""
    from softmpc.rig.supervision import State

    track = result.track
    if track.status == "interrupted":
        return INTERRUPTED, f"interrupted at t = {track.time[-1]:g} s"
    if track.status != "finished":
        return NOT_CONVERGED, f"{track.status} at t = {track.time[-1]:g} s"
    last = State(int(result.state[-1]))
    if last >= State.FALL_BACK:
        return NOT_CONVERGED, f"the run ended in state {last}: {result.transitions[-1].strip()}"
    return OK, ""


def _rig_text(data: dict[str, Any]) -> str:
    """What people are told beyond the closed loop."""
    states = ", ".join(f"{name} {count}" for name, count in data["steps_by_state"].items() if count)
    rows: list[tuple[str, object]] = [("steps by state", states)]
    if data["rms_estimate_mm"] is not None:
        rows.append(("RMS error of estimate", f"{data['rms_estimate_mm']:.4g} mm at the tip"))
    if data["offset_mm"] is not None:
        rows.append(("mean error, last 2 s", f"{data['offset_mm']:.3g} mm"))
    if data["estimate_ms_median"] is not None:
        rows.append(("time of estimate, median", f"{data['estimate_ms_median']:.4g} ms"))
    squares = (f"{name} {value:.2f}" for name, value in data["nis"].items())
    rows.append(("innovations, 1 is due", ", ".join(squares) or "none"))
    for name, used in data["back_off_used"].items():
        rows.append((f"back-off of {name} used", f"{100 * used:.0f} %"))
    counts = (f"{name} {count}" for name, count in data["counts"].items())
    rows.append(("not used", ", ".join(counts) or "none"))
    return "\n".join([table(rows), *data["transitions"]])


def answer(result: RigResult, text: str) -> Answer:
    """The answer of the command, `text` of the closed loop first."""
    data = {"title": result.track.title, **result.summary()}
    status, problem = _judged(result)
    return Answer(data, f"{text}\n{_rig_text(data)}", status, problem)
