"""Condensing: states follow from inputs, so that a small dense program in the inputs is left.

With dx⁺ = A dx + B du + gap every state is a sum over the inputs before it. The drive is linear, so
its part of those sums never changes, and neither do the costs and limits that see nothing of the
arm: `Condensing` has them ready. What the state now differs from the predicted one enters last and
cheaply: most of the work can be done before it is known (`Condensed`), and little is left for when
it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from softmpc.control.linearisation import Linearisation, Linearised
from softmpc.control.trajectory import Trajectory
from softmpc.errors import InputError

__all__ = ["Condensed", "Condensing", "Program", "block_of_each"]

Array = np.ndarray


@dataclass(frozen=True)
class Program:
    """min ½ v·H v + f·v with low ≤ v ≤ high and low_rows ≤ R v ≤ high_rows."""

    H: Array
    f: Array
    low: Array
    high: Array
    R: Array
    low_rows: Array
    high_rows: Array


@dataclass(frozen=True)
class Condensed:
    """A linearised problem in its moves v: the inputs of all blocks of intervals, one by one."""

    linear: Linearised
    blocks: Array  # block of each interval (N)
    states: Array  # ∂x⁺/∂v (N×nx×moves)
    still: tuple[Array, Array]  # residuals that never change their slopes: which, and ∂e/∂v
    moving: tuple[Array, Array]  # the others
    end: Array  # ∂e/∂v at the end of the horizon
    rows: Array  # ∂(limit rows)/∂v (N×rows×moves)
    H: Array

    def residuals_without(self, free: Array) -> tuple[Array, Array]:
        """The residuals of the intervals (N×…) and of the end (1×…) without any move."""
        linear, first = self.linear, 2 * self.linear.steps.B.shape[2]
        e = linear.e + (linear.E[:, :, first:] @ free[:, :, None])[..., 0]
        return e, linear.e_end + linear.E_end[0, :, first:] @ free[-1]

    def gradient(self, free: Array) -> Array:
        """Slope of the squares in the moves."""
        e, e_end = self.residuals_without(free)
        found = e_end[0] @ self.end
        for which, by in (self.still, self.moving):
            found += e[:, which].ravel() @ by
        return np.asarray(found)

    def predicted(self, step: Trajectory, price: Array) -> float:
        """Cost of the linearised problem after a step; `price` of each scaled decision (nu)."""
        linear = self.linear
        before = np.concatenate([np.zeros_like(step.u[:1]), step.u[:-1]])
        moved = np.concatenate([before, step.u, step.x], axis=1)
        e = linear.e + (linear.E @ moved[:, :, None])[:, :, 0]
        e_end = linear.e_end[0] + linear.E_end[0] @ moved[-1]
        squares = float(np.vdot(e, e)) + float(np.vdot(e_end, e_end))
        return 0.5 * squares + float(np.sum(step.u @ price))

    def limits(self, free: Array) -> Array:
        """The limit rows without any move (N×rows)."""
        first = 2 * self.linear.steps.B.shape[2]
        return np.asarray(self.linear.c + (self.linear.L[:, :, first:] @ free[:, :, None])[..., 0])

    def expand(self, moves: Array, dx: Array, free: Array) -> Trajectory:
        """The step of the whole trajectory that goes with the moves."""
        du = moves.reshape(-1, self.linear.steps.B.shape[2])[self.blocks]
        x = free + self.states @ moves
        return Trajectory(du, self.linear.steps.stages(dx, x, du), x)


class Condensing:
    """Condenses problems of one transcription; intervals of one block share their move."""

    def __init__(self, linearisation: Linearisation, blocks: Array) -> None:
        self.t, self.blocks, self.terms = linearisation.t, blocks, linearisation.terms
        self.arm, self.width = 2 * self.t.n, self.t.nu
        self.moves = self.width * (int(blocks[-1]) + 1)
        self.drive = self._drive_states(linearisation)
        split, moving = linearisation.residuals, self.terms.moving
        self._still, self._moving = np.flatnonzero(~moving[:split]), np.flatnonzero(moving[:split])
        self._moving_rows = np.flatnonzero(moving[split:])
        constant = self.terms.constant
        states = np.zeros((self.t.N, self.t.nx, self.moves))
        states[:, self.arm :] = self.drive
        self._still_by = self._through(constant[:, self._still], states, True)
        self._still_by = self._still_by.reshape(-1, self.moves)
        self.still_H = self._still_by.T @ self._still_by
        self.still_rows = self._through(constant[:, split:], states, True)
        self._inputs_move = bool(self.terms.of_input[self._moving].any())
        self._touched = self.width if self._inputs_move else self.t.inputs  # slacks move no state

    def _drive_states(self, linearisation: Linearisation) -> Array:
        """∂z⁺/∂v, constant (N × states of the drive × moves)."""
        t, grid = self.t, linearisation.dynamics.grid
        phi, gamma = grid.phi[:, -1], grid.gamma[:, -1]
        scale = t.x_scale[self.arm :]
        found = np.zeros((t.N, t.nx - self.arm, self.moves))
        for k, block in enumerate(self.blocks):
            if k:
                found[k] = (phi[k] * scale / scale[:, None]) @ found[k - 1]
            own = block * self.width + np.arange(t.inputs)
            found[k][:, own] += gamma[k] * t.u_scale[: t.inputs] / scale[:, None]
        return found

    def __call__(self, linear: Linearised) -> Condensed:
        """Eliminate the states."""
        states = self._states(linear)
        every = self._through(linear.E[:, self._moving], states, self._inputs_move)
        every = every.reshape(-1, self.moves)
        first = 2 * self.width
        end = linear.E_end[0, :, first:] @ states[-1]
        if len(end):
            u_before, u = self.blocks[-2:] if self.t.N > 1 else (None, self.blocks[-1])
            self._place(end[None], linear.E_end, [u_before], [u])
        H = self.still_H + end.T @ end if len(end) else self.still_H.copy()
        used, shape = self._touched, (-1, self.moves // self.width, self.width)
        seen = every.reshape(shape)[:, :, :used].reshape(len(every), -1)
        part = H.reshape(*shape[1:], *shape[1:])[:, :used, :, :used]
        part += (seen.T @ seen).reshape(part.shape)
        rows = self.still_rows
        if len(self._moving_rows):
            rows = rows.copy()
            rows[:, self._moving_rows] = self._through(linear.L[:, self._moving_rows], states, True)
        still, moving = (self._still, self._still_by), (self._moving, every)
        return Condensed(linear, self.blocks, states, still, moving, end, rows, H)

    def _states(self, linear: Linearised) -> Array:
        """∂x⁺/∂v; only the arm's part changes."""
        arm, width, count = self.arm, self.width, self.t.N
        states = np.empty((count, self.t.nx, self.moves))
        states[:, arm:] = self.drive
        states[0, :arm] = 0.0
        np.matmul(linear.steps.A[1:, :arm, arm:], self.drive[:-1], out=states[1:, :arm])
        before = 0  # later moves do not reach back
        for k, block in enumerate(self.blocks):
            own = block * width
            states[k, :arm, own : own + width] += linear.steps.B[k, :arm]
            if k:
                reached = linear.steps.A[k, :arm, :arm] @ states[k - 1, :arm, :before]
                states[k, :arm, :before] += reached
            before = own + width
        return states

    def _through(self, by: Array, states: Array, inputs: bool) -> Array:
        """∂(rows)/∂v of rows that depend on (u_before, u, x⁺) of their interval (N×rows×moves)."""
        of_state = 2 * self.width + np.flatnonzero(np.any(by[:, :, 2 * self.width :], axis=(0, 1)))
        found = by[:, :, of_state] @ states[:, of_state - 2 * self.width]
        if inputs:
            self._place(found, by, [None, *self.blocks[:-1]], self.blocks)
        return np.asarray(found)

    def _place(self, found: Array, by: Array, before: list, own: Array | list) -> None:
        """Add what inputs do to the rows themselves, in place."""
        width = self.width
        for k, (u_before, u) in enumerate(zip(before, own, strict=True)):
            found[k, :, u * width : (u + 1) * width] += by[k, :, width : 2 * width]
            if u_before is not None:
                start = u_before * width
                found[k, :, start : start + width] += by[k, :, :width]


def block_of_each(blocks: Sequence[int] | None, intervals: int) -> Array:
    """The block of each interval (N), from how many each has; without `blocks` one each."""
    counts = [1] * intervals if blocks is None else list(blocks)
    if sum(counts) != intervals or not all(isinstance(c, int) and c >= 1 for c in counts):
        raise InputError(
            f"blocks = {counts}: must be whole numbers from 1 that add up to the {intervals} "
            "intervals"
        )
    return np.repeat(np.arange(len(counts)), counts)
