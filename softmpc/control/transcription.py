"""Direct transcription over the residual: an `Ocp` becomes a nonlinear program.

Each interval is one Radau IIA step in second-order form. Its stage accelerations a are unknowns,
the strains and rates at the stages follow from them linearly, and the residual at each stage is a
constraint, so M is never inverted. The hydraulics are linear: exact matrices carry them from node
to node and to the stages, outside the automatic differentiation.

    stage    r(q_s, dq_s, a_s, P_s) = 0
    node     q⁺ = q + h dq + h² Σ (bA)_j a_j,  dq⁺ = dq + h Σ b_j a_j,  z⁺ = Φ z + Γ u

Variables are scaled. Their order is u_0, a_0, x_1, u_1, a_1, x_2, …; x_0, the input before and the
references are parameters. Small SX functions are mapped over the horizon, and the Jacobian and the
Gauss-Newton Hessian are put together from their nonzeros.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from softmpc.control.discretise import held_input
from softmpc.control.limits import Rows
from softmpc.control.ocp import Ocp
from softmpc.control.stage import Stage
from softmpc.errors import BuildError
from softmpc.model.model import Model, sparse_times
from softmpc.simulation.tableau import Tableau, radau_iia

__all__ = ["NonlinearProgram", "Transcription"]


@dataclass(frozen=True)
class NonlinearProgram:
    """min f(w, p) with low ≤ w ≤ high and low_g ≤ g(w, p) ≤ high_g, all scaled and named."""

    w: ca.MX
    p: ca.MX
    f: ca.MX
    g: ca.MX
    bounds: tuple[np.ndarray, np.ndarray]
    bounds_g: tuple[np.ndarray, np.ndarray]
    names: tuple[str, ...]
    names_g: tuple[str, ...]
    gauss_newton: dict[str, ca.Function]  # grad_f, jac_g and hess_lag, as `nlpsol` takes them


class Transcription:
    """The nonlinear program of an `Ocp`, and the way between its vectors and trajectories."""

    def __init__(self, ocp: Ocp, stages: int = 2) -> None:
        self.ocp = ocp
        self.model = ocp.model
        _require_linear_drive(self.model)
        self.tableau: Tableau = radau_iia(stages)
        layout = self.model.layout
        self.n, self.nx, self.nu = len(layout.q), len(layout.x), len(layout.u)
        self.na = stages * self.n
        self.nw = self.nu + self.na + self.nx  # variables an interval
        self.N = ocp.intervals
        self.x_scale, self.u_scale = layout.x.scale, layout.u.scale
        self.a_scale = np.tile(layout.ddq.scale, stages)
        self.w_scale = np.tile(np.concatenate([self.u_scale, self.a_scale, self.x_scale]), self.N)

    # --- vectors and trajectories -------------------------------------------------------------

    def parameters(self, x: np.ndarray, u_before: np.ndarray, targets: np.ndarray) -> np.ndarray:
        """p from the state now, the input before and the references at the nodes (N×3)."""
        scaled = (x / self.x_scale, u_before / self.u_scale, np.asarray(targets).ravel())
        return np.concatenate(scaled)

    def split(self, w: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Inputs (N×k), stage accelerations (N×s·n) and states (N×nx) in SI."""
        rows = (np.asarray(w).ravel() * self.w_scale).reshape(self.N, self.nw)
        return tuple(np.split(rows, [self.nu, self.nu + self.na], axis=1))  # type: ignore[return-value]

    def resting(self, x: np.ndarray, u: np.ndarray) -> np.ndarray:
        """A first guess: the arm stays where it is."""
        row = np.concatenate([u / self.u_scale, np.zeros(self.na), x / self.x_scale])
        return np.tile(row, self.N)

    def shifted(self, vector: np.ndarray, width: int) -> np.ndarray:
        """A stage-wise vector one interval later, the last one repeated."""
        return np.concatenate([vector[width:], vector[-width:]])

    # --- one interval -------------------------------------------------------------------------

    @cached_property
    def _drive(self) -> tuple[list[tuple[np.ndarray, np.ndarray]], tuple[np.ndarray, np.ndarray]]:
        """Exact discrete hydraulics up to each stage, and to the end of the interval."""
        drive, h = self.model.drive, self.ocp.step
        steps = [held_input(drive.A, drive.B, c * h) for c in self.tableau.c]
        return steps, steps[-1]

    @cached_property
    def interval(self) -> ca.Function:
        """(x, u, a) scaled -> defects (s·n residuals, then x⁺) and their Jacobian."""
        looped = self.model.residual_jacobian.is_a("MXFunction")  # a call on SX would unroll it
        kind: Any = ca.MX if looped else ca.SX
        x, u, a = (kind.sym(s, k) for s, k in (("x", self.nx), ("u", self.nu), ("a", self.na)))
        X, U, A = x * self.x_scale, u * self.u_scale, a * self.a_scale
        rows, jacobians = self._stage_rows(X, U, A)
        after = ca.vertcat(*self._end(X, U, A)) / self.x_scale
        scale = ca.DM(np.concatenate([self.x_scale, self.u_scale, self.a_scale]))
        J = ca.vertcat(*jacobians) @ ca.diag(scale)
        J = ca.vertcat(J, ca.jacobian(after, ca.vertcat(x, u, a)))
        outputs = [ca.vertcat(*rows, after), J if looped else ca.sparsify(J)]
        return ca.Function("interval", [x, u, a], outputs, {"cse": True})

    def _at_stage(self, s: int, X: Any, U: Any, A: Any) -> tuple[Any, ...]:
        n, h, t = self.n, self.ocp.step, self.tableau
        q, dq, z = ca.vertsplit(X, [0, n, 2 * n, self.nx])
        a = ca.vertsplit(A, n)
        squared = t.A @ t.A
        q_s = q + t.c[s] * h * dq + h**2 * sum(squared[s, j] * a_j for j, a_j in enumerate(a))
        dq_s = dq + h * sum(t.A[s, j] * a_j for j, a_j in enumerate(a))
        phi, gamma = self._drive[0][s]
        return (
            q_s,
            dq_s,
            a[s],
            self.model.pressures(sparse_times(phi, z) + sparse_times(gamma, U), U),
        )

    def _stage_rows(self, X: Any, U: Any, A: Any) -> tuple[list[Any], list[Any]]:
        """Scaled residuals of all stages, and their Jacobians in (X, U, A), SI columns."""
        model, h, t = self.model, self.ocp.step, self.tableau
        squared, scale = t.A @ t.A, model.layout.r.scale
        eye = ca.DM.eye(self.n)
        rows, jacobians = [], []
        for s in range(len(t.c)):
            at = self._at_stage(s, X, U, A)
            by_q, by_dq, by_ddq, by_p = model.residual_jacobian(*at)
            to_a = [
                by_q * (h**2 * squared[s, j]) + by_dq * (h * t.A[s, j]) for j in range(len(t.c))
            ]
            to_a[s] = to_a[s] + by_ddq
            phi, gamma = self._drive[0][s]
            drive = model.drive
            to_z = by_p @ ca.sparsify(ca.DM(drive.C @ phi))
            to_u = by_p @ ca.sparsify(ca.DM(drive.C @ gamma + drive.D))
            to_dq = by_q @ (t.c[s] * h * eye) + by_dq
            rows.append(model.residual(*at) / scale)
            J = ca.horzcat(by_q, to_dq, to_z, to_u, *to_a)
            jacobians.append(ca.diag(ca.DM(1 / scale)) @ J)
        return rows, jacobians

    def _end(self, X: Any, U: Any, A: Any) -> tuple[Any, Any, Any]:
        """State at the end of the interval: the last stage is stiffly accurate."""
        q, dq, _, _ = self._at_stage(len(self.tableau.c) - 1, X, U, A)
        phi, gamma = self._drive[1]
        return q, dq, sparse_times(phi, X[2 * self.n :]) + sparse_times(gamma, U)

    # --- costs and limits ---------------------------------------------------------------------

    @cached_property
    def _stage(self) -> Stage:
        return Stage.of(self.model)

    @cached_property
    def _symbols(self) -> list[ca.SX]:
        """Scaled (u_before, u, x) of an interval, and its target."""
        sizes = (("u_before", self.nu), ("u", self.nu), ("x", self.nx))
        return [*(ca.SX.sym(name, size) for name, size in sizes), self._stage.target]

    def _scaled(self, expression: ca.SX) -> ca.SX:
        """An expression of the stage in scaled symbols."""
        stage, (u_before, u, x, _) = self._stage, self._symbols
        values = [u_before * self.u_scale, u * self.u_scale, x * self.x_scale]
        return ca.substitute([expression], [stage.u_before, stage.u, stage.x], values)[0]

    @cached_property
    def cost(self) -> ca.Function:
        """(u_before, u, x, target) scaled -> ½ e·e, its gradient and JᵀJ (upper half)."""
        residuals = [c.residual(self._stage) for c in self.ocp.costs]
        e = self._scaled(ca.vertcat(*residuals))
        J = ca.jacobian(e, ca.vertcat(*self._symbols[:3]))
        outputs = [0.5 * ca.sumsqr(e), ca.densify(J.T @ e), ca.triu(ca.sparsify(J.T @ J))]
        return ca.Function("cost", self._symbols, outputs, {"cse": True})

    @cached_property
    def _limits(self) -> tuple[list[tuple[int, float, float]], list[tuple[ca.SX, Rows, int]]]:
        """Limits that bound one variable of (u_before, u, x), and those that do not."""
        simple, general = [], []
        for limit in self.ocp.limits:
            rows = limit.rows(self._stage)
            value = self._scaled(rows.value / rows.scale)
            J = ca.jacobian(value, ca.vertcat(*self._symbols[:3]))
            low, high = rows.low / rows.scale, rows.high / rows.scale
            for i in range(value.shape[0]):
                columns = J[i, :].sparsity().get_col()
                if len(columns) == 1 and J[i, columns[0]].is_constant() and columns[0] >= self.nu:
                    slope = float(J[i, columns[0]])
                    ends = sorted((low[i] / slope, high[i] / slope))
                    simple.append((columns[0] - self.nu, *ends))
                else:
                    general.append((value[i], rows, i))
        return simple, general

    @cached_property
    def limit(self) -> ca.Function | None:
        """(u_before, u, x, target) scaled -> rows of the limits that are no bounds."""
        general = self._limits[1]
        if not general:
            return None
        value = ca.vertcat(*(v for v, _, _ in general))
        J = ca.sparsify(ca.jacobian(value, ca.vertcat(*self._symbols[:3])))
        return ca.Function("limit", self._symbols, [value, J], {"cse": True})

    # --- the program --------------------------------------------------------------------------

    @cached_property
    def program(self) -> NonlinearProgram:
        """The nonlinear program."""
        from softmpc.control.assembly import assemble

        return assemble(self)

    def variable_bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Bounds of the scaled variables of one interval, (u, a, x)."""
        low, high = np.full(self.nw, -np.inf), np.full(self.nw, np.inf)
        for column, a, b in self._limits[0]:
            i = column if column < self.nu else column + self.na
            low[i], high[i] = max(low[i], a), min(high[i], b)
        return low, high

    def row_bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Bounds of the constraints of one interval: defects are zero, limits as they say."""
        zero = np.zeros(self.na + self.nx)
        general = self._limits[1]
        low = [rows.low[i] / rows.scale[i] for _, rows, i in general]
        high = [rows.high[i] / rows.scale[i] for _, rows, i in general]
        return np.concatenate([zero, low]), np.concatenate([zero, high])

    def variable_names(self) -> list[str]:
        """Names of the variables of one interval."""
        layout = self.model.layout
        stages = range(1, len(self.tableau.c) + 1)
        a = [f"{name} (stage {s})" for s in stages for name in layout.ddq.names]
        return [*layout.u.names, *a, *layout.x.names]

    def row_names(self) -> list[str]:
        """Names of the constraints of one interval."""
        layout = self.model.layout
        stages = range(1, len(self.tableau.c) + 1)
        residuals = [f"{name} (stage {s})" for s in stages for name in layout.r.names]
        nodes = [f"continuity of {name}" for name in layout.x.names]
        return [*residuals, *nodes, *(rows.names[i] for _, rows, i in self._limits[1])]


def _require_linear_drive(model: Model) -> None:
    if not model.drive_is_linear:
        raise BuildError(
            f"this problem carries the drive {model.scene.actuation.name!r} exactly over each "
            "interval, so it needs a linear one that the arm does not act on: leave out "
            f"{', '.join(model.drive_nonlinear)} in the model of the controller; "
            "the plant may keep them"
        )
