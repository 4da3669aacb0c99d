"""The optimum next to a plan, to rounding: its active rows, multipliers and KKT conditions.

A plan is least to some 1e-4, which is not enough to tell all limits that hold it. Programs with a
little damping find those; Newton's method on the KKT conditions with these limits, and with the
exact Hessian of the Lagrangian, goes to the optimum where they are right.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import linalg, sparse

from softmpc.planning.attempt import Attempt
from softmpc.planning.elastic import Elastic, Step
from softmpc.planning.motion import Motion
from softmpc.planning.sensitivity_constraints import Constraints, Multipliers, hessian
from softmpc.planning.sensitivity_kkt import Kkt

__all__ = ["Optimum", "find_optimum"]

ROUNDS, NEWTON = 3, 16
DAMPING = 1e-3  # curvature in the inputs that a program has beside its own
PRICE = 300.0  # of a scaled unit outside; multipliers are some 1
NEAR = 0.3  # scaled rows further from their bounds are left out of a program
SETTLED = 1e-6  # scaled, of a Newton step that is the last
WRONG = 1e-6  # of the largest multiplier, with the wrong sign
FAR = 0.5  # scaled, the longest step

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Optimum:
    """A motion and what holds it: `active` rows are 1 at an upper bound, -1 at a lower one, else 0.

    `exact`: the search ended, to rounding.
    """

    motion: Motion
    here: Constraints
    multipliers: Multipliers
    active: Array
    kkt: Kkt | None = None
    exact: bool = False


def find_optimum(attempt: Attempt) -> Optimum | None:
    """The optimum next to the motion that an attempt ended with.

    Where it is not found exactly, the nearest that programs come to; None without any.
    """
    motion, best = attempt.solved.motion, None
    for _ in range(ROUNDS):
        program = _programmed(attempt, motion)
        if program is None:
            break
        motion, best = program.motion, _newton(attempt, program) or best
        if best is not None and best.exact:
            break
    return best


def _programmed(attempt: Attempt, motion: Motion) -> Optimum | None:
    """Where a damped program around a motion leads, with its active rows and multipliers."""
    here, inputs = Constraints.of(attempt, motion), attempt.mesh.inputs
    H, f = attempt.objective.model(motion)
    damping = np.where(np.arange(len(f)) < inputs, DAMPING, 0.0)
    step, used = _step(here, (H + sparse.diags(damping)).tocsc(), f)
    there = attempt.roll.moved(motion, step.v) if step.solved else None
    if there is None:
        return None
    of_rows = np.zeros(len(here.value))
    of_rows[used] = step.of_rows
    at = here.value + here.J @ step.v
    # Of an active row the multiplier is large and its room rounding; of others it is the reverse.
    up, down = of_rows > here.high - at, -of_rows > at - here.low
    active = np.where(up, 1, 0) - np.where(down, 1, 0)
    multipliers = Multipliers(step.of_steps, np.where(active != 0, of_rows, 0.0))
    return Optimum(there, Constraints.of(attempt, there), multipliers, active)


def _step(here: Constraints, H: sparse.csc_matrix, f: Array) -> tuple[Step, Array]:
    """A program's step, and the rows that it had."""
    low, high = here.low - here.value, here.high - here.value
    used = np.flatnonzero((low > -NEAR) | (high < NEAR))
    far, prices = np.full(len(f), FAR), np.full(len(used), PRICE)
    program = Elastic(H, f, here.D, here.d, here.J[used], low[used], high[used], prices, -far, far)
    return program.solve(), used


def _newton(attempt: Attempt, program: Optimum) -> Optimum | None:
    """Newton steps with the active rows, one row more where it stops a step, one less where its
    multiplier has the wrong sign, until they settle. The program's motion where they do not.

    H stays that of the first.
    """
    H = hessian(attempt, program.motion, program.multipliers)
    at, active, given_up = program, program.active.copy(), set[int]()
    for _ in range(NEWTON):
        kkt = Kkt.of(attempt, H, at.here, active)
        try:
            v, multipliers = kkt.newton(attempt.objective.model(at.motion)[1])
        except linalg.LinAlgError:
            break
        if program.kkt is None:
            program = replace(program, kkt=kkt)
        size = float(np.abs(v).max())
        share, stopping = _share(at.here, v, active == 0)
        there = attempt.roll.moved(at.motion, min(share, FAR / max(size, FAR)) * v)
        if there is None:
            break
        if share < 1:
            active[stopping] = 1 if (at.here.J @ v)[stopping] > 0 else -1
        at = Optimum(there, Constraints.of(attempt, there), multipliers, kkt.active, kkt)
        if share == 1 and size <= SETTLED:
            wrong = -multipliers.of_rows * active
            worst = int(wrong.argmax())
            if wrong[worst] <= WRONG * np.abs(multipliers.of_rows).max() or worst in given_up:
                return replace(at, exact=True)
            given_up.add(worst)
            active[worst] = 0
    return program if program.kkt is not None else None


def _share(here: Constraints, v: Array, others: Array) -> tuple[float, int]:
    """Of moves, that keeps the other rows within their bounds, and the row that stops them."""
    moves = np.where(others, here.J @ v, 0.0)
    bounds = np.where(moves > 0, here.high, here.low)
    still = moves == 0
    room = np.where(still, np.inf, (bounds - here.value) / np.where(still, 1.0, moves))
    first = int(room.argmin())
    return min(max(float(room[first]), 0.0), 1.0), first
