"""Sequential quadratic programming with Gauss-Newton Hessian, as real-time iteration or to the end.

Each iteration linearises the problem, condenses it and solves a dense program in the inputs. A
real-time iteration does one in a sampling step: `prepare` before the state is known, `feedback`
when it is. Of each step the largest share is taken that makes the merit function smaller, and
nothing where none does: what is returned is never worse than what it began with.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from softmpc.control.condensing import Condensed, Condensing, Program, block_of_each
from softmpc.control.daqp import Daqp, QpSolution
from softmpc.control.input_guard import InputGuard
from softmpc.control.linearisation import Linearisation, Measured
from softmpc.control.merit import Limited, Merit, Multipliers, violations
from softmpc.control.one_thread import one_thread
from softmpc.control.solver import NO_MULTIPLIERS, Solution
from softmpc.control.trajectory import Moment, Trajectory
from softmpc.control.transcription import Transcription
from softmpc.errors import InputError

__all__ = ["RealTime"]

SHARES = (1.0, 0.5, 0.25, 0.1, 0.02)  # of a step: the first good one is taken
DECREASE = 1e-4  # of what the linearised problem promises, that a step must bring
ROUNDING = 1e-10  # of the merit function
DAMPING = 1e-10  # of each diagonal entry of the Hessian, so that it is positive definite

Array = np.ndarray


@dataclass(frozen=True)
class _Prepared:
    moment: Moment  # with the state that is expected
    at: Trajectory
    condensed: Condensed
    H: Array
    merit: Merit | None = None  # of the step before, in one solve


class RealTime:
    """Solves the problem of a transcription, with at most `iterations` in a call.

    One iteration is real-time iteration, and always an answer; more are sequential quadratic
    programming, solved once the KKT residual is below `tolerance`. `blocks` says how many intervals
    share each move, such as (1, 1, 2, 4, 12); without it each has its own.
    """

    timed = True  # see `Solver`

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
        self.blocks = block_of_each(blocks, t.N)
        self._starts = np.flatnonzero(np.diff(self.blocks, prepend=-1))
        low, high = t.variable_bounds()
        rows = tuple(bound[t.na + t.nx :] for bound in t.row_bounds())
        x = low[t.nu + t.na :], high[t.nu + t.na :]
        self.limited = Limited((low[: t.nu], high[: t.nu]), x, (rows[0], rows[1]))
        self.bounded = np.flatnonzero(np.isfinite(x[0]) | np.isfinite(x[1]))
        self.linearisation.make()
        one_thread.look()
        self.condensing = Condensing(self.linearisation, self.blocks)
        self._prices = np.outer(np.diff([*self._starts, t.N]), t.objective.price).ravel()
        self._names = t.variable_names(), t.row_names()
        self.reset()

    @property
    def splits(self) -> bool:
        """Whether a call is one iteration, which `prepare` and `feedback` do in two parts."""
        return self.iterations == 1

    def reset(self) -> None:
        """Forget what earlier calls left: what was prepared, and the active set."""
        self._prepared: _Prepared | None = None
        self._active: Array | None = None  # multipliers of the last quadratic program

    def limit_inputs(self, guard: InputGuard) -> None:
        """Plan within these limits of the input, and of its change where the problem limits that.

        They are never wider than the problem's own, and hard.
        """
        t, k = self.transcription, self.transcription.inputs
        scale = t.u_scale[:k]
        (low, high), rows = t.variable_bounds(), [bound[t.na + t.nx :] for bound in t.row_bounds()]
        low[:k], high[:k] = (
            np.maximum(low[:k], guard.low / scale),
            np.minimum(high[:k], guard.high / scale),
        )
        at = {name: i for i, name in enumerate(t.row_names()[t.na + t.nx :])}
        for i, name in enumerate(t.model.layout.u.names):
            row = at.get(f"d{name}")
            if row is not None:
                rows[0][row] = max(rows[0][row], guard.fall[i] / scale[i])
                rows[1][row] = min(rows[1][row], guard.rise[i] / scale[i])
        limited = self.limited
        self.limited = replace(limited, u=(low[: t.nu], high[: t.nu]), rows=(rows[0], rows[1]))

    @one_thread
    def prepare(self, moment: Moment, w: Array) -> None:
        """All that needs no measurement: linearise around `w`, condense; `moment.x` is expected.

        Meant for a step later than the last `feedback`: its active set moves on by one interval.
        """
        self._active = self._later(self._active)
        self._prepare(moment, Trajectory.of(self.transcription, w), None)

    def _prepare(self, moment: Moment, at: Trajectory, merit: Merit | None) -> None:
        self._prepared = None
        condensed = self.condensing(self.linearisation(moment, at))
        H = condensed.H
        H[np.diag_indices_from(H)] *= 1.0 + DAMPING
        H[np.diag_indices_from(H)] += DAMPING
        self._prepared = _Prepared(moment, at, condensed, H, merit)

    @one_thread
    def feedback(self, x: Array, time_limit: float | None = None) -> Solution:
        """One step from what was prepared, for the scaled state x (nx) as measured.

        `time_limit` (s) is that of the quadratic program.
        """
        return self._feedback(x, time_limit)[0]

    def _feedback(self, x: Array, time_limit: float | None) -> tuple[Solution, Merit | None]:
        began, ready = time.perf_counter(), self._prepared
        if ready is None:
            raise InputError("RealTime.feedback: call `prepare` before each `feedback`")
        self._prepared = None
        dx = x - ready.moment.x
        free = ready.condensed.linear.steps.free(dx)
        program = self._program(ready, free)
        found = self.qp.solve(program, time_limit, self._active)
        self._active = found.multipliers if found.solved else None  # never that of a failure
        here, moment = ready.condensed.linear.measured, replace(ready.moment, x=x)
        if dx.any():
            here = self.linearisation.from_another_state(here, moment, ready.at)
        if not found.solved:  # what is wrong with the start is the best hint there is
            return _failed(ready.at.w, found, self._worst(ready.at, here), began), None
        step = ready.condensed.expand(found.v, dx, free)
        multipliers = Multipliers.of(ready.condensed, step, *self._apart(found.multipliers))
        merit = Merit(self.limited, multipliers, ready.merit)
        at, measured, share = self._globalised(merit, ready, moment, here, step)
        slope = float(np.abs(program.H @ found.v).max())  # what the cost would still fall by
        return self._solution(at, measured, multipliers, found, share, slope, began), merit

    @one_thread
    def solve(
        self,
        parameters: Array,
        guess: Array,
        multipliers: Solution | None = None,
        time_limit: float | None = None,
    ) -> Solution:
        """Iterate from `guess` until the tolerance holds, or iterations or time (s) are used up."""
        began, t = time.perf_counter(), self.transcription
        moment, at = Moment.of(t, parameters), Trajectory.of(t, guess)
        self._active, merit, left = self._together(multipliers), None, time_limit
        iteration = 0
        while True:
            iteration += 1
            self._prepare(moment, at, merit)
            if time_limit is not None:
                left = max(time_limit - _since(began), 0.0)
            solution, merit = self._feedback(moment.x, left)
            at = Trajectory.of(t, solution.w)
            done = solution.kkt <= self.tolerance or not solution.share > 0.0
            late = time_limit is not None and _since(began) > time_limit
            if not solution.solved or done or late or iteration >= self.iterations:
                break
        found = replace(solution, iterations=iteration, seconds=_since(began))
        return self._judged(found, time_limit)

    def _judged(self, solution: Solution, time_limit: float | None) -> Solution:
        """More iterations than one are there to reach the tolerance."""
        unfinished = solution.solved and not solution.kkt <= self.tolerance
        if self.iterations == 1 or not unfinished:
            return solution
        if solution.share == 0.0:
            return replace(solution, solved=False, status="no share of a step is an improvement")
        late = time_limit is not None and solution.seconds > time_limit
        return replace(solution, solved=False, status="time limit" if late else "iteration limit")

    # --- the quadratic program -------------------------------------------------------------------

    def _program(self, ready: _Prepared, free: Array) -> Program:
        condensed, at, limited = ready.condensed, ready.at, self.limited
        f = condensed.gradient(free) + self._prices
        low, high = (self._tightest(bound - at.u, k) for k, bound in enumerate(limited.u))
        base = (at.x + free)[:, self.bounded]
        rows = condensed.limits(free)
        low_rows, high_rows = (
            np.concatenate([(x[self.bounded] - base).ravel(), (bound - rows).ravel()])
            for x, bound in zip(limited.x, limited.rows, strict=True)
        )
        R = condensed.rows.reshape(-1, len(f))
        if len(self.bounded):
            R = np.vstack([condensed.states[:, self.bounded].reshape(-1, len(f)), R])
        return Program(ready.H, f, low, high, R, low_rows, high_rows)

    def _tightest(self, room: Array, side: int) -> Array:
        """Bounds of the moves from those of the intervals that share them."""
        pick = np.minimum if side else np.maximum
        return np.asarray(pick.reduceat(room, self._starts, axis=0)).ravel()

    # --- multipliers -----------------------------------------------------------------------------

    def _apart(self, multipliers: Array) -> tuple[Array, Array, Array]:
        """Multipliers of the program as those of decisions, states and limit rows (N×…)."""
        t, moves = self.transcription, len(self._prices)
        bounded = moves + t.N * len(self.bounded)
        u, x = np.zeros((t.N, t.nu)), np.zeros((t.N, t.nx))
        u[self._starts] = multipliers[:moves].reshape(-1, t.nu)
        x[:, self.bounded] = multipliers[moves:bounded].reshape(t.N, -1)
        return u, x, multipliers[bounded:].reshape(t.N, -1)

    def _together(self, solution: Solution | None) -> Array | None:
        """Multipliers of the program from those of a solution."""
        t = self.transcription
        if solution is None or not (len(solution.lam_w) and len(solution.lam_g)):
            return None
        lam_w, lam_g = solution.lam_w.reshape(t.N, t.nw), solution.lam_g.reshape(t.N, -1)
        u = np.add.reduceat(lam_w[:, : t.nu], self._starts, axis=0)
        x, rows = lam_w[:, t.nu + t.na :][:, self.bounded], lam_g[:, t.na + t.nx :]
        return np.concatenate([u.ravel(), x.ravel(), rows.ravel()])

    def _later(self, multipliers: Array | None) -> Array | None:
        """Multipliers of the program a step later."""
        if multipliers is None:
            return None
        t = self.transcription
        parts = (np.concatenate([part[1:], part[-1:]]) for part in self._apart(multipliers))
        u, x, rows = parts
        u = u[self._starts] if len(self._starts) < t.N else u
        return np.concatenate([u.ravel(), x[:, self.bounded].ravel(), rows.ravel()])

    # --- globalisation ---------------------------------------------------------------------------

    def _globalised(
        self,
        merit: Merit,
        ready: _Prepared,
        moment: Moment,
        here: Measured,
        step: Trajectory,
    ) -> tuple[Trajectory, Measured, float]:
        """As much of the step as makes the merit function smaller; nothing where none does."""
        at, now = ready.at, merit(ready.at, here)
        price = self.transcription.objective.price
        promised = now - ready.condensed.predicted(step, price) - float(np.sum(at.u @ price))
        for share in SHARES:
            there = at.moved(step, share)
            measured = self.linearisation.measure(moment, there)
            wanted = now - DECREASE * share * max(promised, 0.0) + ROUNDING * abs(now)
            if merit(there, measured) <= wanted:  # never where it is not finite
                return there, measured, share
        return at, here, 0.0

    # --- the answer ------------------------------------------------------------------------------

    def _solution(
        self,
        at: Trajectory,
        measured: Measured,
        multipliers: Multipliers,
        found: QpSolution,
        share: float,
        slope: float,
        began: float,
    ) -> Solution:
        violation, worst = self._worst(at, measured)
        finite = measured.finite
        return Solution(
            solved=finite,
            status="solved" if finite else "not finite",
            w=at.w,
            lam_w=multipliers.lam_w,
            lam_g=multipliers.lam_g,
            cost=measured.cost,
            violation=violation,
            worst=worst,
            iterations=1,
            seconds=_since(began),
            kkt=max(slope, violation),
            qp=found.status,
            share=share,
        )

    def _worst(self, at: Trajectory, measured: Measured) -> tuple[float, str]:
        """The largest violation and its name; one that is not a number is infinite."""
        found = []
        for over, names in zip(violations(self.limited, at, measured), self._names, strict=True):
            k, i = divmod(int(over.argmax()), over.shape[1])  # NaN counts as the largest
            size = float(np.nan_to_num(over[k, i], nan=np.inf))
            found.append((size, f"{names[i]} at interval {k + 1}"))
        return max(found, key=lambda one: one[0])


def _failed(w: Array, found: QpSolution, worst: tuple[float, str], began: float) -> Solution:
    return Solution(
        False, f"QP {found.status}", w, NO_MULTIPLIERS, NO_MULTIPLIERS, float("nan"), *worst,
        1, _since(began), float("inf"), found.status, 0.0,
    )  # fmt: skip


def _since(began: float) -> float:
    return time.perf_counter() - began
