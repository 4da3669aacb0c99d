"""Model predictive control: one solve a sampling step, and what to do when a solve fails.

    prepare    between samples: shift the plan, linearise where the arm is expected to be
    feedback   at the sample: solve for the state as measured, choose the input
    step       both

The input is always finite and within the limits of torque and torque rate. A failed solve is never
used as a warm start; the last good plan is followed instead, and after a few failures in a row the
solver starts afresh from the arm at rest.
"""

from __future__ import annotations

import logging
import time
from dataclasses import dataclass, replace

import numpy as np

from softmpc.control.costs import PLANNED_INPUT
from softmpc.control.daqp import Daqp
from softmpc.control.input_guard import InputGuard
from softmpc.control.ipopt import Ipopt
from softmpc.control.one_thread import one_thread
from softmpc.control.plan import Plan
from softmpc.control.rollout import Rollout
from softmpc.control.solver import Solution, Solver, split
from softmpc.control.step import (
    BUDGET_OVERRUN,
    FAILED,
    INPUT_NOT_FINITE,
    ITERATION_CAP,
    SOLVED,
    Step,
)
from softmpc.control.trajectory import Moment
from softmpc.control.transcription import References, Transcription
from softmpc.control.violations import Violations
from softmpc.errors import InputError

__all__ = ["Mpc", "Step"]

RESTART_AFTER = 3
CONSISTENT = 0.1  # largest scaled violation of a plan that an iteration may begin with
CLIPPED = 1e-6  # of the input's scale, by which the last guard must change it to be reported
_REPORTED = ("iterations", "cost", "kkt", "qp", "share", "violation")
LOG = logging.getLogger(__name__)

Array = np.ndarray


@dataclass(frozen=True)
class _Asked:
    """What was known before the sample, and how preparing for it went."""

    u_before: Array
    given: Array  # references (N×nr)
    finite: bool
    prepared: bool = False  # by the solver
    error: str = ""
    seconds: float = 0.0


