"""Costs and limits of a problem as functions of one interval, in scaled variables.

Arguments are (u_before, u, x, given, ratio): the decisions before and in the interval, the state at
its end, the references, and its length in steps. The decisions u are the model's inputs and then
one slack for each soft limit.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import casadi as ca
import numpy as np

from softmpc.control.limits import Limit, Rows
from softmpc.control.ocp import Ocp
from softmpc.control.stage import DISTURBANCE, Stage
from softmpc.errors import InputError

__all__ = ["Objective", "Row"]


class Row(NamedTuple):
    """One row of the limits that is no bound of a variable, scaled."""

    value: ca.SX
    low: float
    high: float
    name: str
    scale: float  # in `unit`
    unit: str


@dataclass(frozen=True, eq=False)
class Objective:
    """Costs and limits of one problem."""

    ocp: Ocp

    @property
    def soft(self) -> list[Limit]:
        """The soft limits, in the order of their slacks."""
        return [limit for limit in self.ocp.limits if limit.soft is not None]

    @cached_property
    def u_names(self) -> tuple[str, ...]:
        """Names of the decisions of an interval."""
        return (*self.ocp.model.layout.u.names, *(f"slack of {s.name}" for s in self.soft))

    @cached_property
    def u_scale(self) -> np.ndarray:
        return np.concatenate([self.ocp.model.layout.u.scale, np.ones(len(self.soft))])

    @cached_property
    def price(self) -> np.ndarray:
        """What each scaled decision costs beside the squares: an excess of a soft limit does."""
        inputs = np.zeros(len(self.ocp.model.layout.u))
        return np.concatenate([inputs, [0.1 / excess for excess in self._excesses]])

    @property
    def _excesses(self) -> list[float]:
        """The excess of each soft limit whose square costs ½."""
        return [limit.soft for limit in self.ocp.limits if limit.soft is not None]

    # --- symbols -------------------------------------------------------------------------------

    @cached_property
    def _stage(self) -> Stage:
        return Stage.of(self.ocp.model, self.ocp.disturbance)

    @cached_property
    def _scaled(self) -> list[ca.SX]:
        sizes = (("u_before", len(self.u_scale)), ("u", len(self.u_scale)))
        return [
            *(ca.SX.sym(name, size) for name, size in sizes),
            ca.SX.sym("x", len(self.ocp.model.layout.x)),
        ]

    @cached_property
    def _ratio(self) -> ca.SX:
        return ca.SX.sym("ratio")

    @cached_property
    def _terms(self) -> tuple[ca.SX, ca.SX, list[tuple[Limit, Rows]]]:
        """Residuals of every interval and of the end, and the rows of the limits; SI."""
        lasting = ca.sqrt(self._ratio)
        every, end = [], []
        if self.ocp.disturbance is not None:
            self._stage.given(DISTURBANCE, len(self.ocp.disturbance))
        for cost in self.ocp.costs:
            e = cost.residual(self._stage)
            if cost.at_end:
                end.append(e)
            else:
                every.append(e / lasting if cost.of_change else e * lasting)
        rows = [(limit, limit.rows(self._stage)) for limit in self.ocp.limits]
        return ca.vertcat(*every), ca.vertcat(*end), rows

    @cached_property
    def references(self) -> dict[str, int]:
        """What changes from solve to solve: names and sizes, in their order in `given`."""
        _ = self._terms  # asks for them
        return {name: symbol.numel() for name, symbol in self._stage.references.items()}

    @cached_property
    def symbols(self) -> list[ca.SX]:
        """u_before, u, x, given, ratio."""
        _ = self.references
        return [*self._scaled, ca.vertcat(*self._stage.references.values()), self._ratio]

    def _in_scaled(self, expression: ca.SX) -> ca.SX:
        stage, (u_before, u, x) = self._stage, self._scaled
        layout, k = self.ocp.model.layout, len(self.ocp.model.layout.u)
        values = [u_before[:k] * layout.u.scale, u[:k] * layout.u.scale, x * layout.x.scale]
        return ca.substitute([expression], [stage.u_before, stage.u, stage.x], values)[0]

    # --- costs ---------------------------------------------------------------------------------

    @cached_property
    def residuals(self) -> ca.SX:
        """Residuals of every interval, those of the slacks last."""
        k = len(self.ocp.model.layout.u)
        slacks = [self._scaled[1][k + j] / soft for j, soft in enumerate(self._excesses)]
        return ca.vertcat(self._in_scaled(self._terms[0]), *slacks)

    @cached_property
    def end_residuals(self) -> ca.SX:
        """Residuals at the end of the horizon."""
        return self._in_scaled(self._terms[1])

    @cached_property
    def cost(self) -> ca.Function:
        """Cost of an interval, its gradient in (u_before, u, x), and JᵀJ (upper half)."""
        return self._squares("cost", self.residuals, ca.dot(ca.DM(self.price), self._scaled[1]))

    @cached_property
    def end_cost(self) -> ca.Function | None:
        """The same of what counts at the end of the horizon alone; None where nothing does."""
        e = self.end_residuals
        return self._squares("end_cost", e, ca.SX(0)) if e.numel() else None

    def _squares(self, name: str, e: ca.SX, more: ca.SX) -> ca.Function:
        variables = ca.vertcat(*self._scaled)
        J, slope = ca.jacobian(e, variables), ca.densify(ca.gradient(more, variables))
        outputs = [
            0.5 * ca.sumsqr(e) + more,
            ca.densify(J.T @ e) + slope,
            ca.triu(ca.sparsify(J.T @ J)),
        ]
        return ca.Function(name, self.symbols, outputs, {"cse": True})

    # --- limits --------------------------------------------------------------------------------

    @cached_property
    def _sorted_limits(self) -> tuple[list[tuple[int, float, float]], list[Row]]:
        """Limits that bound one variable of (u, x), and those that do not."""
        bounds: list[tuple[int, float, float]] = []
        general: list[Row] = []
        count = len(self.u_scale)
        for limit, rows in self._terms[2]:
            value = self._in_scaled(rows.value / rows.scale)
            if limit.of_change:
                value = value / self._ratio
            low, high = rows.low / rows.scale, rows.high / rows.scale
            if limit.soft is not None:
                slack = self._scaled[1][count - len(self.soft) + self.soft.index(limit)]
                general += _softened(value, low, high, rows, slack)
                continue
            J = ca.jacobian(value, ca.vertcat(*self._scaled))
            for i, name in enumerate(rows.names):
                columns = J[i, :].sparsity().get_col()
                simple = len(columns) == 1 and J[i, columns[0]].is_constant()
                if simple and columns[0] >= count:
                    slope = float(J[i, columns[0]])
                    bounds.append((columns[0] - count, *sorted((low[i] / slope, high[i] / slope))))
                else:
                    size = float(rows.scale[i]), rows.units[i]
                    general.append(Row(value[i], low[i], high[i], name, *size))
        return bounds, general

    @property
    def rows(self) -> list[Row]:
        """The rows of the limits that are no bounds."""
        return self._sorted_limits[1]

    @cached_property
    def limit(self) -> ca.Function | None:
        """Values of the rows and their Jacobian in (u_before, u, x); None without rows."""
        if not self.rows:
            return None
        value = ca.vertcat(*(row.value for row in self.rows))
        J = ca.sparsify(ca.jacobian(value, ca.vertcat(*self._scaled)))
        return ca.Function("limit", self.symbols, [value, J], {"cse": True})

    @cached_property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Bounds of (u, x): those of limits, and slacks are not negative."""
        count = len(self.u_scale)
        size = count + len(self.ocp.model.layout.x)
        low, high = np.full(size, -np.inf), np.full(size, np.inf)
        low[count - len(self.soft) : count] = 0.0
        for i, a, b in self._sorted_limits[0]:
            low[i], high[i] = max(low[i], a), min(high[i], b)
        crossed = np.flatnonzero(low > high)
        if len(crossed):
            names = (*self.u_names, *self.ocp.model.layout.x.names)
            raise InputError(f"the limits of {names[crossed[0]]} leave nothing between them")
        return low, high


def _softened(
    value: ca.SX, low: np.ndarray, high: np.ndarray, limited: Rows, slack: ca.SX
) -> list[Row]:
    """Rows that a slack widens, one for each finite bound."""
    rows = []
    for i, name in enumerate(limited.names):
        size = float(limited.scale[i]), limited.units[i]
        if np.isfinite(low[i]):
            above = float(low[i]), np.inf, f"{name} (soft, low)"
            rows.append(Row(value[i] + slack, *above, *size))
        if np.isfinite(high[i]):
            below = -np.inf, float(high[i]), f"{name} (soft, high)"
            rows.append(Row(value[i] - slack, *below, *size))
    return rows
