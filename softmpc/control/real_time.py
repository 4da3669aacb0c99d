"""Sequential quadratic programming with Gauss-Newton Hessian, as real-time iteration or to the end.

Each iteration linearises the problem, condenses it and solves a dense program in the inputs. A
real-time iteration does one in a sampling step: `prepare` before the state is known, `feedback`
when it is. A step is shortened where it would make cost and defects worse together.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from softmpc.control.condensing import Condensed, Program, condense
from softmpc.control.daqp import Daqp, QpSolution
from softmpc.control.linearisation import Linearisation, Measured
from softmpc.control.solver import NO_MULTIPLIERS, Solution
from softmpc.control.trajectory import Moment, Trajectory
from softmpc.control.transcription import Transcription
from softmpc.errors import InputError

__all__ = ["RealTime"]

SHARES = (1.0, 0.5, 0.25, 0.1)  # of a step: the first good one is taken, else the last
DECREASE = 1e-4  # of what the linearised problem promises, that a step must bring
DAMPING = 1e-10  # of each diagonal entry of the Hessian, so that it is positive definite

Array = np.ndarray


@dataclass(frozen=True)
class _Prepared:
    moment: Moment  # with the state that is expected
    at: Trajectory
    condensed: Condensed
    H: Array


class RealTime:
    """Solves the problem of a transcription, with at most `iterations` in a call.

    One iteration is real-time iteration; many, until the KKT residual is below `tolerance`, are
    sequential quadratic programming. `blocks` says how many intervals share each move, such as
    (1, 1, 2, 4, 12); without it each has its own.
    """

    def __init__(
        self,
        transcription: Transcription,
        iterations: int = 1,
        tolerance: float = 1e-6,
        blocks: Sequence[int] | None = None,
        mode: str = "auto",
    ) -> None:
        self.transcription = t = transcription
        self.iterations, self.tolerance = iterations, tolerance
        self.linearisation, self.qp = Linearisation(t, mode), Daqp()
        self.blocks = _blocks(blocks, t.N)
        low, high = t.variable_bounds()
        states = np.arange(t.nu + t.na, t.nw)
        self._bounded = np.flatnonzero(np.isfinite(low[states]) | np.isfinite(high[states]))
        self._u_bounds = low[: t.nu], high[: t.nu]
        self._x_bounds = low[states][self._bounded], high[states][self._bounded]
        self._row_bounds = tuple(bound[t.na + t.nx :] for bound in t.row_bounds())
        self._weight = 1.0  # of defects and violations against cost
        self.linearisation.make()
        self._prepared: _Prepared | None = None

    def reset(self) -> None:
        """Forget what the last solves left: active set, weight of defects, what was prepared."""
        self.qp = Daqp(self.qp.max_iterations)
        self._weight = 1.0
        self._prepared = None

    def prepare(self, moment: Moment, w: Array) -> None:
        """All that needs no measurement: linearise around `w`, condense; `moment.x` is expected."""
        at = Trajectory.of(self.transcription, w)
        condensed = condense(self.linearisation(moment, at), self.blocks)
        H = condensed.H + np.diag(DAMPING * (1.0 + np.diag(condensed.H)))
        self._prepared = _Prepared(moment, at, condensed, H)

    def feedback(self, x: Array, time_limit: float | None = None) -> Solution:
        """One step from what was prepared, for the scaled state x (nx) as measured."""
        began, ready = time.perf_counter(), self._prepared
        if ready is None:
            raise InputError("RealTime.feedback: call `prepare` before each `feedback`")
        self._prepared = None
        dx = x - ready.moment.x
        free = ready.condensed.free(dx)
        program = self._program(ready, free)
        found = self.qp.solve(program, time_limit)
        if not found.solved:
            return _failed(ready.at.w, found, began)
        step = ready.condensed.expand(found.v, dx, free)
        promised = float(program.f @ found.v + 0.5 * found.v @ program.H @ found.v)
        moment = replace(ready.moment, x=x)
        at, measured, share = self._globalised(moment, ready.at, step, promised)
        slope = float(np.abs(program.H @ found.v).max())  # what the cost would still fall by
        return self._solution(at, measured, found, share, slope, began)

    def solve(
        self, parameters: Array, guess: Array, multipliers: Solution | None = None
    ) -> Solution:
        """Iterate from `guess` until the tolerance holds or the iterations are used up."""
        began, w = time.perf_counter(), guess
        moment = Moment.of(self.transcription, parameters)
        iterations = 0
        while iterations < self.iterations:
            self.prepare(moment, w)
            iterations += 1
            solution = self.feedback(moment.x)
            w = solution.w
            if not solution.solved or solution.kkt <= self.tolerance:
                break
        seconds = time.perf_counter() - began
        return replace(solution, iterations=iterations, seconds=seconds)

    # --- the quadratic program -------------------------------------------------------------------

    def _program(self, ready: _Prepared, free: Array) -> Program:
        condensed, at = ready.condensed, ready.at
        e = condensed.residuals_without(free)
        f = condensed.residuals.T @ e + self._prices
        low, high = (self._tightest(bound - at.u, k) for k, bound in enumerate(self._u_bounds))
        base = at.x[:, self._bounded] + free[:, self._bounded]
        rows = condensed.limits(free)
        low_rows, high_rows = (
            np.concatenate([(bound - base).ravel(), (row_bound - rows).ravel()])
            for bound, row_bound in zip(self._x_bounds, self._row_bounds, strict=True)
        )
        moves = len(f)
        parts = condensed.states[:, self._bounded], condensed.rows
        R = np.vstack([part.reshape(-1, moves) for part in parts])
        return Program(ready.H, f, low, high, R, low_rows, high_rows)

    @property
    def _prices(self) -> Array:
        counts = np.bincount(self.blocks)
        return np.outer(counts, self.transcription.objective.price).ravel()

    def _tightest(self, room: Array, side: int) -> Array:
        """Bounds of the moves from those of the intervals that share them."""
        starts = np.flatnonzero(np.diff(self.blocks, prepend=-1))
        pick = np.minimum if side else np.maximum
        return np.asarray(pick.reduceat(room, starts, axis=0)).ravel()

    # --- globalisation ---------------------------------------------------------------------------

    def _wrong(self, measured: Measured, at: Trajectory) -> float:
        """Sum of defects and violations."""
        total = float(np.abs(measured.defects).sum())
        pairs = (
            (measured.rows, self._row_bounds),
            (at.x[:, self._bounded], self._x_bounds),
        )
        for value, (low, high) in pairs:
            total += float(np.maximum(low - value, 0).sum() + np.maximum(value - high, 0).sum())
        return total

    def _globalised(
        self, moment: Moment, at: Trajectory, step: Trajectory, promised: float
    ) -> tuple[Trajectory, Measured, float]:
        """As much of the step as makes the ℓ₁ merit function smaller."""
        before = self.linearisation.measure(moment, at)
        wrong = self._wrong(before, at)
        if wrong > 0:
            self._weight = max(self._weight, 2 * promised / wrong)
        merit = before.cost + self._weight * wrong
        slope = promised - self._weight * wrong
        for share in SHARES:
            there = at.moved(step, share)
            after = self.linearisation.measure(moment, there)
            reached = after.cost + self._weight * self._wrong(after, there)
            if reached <= merit + DECREASE * share * slope + 1e-12 * abs(merit):
                break
        return there, after, share

    def _solution(
        self,
        at: Trajectory,
        measured: Measured,
        found: QpSolution,
        share: float,
        slope: float,
        began: float,
    ) -> Solution:
        w = at.w
        finite = bool(np.all(np.isfinite(w)))
        return Solution(
            solved=finite,
            status="solved" if finite else "not finite",
            w=w,
            lam_w=NO_MULTIPLIERS,
            lam_g=NO_MULTIPLIERS,
            cost=measured.cost,
            violation=self._wrong(measured, at),
            worst="",
            iterations=1,
            seconds=time.perf_counter() - began,
            kkt=max(slope, float(np.abs(measured.defects).max())),
            qp=found.status,
            share=share,
        )


def _blocks(blocks: Sequence[int] | None, intervals: int) -> Array:
    counts = [1] * intervals if blocks is None else list(blocks)
    if sum(counts) != intervals or not all(isinstance(c, int) and c >= 1 for c in counts):
        raise InputError(
            f"blocks = {counts}: must be whole numbers from 1 that add up to the {intervals} "
            "intervals"
        )
    return np.repeat(np.arange(len(counts)), counts)


def _failed(w: Array, found: QpSolution, began: float) -> Solution:
    return Solution(
        False, f"QP {found.status}", w, NO_MULTIPLIERS, NO_MULTIPLIERS, float("nan"), float("inf"),
        "", 1, time.perf_counter() - began, float("inf"), found.status, 0.0,
    )  # fmt: skip