class Mpc:
    """A controller for one arm; it keeps its last good plan and its last input.

    `budget` is the time (s) that a step may take, prepare and feedback together; None only
    measures. A result that comes later is kept as the plan, for the next step; the input of this
    one is what the plan before had for it, or the last input. A solver belongs to one controller.
    """

    def __init__(
        self,
        transcription: Transcription,
        solver: Solver | None = None,
        budget: float | None = None,
        restart_after: int = RESTART_AFTER,
    ) -> None:
        if budget is not None and not 0 < budget < float("inf"):
            raise InputError(f"Mpc(budget={budget!r}): must be above 0 s; None sets no budget")
        if restart_after < 1:
            raise InputError(f"Mpc(restart_after={restart_after!r}): must be 1 failure or more")
        self.transcription, self.ocp = transcription, transcription.ocp
        self.solver: Solver = solver or Ipopt(transcription)
        self.budget, self.restart_after = budget, restart_after
        self.guard = InputGuard(self.ocp)
        self._split = split(self.solver)
        self._violations = Violations(transcription)
        fast = None if self._split is None else self._split.linearisation
        self._rollout = Rollout(transcription, fast)
        one_thread.look()
        self.reset()

    @property
    def qp(self) -> Daqp | None:
        """What solves its quadratic programs; None where there are none."""
        return getattr(self.solver, "qp", None)

    def set_limits(self, **narrower: Array | None) -> None:
        """Narrower limits, see `InputGuard.narrow`: `low`, `high`, `fall` and `rise`.

        Real-time iteration plans within them; any solver's input is clipped to them.
        """
        self.guard.narrow(**narrower)
        if self._split is not None:
            self._split.limit_inputs(self.guard)

    def reset(self) -> None:
        """Forget the last plan and input, and narrower limits."""
        self.set_limits()
        self._plan: Plan | None = None
        self._u: Array | None = None
        self._asked: _Asked | None = None
        self._failures = 0  # of the solver, in a row
        self._reset_solver()

    # --- the three calls -------------------------------------------------------------------------

    @one_thread
    def step(self, x: Array, u_before: Array, given: References) -> Step:
        """The input for the state x (q, dq, z) and references at the coming nodes, see `prepare`.

        References are arrays by name, "tip" (N×3, m) among them; an array alone is "tip".
        """
        self.prepare(given, u_before)
        return self.feedback(x)

    @one_thread
    def prepare(self, given: References, u_before: Array | None = None) -> None:
        """What needs no measurement, for a sample with references `given` at its nodes.

        `u_before` (k) is the input applied until then, by default the one last returned.
        """
        began, t = time.perf_counter(), self.transcription
        until_now = self._u if u_before is None else u_before
        if until_now is None:
            raise InputError("Mpc.prepare: the first step needs `u_before`, the input until now")
        u = self._sized("u_before", until_now, t.inputs)
        references = t.references(given)
        finite = bool(np.all(np.isfinite(u)) and np.all(np.isfinite(references)))
        asked = _Asked(self.guard.finite(u, self._u), references, finite)
        prepared, error = self._prepare_solver(asked)
        self._asked = replace(asked, prepared=prepared, error=error, seconds=_since(began))

    @one_thread
    def feedback(self, x: Array) -> Step:
        """The input for the state x (q, dq, z) as measured."""
        began, asked = time.perf_counter(), self._asked
        if asked is None:
            raise InputError("Mpc.feedback: call `prepare` before each `feedback`")
        x = self._sized("x", x, self.transcription.nx)
        self._asked = None
        if not (asked.finite and np.all(np.isfinite(x))):
            return self._stepped(began, asked, INPUT_NOT_FINITE)
        w, multipliers = self._guess(x, asked)
        solution, why = self._attempt(x, asked, w, multipliers, began)
        late = self.budget is not None and asked.seconds + _since(began) > self.budget
        status = self._status(solution, why, late)
        usable = solution is not None and solution.usable
        self._failures = 0 if usable else self._failures + 1
        worst = "" if status == SOLVED else self._worst(x, asked, solution, w)
        if worst and not late:  # of many in a row the first, second, fourth … are said
            often = self._failures & (self._failures - 1) if self._failures else 0
            level = logging.INFO if often else logging.WARNING
            LOG.log(level, "step: %s (%d in a row); %s", status, self._failures, worst)
        return self._stepped(began, asked, status, solution, worst)

    def _sized(self, name: str, value: Array, size: int) -> Array:
        value = np.asarray(value, float).ravel()
        if len(value) != size:
            raise InputError(f"Mpc: {name} has {len(value)} numbers; this arm needs {size}")
        return value

    # --- the solver ------------------------------------------------------------------------------

    @property
    def _starts_afresh(self) -> bool:
        return self._failures >= self.restart_after or self._plan is None or self._plan.over

    def _moment(self, x: Array, asked: _Asked) -> Moment:
        t = self.transcription
        return Moment(x / t.x_scale, t.decisions(asked.u_before), asked.given)

    def _prepare_solver(self, asked: _Asked) -> tuple[bool, str]:
        """Linearise along the plan from where it expects the arm; what went wrong, if anything."""
        plan, solver = self._plan, self._split
        if not asked.finite or solver is None or plan is None or self._starts_afresh:
            return False, ""
        moment = self._moment(plan.state, asked)
        try:
            solver.prepare(moment, self._consistent(plan, moment))
        except Exception as error:  # a failure of the step, whatever it is
            return False, _reason(error)
        return True, ""

    def _guess(self, x: Array, asked: _Asked) -> tuple[Array, Solution | None]:
        """Where to start: the last good plan, shifted; else the arm at rest, or as planned."""
        plan, moment = self._plan, self._moment(x, asked)
        if plan is None or self._starts_afresh:
            self._reset_solver()
            resting = self.transcription.resting(x, self._first_inputs(asked))
            return self._simulated(moment, resting), None
        if asked.prepared or plan.solution.violation <= CONSISTENT:
            return plan.shifted, plan.multipliers
        return self._consistent(plan, moment), None

    def _first_inputs(self, asked: _Asked) -> Array:
        """Planned inputs (N×k) where the problem is told of some, else the one until now (k)."""
        planned = asked.given[:, self.transcription.columns_of(PLANNED_INPUT)]
        return self.guard.inside(planned if planned.size else asked.u_before)

    def _consistent(self, plan: Plan, moment: Moment) -> Array:
        """The plan from this step on; simulated anew where it breaks the arm's equations."""
        broken = plan.solution.violation > CONSISTENT
        return self._simulated(moment, plan.shifted) if broken else plan.shifted

    def _simulated(self, moment: Moment, w: Array) -> Array:
        found = self._rollout(moment, w)
        return w if found is None else found

    def _reset_solver(self) -> None:
        reset = getattr(self.solver, "reset", None)
        if reset is not None:
            reset()

    def _attempt(
        self, x: Array, asked: _Asked, w: Array, multipliers: Solution | None, began: float
    ) -> tuple[Solution | None, str]:
        """What the solver found, or why there is nothing."""
        if asked.error:
            return None, asked.error
        moment, left = self._moment(x, asked), self._time_left(asked, began)
        try:
            if self._split is not None:
                if not asked.prepared:
                    self._split.prepare(moment, w)
                found = self._split.feedback(moment.x, left)
            else:
                given = np.concatenate([moment.x, moment.u_before, moment.given.ravel()])
                limit = {"time_limit": left} if getattr(self.solver, "timed", False) else {}
                found = self.solver.solve(given, w, multipliers, **limit)
        except Exception as error:  # a solver must not stop the control of an arm
            return None, _reason(error)
        return found, "" if found.solved else found.status

    def _time_left(self, asked: _Asked, began: float) -> float | None:
        """Of the budget, for the quadratic program.

        Where nothing is left the result is late anyway: it has another budget, to be of use in the
        next step.
        """
        if self.budget is None:
            return None
        left = self.budget - asked.seconds - _since(began)
        return left if left > 0 else self.budget

    def _status(self, solution: Solution | None, why: str, late: bool) -> str:
        if solution is None:
            return f"{FAILED}: {why}"
        if "time" in f"{solution.status} {solution.qp}".lower() and not solution.solved:
            return BUDGET_OVERRUN
        if solution.solved and not np.all(np.isfinite(solution.w)):
            return f"{FAILED}: result not finite"
        if late and solution.usable:
            return BUDGET_OVERRUN
        if solution.capped:
            return ITERATION_CAP
        return SOLVED if solution.solved else f"{FAILED}: {why}"

    # --- the input -------------------------------------------------------------------------------

    def _stepped(
        self,
        began: float,
        asked: _Asked,
        status: str,
        solution: Solution | None = None,
        worst: str = "",
    ) -> Step:
        """The input that follows from a solve, and the plan for the next step."""
        usable = solution is not None and solution.usable
        plan = self._plan
        if solution is not None and usable:
            self._plan = Plan(self.transcription, solution, 1)
        elif plan is not None:
            self._plan = plan.older()
        if solution is not None and usable and status != BUDGET_OVERRUN:
            wanted, source = self.transcription.split(solution.w)[0][0], "solution"
        elif plan is not None and not plan.over:
            wanted, source = plan.input, "shifted plan"
        else:
            wanted, source = asked.u_before, "held input"
        self._u = self.guard.after(asked.u_before, wanted)
        moved = np.abs(self._u - wanted) / self.transcription.u_scale[: len(wanted)]
        about = {name: getattr(solution, name) for name in _REPORTED} if solution else {}
        return Step(
            u=self._u.copy(),
            status=status,
            source=source,
            prepare_seconds=asked.seconds,
            feedback_seconds=_since(began),
            worst=worst,
            clipped=bool(np.any(moved > CLIPPED)),
            **about,
        )

    def _worst(self, x: Array, asked: _Asked, solution: Solution | None, w: Array) -> str:
        """The worst violations: of what the solver ended with, else of what it began with."""
        if solution is not None and np.all(np.isfinite(solution.w)):
            w = solution.w
        return self._violations.worst(self._moment(x, asked), w)


def _since(began: float) -> float:
    return time.perf_counter() - began


def _reason(error: Exception) -> str:
    return (f"{type(error).__name__}: {error}".splitlines() or [""])[0]
