"""Fatrop on a transcribed problem: an interior-point method that knows the stages.

Fatrop wants variables and constraints stage by stage: gaps x_{k+1} - F(x_k, u_k) first, then
constraints of the stage alone. So the decisions and stage accelerations of an interval are the
controls of its stage, the residuals its equations, and the decisions of the interval before are
further states, since costs and limits of changes see them. The state now and the decisions before
are parameters: the first stage has no states.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from softmpc.control.solver import NO_MULTIPLIERS, Solution, worst_violation
from softmpc.control.transcription import Transcription
from softmpc.errors import BuildError

__all__ = ["Fatrop"]

MISSING = (
    "this build of CasADi has no Fatrop: install casadi 3.7.2 or later from PyPI, or choose "
    "another solver, such as 'ipopt'"
)


class Fatrop:
    """Solves the same program again and again, with the Gauss-Newton Hessian."""

    def __init__(
        self, transcription: Transcription, tolerance: float = 1e-6, max_iterations: int = 100
    ) -> None:
        if not ca.has_nlpsol("fatrop"):
            raise BuildError(MISSING)
        self.transcription, self.max_iterations = transcription, max_iterations
        self.stages = _Stages(transcription)
        options = {
            "print_time": False,
            "error_on_fail": False,
            "structure_detection": "manual",
            "equality": self.stages.equality,
            **self.stages.sizes,
            "fatrop": {"print_level": 0, "tol": tolerance, "max_iter": max_iterations},
        }
        self._solver = ca.nlpsol("fatrop", "fatrop", self.stages.problem, options)

    def solve(
        self, parameters: np.ndarray, guess: np.ndarray, multipliers: Solution | None = None
    ) -> Solution:
        """Solve from `guess`; multipliers are of no use to Fatrop."""
        began, stages = time.perf_counter(), self.stages
        violation, worst = stages.worst(guess, parameters)
        if not np.isfinite(violation):  # Fatrop would not end
            return self._answer("not finite", guess, np.nan, violation, worst, 0, began)
        found = self._solver(x0=stages.extended(guess), p=parameters, **stages.bounds)
        stats = self._solver.stats()
        w = np.asarray(found["x"]).ravel()[stages.own]
        count = int(stats["iter_count"])
        status = "iteration limit" if count >= self.max_iterations else "no solution found"
        if stats["success"]:
            status = "solved" if np.all(np.isfinite(w)) else "not finite"
        violation, worst = stages.worst(w, parameters)
        return self._answer(status, w, float(found["f"]), violation, worst, count, began)

    @staticmethod
    def _answer(
        status: str,
        w: np.ndarray,
        cost: float,
        violation: float,
        worst: str,
        iterations: int,
        began: float,
    ) -> Solution:
        return Solution(
            solved=status == "solved",
            status=status,
            w=w,
            lam_w=NO_MULTIPLIERS,
            lam_g=NO_MULTIPLIERS,
            cost=cost,
            violation=violation,
            worst=worst,
            iterations=iterations,
            seconds=time.perf_counter() - began,
        )


@dataclass(frozen=True, eq=False)
class _Stages:
    """The program of a transcription, in Fatrop's order."""

    t: Transcription

    @cached_property
    def sizes(self) -> dict[str, Any]:
        """States, controls and constraints that are no gaps, a stage (N + 1)."""
        t = self.t
        last = t.N - 1
        return {
            "N": t.N,
            "nx": [0, *[t.nx + t.nu] * last, t.nx],
            "nu": [*[t.nu + t.na] * t.N, 0],
            "ng": [*[t.na + len(t.objective.rows)] * t.N, 0],
        }

    @cached_property
    def _width(self) -> int:
        return self.t.nw + self.t.nu  # of a stage in the middle

    @cached_property
    def own(self) -> np.ndarray:
        """Places of the variables of the transcription among Fatrop's."""
        t = self.t
        first = np.arange(t.nu + t.na)
        places = []
        for k in range(t.N):
            start = k * self._width  # of u_k, a_k
            after = start + t.nu + t.na + np.arange(t.nx)
            places += [start + first, after]
        return np.concatenate(places)

    def extended(self, w: np.ndarray) -> np.ndarray:
        """Fatrop's variables from those of the transcription."""
        t = self.t
        found = np.zeros(t.N * self._width - t.nu)
        found[self.own] = w
        found[self._repeated[1]] = found[self._repeated[0]]
        return found

    @cached_property
    def _repeated(self) -> tuple[np.ndarray, np.ndarray]:
        """Where decisions stand, and where they stand again as states of the next stage."""
        t = self.t
        start = np.arange(t.N - 1)[:, None] * self._width + np.arange(t.nu)
        return start.ravel(), (start + t.nw).ravel()

    @cached_property
    def equality(self) -> list[bool]:
        """Which constraints are equations."""
        t, rows = self.t, len(self.t.objective.rows)
        middle = [True] * (t.nx + t.nu + t.na) + [False] * rows
        last = [True] * (t.nx + t.na) + [False] * rows
        return [*middle * (t.N - 1), *last]

    @cached_property
    def bounds(self) -> dict[str, np.ndarray]:
        """Of variables and constraints, as `nlpsol` takes them."""
        t = self.t
        found: dict[str, np.ndarray] = {}
        pairs = zip(
            ("lb", "ub"), t.variable_bounds(), t.row_bounds(), (-np.inf, np.inf), strict=True
        )
        for side, of_w, of_g, free in pairs:
            whole = np.full(t.N * self._width - t.nu, free)
            whole[self.own] = np.tile(of_w, t.N)
            rows = of_g[t.na + t.nx :]
            middle = np.concatenate([np.zeros(t.nx + t.nu + t.na), rows])
            last = np.concatenate([np.zeros(t.nx + t.na), rows])
            found[f"{side}x"] = whole
            found[f"{side}g"] = np.concatenate([np.tile(middle, t.N - 1), last])
        return found

    @cached_property
    def problem(self) -> dict[str, ca.MX]:
        """The program with its variables stage by stage."""
        t = self.t
        w = ca.MX.sym("w", t.N * self._width - t.nu)
        p = ca.MX.sym("p", t.nx + t.nu + t.nr * t.N)
        x, before = p[: t.nx], p[t.nx : t.nx + t.nu]
        f, g, place = ca.MX(0), [], 0
        for k in range(t.N):
            own = w[place : place + t.nu + t.na]
            place += t.nu + t.na
            given = p[t.nx + t.nu + k * t.nr :][: t.nr]
            y = self._stage(k)(ca.vertcat(x, before, own), given)
            r, after, e, rows = ca.vertsplit(y, self._splits(k))
            f += 0.5 * ca.sumsqr(e) + ca.dot(ca.DM(t.objective.price), own[: t.nu])
            x = w[place : place + t.nx]
            place += t.nx
            g.append(x - after)
            if k < t.N - 1:
                before = w[place : place + t.nu]
                place += t.nu
                g.append(before - own[: t.nu])
            g += [r, rows]
        return {"x": w, "p": p, "f": f, "g": ca.vertcat(*g)}

    def _splits(self, k: int) -> list[int]:
        objective = self.t.objective
        residuals = objective.residuals.numel()
        if k == self.t.N - 1:
            residuals += objective.end_residuals.numel()
        sizes = [self.t.na, self.t.nx, residuals, len(objective.rows)]
        return [0, *np.cumsum(sizes).tolist()]

    def _stage(self, k: int) -> ca.Function:
        """((x, u_before, u, a), given) -> residuals, state after, residuals of costs, limit rows.

        It brings its own Jacobian, which counts as constant: so every second derivative that
        CasADi takes of the program is the Gauss-Newton one.
        """
        kind = float(self.t.ocp.ratios[k]), k == self.t.N - 1
        if kind not in self._made:
            self._made[kind] = self._make_stage(k)
        return self._made[kind]

    @cached_property
    def _made(self) -> dict[tuple[float, bool], ca.Function]:
        return {}

    def _make_stage(self, k: int) -> ca.Function:
        t = self.t
        v = ca.MX.sym("v", t.nx + 2 * t.nu + t.na)
        given = ca.MX.sym("given", t.nr)
        x, before, u, a = ca.vertsplit(v, np.cumsum([0, t.nx, t.nu, t.nu, t.na]).tolist())
        d = [given[t.disturbance_columns]] if t.ocp.disturbance is not None else []
        step, J = t.intervals[k].function(x, u, a, *d)
        wide = ca.horzcat(J[:, : t.nx], ca.DM(J.shape[0], t.nu), J[:, t.nx :])
        value, slopes = self._terms(k)(before, u, step[t.na :], given, float(t.ocp.ratios[k]))
        by_before, by_u, by_x = ca.horzsplit(slopes, [0, t.nu, 2 * t.nu, 2 * t.nu + t.nx])
        none = ca.DM(slopes.shape[0], t.nx), ca.DM(slopes.shape[0], t.na)
        through = by_x @ wide[t.na :, :] + ca.horzcat(none[0], by_before, by_u, none[1])
        outputs = ca.vertcat(step, value), ca.vertcat(wide, through)
        y = ca.MX.sym("y", outputs[0].shape[0])
        constant: Any = {"is_diff_in": [False] * 3}
        zero: Any = ca.DM(y.shape[0], t.nr)
        slope = ca.Function(
            "jac_stage", [v, given, y], [outputs[1], zero],
            ["v", "given", "y"], ["jac_y_v", "jac_y_given"], constant,
        )  # fmt: skip
        options: Any = {"custom_jacobian": slope, "jac_penalty": 0, "never_inline": True}
        return ca.Function("stage", [v, given], [outputs[0]], ["v", "given"], ["y"], options)

    def _terms(self, k: int) -> ca.Function:
        """Residuals of costs and rows of limits, and their Jacobian in (u_before, u, x)."""
        objective = self.t.objective
        e = [objective.residuals, *([objective.end_residuals] if k == self.t.N - 1 else [])]
        value = ca.densify(ca.vertcat(*e, *(row.value for row in objective.rows)))
        J = ca.sparsify(ca.jacobian(value, ca.vertcat(*objective.symbols[:3])))
        return ca.Function("terms", objective.symbols, [value, J], {"cse": True})

    # --- what is wrong with an answer ------------------------------------------------------------

    def worst(self, w: np.ndarray, parameters: np.ndarray) -> tuple[float, str]:
        """Its largest violation, and which one."""
        program = self.t.program
        return worst_violation(program, w, np.asarray(self._g(w, parameters)).ravel())

    @cached_property
    def _g(self) -> ca.Function:
        program = self.t.program
        return ca.Function("g", [program.w, program.p], [program.g])
