"""`softmpc workspace SCENE`: where the tip can be at rest, and the limits of each section."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from softmpc.cli.common import (
    OK,
    Answer,
    answering,
    load,
    notice,
    progress,
    row,
    scene_argument,
    table,
)
from softmpc.cli.sweep_options import executor_for, sweep_options
from softmpc.cli.target_options import Held, held_units

if TYPE_CHECKING:
    from softmpc.model.model import Model
    from softmpc.statics.workspace_check import WorkspaceCheck
    from softmpc.statics.workspace_result import Workspace

__all__ = ["command"]

KEPT = "workspace_parts"  # what is done, until all of it is
INSIDE = 200  # places between the surfaces that --check looks at, at most
NAMES = {
    "bending_angle_deg": ("bending angle", "deg"),
    "arc_length_m": ("arc length", "m"),
    "radius_m": ("radius", "m"),
}
KINDS = ("a point", "a curve", "a surface", "a body")


@click.command("workspace")
@scene_argument
@click.option(
    "--section", type=click.IntRange(min=1), metavar="K",
    help="The section whose tip it is about; all units move.  [default: the last one]",
)  # fmt: skip
@click.option(
    "--hold", type=Held(), multiple=True, metavar="UNIT=MPA",
    help="A unit that is stuck there, such as P_2=0.3.",
)  # fmt: skip
@click.option(
    "--azimuths", type=click.IntRange(min=4), default=24, show_default=True, metavar="N",
    help="Half-planes around the axis, an even number.",
)  # fmt: skip
@click.option(
    "--polars", type=click.IntRange(min=5), default=13, show_default=True, metavar="N",
    help="Rays in each half-plane, an odd number.",
)  # fmt: skip
@click.option(
    "--check", type=click.IntRange(min=1), metavar="N",
    help="Check the result with N random postures that the search has not seen.",
)  # fmt: skip
@sweep_options
@answering("workspace")
def command(
    scene: Path,
    section: int | None,
    hold: tuple[tuple[int, float], ...],
    azimuths: int,
    polars: int,
    check: int | None,
    workers: int | None,
    dask: str | None,
    out: Path | None,
) -> Answer:
    """Find where the tip of the arm in the scene file SCENE can be at rest.

    The outer and the inner surface, extents, volume, and the limits of bending angle, arc length
    and radius of each section. With --out, pictures and files too; interrupted, what is done stays
    there for the next time.
    """
    from softmpc.model.model import build

    held = held_units(hold)
    title, parsed = load(scene)
    model = build(parsed)
    space = _find(model, section, held, azimuths, polars, workers, dask, out).titled(title)
    data: dict[str, Any] = {"title": title, **space.summary()}
    if check:
        from softmpc.statics.workspace_check import check_workspace

        data["check"] = _check(check_workspace(model, space, check, inside=min(check, INSIDE)))
    data["warnings"] = _warnings(space)
    if out:
        _write(out, model, space, title)
    return Answer(data, _text(data, space), OK)


def _find(
    model: Model,
    section: int | None,
    held: dict[int, float],
    azimuths: int,
    polars: int,
    workers: int | None,
    dask: str | None,
    out: Path | None,
) -> Workspace:
    from softmpc.errors import InputError
    from softmpc.statics.workspace import find_workspace

    keep = out / KEPT if out else None
    with executor_for(workers, dask) as executor, progress("workspace", "%") as tell:
        try:
            space = find_workspace(
                model, section=section, held=held, azimuths=azimuths, polars=polars,
                executor=executor, progress=tell, keep=keep,
            )  # fmt: skip
        except KeyboardInterrupt:
            if keep:
                notice(f"what is done is kept in {keep}: the same command goes on from there")
            raise
        except InputError as error:
            if keep and str(error).startswith(str(keep)):
                raise InputError(
                    f"{keep} is what an interrupted search of another scene or with other options "
                    "left: repeat that one, remove the folder, or give another --out"
                ) from error
            raise
    if keep and keep.is_dir():
        for part in keep.glob("*.jsonl"):
            part.unlink()
        keep.rmdir()
    return space


def _check(found: WorkspaceCheck) -> dict[str, Any]:
    return {
        "samples": found.samples,
        "searched": found.searched,
        "outside_mm": found.outside * 1e3,
        "outside_by_grid_mm": found.by_grid * 1e3,
        "points": found.points,
        "unreachable_points": found.unreachable,
        "off_mm": found.off * 1e3,
        "filled": found.filled,
    }


def _warnings(space: Workspace) -> list[str]:
    """What is not as it should be, or not what one may take it for."""
    said = []
    if space.shell is None and space.dimension == 3:
        said.append(
            "no half-plane has both its ends confirmed, so there is no shell: mostly where the arm "
            "falls over; the places in reach are those of the samples"
        )
    elif space.shell is None and space.dimension:
        said.append(
            f"the tip is bound to {KINDS[space.dimension]}: there is no shell, the places in reach "
            "are those of the samples"
        )
    for name, side in (("outer", space.outer), ("inner", space.inner)):
        if side is None:
            continue
        missing, beyond = int((side.flags == 0).sum()), int((side.flags == 2).sum())
        if missing:
            said.append(f"{name} surface: nothing was found on {missing} of {side.flags.size} rays")
        if beyond:
            said.append(
                f"{name} surface: on {beyond} of {side.flags.size} rays equilibria go on that are "
                "not stable, or not reached from rest; it ends where they begin"
            )
    beyond = sum(e.place is not None and not e.place.best for e in space.extremes)
    if beyond:
        said.append(
            f"limits: {beyond} of {len(space.extremes)} are the best that was confirmed; searches "
            "went on to equilibria that are not stable, or not reached from rest"
        )
    lost = [e for e in space.extremes if e.place is None]
    said += [f"no {e.sense} {e.quantity} of section {e.section} was found" for e in lost]
    return said


def _write(out: Path, model: Model, space: Workspace, title: str) -> None:
    from softmpc.view.style import save_figure
    from softmpc.view.workspace import limit_postures_figure, workspace_figure
    from softmpc.view.workspace_cut import limit_postures, workspace_cut_figure

    space.save(out)
    save_figure(workspace_figure(model, space, title), out / "workspace.png")
    save_figure(workspace_cut_figure(model, space, title=title), out / "workspace_cut.png")
    if postures := limit_postures(space):
        figure = limit_postures_figure(model, postures, f"{title}: limit postures")
        save_figure(figure, out / "limit_postures.png")


def _text(data: dict[str, Any], space: Workspace) -> str:
    rows: list[tuple[str, object]] = [
        ("tip of section", data["section"]),
        ("the places in reach are", KINDS[data["dimension"]]),
    ]
    rows += [(f"{axis} (m)", row(ends)) for axis, ends in data["extents_m"].items()]
    if data["dimension"] == 3 and space.shell is not None:
        error = 1e3 * data["volume_error_m3"]
        rows.append(("volume", f"{1e3 * data['volume_m3']:.5g} l, ± {error:.2g} l by the grid"))
    if "area_m2" in data:
        rows.append(("area", f"{data['area_m2']:.5f} m²"))
    if space.shell is not None:
        rows += [
            ("radius from the base (m)", row(data["radius_m"])),
            ("polar angle (deg)", row(data["polar_deg"], 2)),
            ("points confirmed", _points(data["points"])),
            ("lines between them cut off", f"{data['grid_error_mm']:.2f} mm at most"),
        ]
    for found in data["limits"]:
        if found["quantity"] in NAMES:
            name, unit = NAMES[found["quantity"]]
            value = _value(found["value"], unit) if found["found"] else "not found"
            rows.append((f"section {found['section']}, {found['sense']} {name}", value))
    if "check" in data:
        c = data["check"]
        rows.append(("check", f"{c['samples']} postures, {c['outside_mm']:.3g} mm outside at most"))
        rows.append(("", f"{c['points']} points again, {c['unreachable_points']} unreachable"))
        if c["filled"] == c["filled"]:  # a number
            rows.append(("", f"{100 * c['filled']:.1f} % of places between the surfaces in reach"))
    rows.append(("time", f"{data['wall_s']:.1f} s"))
    rows += [("warning", text) for text in data["warnings"]]
    return "\n".join([data["title"], table(rows)])


def _value(value: float, unit: str) -> str:
    return f"{value:.4g} {unit}" if value < float("inf") else "straight"


def _points(counts: dict[str, dict[str, Any]]) -> str:
    return ", ".join(f"{side} {found['confirmed']}" for side, found in counts.items())
