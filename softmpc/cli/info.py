"""`softmpc info SCENE`: what a scene is as a model."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from softmpc.cli.common import Answer, answering, load, scene_argument, table

if TYPE_CHECKING:
    from softmpc.model.model import Model
    from softmpc.model.scene import Scene

__all__ = ["command"]


@click.command("info")
@scene_argument
@answering("info")
def command(scene: Path, out: Path | None) -> Answer:
    """Show the scene file SCENE as a model: states, inputs, effects, size of its functions."""
    from softmpc.model.model import build

    title, parsed = load(scene)
    start = time.perf_counter()
    model = build(parsed)
    instructions = model.instructions()
    data = {
        "title": title,
        **_arm(parsed),
        **_variables(model),
        "effects": [effect.name for effect in parsed.effects],
        **_drive(model),
        "instructions": instructions,
        "build_s": time.perf_counter() - start,
    }
    return Answer(data, _text(data))


def _arm(scene: Scene) -> dict[str, Any]:
    from softmpc.model.scene import SCHEMA_VERSION

    arm, form = scene.manipulator, scene.formulation
    return {
        "schema": SCHEMA_VERSION,
        "parameters": arm.name,
        "sections": len(arm.sections),
        "segments": scene.segments,
        "units": arm.units,
        "length_m": arm.length,
        "formulation": form.name,
        "kinematics": scene.kinematics.name,
        "mass": form.mass.name,
        "elasticity": form.elasticity.name,
        "actuation": scene.actuation.name,
        "strains": list(scene.strains),
    }


def _variables(model: Model) -> dict[str, Any]:
    """Names of states and inputs; rates are states only where there is inertia."""
    layout = model.layout
    states = [*layout.q.names, *(layout.dq.names if model.order == 2 else ()), *layout.z.names]
    return {
        "states": states,
        "state_count": len(states),
        "inputs": list(layout.u.names),
        "input_unit": layout.u.units[0],
        "massless": list(model.massless),
    }


def _drive(model: Model) -> dict[str, Any]:
    """Poles of one drive of each section, and its gain at rest; nothing without a drive."""
    import numpy as np

    if model.scene.actuation.input != "torque":
        return {}
    units, A = model.scene.manipulator.units, model.drive.A
    firsts = np.cumsum([0, *(section.units for section in model.scene.manipulator.sections[:-1])])
    found: dict[str, Any] = {
        "static_gain_mpa_per_nm": np.diag(model.drive.static_gain)[firsts] / 1e6,
    }
    if len(A):
        found["drive_poles_per_s"] = [_poles(A[i::units, i::units]) for i in firsts]
    return found


def _poles(matrix: Any) -> list[Any]:
    """Poles, slowest last; one that swings as [real part, imaginary part]."""
    import numpy as np

    poles = np.sort_complex(np.linalg.eigvals(matrix))
    return [float(p.real) if p.imag == 0 else [float(p.real), float(p.imag)] for p in poles]


def _text(data: dict[str, Any]) -> str:
    arm = "{sections} sections x {segments} segments, {units} units, {length_m:g} m"
    rows: list[tuple[str, object]] = [
        ("parameters", data["parameters"]),
        ("arm", arm.format(**data)),
        ("formulation", "{formulation}, mass {mass}, elasticity {elasticity}".format(**data)),
        ("kinematics", data["kinematics"]),
        ("strains", ", ".join(data["strains"])),
        ("effects", ", ".join(data["effects"]) or "none"),
        ("actuation", data["actuation"]),
        ("states", data["state_count"]),
        ("inputs", f"{len(data['inputs'])} ({data['input_unit']})"),
        ("massless", ", ".join(data["massless"]) or "none"),
    ]
    for i, poles in enumerate(data.get("drive_poles_per_s", []), 1):
        shown = ", ".join(_pole_text(pole) for pole in poles)
        rows.append((f"drive poles, section {i}", f"{shown} 1/s"))
    for i, gain in enumerate(data.get("static_gain_mpa_per_nm", []), 1):
        rows.append((f"static gain, section {i}", f"{gain:.4g} MPa per N·m"))
    rows.append(("built in", f"{data['build_s']:.2f} s"))
    counts = [(f"  {name}", f"{count:9,d}") for name, count in data["instructions"].items()]
    return "\n".join([data["title"], table(rows), "instructions", table(counts)])


def _pole_text(pole: Any) -> str:
    return f"{pole:.4g}" if isinstance(pole, float) else f"{pole[0]:.4g}{pole[1]:+.4g}i"
