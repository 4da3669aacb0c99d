"""IPOPT on a transcribed problem, with Gauss-Newton or exact Hessian."""

from __future__ import annotations

import time
from typing import Any, Literal

import casadi as ca
import numpy as np

from softmpc.control.solver import Solution, worst_violation
from softmpc.control.transcription import NonlinearProgram, Transcription

__all__ = ["Ipopt"]


class Ipopt:
    """Solves the same program again and again, from the last solution where there is a good one.

    Hessian "gauss-newton" needs Jacobians only; "exact" converges in fewer steps near a solution
    but each costs several times as much (`python -m tests.benchmarks.hessians`).
    """

    def __init__(
        self,
        transcription: Transcription,
        hessian: Literal["gauss-newton", "exact"] = "gauss-newton",
        tolerance: float = 1e-6,
        max_iterations: int = 50,
    ) -> None:
        self.transcription = transcription
        self.program: NonlinearProgram = transcription.program
        program = self.program
        options: dict[str, Any] = {
            "print_time": False,
            "error_on_fail": False,
            "ipopt": {
                "print_level": 0,
                "sb": "yes",
                "tol": tolerance,
                "max_iter": max_iterations,
                "mu_strategy": "monotone",
                "mu_init": 1e-2,
                "warm_start_init_point": "no",
                "warm_start_bound_push": 1e-6,
                "warm_start_mult_bound_push": 1e-6,
                "warm_start_slack_bound_push": 1e-6,
                "nlp_scaling_method": "none",  # scaled already
                "bound_relax_factor": 0.0,  # slacks have a price, limits are limits
            },
        }
        problem = {"x": program.w, "p": program.p, "f": program.f, "g": program.g}
        if hessian == "gauss-newton":
            options |= program.gauss_newton
        self._cold = ca.nlpsol("cold", "ipopt", problem, options)
        warm = {**options["ipopt"], "warm_start_init_point": "yes", "mu_init": 1e-4}
        self._warm = ca.nlpsol("warm", "ipopt", problem, {**options, "ipopt": warm})

    def solve(
        self, parameters: np.ndarray, guess: np.ndarray, multipliers: Solution | None = None
    ) -> Solution:
        """Solve from `guess`; `multipliers` of a solved neighbour make it a warm start."""
        started = time.perf_counter()
        program = self.program
        (low, high), (low_g, high_g) = program.bounds, program.bounds_g
        call: dict[str, Any] = {
            "x0": guess,
            "p": parameters,
            "lbx": low,
            "ubx": high,
            "lbg": low_g,
            "ubg": high_g,
        }
        solver = self._cold
        if multipliers is not None:
            solver = self._warm
            call |= {"lam_x0": multipliers.lam_w, "lam_g0": multipliers.lam_g}
        found = solver(**call)
        stats = solver.stats()
        w, g = np.asarray(found["x"]).ravel(), np.asarray(found["g"]).ravel()
        violation, worst = worst_violation(program, w, g)
        return Solution(
            solved=bool(stats["success"]) and bool(np.all(np.isfinite(w))),
            status=str(stats["return_status"]),
            w=w,
            lam_w=np.asarray(found["lam_x"]).ravel(),
            lam_g=np.asarray(found["lam_g"]).ravel(),
            cost=float(found["f"]),
            violation=violation,
            worst=worst,
            iterations=int(stats["iter_count"]),
            seconds=time.perf_counter() - started,
            kkt=_kkt(stats),
        )


def _kkt(stats: dict[str, Any]) -> float:
    """Largest residual of the conditions of an optimum at the last iterate."""
    last = [stats["iterations"][name][-1:] for name in ("inf_pr", "inf_du")]
    return float(max([*last[0], *last[1]], default=np.nan))
