"""Limits along the way, measured at samples of a replay: between the nodes of a plan as well."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from softmpc.control.clearance import KeepClear
from softmpc.control.limits import Limit, TorqueLimit
from softmpc.control.stage import Stage
from softmpc.planning.problem import PlanProblem

__all__ = ["Along", "Beyond"]

Array = np.ndarray


@dataclass(frozen=True)
class Beyond:
    """By how much a kind of limit is passed at most, in its unit and in its scale; 0 if not."""

    amount: float
    unit: str
    scaled: float


class Along:
    """All limits of a problem but those of inputs, which hold exactly, and clearance."""

    def __init__(self, problem: PlanProblem) -> None:
        stage = Stage.of(problem.model)
        limits = [one for one in problem.all_limits if not isinstance(one, TorqueLimit | KeepClear)]
        self._rows: list[tuple[Limit, Array, Array, Array, str]] = []
        values = []
        for limit in limits:
            rows = limit.rows(stage)
            values.append(rows.value)
            self._rows.append((limit, rows.low, rows.high, rows.scale, rows.units[0]))
        every = ca.densify(ca.vertcat(*values))
        self._function = ca.Function("along", [stage.x, stage.u], [every], {"cse": True})

    def __call__(self, x: Array, u: Array) -> dict[str, Beyond]:
        """What passes its limit at most, by the limits' names, over states (N×nx), inputs (N×k)."""
        values = np.asarray(self._function(x.T, u.T)).reshape(-1, len(x)).T
        found: dict[str, Beyond] = {}
        first = 0
        for limit, low, high, scale, unit in self._rows:
            own = values[:, first : first + len(low)]
            first += len(low)
            out = np.maximum(np.maximum(low - own, own - high), 0.0).max(axis=0)
            worst = int(np.argmax(out / scale))
            here = Beyond(float(out[worst]), unit, float(out[worst] / scale[worst]))
            if limit.name not in found or here.scaled > found[limit.name].scaled:
                found[limit.name] = here
        return found
