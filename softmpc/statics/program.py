"""The arm at rest as a nonlinear program for IPOPT: strains and pressures in equilibrium.

Inverse statics and workspace limits add what they want of them: an objective, further variables,
rows and parameters. Everything is scaled; symbols are given in SI.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from softmpc.interrupts import InterruptLater
from softmpc.model.model import Model
from softmpc.statics.rest_limits import RestLimits, limit_rows, rest_limits

__all__ = ["Extra", "RestProgram", "RestSolution", "RestSolver", "Rows"]

TOLERANCE = 1e-9
ITERATIONS = 200
ACTIVE = 1e-7  # scaled distance from a bound within which it counts as active
MOST_WRITTEN_OUT = 16  # segments in all; beyond, the Hessian is made column by column
# A start at a good guess moves it little and begins with a low barrier; far away it does no harm.
WARM: dict[str, Any] = {
    "warm_start_init_point": "yes",
    "mu_init": 1e-4,
    "warm_start_bound_push": 1e-6,
    "warm_start_bound_frac": 1e-6,
    "warm_start_slack_bound_push": 1e-6,
    "warm_start_slack_bound_frac": 1e-6,
    "warm_start_mult_bound_push": 1e-6,
}
EMPTY = np.zeros(0)


@dataclass(frozen=True)
class Extra:
    """Further variables of a program between bounds, of size one by nature."""

    symbol: ca.SX = field(default_factory=lambda: ca.SX(0, 1))
    low: np.ndarray = field(default_factory=lambda: EMPTY)
    high: np.ndarray = field(default_factory=lambda: EMPTY)


@dataclass(frozen=True)
class Rows:
    """Further rows between bounds, of size one by nature."""

    value: ca.SX = field(default_factory=lambda: ca.SX(0, 1))
    low: np.ndarray = field(default_factory=lambda: EMPTY)
    high: np.ndarray = field(default_factory=lambda: EMPTY)


@dataclass(frozen=True)
class RestSolution:
    """What IPOPT found; `solved` says whether it is an optimum. SI but for `extra`."""

    solved: bool
    status: str  # IPOPT's return status
    q: np.ndarray
    pressures: np.ndarray  # Pa, within the limits to the last bit
    extra: np.ndarray
    objective: float
    iterations: int
    point: tuple[np.ndarray, np.ndarray, np.ndarray]  # variables, multipliers: the next start
    parameters: np.ndarray


class RestProgram:
    """Strains `q` (n) and unit pressures `p` (m) of one model, symbols in SI, and its places.

    `held` gives the pressure (Pa) of units that are stuck, by unit 1, 2, …
    """

    def __init__(self, model: Model, held: Mapping[int, float] | None = None) -> None:
        self.model = model
        self.limits: RestLimits = rest_limits(model, held)
        n, m = model.strains, len(self.limits.low)
        self._w = ca.SX.sym("w", n + m)
        self.q: ca.SX = self._w[:n] * model.layout.q.scale
        self.p: ca.SX = self._w[n:] * model.layout.p.scale

    @cached_property
    def tips(self) -> list[ca.SX]:
        """Places of the section tips, base first (3, m)."""
        return list(ca.horzsplit(self._frames[0]))

    @cached_property
    def rotations(self) -> list[ca.SX]:
        """Orientations of the section tips, base first (3×3)."""
        return list(ca.horzsplit(self._frames[1], 3))

    @cached_property
    def _frames(self) -> Any:
        return self.model.frames(self.q)

    def solver(
        self,
        objective: ca.SX,
        *,
        extra: Extra | None = None,
        rows: Rows | None = None,
        parameters: ca.SX | None = None,
        options: Mapping[str, Any] | None = None,
    ) -> RestSolver:
        """IPOPT for: minimise `objective` in equilibrium, within the limits and these rows."""
        extra, rows = extra or Extra(), rows or Rows()
        layout, limits = self.model.layout, self.limits
        balance = self.model.balance(self.q, self.p) / layout.r.scale
        own, own_low, own_high = limit_rows(self.model, self.q, self.p)
        still = np.zeros(self.model.strains)
        return RestSolver(
            self.model,
            variables=ca.vertcat(self._w, extra.symbol),
            parameters=ca.SX(0, 1) if parameters is None else parameters,
            objective=objective,
            rows=ca.vertcat(balance, own, rows.value),
            bounds=(
                np.concatenate(
                    [limits.q_low / layout.q.scale, limits.low / layout.p.scale, extra.low]
                ),
                np.concatenate(
                    [limits.q_high / layout.q.scale, limits.high / layout.p.scale, extra.high]
                ),
            ),
            row_bounds=(
                np.concatenate([still, own_low, rows.low]),
                np.concatenate([still, own_high, rows.high]),
            ),
            options=dict(options or {}),
        )

    def guess(self, q: ArrayLike, pressures: ArrayLike, extra: ArrayLike = EMPTY) -> np.ndarray:
        """A start (scaled variables) from strains and pressures in SI."""
        layout = self.model.layout
        parts = [np.asarray(q) / layout.q.scale, np.asarray(pressures) / layout.p.scale, extra]
        return np.concatenate([np.asarray(part, float).ravel() for part in parts])


@dataclass(frozen=True, eq=False)
class RestSolver:
    """IPOPT for one program; call it with a start and values of the parameters."""

    model: Model
    variables: ca.SX
    parameters: ca.SX
    objective: ca.SX
    rows: ca.SX
    bounds: tuple[np.ndarray, np.ndarray]
    row_bounds: tuple[np.ndarray, np.ndarray]
    options: dict[str, Any]

    def __call__(
        self,
        start: np.ndarray | RestSolution,
        parameters: ArrayLike = EMPTY,
    ) -> RestSolution:
        """Solve from a guess, or from another solution with its multipliers (a warm start)."""
        if isinstance(start, RestSolution):
            x, lam_x, lam_g = start.point
        else:
            x, lam_x, lam_g = start, np.zeros(len(start)), np.zeros(self.rows.numel())
        values = np.asarray(parameters, float).ravel()
        ipopt = self._ipopt
        with InterruptLater() as interrupt:
            found = ipopt(
                x0=x, lam_x0=lam_x, lam_g0=lam_g, p=values,
                lbx=self.bounds[0], ubx=self.bounds[1],
                lbg=self.row_bounds[0], ubg=self.row_bounds[1],
            )  # fmt: skip
        if interrupt.asked:
            raise KeyboardInterrupt
        return self._solution(found, values)

    @cached_property
    def _ipopt(self) -> ca.Function:
        problem: Any = {
            "x": self.variables, "p": self.parameters, "f": self.objective, "g": self.rows,
        }  # fmt: skip
        quiet = {"print_level": 0, "sb": "yes", "tol": TOLERANCE, "max_iter": ITERATIONS}
        settings: dict[str, Any] = {
            "print_time": False,
            "error_on_fail": False,
            "ipopt": quiet | WARM | self.options,
        }
        segments = len(self.model.chain.segments)
        if segments > MOST_WRITTEN_OUT:
            settings["hess_lag"] = self._hessian_by_direction
        return ca.nlpsol("at_rest", "ipopt", problem, settings)

    def _solution(self, found: dict[str, Any], parameters: np.ndarray) -> RestSolution:
        x, lam_x, lam_g = (np.asarray(found[k]).ravel() for k in ("x", "lam_x", "lam_g"))
        layout, stats = self.model.layout, self._ipopt.stats()
        n, m = self.model.strains, len(layout.p)
        low, high = (bound[n : n + m] for bound in self.bounds)
        finite = bool(np.all(np.isfinite(x)))
        return RestSolution(
            solved=bool(stats["success"]) and finite,
            status=str(stats["return_status"]),
            q=x[:n] * layout.q.scale,
            pressures=np.clip(x[n : n + m], low, high) * layout.p.scale,
            extra=x[n + m :],
            objective=float(found["f"]),
            iterations=int(stats.get("iter_count", 0)),
            point=(x, lam_x, lam_g),
            parameters=parameters,
        )

    # --- derivatives -----------------------------------------------------------------------------

    @cached_property
    def _multipliers(self) -> ca.SX:
        return ca.SX.sym("lam_g", self.rows.numel())

    @cached_property
    def _slope(self) -> ca.SX:
        """Gradient of the Lagrangian."""
        lagrangian = self.objective + ca.dot(self._multipliers, self.rows)
        return ca.gradient(lagrangian, self.variables)

    @cached_property
    def _hessian_by_direction(self) -> ca.Function:
        """The Hessian in IPOPT's form, a column at a time by one function: small for long arms."""
        weight, along = ca.SX.sym("lam_f"), ca.SX.sym("along", self.variables.numel())
        lagrangian = weight * self.objective + ca.dot(self._multipliers, self.rows)
        column = ca.jtimes(ca.gradient(lagrangian, self.variables), self.variables, along)
        given = [self.variables, self.parameters, weight, self._multipliers]
        one = ca.Function("column", [*given, along], [ca.densify(column)], {"cse": True})
        size = self.variables.numel()
        symbols = [ca.MX.sym(name, *s.shape) for name, s in zip("xplg", given, strict=True)]
        columns = one.map(size)(*(ca.repmat(s, 1, size) for s in symbols), ca.DM.eye(size))
        names = ["x", "p", "lam_f", "lam_g"]
        return ca.Function("hessian", symbols, [ca.triu(columns)], names, ["hess_gamma_x_x"])

    @cached_property
    def _by_parameters(self) -> ca.Function:
        """(variables, parameters, multipliers) -> what the parameters change of the conditions."""
        x, theta = self.variables, self.parameters
        outputs = [ca.jacobian(self._slope, theta), ca.jacobian(self.rows, theta)]
        return ca.Function("by_parameters", [x, theta, self._multipliers], outputs)

    def derivative(self, solution: RestSolution) -> np.ndarray:
        """∂(q, p, extra)/∂(parameters) at an optimum, SI but for `extra`.

        From the optimality conditions with the active bounds and rows held. A bound that is about
        to become active or inactive makes it one-sided. NaN where these do not settle it.
        """
        x, lam_x, lam_g = solution.point
        theta = solution.parameters
        H = _full(self._ipopt.get_function("nlp_hess_l")(x, theta, 1.0, lam_g))
        g, A = (np.asarray(v) for v in self._ipopt.get_function("nlp_jac_g")(x, theta))
        H_theta, A_theta = (np.asarray(v) for v in self._by_parameters(x, theta, lam_g))
        low, high = self.bounds
        free = np.flatnonzero(~(((x - low < ACTIVE) | (high - x < ACTIVE)) & (np.abs(lam_x) > 0)))
        low, high = self.row_bounds
        g = g.ravel()
        tight = np.flatnonzero((g - low < ACTIVE) | (high - g < ACTIVE))
        A = A[np.ix_(tight, free)]
        K = np.block([[H[np.ix_(free, free)], A.T], [A, np.zeros((len(tight), len(tight)))]])
        right = -np.vstack([H_theta[free], A_theta[tight]])
        slopes = np.zeros((len(x), right.shape[1]))
        try:
            slopes[free] = np.linalg.solve(K, right)[: len(free)]
        except np.linalg.LinAlgError:
            slopes[:] = np.nan
        layout = self.model.layout
        scale = np.concatenate([layout.q.scale, layout.p.scale])
        slopes[: len(scale)] *= scale[:, None]
        return slopes


def _full(upper: ca.DM) -> np.ndarray:
    """A symmetric matrix from its upper triangle."""
    triangle = np.asarray(upper)
    return np.asarray(triangle + np.triu(triangle, 1).T)
