"""Dense quadratic programs by DAQP, a dual active-set solver started from its last active set."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from softmpc.control.condensing import Program

__all__ = ["Daqp", "QpSolution"]

STATUS = {
    2: "soft optimal", 1: "optimal", -1: "infeasible", -2: "cycling", -3: "unbounded",
    -4: "iteration limit", -5: "not convex", -6: "overdetermined", -7: "time limit",
}  # fmt: skip


@dataclass(frozen=True)
class QpSolution:
    """Moves, multipliers (of bounds, then rows) and how the solver ended."""

    solved: bool
    status: str
    v: np.ndarray
    multipliers: np.ndarray
    iterations: int
    seconds: float


class Daqp:
    """Solves programs of one size, each from the active set of the last."""

    def __init__(self, max_iterations: int = 1000) -> None:
        self.max_iterations = max_iterations
        self._size: tuple[int, int] | None = None

    def solve(self, program: Program, time_limit: float | None = None) -> QpSolution:
        """Solve; `time_limit` in s."""
        import daqp

        began = time.perf_counter()
        upper = np.concatenate([program.high, program.high_rows])
        lower = np.concatenate([program.low, program.low_rows])
        R = np.ascontiguousarray(program.R)
        if self._size != R.shape:
            self._model: Any = daqp.Model()
            self._size = R.shape
            sense = np.zeros(len(upper), dtype=np.intc)
            flag = self._model.setup(program.H, program.f, R, upper, lower, sense)
            self._model.settings = {"iter_limit": self.max_iterations}
        else:
            flag = self._model.update(H=program.H, f=program.f, A=R, bupper=upper, blower=lower)
        if time_limit is not None:
            self._model.settings = {"time_limit": time_limit}
        v, _, flag, info = self._model.solve()
        v = np.asarray(v)
        solved = flag > 0 and bool(np.all(np.isfinite(v)))
        if not solved:
            self._size = None  # never from the active set of a failure
        return QpSolution(
            solved=solved,
            status=STATUS.get(int(flag), str(flag)),
            v=v,
            multipliers=np.asarray(info["lam"]),
            iterations=int(info["iterations"]),
            seconds=time.perf_counter() - began,
        )
