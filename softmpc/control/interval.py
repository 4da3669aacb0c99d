"""One interval of a transcription as a CasADi function: the implicit step and its Jacobian."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from softmpc.control.discretise import held_input
from softmpc.control.step_form import StepForm
from softmpc.model.disturbance import Disturbance
from softmpc.model.model import Model, sparse_times
from softmpc.simulation.tableau import Tableau

__all__ = ["Interval", "Scales"]


@dataclass(frozen=True)
class Scales:
    """Sizes of a state, of the decisions in an interval, and of its stage accelerations."""

    x: np.ndarray
    u: np.ndarray  # inputs of the model first
    a: np.ndarray


@dataclass(frozen=True, eq=False)
class Interval:
    """`length` seconds of one model by one tableau, its input held."""

    model: Model
    tableau: Tableau
    scales: Scales
    length: float
    disturbance: Disturbance | None = None

    @cached_property
    def form(self) -> StepForm:
        """How the unknowns make strains and rates."""
        return StepForm.of(self.model, self.tableau, self.length)

    @cached_property
    def drive(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Exact discrete hydraulics up to each stage, z = Φ z + Γ u; the last is the end."""
        drive = self.model.drive
        return [held_input(drive.A, drive.B, c * self.length) for c in self.tableau.c]

    @cached_property
    def function(self) -> ca.Function:
        """(x, u, a) scaled -> defects (s·n residuals, then x⁺) and their Jacobian in them.

        With a disturbance d that is the fourth argument, and no column of the Jacobian.
        """
        looped = self.model.residual_jacobian.is_a("MXFunction")  # a call on SX would unroll it
        kind: Any = ca.MX if looped else ca.SX
        x, u, a = (kind.sym(name, len(getattr(self.scales, name))) for name in "xua")
        inputs = len(self.model.layout.u)
        X, U, A = x * self.scales.x, (u * self.scales.u)[:inputs], a * self.scales.a
        d, force = [], 0.0
        if self.disturbance is not None:
            d = [kind.sym("d", len(self.disturbance))]
            U = U + sparse_times(self.disturbance.G, d[0])
            force = sparse_times(self.disturbance.F, d[0])
        rows, jacobians = self._stage_rows(X, U, A, force)
        after = ca.vertcat(*self._end(X, U, A)) / self.scales.x
        J = ca.vertcat(*jacobians) @ ca.diag(ca.DM(self._columns(inputs)))
        slacks = ca.DM(J.shape[0], len(self.scales.u) - inputs)
        split = len(self.scales.x) + inputs
        J = ca.horzcat(J[:, :split], slacks, J[:, split:])
        J = ca.vertcat(J, ca.jacobian(after, ca.vertcat(x, u, a)))
        outputs = [ca.vertcat(*rows, after), J if looped else ca.sparsify(J)]
        return ca.Function("interval", [x, u, a, *d], outputs, {"cse": True})

    def _columns(self, inputs: int) -> np.ndarray:
        return np.concatenate([self.scales.x, self.scales.u[:inputs], self.scales.a])

    def _at_stage(self, s: int, X: Any, U: Any, A: Any) -> tuple[Any, ...]:
        n, form = self.model.strains, self.form
        q, dq, z = ca.vertsplit(X, [0, n, 2 * n, len(self.scales.x)])
        a = ca.vertsplit(A, n)
        q_s = q + sum(form.to_strain[s, j] * a_j for j, a_j in enumerate(a))
        dq_s = sum(form.to_rate[s, j] * a_j for j, a_j in enumerate(a))
        if form.accelerates:
            q_s, dq_s = q_s + form.of_rate[s] * dq, dq_s + dq
        phi, gamma = self.drive[s]
        p = self.model.pressures(sparse_times(phi, z) + sparse_times(gamma, U), U)
        return q_s, dq_s, a[s] if form.accelerates else 0 * a[s], p

    def _stage_rows(self, X: Any, U: Any, A: Any, force: Any) -> tuple[list[Any], list[Any]]:
        """Scaled residuals of all stages, and their Jacobians in (X, U, A), SI columns."""
        model, form, scale = self.model, self.form, self.model.layout.r.scale
        stages = range(len(self.tableau.c))
        rows, jacobians = [], []
        for s in stages:
            at = self._at_stage(s, X, U, A)
            by_q, by_dq, by_ddq, by_p = model.residual_jacobian(*at)
            to_a = [by_q * form.to_strain[s, j] + by_dq * form.to_rate[s, j] for j in stages]
            if form.accelerates:
                to_a[s] = to_a[s] + by_ddq
            phi, gamma = self.drive[s]
            drive = model.drive
            to_z = by_p @ ca.sparsify(ca.DM(drive.C @ phi))
            to_u = by_p @ ca.sparsify(ca.DM(drive.C @ gamma + drive.D))
            to_dq = by_q * form.of_rate[s] + by_dq * form.kept
            rows.append((model.residual(*at) - force) / scale)
            J = ca.horzcat(by_q, to_dq, to_z, to_u, *to_a)
            jacobians.append(ca.diag(ca.DM(1 / scale)) @ J)
        return rows, jacobians

    def _end(self, X: Any, U: Any, A: Any) -> tuple[Any, Any, Any]:
        """State at the end of the interval: the last stage is stiffly accurate."""
        q, dq, _, _ = self._at_stage(len(self.tableau.c) - 1, X, U, A)
        phi, gamma = self.drive[-1]
        z = X[2 * self.model.strains :]
        return q, dq, sparse_times(phi, z) + sparse_times(gamma, U)
