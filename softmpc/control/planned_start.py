"""Before a run along a plan: what of it the controller may not do, and where the run begins."""

from __future__ import annotations

import numpy as np

from softmpc.control.closed_loop import Start, start_at
from softmpc.control.limits import TorqueLimit, TorqueRateLimit
from softmpc.control.ocp import Ocp
from softmpc.control.paths import Reference
from softmpc.control.planned import PlannedMotion
from softmpc.control.preflight import SLACK, Finding, beyond, input_unit, stretches
from softmpc.control.rest_path import IN_REACH
from softmpc.control.state_map import StateMap
from softmpc.model.model import Model
from softmpc.statics.equilibrium import refine_equilibrium
from softmpc.statics.inverse import InverseStatics
from softmpc.statics.rest_costs import ClosestPosture
from softmpc.statics.targets import Position

__all__ = ["check_plan", "is_at_rest", "start_of"]

AT_REST = 1e-5  # scaled

Array = np.ndarray


def check_plan(motion: PlannedMotion, reference: Reference, ocp: Ocp) -> list[Finding]:
    """Where the planned inputs, or their rates, are beyond the limits of a problem.

    A rate is the change from one interval to the next over the longer of the two, or over a step of
    the controller where both are shorter.
    """
    lengths = np.diff(motion.t)
    longer = np.maximum(np.maximum(lengths, np.append(lengths[0], lengths[:-1])), ocp.step)
    rates = np.diff(np.vstack([motion.u_before, motion.u]), axis=0) / longer[:, None]
    inputs = np.vstack([motion.u_before, motion.u, motion.u_after])
    over, faster = np.zeros(len(inputs)), np.zeros(len(rates))
    for limit in ocp.limits:
        if isinstance(limit, TorqueLimit):
            over = np.maximum(over, beyond(inputs, limit.low, limit.high))
        elif isinstance(limit, TorqueRateLimit):
            bounds = limit.low / ocp.step, limit.high / ocp.step
            faster = np.maximum(faster, beyond(rates, *bounds))
    unit, allowed = input_unit(ocp.model), SLACK * float(ocp.model.layout.u.scale.max())
    times = np.append(0.0, motion.t)
    rate = faster, allowed / ocp.step, f"{unit}/s"
    return [
        *stretches("planned torque", reference, times, over, allowed, unit),
        *stretches("planned torque rate", reference, motion.t[:-1], *rate),
    ]


def is_at_rest(model: Model, x: Array, u: Array) -> bool:
    """Whether the model stays in state x under input u (SI)."""
    n, layout = model.strains, model.layout
    q, dq, z = np.split(np.asarray(x, float), [n, 2 * n])
    pressures = model.drive.C @ z + model.drive.D @ u
    off = (
        dq / layout.dq.scale,
        (z - model.drive_rest(u, q)) / layout.z.scale,
        np.asarray(model.residual(q, 0, 0, pressures)).ravel() / layout.r.scale,
    )
    return bool(max(np.abs(part).max(initial=0.0) for part in off) <= AT_REST)


def start_of(
    motion: PlannedMotion, planner: Model, plant: Model, reference: Reference
) -> tuple[Start, list[Finding]]:
    """The plan's start as state and input of the plant, and what it cannot do there.

    A plan that begins at rest begins so on any plant. One that does not rest under the plan's own
    input begins where its tip is at the same place, in the posture nearest to the plan's.
    """
    u, tip = motion.u_before, motion.samples_tips[0, -1]
    x = StateMap(planner, plant)(motion.x[0], u)
    if is_at_rest(plant, x, u) or not is_at_rest(planner, motion.x[0], u):
        return Start(x, u), []
    q = x[: plant.strains]
    near = refine_equilibrium(plant, plant.drive.static_gain @ u, q)
    inverse = InverseStatics(plant, ClosestPosture(tuple(q)))
    found = inverse.solve(Position(tuple(tip)), near)
    start, far = start_at(plant, found.posture), float(found.distance)
    if far <= IN_REACH:
        return start, []
    return start, [Finding("start", 0.0, 0.0, tuple(tip.tolist()), 1e3 * far, "mm")]
