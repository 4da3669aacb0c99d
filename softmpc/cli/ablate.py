"""`softmpc ablate SCENE`: what each part of a scene changes and costs."""

from __future__ import annotations

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
    progress,
    scene_argument,
)

if TYPE_CHECKING:
    from softmpc.study.ablate import Ablation
    from softmpc.study.propose import Proposal

__all__ = ["command"]


class Length(click.ParamType):
    """A length with its unit, in m."""

    name = "length"

    def convert(self, value: Any, param: Any, ctx: Any) -> float:
        """The length of a text such as 1mm."""
        from softmpc.errors import InputError
        from softmpc.study.lengths import length_m

        try:
            return length_m(value)
        except InputError as error:
            self.fail(str(error), param, ctx)


@click.command("ablate")
@scene_argument
@click.option(
    "--tolerance",
    type=Length(),
    metavar="LENGTH",
    help="Propose the cheapest scene within this error of every section tip, such as 1mm.",
)
@click.option("--add", is_flag=True, help="Also add each effect that the scene does not have.")
@click.option(
    "--duration", type=float, metavar="S", help="Run this much of the motion, not all of it."
)
@click.option(
    "--repeats",
    type=click.IntRange(1, 1000),
    default=5,
    show_default=True,
    help="Runs of which times are the median.",
)
@answering("ablate")
def command(
    scene: Path,
    tolerance: float | None,
    add: bool,
    duration: float | None,
    repeats: int,
    out: Path | None,
) -> Answer:
    """Run the motion of SCENE without each of its parts, or with it coarser or finer.

    Prints the change of the section tips and what is saved.
    """
    from softmpc.study.ablate import ablate_file

    with progress("ablating", "row") as report:
        found = ablate_file(scene, duration=duration, add=add, repeats=repeats, progress=report)
    proposal, status = None, found.status
    if tolerance is not None and status == "finished":
        proposal = _propose(found, tolerance)
        status = "finished" if proposal else "interrupted"
    data = {**found.summary(), "status": status}
    if tolerance is not None:
        data["proposal"] = proposal.summary() if proposal else None
    if out:
        _write(out, scene, found, proposal, tolerance)
    text = "\n\n".join([_text(found), *([_proposed(proposal, data)] if proposal else [])])
    return Answer(data, text, *_judge(status, found, proposal))


def _propose(found: Ablation, tolerance: float) -> Proposal | None:
    """The proposal, None when it is interrupted."""
    from softmpc.study.propose import propose

    try:
        with progress("combining", "change") as report:
            return propose(found, tolerance, report)
    except KeyboardInterrupt:
        return None


def _judge(status: str, found: Ablation, proposal: Proposal | None) -> tuple[int, str]:
    """Exit status, and why it is not 0."""
    from softmpc.study.lengths import length_text

    if status == "interrupted":
        return INTERRUPTED, f"interrupted after {len(found.rows)} rows"
    if proposal and not proposal.within:
        error, allowed = length_text(proposal.errors.worst), length_text(proposal.tolerance_m)
        return NOT_CONVERGED, (
            f"the scene as given is integrated to {error}, not to {allowed}: "
            "set a smaller tip_tolerance (or tolerance, or step) in [simulate]"
        )
    return OK, ""


def _write(
    out: Path, scene: Path, found: Ablation, proposal: Proposal | None, tolerance: float | None
) -> None:
    from softmpc.model.scene_file import read_document
    from softmpc.simulation.columns import write_columns
    from softmpc.study.propose import write_proposal
    from softmpc.view.ablation import ablation_figure
    from softmpc.view.style import save_figure

    if found.rows:
        write_columns(out / "ablation.csv", found.columns())
        save_figure(ablation_figure(found, tolerance), out / "ablation.png")
    if proposal:
        document = read_document(scene)
        proved = {"duration": found.baseline.motion.duration_s}  # --duration may be shorter
        document["simulate"] = document["simulate"] | proved
        log.info("wrote %s", write_proposal(proposal, document, scene.parent, out))


# ---------------------------------------------------------------- for people


def _text(found: Ablation) -> str:
    """Two lines about the scene as given, and the table."""
    from softmpc.study.lengths import length_text

    base = found.baseline
    given = base.cost
    sizes = f"{given.residual:,} + {given.residual_jacobian:,} instructions (residual, Jacobian)"
    drive = f", {given.drive:,} (drive)" if given.drive else ""
    floor, own = length_text(base.floor_m), length_text(base.own_m)
    lines = [
        found.title,
        f"as given: {sizes}{drive}, {given.states} states; "
        f"{base.motion.duration_s:g} s of motion in {given.wall_s:.3g} s",
        f"numerical floor {floor}; the scene's own integration is off by {own}",
    ]
    return "\n".join(lines) + "\n\n" + _table(found)


def _table(found: Ablation) -> str:
    sections = range(1, found.baseline.motion.tips.shape[1] + 1)
    by_section = [f"max {i}" for i in sections] if len(sections) > 1 else []
    head = ["change", "tip max", "tip RMS", *by_section, "time", "instructions", "states"]
    body: list[list[str]] = []
    floor = found.baseline.floor_m
    for row in found.rows:
        if row.errors is None or row.cost is None:
            continue
        largest = [_error(e, floor) for e in row.errors.largest]
        shown = [row.change.name, largest[-1], _error(row.errors.rms[-1], floor)]
        shown += largest if by_section else []
        instructions = row.cost.instructions / found.baseline.cost.instructions
        body.append([*shown, f"{row.time_ratio:.2f}", f"{instructions:.2f}", str(row.cost.states)])
    lines = _aligned([head, *body]) if body else []
    failed = [f"{r.change.name}: {r.status}" for r in found.rows if r.errors is None]
    return "\n".join([*lines, *(["", "not run:", *failed] if failed else [])])


def _error(metres: float, floor: float) -> str:
    from softmpc.study.lengths import length_text

    return length_text(metres) if metres > floor else "< floor"


def _aligned(rows: list[list[str]]) -> list[str]:
    """The first column to the left, the others to the right."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = []
    for first, *rest in rows:
        cells = [cell.rjust(width) for cell, width in zip(rest, widths[1:], strict=True)]
        lines.append("  ".join([first.ljust(widths[0]), *cells]))
    return lines


def _proposed(proposal: Proposal, data: dict[str, Any]) -> str:
    from softmpc.study.lengths import length_text

    error = length_text(proposal.errors.worst)
    verdict = "within" if proposal.within else "NOT within"
    lines = [
        f"cheapest scene {verdict} {length_text(proposal.tolerance_m)}: largest error {error}, "
        f"{proposal.speed_factor:.2f} times as fast",
        *(f"  {name}" for name in proposal.changes or ("the scene as given",)),
    ]
    lines += [f"  left in, for it saves nothing beside these: {name}" for name in proposal.undone]
    finer = [r for r in data["rows"] if r["kind"] == "finer" and "max_error_m" in r]
    beyond = [r for r in finer if max(r["max_errors_by_section_m"]) > proposal.tolerance_m]
    lines += [
        f"  note: {r['change']} moves the tip by {length_text(r['max_error_m'])}, which is more "
        "than the tolerance: the scene as given is not that exact"
        for r in beyond
    ]
    return "\n".join(lines)
