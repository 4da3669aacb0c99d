"""Multipliers of a linearised step, and the ℓ₁ merit function that judges how much of it to take.

    merit = cost + Σ weight |defect| + Σ weight (violation of a limit)

With weights above the multipliers of the quadratic program its step is a descent direction of the
merit function: the decrease that the linearised problem promises is at least ½ d·H d.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softmpc.control.condensing import Condensed
from softmpc.control.linearisation import Measured
from softmpc.control.trajectory import Trajectory

__all__ = ["Limited", "Merit", "Multipliers", "violations"]

MARGIN = 1.5  # weights over multipliers
SHARE = 0.1  # of the mean multiplier of its kind that a weight is at least
LEAST = 1.0  # cost of a scaled unit of defect

Array = np.ndarray


@dataclass(frozen=True)
class Limited:
    """Bounds of the decisions (nu), of all states (nx) and of the limit rows, scaled."""

    u: tuple[Array, Array]
    x: tuple[Array, Array]
    rows: tuple[Array, Array]

    def over(self, at: Trajectory, measured: Measured) -> tuple[Array, Array, Array]:
        """By how much a trajectory exceeds each (N×…), 0 where it does not."""
        pairs = ((at.u, self.u), (at.x, self.x), (measured.rows, self.rows))
        u, x, rows = (np.maximum(np.maximum(b[0] - v, v - b[1]), 0.0) for v, b in pairs)
        return u, x, rows


@dataclass(frozen=True)
class Multipliers:
    """Of a trajectory's bounds, defects and limit rows, in CasADi's signs (N×…)."""

    u: Array
    x: Array
    stages: Array
    nodes: Array
    rows: Array

    @classmethod
    def of(
        cls, condensed: Condensed, step: Trajectory, u: Array, x: Array, rows: Array
    ) -> Multipliers:
        """Those of the defects follow from the others backwards through the horizon."""
        linear, width = condensed.linear, condensed.linear.steps.B.shape[2]
        before = np.concatenate([np.zeros((1, width)), step.u[:-1]])
        moved = np.concatenate([before, step.u, step.x], axis=1)[:, :, None]
        e = linear.e + (linear.E @ moved)[:, :, 0]
        e_end = linear.e_end[0] + linear.E_end[0] @ moved[-1, :, 0]
        slope = (e[:, None] @ linear.E[:, :, 2 * width :])[:, 0] + x
        if rows.shape[1]:
            slope += (rows[:, None] @ linear.L[:, :, 2 * width :])[:, 0]
        slope[-1] += e_end @ linear.E_end[0, :, 2 * width :]
        nodes = np.empty_like(slope)
        nodes[-1] = at = slope[-1]
        for k in range(len(slope) - 2, -1, -1):
            nodes[k] = at = slope[k] + at @ linear.steps.A[k + 1]
        arm = linear.steps.carry.shape[1]
        stages = -(nodes[:, None, :arm] @ linear.steps.carry)[:, 0]
        return cls(u, x, stages, nodes, rows)

    @property
    def lam_w(self) -> Array:
        """In the order of a program's variables."""
        return np.concatenate([self.u, np.zeros_like(self.stages), self.x], axis=1).ravel()

    @property
    def lam_g(self) -> Array:
        """In the order of a program's constraints."""
        return np.concatenate([self.stages, self.nodes, self.rows], axis=1).ravel()


class Merit:
    """The merit function with the weights of a step; `before` are those of the step before it."""

    def __init__(
        self, limited: Limited, multipliers: Multipliers, before: Merit | None = None
    ) -> None:
        self.limited = limited
        m = multipliers
        parts = m.stages, m.nodes, m.u, m.x, m.rows
        self.weights = [_weights(part) for part in parts]
        if before is not None:  # they fall slowly, so that no two steps undo each other
            pairs = zip(self.weights, before.weights, strict=True)
            self.weights = [np.maximum(new, 0.5 * (new + old)) for new, old in pairs]

    def wrong(self, at: Trajectory, measured: Measured) -> float:
        """Weighted defects and violations."""
        defects, split = np.abs(measured.defects), self.weights[0].shape[1]
        wrong = (defects[:, :split], defects[:, split:], *self.limited.over(at, measured))
        return sum(float(np.vdot(w, v)) for w, v in zip(self.weights, wrong, strict=True))

    def __call__(self, at: Trajectory, measured: Measured) -> float:
        return measured.cost + self.wrong(at, measured)


def _weights(multipliers: Array) -> Array:
    size = np.abs(multipliers)
    least = max(SHARE * float(size.mean()), LEAST) if size.size else LEAST
    return np.maximum(MARGIN * size, least)


def violations(limited: Limited, at: Trajectory, measured: Measured) -> tuple[Array, Array]:
    """Violations in the order of a program's variables and of its constraints (N×…)."""
    u, x, rows = limited.over(at, measured)
    stages = np.zeros((len(u), measured.defects.shape[1] - x.shape[1]))
    of_w = np.concatenate([u, stages, x], axis=1)
    return of_w, np.concatenate([np.abs(measured.defects), rows], axis=1)
