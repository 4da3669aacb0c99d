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
ACTIVE, LOWER = 1, 2  # flags of a constraint in DAQP's `sense`
SMALL = 1e-9  # of the largest multiplier: those below it belong to no active constraint
LIMIT_OF_TIME = -7


@dataclass(frozen=True)
class QpSolution:
    """Moves, multipliers (of bounds, then rows; above zero at an upper bound) and how it ended."""

    solved: bool
    status: str
    v: np.ndarray
    multipliers: np.ndarray
    iterations: int
    seconds: float


class Daqp:
    """Solves programs of one size, each from a guess of the active set."""

    def __init__(self, max_iterations: int = 1000) -> None:
        self.max_iterations = max_iterations

    def solve(
        self,
        program: Program,
        time_limit: float | None = None,
        multipliers: np.ndarray | None = None,
    ) -> QpSolution:
        """Solve within `time_limit` (s), from the active set that goes with `multipliers`.

        A guess that leads nowhere is left: the program is solved once more without it.
        """
        began = time.perf_counter()
        finite = np.isfinite(program.H).all() and np.isfinite(program.f).all()
        if not (finite and np.isfinite(program.R).all()):
            nothing = np.full(len(program.f), np.nan)
            return QpSolution(False, "not finite", nothing, np.zeros(0), 0, _since(began))
        if np.any(program.low > program.high) or np.any(program.low_rows > program.high_rows):
            nothing = np.full(len(program.f), np.nan)
            return QpSolution(False, "infeasible", nothing, np.zeros(0), 0, _since(began))
        v, flag, info = self._solve(program, time_limit, _sense(program, multipliers))
        if flag <= 0 and flag != LIMIT_OF_TIME and multipliers is not None:
            left = None if time_limit is None else max(time_limit - _since(began), 1e-6)
            v, flag, info = self._solve(program, left, _sense(program, None))
        return QpSolution(
            solved=flag > 0 and bool(np.all(np.isfinite(v))),
            status=STATUS.get(flag, str(flag)),
            v=v,
            multipliers=np.asarray(info["lam"]),
            iterations=int(info["iterations"]),
            seconds=_since(began),
        )

    def _solve(
        self, program: Program, time_limit: float | None, sense: np.ndarray
    ) -> tuple[np.ndarray, int, dict[str, Any]]:
        """In a workspace of its own: set up as fast as updated, and free of leftovers."""
        import daqp

        upper = np.concatenate([program.high, program.high_rows])
        lower = np.concatenate([program.low, program.low_rows])
        model, size = daqp.Model(), len(program.f)
        flag, _ = model.setup(program.H, program.f, program.R, upper, lower, sense)
        empty = {"lam": np.zeros(len(upper)), "iterations": 0}
        if flag < 0:
            return np.full(size, np.nan), int(flag), empty
        model.settings = {
            "iter_limit": self.max_iterations,
            "time_limit": 0.0 if time_limit is None else max(time_limit, 1e-6),
        }
        v, _, flag, info = model.solve()
        return np.asarray(v), int(flag), info


def _sense(program: Program, multipliers: np.ndarray | None) -> np.ndarray:
    """Which constraints to start with, in DAQP's flags."""
    sense = np.zeros(len(program.f) + len(program.low_rows), dtype=np.intc)
    if multipliers is None or len(multipliers) != len(sense):
        return sense
    size = np.abs(multipliers)
    active = size > SMALL * size.max(initial=0.0)
    sense[active] = ACTIVE
    sense[active & (multipliers < 0)] = ACTIVE | LOWER
    return sense


def _since(began: float) -> float:
    return time.perf_counter() - began
