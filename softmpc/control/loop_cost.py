"""What a closed loop cost: the controller's own costs, summed over what the plant did."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from softmpc.control.guide import Guide
from softmpc.control.objective import Objective
from softmpc.control.ocp import Ocp
from softmpc.model.model import Model

__all__ = ["loop_costs"]


def loop_costs(ocp: Ocp, plant: Model, guide: Guide, x: np.ndarray, run: Any) -> dict[str, float]:
    """Each cost by name, of all steps at the plant's states x at their ends (N×nx).

    `run` is a TrackResult. Costs at the end of a horizon do not count; those of one name add up.
    Empty where a cost needs a reference that `guide` does not give, and without a step.
    """
    costs = tuple(cost for cost in ocp.costs if not cost.at_end)
    if not costs or not len(x):
        return {}
    given = guide.seen_by(plant).given(run.control_time + ocp.step)
    layout = plant.layout
    before = np.vstack([run.u_start, run.u[:-1]]) / layout.u.scale
    inputs, states = run.u / layout.u.scale, x / layout.x.scale
    found: dict[str, float] = {}
    for cost in costs:
        objective = Objective(Ocp(plant, 1, ocp.step, (cost,), ()))
        if not set(objective.references) <= set(given):
            return {}
        references = [given[name] for name in objective.references]
        stacked = np.hstack([np.zeros((len(x), 0)), *references])
        rows = before, inputs, states, stacked, np.ones((len(x), 1))
        value = ca.Function("e", objective.symbols, [ca.sumsqr(objective.residuals)])
        paid = 0.5 * np.asarray(value.map(len(x))(*(row.T for row in rows))).sum()
        found[cost.name] = found.get(cost.name, 0.0) + float(paid)
    return found
