"""One tracking problem for softmpc and for do-mpc, which is an optional dependency.

Kinds of do-mpc's controller:

    collocation   the model as x' = f(x, u), Radau collocation of two points, as in do-mpc's
                  examples; its hydraulics are collocated too, ours are exact
    our step      our implicit step as a discrete model of do-mpc with algebraic states: our program
    tuned         the same with `expand` and a warm start in IPOPT's options
"""

from __future__ import annotations

import warnings
from typing import Any

import casadi as ca
import numpy as np

from tests.benchmarks.controllers import setting

INTERVALS, STEP = 20, 0.025  # s
FULL = 2.5  # N·m
QUIET = {"ipopt.print_level": 0, "ipopt.sb": "yes", "print_time": 0, "ipopt.tol": 1e-6}
TUNED = {
    "expand": True,
    "ipopt.warm_start_init_point": "yes",
    "ipopt.mu_init": 1e-4,
    "ipopt.warm_start_bound_push": 1e-6,
    "ipopt.warm_start_mult_bound_push": 1e-6,
}


class Problem:
    """The circle, and the problem as softmpc poses it: torque is limited, nothing else is."""

    def __init__(self, intervals: int = INTERVALS, stages: int = 2) -> None:
        from softmpc.control.limits import TorqueLimit
        from softmpc.control.ocp import tracking_problem
        from softmpc.control.transcription import Transcription

        self.reference, self.model, self.start, _ = setting(1, intervals, FULL)
        limits = (TorqueLimit(0, FULL),)
        self.t = Transcription(tracking_problem(self.model, intervals, STEP, limits=limits), stages)

    def targets(self, now: float) -> np.ndarray:
        """References at and after a time (N+1×3)."""
        return np.asarray(self.reference.position(now + STEP * np.arange(self.t.N + 1)))

    def costs(self, x: Any, u: Any, tip: Any) -> tuple[Any, Any]:
        """Our costs, written anew: those of a state, and those of an input."""
        by = {c.name: c.deviation for c in self.t.ocp.costs}
        n, layout = self.model.strains, self.model.layout
        off = (self.model.tip(x[:n]) - tip) / by["tip"]
        rates = x[n : 2 * n] / layout.dq.scale / by["strain rate"]
        effort = u[: self.t.inputs] / layout.u.scale / by["torque"]
        return 0.5 * (ca.sumsqr(off) + ca.sumsqr(rates)), 0.5 * ca.sumsqr(effort) + self.excess(u)

    def excess(self, u: Any) -> Any:
        """Cost of the slacks of soft limits, which are the last of the inputs."""
        soft = [limit.soft for limit in self.t.ocp.limits if limit.soft is not None]
        slacks = [u[self.t.inputs + i] for i in range(len(soft))]
        return sum(0.5 * (s / by) ** 2 + 0.1 * s / by for s, by in zip(slacks, soft, strict=True))


class Ours:
    """softmpc with one of its solvers."""

    def __init__(self, problem: Problem, solver: str) -> None:
        from softmpc.control.mpc import Mpc
        from softmpc.control.solvers import make_solver

        self.problem, self.mpc = problem, Mpc(problem.t, make_solver(solver, problem.t))

    def step(self, x: np.ndarray, u: np.ndarray, now: float) -> np.ndarray:
        return self.mpc.step(x, u, self.problem.targets(now)[1:]).u

    def cost(self, x: np.ndarray, u: np.ndarray, now: float) -> float:
        """Cost of the optimum, found without a warm start."""
        t = self.problem.t
        p = t.parameters(x, u, self.problem.targets(now)[1:])
        found = self.mpc.solver.solve(p, t.resting(x, u))
        return found.cost if found.solved else np.nan


