"""Simulate the inputs of a plan: a trajectory that breaks none of the model's equations.

Iterations that jump far leave stage equations behind that a later iteration may never mend. From a
state and inputs a trajectory can always be made anew with Newton's method: on all intervals at once
where the solver has fast functions for that and the trajectory is near enough, else one by one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from softmpc.control.interval import Interval
from softmpc.control.linearisation import Linearisation
from softmpc.control.trajectory import Moment, Trajectory
from softmpc.control.transcription import Transcription

__all__ = ["Rollout"]

TOLERANCE = 1e-7  # of the scaled residual
AT_ONCE = 1e-2  # the same, of all intervals at once: the next linearisation takes the rest
MOST = 12  # Newton iterations of an interval
SHARES = (1.0, 0.5, 0.25, 0.1)  # of a Newton step: the first that makes the residual smaller

Array = np.ndarray


class Rollout:
    """Simulates one transcription, by the steps it is made of."""

    def __init__(
        self, transcription: Transcription, linearisation: Linearisation | None = None
    ) -> None:
        self.t = t = transcription
        self.linearisation = linearisation
        stages = len(t.tableau.c)
        self._residual = t.model.residual.map(stages)
        self._slopes = t.model.residual_jacobian.map(stages)
        self._r_scale = np.tile(t.model.layout.r.scale, stages)

    def __call__(self, moment: Moment, w: Array) -> Array | None:
        """Variables (N·nw) from the moment's state under the inputs in w; None where none are."""
        at = Trajectory.of(self.t, w)
        bounds = (bound[: self.t.nu] for bound in self.t.variable_bounds())
        at = replace(at, u=np.clip(at.u, *bounds))
        found = self._at_once(moment, at)
        return self.one_by_one(moment, at, self.t.intervals) if found is None else found

    def _at_once(self, moment: Moment, at: Trajectory) -> Array | None:
        """Newton's method on all intervals, as long as each step makes the defects smaller."""
        linearisation = self.linearisation
        if linearisation is None:
            return None
        still = np.zeros_like(moment.x), np.zeros_like(at.u)
        for _ in range(MOST):
            try:
                linear = linearisation(moment, at)
            except np.linalg.LinAlgError:
                return None
            dx = linear.steps.free(still[0])
            at = Trajectory(at.u, at.a + linear.steps.stages(still[0], dx, still[1]), at.x + dx)
            before, after = linear.measured, linearisation.measure(moment, at)
            worst = float(np.abs(after.defects).max())
            if worst <= AT_ONCE:
                return at.w
            if not worst < np.abs(before.defects).max():
                break
        return None

    def one_by_one(
        self, moment: Moment, at: Trajectory, intervals: Sequence[Interval]
    ) -> Array | None:
        """Newton's method on each interval in turn; variables (N·nw), None where there are none.

        It begins at the given accelerations, and where that does not lead to a solution at those of
        the interval before, and at none.
        """
        t, u = self.t, at.u
        a, states = np.empty_like(at.a), np.empty_like(at.x)
        before, last = moment.x, np.zeros(t.na)
        for k, interval in enumerate(intervals):
            disturbed = self._disturbed(moment.given[k])
            for guess in (at.a[k], last, np.zeros(t.na)):
                found = self._step(interval, before, u[k], guess, *disturbed)
                if found is not None:
                    break
            if found is None:
                return None
            a[k], states[k] = found
            before, last = states[k], a[k]
        return Trajectory(u, a, states).w

    def _disturbed(self, given: Array) -> tuple[Array | float, Array | float]:
        """Force on the strains (scaled as residuals, n) and offset of the input (k; SI)."""
        disturbance = self.t.ocp.disturbance
        if disturbance is None:
            return 0.0, 0.0
        d = given[self.t.disturbance_columns]
        force = disturbance.F @ d / self.t.model.layout.r.scale
        return np.tile(force, len(self.t.tableau.c)), disturbance.G @ d

    def _step(
        self,
        interval: Interval,
        x: Array,
        u: Array,
        a: Array,
        force: Array | float,
        offset: Array | float,
    ) -> tuple[Array, Array] | None:
        """Unknowns and state at the end of one interval, scaled."""
        X, U = x * self.t.x_scale, (u * self.t.u_scale)[: self.t.inputs] + offset
        drive = self._drive(interval, X[2 * self.t.n :], U)
        at = self._at(interval, X, a)
        r = self._rows(at, drive[0]) - force
        for _ in range(MOST):
            if not np.all(np.isfinite(r)):
                return None
            if np.abs(r).max() <= TOLERANCE:
                end = np.concatenate([at[0][-1], at[1][-1], drive[1]])
                return a, end / self.t.x_scale
            try:
                step = np.linalg.solve(self._matrix(interval, at, drive[0]), r)
            except np.linalg.LinAlgError:
                return None
            for share in SHARES:
                there = a - share * step
                at = self._at(interval, X, there)
                after = self._rows(at, drive[0]) - force
                if np.abs(after).max() < np.abs(r).max():
                    break
            else:
                return None
            a, r = there, after
        return None

    def _drive(self, interval: Interval, z: Array, U: Array) -> tuple[Array, Array]:
        """Pressures at the stages (s×m), and the drive's state at the end; SI."""
        drive = self.t.model.drive
        states = [phi @ z + gamma @ U for phi, gamma in interval.drive]
        return np.array(states) @ drive.C.T + drive.D @ U, states[-1]

    def _at(self, interval: Interval, X: Array, a: Array) -> tuple[Array, Array, Array]:
        """q, dq and ddq at the stages (s×n), SI."""
        n, form = self.t.n, interval.form
        A = (a * self.t.a_scale).reshape(-1, n)
        q = X[:n] + np.outer(form.of_rate, X[n : 2 * n]) + form.to_strain @ A
        dq = form.kept * X[n : 2 * n] + form.to_rate @ A
        return q, dq, A * form.accelerates

    def _rows(self, at: tuple[Array, ...], p: Array) -> Array:
        """Scaled residuals at the stages (s·n)."""
        r = np.asarray(self._residual(*(value.T for value in at), p.T))
        return r.ravel(order="F") / self._r_scale

    def _matrix(self, interval: Interval, at: tuple[Array, ...], p: Array) -> Array:
        """∂(scaled residuals)/∂(scaled unknowns)."""
        n, form, stages = self.t.n, interval.form, len(at[0])
        found = self._slopes(*(value.T for value in at), p.T)
        K, D, M = (np.asarray(J.full()).reshape(n, stages, n).swapaxes(0, 1) for J in found[:3])
        blocks = np.einsum("sj,sab->sajb", form.to_strain, K)
        blocks += np.einsum("sj,sab->sajb", form.to_rate, D)
        if form.accelerates:
            stage = np.arange(stages)
            blocks[stage, :, stage] += M
        rows = blocks.reshape(stages * n, stages * n)
        return np.asarray(rows * self.t.a_scale / self._r_scale[:, None])
