"""The plant of a scene in C: sizes, constant arrays and functions beside `c/demo/plant*.c`.

The arm's equations and their derivatives are those of the simulation (`System`). A linear drive is
known in closed form, any other is solved with the arm. The steps around them are written in C after
`softmpc.simulation.trial`, with one system of equations for all stages. Always in double, whatever
the controller computes in.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from softmpc.codegen import c_text
from softmpc.codegen.model_functions import Wrapped, in_rows, sources
from softmpc.control.state_map import StateMap
from softmpc.errors import BuildError, InputError
from softmpc.model.model import Model
from softmpc.simulation.runge_kutta import LEAST, MOST
from softmpc.simulation.system import System
from softmpc.simulation.tableau import radau_iia

__all__ = ["TOLERANCE", "plant_files"]

STAGES = 3
TOLERANCE = 1e-8  # m, at the tip, of a step


def plant_files(plant: Model, controller: Model, tolerance: float = TOLERANCE) -> dict[str, str]:
    """Constants and functions of the plant, files in `demo` by name.

    `tolerance`: error of a step (m, at the tip). The state of `controller` follows from the
    plant's by `StateMap`. Raises `BuildError` for an arm with neither mass nor damping,
    `InputError` for a tolerance that is out of range.
    """
    if not LEAST <= tolerance <= MOST:
        raise InputError(f"tolerance = {tolerance!r} m: must be between {LEAST:g} and {MOST:g} m")
    if plant.order == 0:
        raise BuildError(
            "the plant in C needs inertia or damping, this scene has neither: add an effect, such "
            "as material_damping, or give [track.plant] a scene that has one"
        )
    system = System(plant)
    functions = [_rows(system), _blocks(system), _drive(system), _ends(plant)]
    arrays = _arrays(system, StateMap(plant, controller))
    declared = "".join(c_text.declaration(n, v.size, "double") for n, v in arrays.items())
    sizes = _sizes(system, len(controller.layout.x), tolerance)
    return {
        **sources("demo/plant_model", functions),
        "demo/plant_data.h": c_text.guard("plant_data.h", f"{sizes}\n{declared}"),
        "demo/plant_data.c": '#include "plant_data.h"\n\n'
        + "\n".join(c_text.array(name, value, "double") for name, value in arrays.items()),
    }


# --- functions ------------------------------------------------------------------------------------


def _rows(system: System) -> Wrapped:
    return _wrapped("rows", system.rows, "scaled equations of a stage, zero along a motion")


def _blocks(system: System) -> Wrapped:
    return _wrapped("blocks", system.blocks, "slopes in the unknowns, their first, second integral")


def _wrapped(name: str, function: ca.Function, comment: str) -> Wrapped:
    names = ["acting" if of == "w" else of for of in function.name_in()]  # w is work memory in C
    given: dict[str, Any] = {of: ca.MX.sym(of, *function.size_in(i)) for i, of in enumerate(names)}
    found = dict(zip(function.name_out(), function.call([*given.values()]), strict=True))
    return Wrapped(f"plant_{name}", in_rows(f"plant_{name}", given, found), comment, "double")


def _drive(system: System) -> Wrapped:
    layout, drive = system.model.layout, system.model.drive
    h, k = len(layout.z), len(layout.u)
    z, u, t = ca.SX.sym("z", h), ca.SX.sym("u", k), ca.SX.sym("t")
    after = z if system.drive is None else _moved(system, z, u, t)
    pressures = _sparse(drive.C) @ after + _sparse(drive.D) @ u
    given = {"z": z, "u": u, "t": t}
    function = in_rows("plant_drive", given, {"z_after": after, "p": pressures})
    comment = "states and pressures of the linear drive t seconds after z, u being held"
    return Wrapped("plant_drive", function, comment, "double")


def _moved(system: System, z: ca.SX, u: ca.SX, t: ca.SX) -> ca.SX:
    """States of the drive after t seconds: what `DriveMotion.states` says, column by column."""
    drive, given = system.drive, ca.vertcat(z, u)
    assert drive is not None
    h, k = z.numel(), u.numel()
    every = np.eye(h + k)
    law = drive.law(every[:, :h], every[:, h:], np.zeros((h + k, k)))
    found = _sparse(law.constant.T) @ given
    for j, rate in enumerate(drive.rates):
        wave = law.modes[:, :, j].T
        decay, turn = ca.exp(float(rate.real) * t), float(rate.imag) * t
        found += decay * ca.cos(turn) * (_sparse(wave.real) @ given)
        if rate.imag:
            found -= decay * ca.sin(turn) * (_sparse(wave.imag) @ given)
    return found


def _ends(plant: Model) -> Wrapped:
    q = ca.MX.sym("q", plant.strains)
    tips = ca.vec(plant.frames(q)[0])
    function = in_rows("plant_ends", {"q": q}, {"tips": tips})
    return Wrapped("plant_ends", function, "places of the ends of the sections", "double")


def _sparse(matrix: np.ndarray) -> ca.DM:
    return ca.sparsify(ca.DM(matrix))


# --- numbers --------------------------------------------------------------------------------------


def _arrays(system: System, seen: StateMap) -> dict[str, np.ndarray]:
    tableau = radau_iia(STAGES)
    gamma, weights = tableau.embedded
    found = {
        "A": tableau.A,
        "A2": tableau.A @ tableau.A,
        "c": tableau.c,
        "embedded": np.concatenate([[gamma], weights]),
        "y_scale": system.y_scale,
        "levers": system.levers * system.y_scale,
        "seen_by_x": seen.A,
        "seen_by_u": seen.B,
    }
    return {f"smpc_plant_{name}": value for name, value in found.items()}


def _sizes(system: System, seen: int, tolerance: float) -> str:
    layout = system.model.layout
    sizes: dict[str, tuple[object, str]] = {
        "NX": (len(layout.x), "states: strains, their rates, drive"),
        "INPUTS": (len(layout.u), "inputs"),
        "N": (system.n, "strains"),
        "NZ": (len(layout.z), "states of the drive"),
        "SECTIONS": (len(system.model.scene.manipulator.sections), "of the arm"),
        "SEEN": (seen, "states of the controller's model"),
        "ORDER": (system.order, "2 with inertia, 1 without"),
        "JOINT": (int(system.joint), "whether the drive is solved with the arm"),
        "K": (system.k, "states of the drive that are"),
        "NW": (system.inputs, "pressures, or inputs of a drive solved with the arm"),
        "SIZE": (system.size, "unknowns of a stage"),
        "STAGES": (STAGES, "of a step"),
        "UNKNOWNS": (STAGES * system.size, "of a step"),
        "TOLERANCE": (float(tolerance), "m, at the tip, of a step"),
    }
    return "".join(c_text.define(f"SMPC_PLANT_{name}", *both) for name, both in sizes.items())
