"""Which limits a posture at rest is at, by the names that they have in the scene."""

from __future__ import annotations

import casadi as ca
import numpy as np

from softmpc.model.model import Model
from softmpc.statics.rest_limits import RestLimits, limit_rows, row_names

__all__ = ["ActiveLimits"]

NEAR = 1e-6  # of the width of a limit


class ActiveLimits:
    """Names of what holds a posture back, such as "P_2 = pressure_min"."""

    def __init__(self, model: Model, limits: RestLimits) -> None:
        self.model, self.limits = model, limits
        self._names = row_names(model)
        if self._names:
            q, p = ca.SX.sym("q", model.strains), ca.SX.sym("p", len(limits.low))
            value, self._low, self._high = limit_rows(model, q, p)
            self._rows = ca.Function("limit_rows", [q, p], [value])

    def __call__(self, q: np.ndarray, pressures: np.ndarray) -> tuple[str, ...]:
        """Of strains (n) and unit pressures (m, Pa)."""
        return (*self._pressures(pressures), *self._strains(q), *self._others(q, pressures))

    def _pressures(self, pressures: np.ndarray) -> list[str]:
        limits, names = self.limits, self.model.layout.p.names
        slack = NEAR * np.maximum(limits.range, self.model.layout.p.scale)
        said = []
        for j, (name, p) in enumerate(zip(names, pressures, strict=True)):
            if j + 1 in limits.held:
                said.append(f"{name} held")
            elif p <= limits.low[j] + slack[j]:
                said.append(f"{name} = {self._source(limits.low[j], j, 'min')}")
            elif p >= limits.high[j] - slack[j]:
                said.append(f"{name} = {self._source(limits.high[j], j, 'max')}")
        return said

    def _source(self, bound: float, unit: int, end: str) -> str:
        """Which limit of the scene is the bound of a pressure: for the same one, pressure."""
        model, near = self.model, NEAR * float(self.model.layout.p.scale[unit])
        given = model.scene.manipulator.limits
        if abs(bound - getattr(given, f"pressure_{end}")) <= near:
            return f"pressure_{end}"
        if model.scene.actuation.input == "torque":
            gain = model.drive.static_gain[unit, unit]
            if abs(bound - gain * getattr(given, f"torque_{end}")) <= near:
                return f"torque_{end}"
        return "stroke_max"

    def _strains(self, q: np.ndarray) -> list[str]:
        limits, said = self.limits, []
        for name, value, low, high in zip(
            self.model.layout.q.names, q, limits.q_low, limits.q_high, strict=True
        ):
            if value <= low + NEAR:
                said.append(f"{name} = stretch_min")
            elif value >= high - NEAR:
                said.append(f"{name} = stretch_max")
        return said

    def _others(self, q: np.ndarray, pressures: np.ndarray) -> list[str]:
        if not self._names:
            return []
        values = np.asarray(self._rows(q, pressures)).ravel()
        at = (values <= self._low + NEAR) | (values >= self._high - NEAR)
        return [
            f"{name} = {name.split()[0]}_max"
            for name, here in zip(self._names, at, strict=True)
            if here
        ]
