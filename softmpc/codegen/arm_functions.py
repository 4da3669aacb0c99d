"""The equations of an arm in C, for whoever wants more than its controller: `arm/` of a directory.

What they are in Python (`softmpc.model.model.Model`) they are there: SI, one function a file, so
that a program links only those that it calls. The controller has its own, scaled ones.
"""

from __future__ import annotations

import textwrap
from typing import Any

import casadi as ca

from softmpc.codegen import c_text
from softmpc.codegen.model_functions import Wrapped, in_rows, sources
from softmpc.model.layout import Variables
from softmpc.model.model import Model

__all__ = ["arm_files", "arm_functions"]

ABOUT = """\
/* Equations of the arm, its hydraulics and its places, in SI; matrices row by row.
 *
{variables}
 * r, N, tau: forces on the strains; times dq they are powers in W
 *
 * Compile the files that are needed with the directory of real.h as include directory. */

#include "real.h"

#ifdef __cplusplus
extern "C" {{
#endif
"""
END = "#ifdef __cplusplus\n}\n#endif\n"
WIDTH = 96  # characters of a line
ASCII = str.maketrans({"·": " ", "²": "^2", "³": "^3"})


def arm_files(model: Model) -> dict[str, str]:
    """arm/arm.h and a source file for each function, by name."""
    functions = arm_functions(model)
    found = sources("arm/arm", functions)
    files = {name.replace("arm_arm_", "arm_"): text for name, text in found.items()}
    declared = "\n".join(f"{_comment(one.comment)}\n{one.signature};\n" for one in functions)
    about = ABOUT.format(variables="\n".join(_variables(model)))
    return files | {"arm/arm.h": c_text.guard("arm/arm.h", f"{about}\n{declared}\n{END}")}


def arm_functions(model: Model) -> list[Wrapped]:
    """Residual and its Jacobian, M, C, N, τ, drive, pressures, places and their Jacobian.

    Those that an arm does not have, such as places of pistons that are not there, are left out.
    """
    functions = [
        _as_it_is("residual", model.residual, "r = M ddq + C dq + N - tau, zero along a motion"),
        _as_it_is("residual_jacobian", model.residual_jacobian, "slopes of r"),
        _as_it_is("M", model.M, "inertia"),
        _as_it_is("C", model.C, "Coriolis forces and damping; dM/dt - 2 C is skew without it"),
        _as_it_is("N", model.N, "elastic forces less weight"),
        _as_it_is("tau", model.tau, "forces of drive and load"),
        _as_it_is("drive_rate", model.drive_rate, "dz/dt"),
        _as_it_is("drive_jacobian", model.drive_jacobian, "slopes of dz/dt"),
        _pressures(model),
        _as_it_is("pistons", model.piston_places, "places of the pistons, m"),
        _as_it_is("flows", model.tube_flows, "from cylinders to units through the tubes, m^3/s"),
        _as_it_is("tip", model.tip, "place of the tip, m, base frame"),
        _frames(model),
        _as_it_is("tip_jacobian", model.tip_jacobian, "slopes of the ends of all sections"),
    ]
    return [one for one in functions if any(_sizes_out(one.function))]


def _sizes_out(function: ca.Function) -> list[int]:
    return [function.numel_out(i) for i in range(function.n_out())]


def _as_it_is(name: str, function: ca.Function, comment: str) -> Wrapped:
    kind: Any = ca.MX if function.is_a("MXFunction") else ca.SX
    given = {of: kind.sym(of, *function.size_in(i)) for i, of in enumerate(function.name_in())}
    outputs = function.call([*given.values()])
    return _wrapped(name, given, dict(zip(function.name_out(), outputs, strict=True)), comment)


def _wrapped(name: str, given: dict[str, Any], found: dict[str, Any], comment: str) -> Wrapped:
    """The function, with the sizes of all that goes in and out behind the comment."""
    kept = {of: value for of, value in found.items() if value.numel() or len(found) == 1}
    sizes = (
        ", ".join(f"{of}{_size(value)}" for of, value in values.items()) for values in (given, kept)
    )
    text = f"{comment}: {' -> '.join(sizes)}"
    return Wrapped(f"arm_{name}", in_rows(f"casadi_arm_{name}", given, kept), text)


def _size(value: Any) -> str:
    rows, columns = value.shape
    return f"[{rows}]" if columns == 1 else f"[{rows}][{columns}]"


def _pressures(model: Model) -> Wrapped:
    z, u = (ca.SX.sym(name, len(of)) for name, of in (("z", model.layout.z), ("u", model.layout.u)))
    found = {"p": model.pressures(z, u)}
    return _wrapped("pressures", {"z": z, "u": u}, found, "of the units")


def _frames(model: Model) -> Wrapped:
    q = ca.SX.sym("q", model.strains)
    tips, rotations = model.frames(q)
    below = ca.vertcat(*ca.horzsplit(rotations, 3))
    comment = "ends of the sections, m, base frame, and their rotations, one below the other"
    return _wrapped("frames", {"q": q}, {"tips": tips.T, "rotations": below}, comment)


def _comment(text: str) -> str:
    return textwrap.fill(f"/* {text} */", WIDTH, subsequent_indent=" * ")


def _variables(model: Model) -> list[str]:
    layout = model.layout
    lines = [
        f"q: strains, {_names(layout.q)}",
        "dq, ddq: their first and second derivatives in time",
        f"z: states of the drive, {_names(layout.z) or 'none'}",
        f"u: inputs, {_names(layout.u)}",
        f"p: pressures of the units, {_names(layout.p)}",
    ]
    return [
        textwrap.fill(line, WIDTH, initial_indent=" * ", subsequent_indent=" *    ")
        for line in lines
    ]


def _names(variables: Variables) -> str:
    pairs = zip(variables.names, variables.units, strict=True)
    named = ", ".join(f"{name} ({unit})" if unit else name for name, unit in pairs)
    return named.translate(ASCII)
