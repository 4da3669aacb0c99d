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
    is_interrupt,
    load,
    notice,
    progress,
    row,
    scene_argument,
    table,
)

if TYPE_CHECKING:
    from softmpc.simulation.audit import Audit
    from softmpc.simulation.result import Simulation

__all__ = ["command"]


@click.command("simulate")
@scene_argument
@click.option(
    "--duration", type=float, metavar="S", help="Simulate this long, not what the scene says."
)
@click.option(
    "--method", metavar="NAME", help="Integrate by radau, radau-2, gauss, gauss-2, idas or cvodes."
)
@click.option(
    "--tip-tolerance", metavar="LENGTH", help="Error of a step at the tip, such as 0.01mm (radau)."
)
@click.option("--step", type=float, metavar="S", help="Keep this step (radau, gauss).")
@click.option("--audit", is_flag=True, help="Add up energies and works: does the balance close?")
@click.option(
    "--certify",
    is_flag=True,
    help="Say how exact it is: a finer model, and effects left out, on a part of the motion.",
)
@animation_option
@answering("simulate")
def command(
    scene: Path,
    duration: float | None,
    method: str | None,
    tip_tolerance: str | None,
    step: float | None,
    audit: bool,
    certify: bool,
    animate: bool,
    out: Path | None,
) -> Answer:
    """Simulate the motion that the table [simulate] of the scene file SCENE describes."""
    from softmpc.simulation.run import simulate_file

    changes = {} if duration is None else {"duration": duration}
    changes |= _method(scene, method, tip_tolerance, step)
    with progress("simulating", "ms") as report:
        done = simulate_file(
            scene, lambda t, end: report(round(1e3 * t), round(1e3 * end)), **changes
        )
    for warning in done.warnings:
        notice(f"warning: {warning.text}")
    data = {"title": done.title, **done.summary()}
    if out:
        done.save(out)
        try:
            _draw(out, scene, done, animate and done.status != "interrupted")
        except BaseException as error:
            if not is_interrupt(error):
                raise
            kept = "the motion itself is complete" if done.finished else "what was reached is kept"
            problem = f"interrupted while drawing; {kept}, in {out / 'simulation.csv'}"
            return Answer(data, _text(data, done), INTERRUPTED, problem)
    if audit:
        data["audit"] = _audit(out, scene, done).summary()
    if certify and done.status != "interrupted":
        data["certificate"] = _certify(scene, duration, done)
        if data["certificate"] is None:
            problem = "interrupted while certifying; the motion itself is complete"
            return Answer(data, _text(data, done), INTERRUPTED, problem)
    if done.finished:
        return Answer(data, _text(data, done))
    if done.status == "interrupted":
        problem = f"interrupted at t = {done.duration_s:g} s"
        return Answer(data, _text(data, done), INTERRUPTED, problem)
    return Answer(data, _text(data, done), NOT_CONVERGED, done.status)  # which says when


def _method(
    scene: Path, name: str | None, tip_tolerance: str | None, step: float | None
) -> dict[str, Any]:
    """What the command line says in place of the scene file's method and its numbers."""
    from softmpc.model.scene_file import read_document
    from softmpc.model.tables import Table
    from softmpc.simulation.settings import read_method
    from softmpc.study.lengths import length_m

    if name is None and tip_tolerance is None and step is None:
        return {}
    numbers = {
        "tip_tolerance": None if tip_tolerance is None else length_m(tip_tolerance),
        "step": step,
    }
    given: dict[str, Any] = {key: value for key, value in numbers.items() if value is not None}
    # A number alone goes to the method of the scene: it must not exchange that unsaid.
    given["method"] = name or read_document(scene).get("simulate", {}).get("method", "radau")
    return {**numbers, "tolerance": None, **read_method(Table(given, "command line"))}


