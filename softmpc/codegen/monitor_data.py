"""What the monitor of a generated directory knows of its scene: limits, tubes, the reachable set.

`c/monitor.h` and `c/monitor.c` are the same for all scenes. Without a workspace no margin is known,
and a drive without tubes has no Reynolds numbers: neither costs anything then.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca
import numpy as np

from softmpc.codegen import c_text
from softmpc.codegen.directory import c_source
from softmpc.codegen.model_functions import Wrapped, in_rows, sources
from softmpc.errors import InputError
from softmpc.model.drive_laws import reynolds_per_flow
from softmpc.model.model import Model
from softmpc.simulation.validity import LAMINAR
from softmpc.statics.equilibrium import find_equilibrium
from softmpc.statics.rest_limits import RestLimits, rest_limits
from softmpc.statics.workspace_result import Workspace
from softmpc.statics.workspace_samples import Samples, box_samples, solve
from softmpc.statics.workspace_shell import Shell

__all__ = ["checked_shell", "monitor_files", "tube_count"]

SAME = 0.05  # of the arm's length, between tips of the file and of the model
AT_LIMIT = 1e-3  # of the range of pressures
COMPARED, CORNERS = 10, 64  # postures

Array = np.ndarray


def monitor_files(
    model: Model, references: Mapping[str, int], back_off: float = 0.0,
    workspace: Workspace | None = None,
) -> dict[str, str]:  # fmt: skip
    """Name and text of each file of a controller of `model`.

    `references`: sizes of what it is told of each node, by name; `back_off`: how much closer its
    limits of pressure are, a share of their range; `workspace`: where margins are measured. Raises
    `InputError` for a workspace of another arm, see `checked_shell`.
    """
    functions = []
    sizes = _sizes(model, references, back_off)
    arrays: dict[str, Array] = {"monitor_C": model.drive.C, "monitor_D": model.drive.D}
    if workspace is not None:
        shell = checked_shell(model, workspace)
        sizes |= _reach_sizes(shell, workspace)
        sizes["REACH_APART"] = (_apart(model, workspace.samples), "m, tips of model and workspace")
        arrays |= _reach(shell)
        functions.append(_tip(model))
    else:
        sizes["REACH"] = (0, "no workspace was given: margins are not known")
    if tube_count(model):
        functions.append(_reynolds(model))
    defined = "".join(c_text.define(f"SMPC_{name}", *both) for name, both in sizes.items())
    declared = "".join(c_text.declaration(f"smpc_{n}", v.size) for n, v in arrays.items())
    return {
        **{name: c_source(name) for name in ("monitor.h", "monitor.c")},
        **sources("model_monitor", functions),
        "monitor_data.h": c_text.guard(
            "monitor_data.h", f'#include "real.h"\n\n{defined}\n{declared}'
        ),
        "monitor_data.c": '#include "monitor_data.h"\n\n'
        + "\n".join(c_text.array(f"smpc_{name}", value) for name, value in arrays.items()),
    }


def tube_count(model: Model) -> int:
    """How many tubes the drive has."""
    return int(model.tube_flows.numel_out(0))


def _sizes(
    model: Model, references: Mapping[str, int], back_off: float
) -> dict[str, tuple[Any, str]]:
    limits, layout = model.scene.manipulator.limits, model.layout
    names = [*references]
    before = names[: names.index("tip")] if "tip" in names else None
    at = -1 if before is None else sum(references[name] for name in before)
    return {
        "MONITOR_PRESSURES": (len(layout.p), "units"),
        "MONITOR_DRIVE": (len(layout.z), "states of the drive"),
        "PRESSURE_MIN": (float(limits.pressure_min), "Pa"),
        "PRESSURE_MAX": (float(limits.pressure_max), "Pa"),
        "BACK_OFF": (float(back_off), "share of their range by which the controller's are closer"),
        "TUBES": (tube_count(model), "of which Reynolds numbers are known"),
        "LAMINAR": (LAMINAR, "Reynolds number up to which flow is laminar"),
        "TIP_REFERENCE": (at, "where the references of a node hold the tip; -1: nowhere"),
    }


# --- functions ------------------------------------------------------------------------------------


def _tip(model: Model) -> Wrapped:
    kind: Any = ca.MX if model.tip.is_a("MXFunction") else ca.SX
    q = kind.sym("q", model.strains)
    function = in_rows("casadi_tip_now", {"q": q}, {"tip": model.tip(q)})
    return Wrapped("tip_now", function, "place of the tip (m) for strains q")


def _reynolds(model: Model) -> Wrapped:
    z = ca.SX.sym("z", len(model.layout.z))
    number = ca.fabs(model.tube_flows(z)) * reynolds_per_flow(model.scene.manipulator.hydraulics)
    function = in_rows("casadi_reynolds", {"z": z}, {"number": number})
    return Wrapped("reynolds", function, "Reynolds number in each tube for states z of the drive")


# --- reachable set --------------------------------------------------------------------------------


def _reach_sizes(shell: Shell, workspace: Workspace) -> dict[str, tuple[Any, str]]:
    rims = shell.between(shell.azimuths)[0]
    return {
        "REACH": (1, "margins are known"),
        "REACH_AZIMUTHS": (len(shell.azimuths), "half-planes"),
        "REACH_NODES": (len(shell.nodes), "polar angles of each"),
        "REACH_FLAT": (int(shell.flat), "whether there is nothing between two half-planes"),
        "REACH_LOW_RIM": (int(np.any(rims[:, 0] > 0)), "whether the axis is out of reach"),
        "REACH_HIGH_RIM": (int(np.any(rims[:, 1] < np.pi)), "the same of its other end"),
        "REACH_ERROR": (workspace.grid_error, "m, what lines between the nodes cut off"),
    }


def _reach(shell: Shell) -> dict[str, Array]:
    """The shell without gaps: what is between half-planes that have any is linear."""
    rims, outer, inner = shell.between(shell.azimuths)
    return {
        "reach_frame": shell.frame, "reach_azimuths": shell.azimuths, "reach_nodes": shell.nodes,
        "reach_rims": rims, "reach_outer": outer, "reach_inner": inner,
    }  # fmt: skip


def checked_shell(model: Model, workspace: Workspace) -> Shell:
    """The surfaces of a workspace, where they are those of the model's tip.

    The file tells sections, pressures and postures: its pressures must be within the limits of the
    model, those that the model may have within the file's, and under the same pressures the tips
    must agree to 5 % of the arm's length (numbers of segments may differ). Raises `InputError`.
    """
    arm = model.scene.manipulator
    if workspace.section != len(arm.sections):
        raise InputError(
            f"workspace: is of the end of section {workspace.section}, this arm's tip is that of "
            f"section {len(arm.sections)}; run `softmpc workspace` with this scene"
        )
    units = workspace.samples.pressures.shape[1]
    if units != arm.units:
        raise InputError(
            f"workspace: is of an arm with {units} units, this one has {arm.units}; run `softmpc "
            "workspace` with this scene"
        )
    if workspace.held:
        raise InputError(
            f"workspace: units {', '.join(map(str, workspace.held))} were held, the controller "
            "moves all of them; run `softmpc workspace` without --hold"
        )
    if workspace.shell is None:
        raise InputError(
            "workspace: has no surfaces, because the tip is bound to a curve or to a surface that "
            "is not flat: there is no margin; leave --workspace out"
        )
    _check_tips(model, workspace.samples)
    _check_pressures(rest_limits(model), workspace.samples, model)
    return workspace.shell


def _apart(model: Model, samples: Samples) -> float:
    """Largest distance (m) between tips of the model and of the file at rest, pressures alike."""
    some = np.linspace(0, len(samples) - 1, min(COMPARED, len(samples))).astype(int)
    found = [find_equilibrium(model, samples.pressures[i]).tips[-1] for i in some]
    return float(np.linalg.norm(np.array(found) - samples.tips[some], axis=1).max())


def _check_tips(model: Model, samples: Samples) -> None:
    """Raise where the model's tips at rest are not those of the file."""
    length, apart = model.scene.manipulator.length, _apart(model, samples)
    if not apart <= SAME * length:
        raise InputError(
            f"workspace: is of another arm: under its pressures the tip of this one rests up to "
            f"{1e3 * apart:.3g} mm elsewhere, {1e3 * SAME * length:.3g} mm are allowed; run "
            "`softmpc workspace` with this scene"
        )


def _check_pressures(limits: RestLimits, samples: Samples, model: Model) -> None:
    """Raise where the file has pressures that the model may not have, or the other way round."""
    corners = box_samples(limits, CORNERS, 0)[:CORNERS]
    allowed = solve(model, corners, len(model.scene.manipulator.sections)).pressures
    slack = AT_LIMIT * limits.range
    for j, given in enumerate(samples.pressures.T):
        low, high = limits.low[j] - slack[j], limits.high[j] + slack[j]
        here = allowed[:, j] if len(allowed) else given
        beyond = given.min() < low or given.max() > high
        if beyond or given.min() > here.min() + slack[j] or given.max() < here.max() - slack[j]:
            raise InputError(
                f"workspace: was found with other limits: the pressure of unit {j + 1} is from "
                f"{given.min() / 1e6:.4g} to {given.max() / 1e6:.4g} MPa in it, this scene has "
                f"{limits.low[j] / 1e6:.4g} to {limits.high[j] / 1e6:.4g} MPa; run `softmpc "
                "workspace` with this scene"
            )
