"""Dense quadratic programs by DAQP, a dual active-set solver started from its last active set.

Most rows are far from their bounds, and most slacks at theirs. So a program begins with the rows
that are active or nearly so, and gets those that its answer breaks, until it breaks none: then the
answer is that of the whole. Variables that nothing else depends on need no solver. For the others

    ½ v·H v + f·v = ½ |y|² + g·y + constant    with v = L⁻ᵀ y, H = L Lᵀ, g = L⁻¹ f

LAPACK changes variables faster than DAQP would, which is left with the unit matrix.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from scipy.linalg.lapack import dpotrf, dtrtri

from softmpc.control.condensing import Program

__all__ = ["Daqp", "QpSolution"]

STATUS = {
    2: "soft optimal", 1: "optimal", 0: "not optimal",
    -1: "infeasible", -2: "cycling", -3: "unbounded",
    -4: "iteration limit", -5: "not convex", -6: "overdetermined", -7: "time limit",
}  # fmt: skip
OPTIMAL, NOT_OPTIMAL, INFEASIBLE, NOT_CONVEX = 1, 0, -1, -5
LIMIT_OF_ITERATIONS, LIMIT_OF_TIME = -4, -7
ACTIVE, LOWER = 1, 2  # flags of a constraint in DAQP's `sense`
SMALL = 1e-9  # of the largest multiplier: those below it belong to no active constraint
NEAR = 0.01  # of a scaled bound without any move: rows to begin with
SLOPE = 1e-6  # of the largest g: what may be left of the slope
BROKEN = 1e-8  # by how much a scaled row that was left out may be

Array = np.ndarray


@dataclass(frozen=True)
class QpSolution:
    """Moves, multipliers (of bounds, then rows; above zero at an upper bound) and how it ended."""

    solved: bool
    status: str
    v: Array
    multipliers: Array
    iterations: int
    seconds: float


class Daqp:
    """Solves programs, each from a guess of the active set, in at most `max_iterations` in all."""

    def __init__(self, max_iterations: int = 1000) -> None:
        self.max_iterations = max_iterations

    def solve(
        self,
        program: Program,
        time_limit: float | None = None,
        multipliers: Array | None = None,
    ) -> QpSolution:
        """Solve within `time_limit` (s), from the active set that goes with `multipliers`.

        A guess that leads nowhere is left: the program is solved once more without it.
        """
        began = time.perf_counter()
        wrong = _wrong(program)
        if wrong:
            nothing = np.full(len(program.f), np.nan)
            return QpSolution(False, wrong, nothing, np.zeros(0), 0, _since(began))
        count = len(program.f)
        guess = _signs(program, multipliers)
        near = np.maximum(program.low_rows, -program.high_rows) > -NEAR  # without any move
        rows = (guess[count:] != 0) | near
        iterations = 0
        while True:
            left = None if time_limit is None else max(time_limit - _since(began), 1e-6)
            more = self.max_iterations - iterations
            v, found, flag, taken = self._solve(program, rows, guess, left, more)
            iterations += taken
            if flag <= 0 and flag != LIMIT_OF_TIME and guess.any():
                guess = np.zeros_like(guess)
                continue
            broken = _excess(program, v) > BROKEN if flag > 0 else rows
            if not np.any(broken & ~rows):
                break
            rows, guess = rows | broken, _signs(program, found)
        solved = flag > 0 and bool(np.all(np.isfinite(v)))
        status = STATUS.get(flag, str(flag))
        return QpSolution(solved, status, v, found, iterations, _since(began))

    def _solve(
        self, program: Program, rows: Array, guess: Array, time_limit: float | None, most: int
    ) -> tuple[Array, Array, int, int]:
        """Moves, multipliers, DAQP's flag and its iterations for the program with some rows."""
        count = len(program.f)
        multipliers, R = np.zeros(count + len(rows)), program.R[rows]
        coupled = (np.count_nonzero(program.H, axis=0) > 1) | R.any(axis=0)
        v, multipliers[:count] = _alone(program)
        if not coupled.any():
            met = not np.any(_excess(program, v)[rows] > BROKEN)
            return v, multipliers, OPTIMAL if met else INFEASIBLE, 0
        H = program.H[coupled][:, coupled]
        U, info = dpotrf(H.T)  # Lᵀ, zero below the diagonal, and so is its inverse
        if info:
            return v, multipliers, NOT_CONVEX, 0
        back = dtrtri(U)[0]  # L⁻ᵀ
        A = np.concatenate([back, R[:, coupled] @ back])
        chosen = np.concatenate([coupled, rows])
        upper = np.concatenate([program.high, program.high_rows])[chosen]
        lower = np.concatenate([program.low, program.low_rows])[chosen]
        y, found, flag, taken = self._daqp(
            program.f[coupled] @ back, A, upper, lower, guess[chosen], time_limit, most
        )
        v[coupled] = back @ y
        multipliers[chosen] = found
        return v, multipliers, flag, taken

    def _daqp(
        self,
        g: Array,
        A: Array,
        upper: Array,
        lower: Array,
        guess: Array,
        time_limit: float | None,
        most: int,
    ) -> tuple[Array, Array, int, int]:
        """min ½|y|² + g·y, lower ≤ A y ≤ upper; in a workspace of its own, free of leftovers."""
        import daqp

        sense = np.zeros(len(upper), dtype=np.intc)
        sense[guess != 0], sense[guess < 0] = ACTIVE, ACTIVE | LOWER
        model = daqp.Model()
        flag, _ = model.setup(np.eye(len(g)), g, A, upper, lower, sense)
        if flag < 0:
            return np.full(len(g), np.nan), np.zeros(len(upper)), int(flag), 0
        if most < 1:
            return np.full(len(g), np.nan), np.zeros(len(upper)), LIMIT_OF_ITERATIONS, 0
        model.settings = {
            "iter_limit": most,
            "time_limit": 0.0 if time_limit is None else time_limit,
        }
        y, _, flag, info = model.solve()
        found = np.asarray(info["lam"])
        slope = y + g + found @ A
        if flag > 0 and not np.abs(slope).max() <= SLOPE * max(np.abs(g).max(), 1.0):
            flag = NOT_OPTIMAL  # DAQP says otherwise after guesses with too many active
        return np.asarray(y), found, int(flag), int(info["iterations"])


