"""What a controller by real-time iteration takes from one step into the next, to be kept and put back."""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

import numpy as np

from softmpc.control.daqp import SMALL
from softmpc.control.mpc import Mpc
from softmpc.control.plan import Plan
from softmpc.control.real_time import RealTime
from softmpc.control.solver import NO_MULTIPLIERS, Solution
from softmpc.errors import InputError

__all__ = ["Memory", "memory_of", "put_back", "remembers"]

Array = np.ndarray


@dataclass(frozen=True)
class Memory:
    """Its last plan, last input and active set, between two steps."""

    plan: Array | None  # scaled variables of the solution
    age: int  # of the plan, in steps
    violation: float  # of the plan
    u: Array | None  # given last (k), SI
    active: Array | None  # of the quadratic program: -1 at a lower bound, 1 at an upper one
    failures: int  # steps in a row


def remembers(controller: object) -> bool:
    """Whether `memory_of` knows this kind of controller."""
    solver = getattr(controller, "solver", None)
    return isinstance(controller, Mpc) and isinstance(solver, RealTime) and solver.splits


def memory_of(mpc: Mpc) -> Memory:
    """What it remembers now. Raises `InputError` where it is not by real-time iteration."""
    plan, multipliers = mpc._plan, _solver(mpc)._active
    least = 0.0 if multipliers is None else SMALL * np.abs(multipliers).max(initial=0.0)
    return Memory(
        plan=None if plan is None else plan.solution.w.copy(),
        age=0 if plan is None else plan.age,
        violation=float("nan") if plan is None else plan.solution.violation,
        u=None if mpc._u is None else mpc._u.copy(),
        active=None
        if multipliers is None
        else np.where(np.abs(multipliers) > least, np.sign(multipliers), 0.0),
        failures=mpc._failures,
    )


def put_back(mpc: Mpc, memory: Memory) -> None:
    """Make it remember this, and nothing else. Raises `InputError` where it does not fit."""
    solver, t = _solver(mpc), mpc.transcription
    wanted = {"plan": t.N * t.nw, "u": t.inputs}
    for name, size in wanted.items():
        part = getattr(memory, name)
        if part is not None and len(part) != size:
            raise InputError(
                f"memory of a controller: {name} has {len(part)} numbers; this one needs {size}"
            )
    mpc.reset()
    if memory.plan is not None:
        solution = Solution(
            True, "solved", memory.plan.copy(), NO_MULTIPLIERS, NO_MULTIPLIERS, float("nan"),
            memory.violation, "", 1, 0.0,
        )  # fmt: skip
        mpc._plan = Plan(t, solution, memory.age)
    mpc._u = None if memory.u is None else memory.u.copy()
    mpc._failures = memory.failures
    solver._active = None if memory.active is None else memory.active.copy()


def _solver(mpc: Mpc) -> RealTime:
    if not remembers(mpc):
        raise InputError(
            "memory of a controller: known is that by real-time iteration, "
            "solver = 'real-time' in [track.controller]"
        )
    return cast(RealTime, mpc.solver)
