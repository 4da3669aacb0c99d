"""What a controller by real-time iteration takes from step to step: kept, and put back."""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

import numpy as np

from softmpc.control.daqp import SMALL
from softmpc.control.mpc import Mpc
from softmpc.control.plan import Plan
from softmpc.control.real_time import RealTime
from softmpc.control.solver import NO_MULTIPLIERS, Solution
from softmpc.control.trajectory import Trajectory
from softmpc.control.transcription import Transcription
from softmpc.errors import InputError

__all__ = ["Memory", "memory_of", "put_back", "remembers"]

Array = np.ndarray


@dataclass(frozen=True)
class Memory:
    """Its last plan, last input and active set, between two steps, in the order of the C code.

    `active` is -1 at a lower bound and 1 at an upper one: bounds of the inputs of all blocks, then
    of their slacks, then rows.
    """

    plan: Array | None  # from the next step on: scaled decisions, unknowns of stages, states
    expected: Array | None  # the state that the plan expects now, scaled
    age: int  # of the plan, in steps
    violation: float  # of the plan
    u: Array | None  # given last (k), SI
    active: Array | None  # of the quadratic program
    failures: int  # steps in a row


@dataclass(frozen=True)
class _Resumed(Plan):
    """A plan that is known from some age on."""

    since: int
    expected: Array  # scaled state at that age

    @property
    def state(self) -> Array:
        if self.age == self.since:
            return np.asarray(self.expected * self.transcription.x_scale)
        return super().state

    def _shifted(self, vector: Array, width: int, times: int) -> Array:
        return super()._shifted(vector, width, times - self.since)


def remembers(controller: object) -> bool:
    """Whether `memory_of` knows this kind of controller."""
    solver = getattr(controller, "solver", None)
    return isinstance(controller, Mpc) and isinstance(solver, RealTime) and solver.splits


def memory_of(mpc: Mpc) -> Memory:
    """What it remembers now. Raises `InputError` where it is not by real-time iteration."""
    plan, solver, t = mpc._plan, _solver(mpc), mpc.transcription
    signs = None if solver._active is None else _signs(solver._active)[_order(solver)]
    at = None if plan is None else Trajectory.of(t, plan.shifted)
    return Memory(
        plan=None if at is None else np.concatenate([at.u.ravel(), at.a.ravel(), at.x.ravel()]),
        expected=None if plan is None else _expected(plan),
        age=0 if plan is None else plan.age,
        violation=0.0 if plan is None else plan.solution.violation,
        u=None if mpc._u is None else mpc._u.copy(),
        active=signs,
        failures=mpc._failures,
    )


def put_back(mpc: Mpc, memory: Memory) -> None:
    """Make it remember this, and nothing else. Raises `InputError` where it does not fit."""
    solver, t, order = _solver(mpc), mpc.transcription, _order(_solver(mpc))
    for name, size in (("plan", t.N * t.nw), ("u", t.inputs), ("active", len(order))):
        part = getattr(memory, name)
        if part is not None and len(part) != size:
            raise InputError(
                f"memory of a controller: {name} has {len(part)} numbers; this one needs {size}"
            )
    mpc.reset()
    if memory.plan is not None and memory.expected is not None:
        w = _path(t, memory.plan).w
        none, nan = NO_MULTIPLIERS, float("nan")
        solution = Solution(True, "solved", w, none, none, nan, memory.violation, "", 1, 0.0)
        mpc._plan = _Resumed(t, solution, memory.age, memory.age, memory.expected.copy())
    mpc._u = None if memory.u is None else memory.u.copy()
    mpc._failures = memory.failures
    if memory.active is not None:
        solver._active = np.empty(len(order))
        solver._active[order] = memory.active


def _expected(plan: Plan) -> Array:
    """The scaled state that it expects now."""
    if isinstance(plan, _Resumed) and plan.age == plan.since:
        return plan.expected
    before = plan._shifted(plan.solution.w, plan.transcription.nw, plan.age - 1)
    return Trajectory.of(plan.transcription, before).x[0]


def _path(t: Transcription, plan: Array) -> Trajectory:
    parts = np.split(np.asarray(plan, float), np.cumsum([t.N * t.nu, t.N * t.na]))
    u, a, x = (part.reshape(t.N, -1) for part in parts)
    return Trajectory(u, a, x)


def _signs(multipliers: Array) -> Array:
    """Of those that belong to something active, see `Daqp`."""
    least = SMALL * np.abs(multipliers).max(initial=0.0)
    return np.where(np.abs(multipliers) > least, np.sign(multipliers), 0.0)


def _order(solver: RealTime) -> Array:
    """Where the constraints of the quadratic program in C are among those in Python."""
    t, bounded = solver.transcription, len(solver.bounded)
    moves = np.arange((int(solver.blocks[-1]) + 1) * t.nu).reshape(-1, t.nu)
    inputs, slacks = moves[:, : t.inputs].ravel(), moves[:, t.inputs :].ravel()
    rows = np.arange(t.N * (bounded + len(t.objective.rows))) + moves.size
    return np.concatenate([inputs, slacks, rows])


def _solver(mpc: Mpc) -> RealTime:
    if not remembers(mpc):
        raise InputError(
            "memory of a controller: known is that by real-time iteration, "
            "solver = 'real-time' in [track.controller]"
        )
    return cast(RealTime, mpc.solver)