class Theirs:
    """do-mpc on the same problem; `points` of collocation."""

    def __init__(self, problem: Problem, kind: str, points: int = 2) -> None:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            from do_mpc.controller import MPC
            from do_mpc.model import Model
        self.problem, t = problem, problem.t
        discrete = kind != "collocation"
        model = Model("discrete" if discrete else "continuous", "MX")
        x = model.set_variable("_x", "x", shape=(t.nx, 1))
        u = model.set_variable("_u", "u", shape=(t.nu, 1))
        tip = model.set_variable("_tvp", "tip", shape=(3, 1))
        if discrete:
            a = model.set_variable("_z", "a", shape=(t.na, 1))
            residuals, after = one_interval(t)(x, u, a)
            model.set_alg("stages", residuals)
        model.set_rhs("x", after if discrete else problem.model.x_dot(x, u[: t.inputs]))
        model.setup()
        self.mpc = MPC(model)
        how = {} if discrete else {"collocation_type": "radau", "collocation_deg": points}
        options = QUIET | (TUNED if kind == "tuned" else {})
        self.mpc.set_param(n_horizon=t.N, t_step=STEP, nlpsol_opts=options, **how)
        if discrete:
            self.mpc.scaling["_z", "a"] = t.a_scale
        self._pose(*problem.costs(x, u, tip))
        if t.objective.rows:  # at the end of the interval, where only our step knows the state
            self._limit(model)
        self.mpc.setup()

    def _pose(self, state: Any, effort: Any) -> None:
        mpc, t = self.mpc, self.problem.t
        mpc.set_objective(mterm=state, lterm=state + effort)
        deviation = next(c.deviation for c in t.ocp.costs if c.name == "torque rate")
        of_change = np.full(t.nu, 0.5 / deviation**2)  # of the scaled inputs
        of_change[t.inputs :] = 0.0
        mpc.set_rterm(u=of_change)
        mpc.scaling["_x", "x"], mpc.scaling["_u", "u"] = t.x_scale, t.u_scale
        low, high = (bound[: t.nu] * t.u_scale for bound in t.variable_bounds())
        mpc.bounds["lower", "_u", "u"], mpc.bounds["upper", "_u", "u"] = low, high
        template = mpc.get_tvp_template()

        def references(now: float) -> Any:
            for k, place in enumerate(self.problem.targets(float(np.asarray(now).ravel()[0]))):
                template["_tvp", k, "tip"] = place
            return template

        mpc.set_tvp_fun(references)

    def _limit(self, model: Any) -> None:
        t, x, u = self.problem.t, model.x["x"], model.u["u"]
        after = one_interval(t)(x, u, model.z["a"])[1] / t.x_scale
        rows = t.objective.limit(0 * u, u / t.u_scale, after, model.tvp["tip"], 1)[0]
        for sign, bounds in zip((-1, 1), t.row_bounds(), strict=True):
            for i, bound in enumerate(bounds[t.na + t.nx :]):
                if np.isfinite(bound):
                    self.mpc.set_nl_cons(f"limit_{sign}_{i}", sign * rows[i], ub=sign * bound)

    def step(self, x: np.ndarray, u: np.ndarray, now: float) -> np.ndarray:
        if not self.mpc.flags["set_initial_guess"]:
            self.mpc.x0, self.mpc.u0 = x, u
            self.mpc.set_initial_guess()
        self.mpc.u0, self.mpc.t0 = u, now
        return np.ravel(self.mpc.make_step(x.reshape(-1, 1)))

    def cost(self, x: np.ndarray, u: np.ndarray, now: float) -> float:
        """Cost of the optimum, found without a warm start; we leave out that of the first state."""
        self.mpc.flags["set_initial_guess"] = False
        self.step(x, u, now)
        stats, tip = self.mpc.solver_stats, ca.DM(self.problem.targets(now)[0])
        first = float(self.problem.costs(ca.DM(x), ca.DM(u), tip)[0])
        return float(stats["iterations"]["obj"][-1]) - first if stats["success"] else np.nan


def one_interval(t: Any) -> ca.Function:
    """Our step: (x, u, accelerations at the stages) -> (scaled residuals there, x after it); SI."""
    x, u, a = (ca.SX.sym(name, size) for name, size in zip("xua", (t.nx, t.nu, t.na), strict=True))
    defects = t.interval(x / t.x_scale, u / t.u_scale, a / t.a_scale)[0]
    return ca.Function("step", [x, u, a], [defects[: t.na], defects[t.na :] * t.x_scale])


def make(problem: Problem, kind: str) -> Ours | Theirs:
    return (Ours if kind in ("sqp", "real-time") else Theirs)(problem, kind)