def _wrong(program: Program) -> str:
    """What no solver needs to be asked about; nothing where all is well."""
    if not all(np.isfinite(part).all() for part in (program.H, program.f, program.R)):
        return "not finite"
    if not np.all(program.H.diagonal() > 0):
        return STATUS[NOT_CONVEX]
    crossed = np.any(program.low > program.high) or np.any(program.low_rows > program.high_rows)
    return STATUS[INFEASIBLE] if crossed else ""


def _excess(program: Program, v: Array) -> Array:
    """By how much each row is beyond its nearer bound; below zero within them."""
    value = program.R @ v
    return np.asarray(np.maximum(program.low_rows - value, value - program.high_rows))


def _alone(program: Program) -> tuple[Array, Array]:
    """The best value of each variable if no other mattered, and its multiplier."""
    diagonal = program.H.diagonal()
    best = -program.f / diagonal
    v = np.clip(best, program.low, program.high)
    return v, diagonal * (best - v)


def _signs(program: Program, multipliers: Array | None) -> Array:
    """Which constraints to start with: above zero at the upper bound, below at the lower one."""
    size = len(program.f) + len(program.low_rows)
    if multipliers is None or len(multipliers) != size:
        return np.zeros(size)
    least = SMALL * np.abs(multipliers).max(initial=0.0)
    return np.where(np.abs(multipliers) > least, np.sign(multipliers), 0.0)


def _since(began: float) -> float:
    return time.perf_counter() - began
