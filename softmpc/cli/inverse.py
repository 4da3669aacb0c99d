"""`softmpc inverse SCENE`: pressures and torques that hold the tip at rest."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from softmpc.cli.common import (
    NOT_CONVERGED,
    OK,
    Answer,
    answering,
    load,
    row,
    scene_argument,
    table,
    write_text,
)
from softmpc.cli.sweep_options import sweep_options
from softmpc.cli.target_options import (
    Held,
    Place,
    SectionNumbers,
    check_targets,
    held_units,
    read_targets,
    targets_from,
)

if TYPE_CHECKING:
    from softmpc.statics.inverse import InverseStatics
    from softmpc.statics.inverse_result import InverseResult
    from softmpc.statics.targets import Target

__all__ = ["command"]

COSTS = ("least-pressure", "least-strain-energy", "closest-posture", "greatest-margin")
COMPARED = 5


@click.command("inverse")
@scene_argument
@click.option(
    "--tip", type=Place(), multiple=True, metavar="X,Y,Z",
    help="Where the tip shall be, in m; '-' leaves a coordinate free. The tip of section 1: "
    "1:X,Y,Z. May be given again for another section.",
)  # fmt: skip
@click.option(
    "--direction", type=SectionNumbers(), multiple=True, metavar="X,Y,Z",
    help="Where the axis of the tip shall point.",
)  # fmt: skip
@click.option(
    "--rotation", type=SectionNumbers(), multiple=True, metavar="X,Y,Z",
    help="The tip's whole orientation, as a rotation vector in degrees.",
)  # fmt: skip
@click.option(
    "--targets", "file", type=click.Path(path_type=Path), metavar="FILE",
    help="Many targets: a CSV file with columns x,y,z or x,y,z,dx,dy,dz.",
)  # fmt: skip
@click.option("--path", is_flag=True, help="FILE is a path: start each row from the one before.")
@click.option(
    "--cost", type=click.Choice(COSTS), default=COSTS[0], show_default=True,
    help="What decides where several postures hold the target.",
)  # fmt: skip
@click.option(
    "--hold", type=Held(), multiple=True, metavar="UNIT=MPA",
    help="A unit that is stuck there, such as P_2=0.3.",
)  # fmt: skip
@click.option(
    "--compare", type=click.IntRange(min=1), metavar="N",
    help="Take the best of N starts that hold the target.  [default: 5, of many targets 1]",
)  # fmt: skip
@sweep_options
@answering("inverse")
def command(
    scene: Path,
    tip: tuple[Any, ...],
    direction: tuple[Any, ...],
    rotation: tuple[Any, ...],
    file: Path | None,
    path: bool,
    cost: str,
    hold: tuple[tuple[int, float], ...],
    compare: int | None,
    workers: int | None,
    dask: str | None,
    out: Path | None,
) -> Answer:
    """Find pressures and torques that hold the tip of the arm in the scene file SCENE, at rest.

    For instance --tip 0.1,0,0.55 --direction 0,0,1. Of a target out of reach the nearest posture
    is found, and the exit status is 3.
    """
    from softmpc.model.model import build
    from softmpc.statics.inverse import InverseStatics
    from softmpc.statics.rest_costs import REST_COSTS

    if bool(file) == bool(tip or direction or rotation):
        raise click.UsageError(
            "give --tip, --direction or --rotation, or a file of --targets",
            click.get_current_context(),
        )
    if path and not file:
        raise click.UsageError("--path is for a file of --targets", click.get_current_context())
    cases = read_targets(file) if file else [targets_from(tip, direction, rotation)]
    held = held_units(hold)
    title, parsed = load(scene)
    for number, targets in enumerate(cases, 1):
        which = f"target {number} of {len(cases)}" if len(cases) > 1 else "the target"
        check_targets(which, parsed, targets)
    inverse = InverseStatics(build(parsed), REST_COSTS[cost](), held)
    if file is None:
        return _one(inverse, cases[0], title, compare or COMPARED, out)
    from softmpc.cli.inverse_batch import many

    return many(inverse, cases, title, path, compare or 1, workers, dask, out)


def _one(
    inverse: InverseStatics, targets: list[Target], title: str, compare: int, out: Path | None
) -> Answer:
    found = inverse.solve(targets, compare=compare)
    data = {"title": title, "cost": inverse.cost.name, **summary(found)}
    data |= _more(inverse, found)
    data["warnings"] = warnings(found) + _unsettled(data)
    if out:
        _write(out, inverse, found, title)
    status = OK if found.solved else NOT_CONVERGED
    return Answer(data, _text(data), status, problem(found))


def summary(found: InverseResult) -> dict[str, Any]:
    """The same for one target and for each of many."""
    from math import degrees

    return {
        "status": found.status,
        "tip_m": found.tips[-1],
        "distance_mm": found.distance * 1e3,
        "angle_deg": degrees(found.angle),
        "pressures_mpa": found.pressures / 1e6,
        "torques_nm": found.torques,
        "stable": found.stable,
        "on_rest_branch": found.on_rest_branch,
        "smallest_stiffness_j": found.smallest_stiffness,
        "active_limits": list(found.active),
        "cost_value": found.cost,
        "iterations": found.iterations,
        "starts": found.starts,
        "seconds": found.seconds,
    }


def _more(inverse: InverseStatics, found: InverseResult) -> dict[str, Any]:
    """What is worth it for one target."""
    model = inverse.model
    data: dict[str, Any] = {
        "tips_m": found.tips,
        "rotation": found.posture.rotations[-1],
        "strain_names": list(model.layout.q.names),
        "strains": found.q,
    }
    if found.torque_band:
        data["torque_band_nm"] = found.torque_band
    if found.solution is not None:
        slopes = inverse.sensitivities(found)
        by_torque = None if slopes.torques is None else slopes.torques
        data |= {
            "tip_compliance_mm_per_n": slopes.compliance * 1e3,
            "moves": list(slopes.moves),
            "pressures_by_moves_mpa": slopes.pressures / 1e6,
            "torques_by_moves_nm": by_torque,
        }
    return data


def problem(found: InverseResult) -> str:
    """Why the exit status is not 0; empty where it is."""
    if found.status == "unreachable":
        return f"the target is out of reach: the nearest posture misses it by {_miss(found)}"
    return "" if found.solved else "no start led to a posture within the limits"


def _miss(found: InverseResult) -> str:
    from math import degrees

    from softmpc.statics.targets import Position

    places = any(isinstance(target, Position) for target in found.targets)
    turns = not all(isinstance(target, Position) for target in found.targets)
    parts = [f"{found.distance * 1e3:.4g} mm"] * places + [f"{degrees(found.angle):.3g}°"] * turns
    return " and ".join(parts)


def warnings(found: InverseResult) -> list[str]:
    """What is not as it should be though there is a posture."""
    said = []
    if not found.stable:
        said.append("this equilibrium is not stable: the arm would not stay there")
    if found.stable and not found.on_rest_branch:
        said.append(
            "raising these pressures from the straight arm leads to another posture than this one"
        )
    return said


def _unsettled(data: dict[str, Any]) -> list[str]:
    """Where the derivatives of the pressures are not numbers."""
    from math import isfinite

    slopes = data.get("pressures_by_moves_mpa", ())
    if all(isfinite(slope) for row in slopes for slope in row):
        return []
    return [
        f"the cost {data['cost']} does not settle the pressures: others hold the tip there at the "
        "same cost, so how they follow a moved target is not known"
    ]


def _text(data: dict[str, Any]) -> str:
    rows: list[tuple[str, object]] = [
        ("status", data["status"] + (", stable" if data["stable"] else "")),
        ("tip (m)", row(data["tip_m"])),
        ("off by", f"{data['distance_mm']:.4g} mm, {data['angle_deg']:.4g} deg"),
        ("pressures (MPa)", row(data["pressures_mpa"])),
    ]
    if data["torques_nm"] is not None:
        rows.append(("torques (N·m)", row(data["torques_nm"])))
    if "torque_band_nm" in data:
        rows.append(("friction holds", f"± {data['torque_band_nm']:.4g} N·m"))
    rows.append(("at its limits", ", ".join(data["active_limits"]) or "nothing"))
    rows.append(("smallest stiffness", f"{data['smallest_stiffness_j']:.4g} J"))
    if "moves" in data:
        rows += [
            (f"tip (mm) by 1 N along {axis}", row(column, 3))
            for axis, column in zip("xyz", data["tip_compliance_mm_per_n"].T, strict=True)
        ]
        rows += [
            (f"MPa by {'1 deg' if move.startswith('turn') else '1 mm'} {move}", row(column, 5))
            for move, column in zip(data["moves"], _small(data), strict=True)
        ]
    rows += [("warning", text) for text in data["warnings"]]
    return "\n".join([data["title"], table(rows)])


def _small(data: dict[str, Any]) -> list[Any]:
    """Pressures (MPa) by each move of 1 mm or 1 degree."""
    from math import radians

    units = [radians(1) if name.startswith("turn") else 1e-3 for name in data["moves"]]
    columns = data["pressures_by_moves_mpa"].T
    return [column * unit for column, unit in zip(columns, units, strict=True)]


def _write(out: Path, inverse: InverseStatics, found: InverseResult, title: str) -> None:
    import numpy as np

    from softmpc.files import replacing
    from softmpc.view.inverse import inverse_figure
    from softmpc.view.style import save_figure

    write_text(out / "inverse.csv", _csv(inverse, found))
    arrays = {
        "q": found.q, "p": found.pressures, "tips": found.tips,
        "rotations": found.posture.rotations,
    }  # fmt: skip
    if found.torques is not None:
        arrays["torques"] = found.torques
    with replacing(out / "inverse.npz") as beside:
        np.savez(beside, allow_pickle=False, **arrays)
    save_figure(inverse_figure(inverse.model, found, title), out / "inverse.png")


def _csv(inverse: InverseStatics, found: InverseResult) -> str:
    """One row a value: name, value, unit."""
    layout = inverse.model.layout
    rows: list[tuple[object, ...]] = [("name", "value", "unit"), ("status", found.status, "")]
    rows += [("distance", found.distance, "m"), ("angle", found.angle, "rad")]
    rows += zip(layout.p.names, found.pressures.tolist(), layout.p.units, strict=True)
    if found.torques is not None:
        rows += zip(layout.u.names, found.torques.tolist(), layout.u.units, strict=True)
    rows += zip(layout.q.names, found.q.tolist(), layout.q.units, strict=True)
    for i, tip in enumerate(found.tips.tolist(), 1):
        rows += [(f"{axis}_{i}", value, "m") for axis, value in zip("xyz", tip, strict=True)]
    return "\n".join(",".join(str(cell) for cell in row) for row in rows)
