"""Condensing: states follow from inputs, so that a small dense program in the inputs is left.

With dx⁺ = A dx + B du + gap every state is a sum over the inputs before it. What the state now
differs from the predicted one enters last and cheaply: most of the work can be done before it is
known (`Condensed`), and little is left for when it is (`Condensed.at`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softmpc.control.linearisation import Linearised
from softmpc.control.trajectory import Trajectory

__all__ = ["Condensed", "Program", "condense"]

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
    residuals: Array  # ∂e/∂v, those at the end last (residuals × moves)
    rows: Array  # ∂(limit rows)/∂v (N×rows×moves)
    H: Array

    def free(self, dx: Array) -> Array:
        """Change of the states without any move, for a first state that differs by dx (N×nx)."""
        found, at = np.empty_like(self.linear.gaps), dx
        for k, (A, gap) in enumerate(zip(self.linear.A, self.linear.gaps, strict=True)):
            found[k] = at = A @ at + gap
        return found

    def residuals_without(self, free: Array) -> Array:
        """The residuals without any move, those at the end last."""
        linear, width = self.linear, self.linear.B.shape[2]
        e = linear.e + (linear.E[:, :, 2 * width :] @ free[:, :, None])[..., 0]
        e_end = linear.e_end[0] + linear.E_end[0, :, 2 * width :] @ free[-1]
        return np.concatenate([e.ravel(), e_end])

    def limits(self, free: Array) -> Array:
        """The limit rows without any move (N×rows)."""
        width = self.linear.B.shape[2]
        return np.asarray(
            self.linear.c + (self.linear.L[:, :, 2 * width :] @ free[:, :, None])[..., 0]
        )

    def expand(self, moves: Array, dx: Array, free: Array) -> Trajectory:
        """The step of the whole trajectory that goes with the moves."""
        linear, width = self.linear, self.linear.B.shape[2]
        du = moves.reshape(-1, width)[self.blocks]
        x = free + self.states @ moves
        before = np.vstack([dx, x[:-1]])
        a = linear.a_0 - (linear.by_x @ before[:, :, None] + linear.by_u @ du[:, :, None])[..., 0]
        return Trajectory(du, a, x)


def condense(linear: Linearised, blocks: Array) -> Condensed:
    """Eliminate the states; intervals of one block share their move."""
    count, nx, width = linear.B.shape
    moves = width * (int(blocks[-1]) + 1)
    states = np.zeros((count, nx, moves))
    for k in range(count):
        start = blocks[k] * width
        if k:
            states[k, :, : start + width] = linear.A[k] @ states[k - 1, :, : start + width]
        states[k, :, start : start + width] += linear.B[k]
    rows = _through(linear.L, states, blocks, width)
    every = _through(linear.E, states, blocks, width).reshape(-1, moves)
    end = linear.E_end[0, :, 2 * width :] @ states[-1]
    residuals = np.vstack([every, end])
    return Condensed(linear, blocks, states, residuals, rows, residuals.T @ residuals)


def _through(by: Array, states: Array, blocks: Array, width: int) -> Array:
    """∂(rows)/∂v of rows that depend on (u_before, u, x⁺) of their interval (N×rows×moves)."""
    of_state = np.flatnonzero(np.any(by[:, :, 2 * width :], axis=(0, 2)))
    found = np.zeros((*by.shape[:2], states.shape[2]))
    found[:, of_state] = by[:, of_state, 2 * width :] @ states
    for k, block in enumerate(blocks):
        start = block * width
        found[k, :, start : start + width] += by[k, :, width : 2 * width]
        if k:
            start = blocks[k - 1] * width
            found[k, :, start : start + width] += by[k, :, :width]
    return found
