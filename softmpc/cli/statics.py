"""`softmpc statics SCENE`: the posture at rest under pressures or torques."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from softmpc.cli.common import (
    NOT_CONVERGED,
    OK,
    Answer,
    Numbers,
    answering,
    load,
    row,
    scene_argument,
    table,
    write_text,
)
from softmpc.errors import InputError

if TYPE_CHECKING:
    import numpy as np

    from softmpc.model.model import Model
    from softmpc.statics.equilibrium import Equilibrium

__all__ = ["command"]


@click.command("statics")
@scene_argument
@click.option(
    "--pressure", type=Numbers(), metavar="MPA,…", help="Unit pressures in MPa, one value a unit."
)
@click.option(
    "--torque", type=Numbers(), metavar="NM,…", help="Motor torques in N·m, one value a unit."
)
@answering("statics")
def command(
    scene: Path, pressure: list[float] | None, torque: list[float] | None, out: Path | None
) -> Answer:
    """Find the posture at rest of the arm in the scene file SCENE.

    Give either --pressure or --torque, for instance --pressure 0.6,0,0,0,0.3,0.3
    """
    from softmpc.model.model import build
    from softmpc.statics.equilibrium import find_equilibrium

    if (pressure is None) == (torque is None):
        raise click.UsageError("give either --pressure or --torque", click.get_current_context())
    title, parsed = load(scene)
    model = build(parsed)
    pressures = _from_mpa(model, pressure) if pressure else _from_torque(model, torque or [])
    found = find_equilibrium(model, pressures)
    data = {"title": title, **_data(model, found), "warnings": _warnings(model, found)}
    if torque:
        data["torques_nm"] = torque
    if out:
        _write(out, model, found, title)
    if found.converged:
        return Answer(data, _text(data), OK)
    return Answer(data, _text(data), NOT_CONVERGED, f"the statics did not converge: {found.status}")


def _from_mpa(model: Model, values: Sequence[float]) -> np.ndarray:
    import numpy as np

    limits = model.scene.manipulator.limits
    low, high = limits.pressure_min / 1e6, limits.pressure_max / 1e6
    _check("--pressure", values, model, low, high, "MPa")
    return np.array(values) * 1e6


def _from_torque(model: Model, values: Sequence[float]) -> np.ndarray:
    from softmpc.statics.equilibrium import pressures_from_torques

    limits = model.scene.manipulator.limits
    if model.scene.actuation.input == "torque":
        _check("--torque", values, model, limits.torque_min, limits.torque_max, "N·m")
    return pressures_from_torques(model, values)


def _check(
    option: str, values: Sequence[float], model: Model, low: float, high: float, unit: str
) -> None:
    """Raise `InputError` unless there is one value a unit, each within the limits."""
    units = model.scene.manipulator.units
    if len(values) != units:
        raise InputError(f"{option}: {len(values)} values given, this arm has {units} units")
    for number, value in enumerate(values, 1):
        if not low <= value <= high:
            raise InputError(
                f"{option}: unit {number} = {value:g} {unit}: must be between {low:g} and "
                f"{high:g} {unit}, see [limits] in the scene file"
            )


def _data(model: Model, found: Equilibrium) -> dict[str, Any]:
    from softmpc.statics.rest_limits import piston_travel

    data = {
        "converged": found.converged,
        "status": found.status,
        "stable": found.stable,
        "smallest_stiffness_j": found.smallest_stiffness,
        "residual": found.residual,
        "iterations": found.iterations,
        "tips_m": found.tips,
        "strain_names": list(model.layout.q.names),
        "strains": found.q,
        "pressures_mpa": found.pressures / 1e6,
        "segments": _segments(model, found.q),
    }
    travel = piston_travel(model, found.q, found.pressures)
    return data if travel is None else data | {"piston_travel_mm": travel * 1e3}


def _segments(model: Model, q: np.ndarray) -> list[dict[str, float]]:
    """Shape of each segment, Eq. (2)."""
    from math import degrees

    from softmpc.model.scene import STRAINS
    from softmpc.model.shape import shape_parameters

    scene = model.scene
    rows = []
    for i, given in enumerate(q.reshape(-1, len(scene.strains))):
        section, segment = divmod(i, scene.segments)
        values = dict(zip(scene.strains, given.tolist(), strict=True))
        rest = scene.manipulator.sections[section].length / scene.segments
        shape = shape_parameters(rest, [values.get(name, 0.0) for name in STRAINS])
        angles = {f"{k}_deg": degrees(getattr(shape, k)) for k in ("theta", "phi", "tau")}
        place = {"section": section + 1, "segment": segment + 1}
        rows.append({**place, "length_m": shape.length, **angles})
    return rows


def _warnings(model: Model, found: Equilibrium) -> list[str]:
    """What is not wrong input, yet not as it should be."""
    from softmpc.statics.rest_limits import beyond_limits

    said = beyond_limits(model, found.q, found.pressures)
    if found.converged and not found.stable:
        said.append("this equilibrium is not stable: the arm would not stay there")
    return said


def _write(out: Path, model: Model, found: Equilibrium, title: str) -> None:
    import numpy as np

    from softmpc.files import replacing
    from softmpc.view.posture import posture_figure
    from softmpc.view.style import save_figure

    write_text(out / "statics.csv", _csv(model, found))
    arrays = {"q": found.q, "p": found.pressures, "tips": found.tips, "rotations": found.rotations}
    with replacing(out / "statics.npz") as beside:
        np.savez(beside, allow_pickle=False, **arrays)
    state = "" if found.stable else f" ({'not stable' if found.converged else found.status})"
    save_figure(posture_figure(model, found.q, title + state), out / "posture.png")


def _csv(model: Model, found: Equilibrium) -> str:
    """One row a value: name, value, unit."""
    layout = model.layout
    rows: list[tuple[object, ...]] = [("name", "value", "unit"), ("status", found.status, "")]
    rows += zip(layout.q.names, found.q.tolist(), layout.q.units, strict=True)
    rows += zip(layout.p.names, found.pressures.tolist(), layout.p.units, strict=True)
    for i, tip in enumerate(found.tips.tolist(), 1):
        rows += [(f"{axis}_{i}", value, "m") for axis, value in zip("xyz", tip, strict=True)]
    return "\n".join(",".join(str(cell) for cell in row) for row in rows)


def _text(data: dict[str, Any]) -> str:
    rows: list[tuple[str, object]] = [
        ("status", data["status"] + (", stable" if data["stable"] else "")),
        ("pressures (MPa)", row(data["pressures_mpa"])),
    ]
    if "torques_nm" in data:
        rows.append(("torques (N·m)", row(data["torques_nm"])))
    if "piston_travel_mm" in data:
        rows.append(("piston travel (mm)", row(data["piston_travel_mm"])))
    for i, tip in enumerate(data["tips_m"], 1):
        rows.append((f"tip of section {i} (m)", row(tip)))
    for s in data["segments"]:
        rows.append((
            f"section {s['section']}, segment {s['segment']}",
            f"length {s['length_m']:.4f} m, {_bend(s)}, "
            f"twisted {round(s['tau_deg'], 2) + 0.0:.2f} deg",
        ))  # fmt: skip
    rows.append(("smallest stiffness", f"{data['smallest_stiffness_j']:.4g} J"))
    rows += [("warning", text) for text in data["warnings"]]
    return "\n".join([data["title"], table(rows)])


def _bend(shape: dict[str, Any]) -> str:
    """How a segment bends; a straight one bends towards nowhere."""
    if round(shape["theta_deg"], 2) == 0:
        return "straight"
    return f"bent {shape['theta_deg']:.2f} deg towards {shape['phi_deg']:.2f} deg"
