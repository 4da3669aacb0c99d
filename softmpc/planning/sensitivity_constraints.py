"""All that holds a motion, as equations and rows in its moves, and how that is curved."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse

from softmpc.control.trajectory import Trajectory
from softmpc.planning.attempt import Attempt
from softmpc.planning.motion import Motion, equations

__all__ = ["Constraints", "Multipliers", "hessian"]

NUDGE = 2e-5  # scaled, of central differences of gradients

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Multipliers:
    """Of the equations (steps, known durations), and of all rows; scaled."""

    of_equations: Array
    of_rows: Array


@dataclass(frozen=True, eq=False)
class Constraints:
    """Equations D v = d and rows low ≤ value + J v ≤ high around a motion, in its moves.

    The rows are those of the conditions, then the inputs themselves.
    """

    D: sparse.csr_matrix
    d: Array
    J: sparse.csr_matrix
    value: Array
    low: Array
    high: Array

    @classmethod
    def of(cls, attempt: Attempt, motion: Motion) -> Constraints:
        mesh, t = attempt.mesh, attempt.t
        D, d = equations(mesh, motion, attempt.problem.timing)
        rows = attempt.conditions(motion)
        low, high = (np.tile(bound[: t.nu], t.N) for bound in t.variable_bounds())
        return cls(
            D, d, sparse.vstack([rows.slopes, mesh.input_itself]).tocsr(),
            np.concatenate([rows.value, motion.at.u.ravel()]),
            np.concatenate([rows.low, low]), np.concatenate([rows.high, high]),
        )  # fmt: skip

    def gradients(self, m: Multipliers) -> Array:
        """Parts of equations and of rows in the gradient of the Lagrangian (2 × moves)."""
        return np.stack([self.D.T @ m.of_equations, self.J.T @ m.of_rows])


def hessian(attempt: Attempt, motion: Motion, m: Multipliers) -> sparse.csc_matrix:
    """Second derivatives of the Lagrangian in the moves, by differences of its gradient.

    Intervals are coupled by equations alone, so one nudge of a state or an input at all nodes at
    once gives that column of all intervals.
    """
    return _Curvature(attempt, motion, m).all()


class _Curvature:
    def __init__(self, attempt: Attempt, motion: Motion, m: Multipliers) -> None:
        self.attempt, self.motion, self.m = attempt, motion, m
        self.t, self.mesh = attempt.t, attempt.mesh
        self._parts: list[tuple[Array, Array, Array]] = []  # values, rows, columns

    def all(self) -> sparse.csc_matrix:
        t, of_x, of_u = self.t, self.mesh.of_x, self.mesh.of_u
        for j in range(t.nx):
            of_steps, of_rows = self._nudged(np.eye(t.nx)[j], np.zeros(t.nu))
            self._keep(of_steps + of_rows, of_x, of_x[:, j], mirrored=False)
            self._keep(of_rows, of_u, of_x[:, j])
            self._keep(of_steps, of_u[1:], of_x[:-1, j])
        for j in range(t.nu):
            of_steps, of_rows = self._nudged(np.zeros(t.nx), np.eye(t.nu)[j])
            self._keep(of_steps + of_rows, of_u, of_u[:, j], mirrored=False)
        values, rows, columns = (np.concatenate(part) for part in zip(*self._parts, strict=True))
        shape = self.mesh.moves, self.mesh.moves
        H = sparse.csc_matrix((values, (rows, columns)), shape)
        return self._with_durations(0.5 * (H + H.T) + self.attempt.objective.model(self.motion)[0])

    def _keep(self, change: Array, rows: Array, column: Array, mirrored: bool = True) -> None:
        """Entries of one column of all intervals; blocks off the diagonal have a mirror image."""
        columns = np.broadcast_to(column[:, None], rows.shape)
        part = change[rows].ravel(), rows.ravel(), columns.ravel()
        self._parts.append(part)
        if mirrored:
            self._parts.append((part[0], part[2], part[1]))

    def _nudged(self, x: Array, u: Array) -> Array:
        """Change of the gradients by a unit of x and u at all nodes."""
        none = np.zeros_like(self.motion.durations)
        up, down = (
            Constraints.of(self.attempt, self._moved(nudge * x, nudge * u, none)).gradients(self.m)
            for nudge in (NUDGE, -NUDGE)
        )
        return (up - down) / (2 * NUDGE)

    def _moved(self, x: Array, u: Array, longer: Array) -> Motion:
        """A motion with linearised stages: its states need not follow from each other."""
        motion, steps, phases = self.motion, self.motion.steps, self.mesh.phases
        durations = motion.durations + longer
        lengths = phases.lengths(durations)
        more = lengths - phases.lengths(motion.durations)
        step = np.zeros((self.t.N, 1))
        dx, du = x + step, u + step
        if steps.by_h is None:
            raise AssertionError("a motion has slopes in its lengths")
        da = steps.stages(np.zeros(self.t.nx), dx, du) - steps.by_h * more[:, None]
        at = motion.at.moved(Trajectory(du, da, dx), 1.0)
        dynamics = self.attempt.roll.dynamics
        dynamics.use(lengths)
        return Motion(at, durations, dynamics(self.attempt.moment, at, by_length=True))

    def _with_durations(self, H: sparse.csc_matrix) -> sparse.csc_matrix:
        """With the rows and columns of the durations, the objective's included."""
        count, still = len(self.motion.durations), (np.zeros(self.t.nx), np.zeros(self.t.nu))
        n, columns = self.mesh.moves - count, []
        for one in np.eye(count):
            up, down = (self._moved(*still, nudge * one) for nudge in (NUDGE, -NUDGE))
            change = self._whole(up) - self._whole(down)
            columns.append(change / (2 * NUDGE))
        C = np.stack(columns, axis=1)
        return sparse.bmat([[H[:n, :n], C[:n]], [C[:n].T, 0.5 * (C[n:] + C[n:].T)]]).tocsc()

    def _whole(self, motion: Motion) -> Array:
        """Gradient of the Lagrangian."""
        held = Constraints.of(self.attempt, motion).gradients(self.m)
        return held.sum(axis=0) + self.attempt.objective.model(motion)[1]