def _draw(out: Path, scene: Path, done: Simulation, animate: bool) -> None:
    from softmpc.model.model import build
    from softmpc.view import time_plots
    from softmpc.view.animation import animate as write_animation
    from softmpc.view.motion import motion_figure
    from softmpc.view.style import save_figure

    model = build(load(scene)[1])
    save_figure(motion_figure(model, done, done.title), out / "motion.png")
    name = f"{done.title}: section tips"
    tips = time_plots.tips_figure(done.time, done.tips, title=name, speeds=done.tip_speeds)
    strains = time_plots.strains_figure(model, done.time, done.q, f"{done.title}: strains")
    drive = time_plots.inputs_figure(model, done.time, done.u, done.p, f"{done.title}: drive")
    save_figure(tips, out / "tips.png")
    save_figure(strains, out / "strains.png")
    save_figure(drive, out / "pressures_torques.png")
    if animate:
        with progress("animation", "frame") as report:
            target = out / "simulation.gif"
            write_animation(model, done.time, done.q, target, title=done.title, progress=report)


def _audit(out: Path | None, scene: Path, done: Simulation) -> Audit:
    from softmpc.model.model import build
    from softmpc.simulation.audit import audit

    found = audit(build(load(scene)[1]), done)
    if out:
        from softmpc.simulation.columns import write_columns
        from softmpc.view.energy import energy_figure
        from softmpc.view.style import save_figure

        write_columns(out / "energy.csv", found.columns())
        save_figure(energy_figure(found, f"{done.title}: energy"), out / "energy.png")
    return found


def _certify(scene: Path, duration: float | None, done: Simulation) -> dict[str, Any] | None:
    """The accuracy note, None when it is interrupted."""
    from softmpc.model.model import build
    from softmpc.study.ablate import read_study
    from softmpc.study.certify import certify

    _, parsed, settings = read_study(scene, duration)
    try:
        with progress("certifying", "run") as report:
            return certify(build(parsed), done, settings, progress=report).summary()
    except KeyboardInterrupt:
        return None


def _text(data: dict[str, Any], done: Simulation) -> str:
    rows: list[tuple[str, object]] = [
        ("status", data["status"]),
        ("duration", f"{data['duration_s']:g} s in {data['wall_s']:.3g} s"),
        ("set up in", f"{data['setup_s']:.2f} s"),
        ("faster than real time", f"{data['realtime_factor']:.2f} times"),
    ]
    for i, tip in enumerate(data["final_tips_m"], 1):
        rows.append((f"final tip of section {i} (m)", row(tip)))
    rows += _rest_rows(data, done)
    rows += _energy_rows(data.get("audit"))
    if data.get("certificate"):
        rows.append(("accuracy", data["certificate"]["text"]))
        text, notes = data["certificate"]["text"], data["certificate"]["notes"]
        rows += [("not covered", note) for note in notes if note not in text]
        rows.append(("not asked", ", ".join(data["certificate"]["skipped"]) or "nothing"))
    return "\n".join([data["title"], table(rows)])


def _rest_rows(data: dict[str, Any], done: Simulation) -> list[tuple[str, object]]:
    """How the tip comes to rest, or that it does not; nothing of a tip that does not move."""
    from softmpc.simulation.settling import has_moved, time_watched

    if data["settling_s"] == data["settling_s"]:  # not nan
        settled = f"{data['settling_s']:.2f} s after the input"
        swing = f"{100 * data['overshoot']:.1f} %"
        return [("at rest within 2 % of its way", settled), ("overshoot of the tip", swing)]
    watched = time_watched(done)
    if watched == 0.0 or not has_moved(done):
        return []
    return [("not at rest", f"within {watched:.3g} s after the last input")]


def _energy_rows(audit: dict[str, Any] | None) -> list[tuple[str, object]]:
    if audit is None:
        return []
    changes = [(f"{name} energy", value) for name, value in audit["energy_change_j"].items()]
    works = [
        (f"work of {name.replace('_', ' ')}", value) for name, value in audit["work_j"].items()
    ]
    rows: list[tuple[str, object]] = [(f"{n} (J)", row([value])) for n, value in changes + works]
    if audit["missing"]:
        return [*rows, *(("no energy balance", reason) for reason in audit["missing"])]
    share = f"within {audit['closure']:.1e} of {audit['turnover_j']:.4g} J"
    return [*rows, ("energy balance closes", share)]
