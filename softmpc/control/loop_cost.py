"""What a closed loop cost: the controller's own costs, summed over what the plant did."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from softmpc.control.guide import Guide
from softmpc.control.objective import Objective
from softmpc.control.ocp import Ocp
from softmpc.model.model import Model

__all__ = ["loop_cost"]


def loop_cost(ocp: Ocp, plant: Model, guide: Guide, x: np.ndarray, run: Any) -> float | None:
    """Costs of every step, at the plant's states x at their ends (N×nx); `run` is a TrackResult.

    Costs at the end of a horizon do not count. None where a cost needs a reference that `guide`
    does not give, and without a step.
    """
    costs = tuple(cost for cost in ocp.costs if not cost.at_end)
    if not costs or not len(x):
        return None
    objective = Objective(Ocp(plant, 1, ocp.step, costs, ()))
    times = run.control_time + ocp.step
    given = guide.given(times)
    if not set(objective.references) <= set(given):
        return None
    layout = plant.layout
    before = np.vstack([run.u_start, run.u[:-1]]) / layout.u.scale
    references = [given[name] for name in objective.references]
    stacked = np.hstack([np.zeros((len(x), 0)), *references])
    rows = before, run.u / layout.u.scale, x / layout.x.scale, stacked, np.ones((len(x), 1))
    value = ca.Function("e", objective.symbols, [ca.sumsqr(objective.residuals)])
    return float(0.5 * np.asarray(value.map(len(x))(*(row.T for row in rows))).sum())
