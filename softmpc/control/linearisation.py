"""A transcribed problem around a trajectory: residuals at the stages, costs, limits, and slopes.

Only the arm's residual and its Jacobian are CasADi functions, mapped over all stages of all
intervals. Tableau, drive and scales are constant matrices and stay in NumPy, so the functions do
not know the grid, and are small enough to compile.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from softmpc.compiled import compiled
from softmpc.control.buffered import Buffered
from softmpc.control.terms import Terms
from softmpc.control.trajectory import Moment, Trajectory
from softmpc.control.transcription import Transcription

__all__ = ["Linearisation", "Linearised", "Measured"]

Array = np.ndarray


@dataclass(frozen=True)
class Measured:
    """How good a trajectory is, scaled."""

    cost: float
    defects: Array  # N × (s·n + nx)
    rows: Array  # of the limits, N×rows

    @property
    def finite(self) -> bool:
        return bool(np.isfinite(self.cost + self.defects.sum() + self.rows.sum()))


@dataclass(frozen=True)
class Linearised:
    """The problem around a trajectory, scaled; one row an interval.

    x⁺ = A x + B u + what is missing (`gaps`), a step a = a_0 - (by_x x + by_u u) of the stage
    accelerations, cost ½|e + E (u_before, u, x⁺)|², limits c + L (u_before, u, x⁺); the same at the
    end of the horizon. `carry` is ∂x⁺/∂(stage residuals) for strains and rates.
    """

    A: Array  # N×nx×nx
    B: Array  # N×nx×nu
    gaps: Array  # N×nx
    a_0: Array  # N×s·n
    by_x: Array
    by_u: Array
    carry: Array  # N×2n×s·n
    e: Array  # N×residuals
    E: Array
    e_end: Array  # 1×residuals, of the last interval
    E_end: Array
    c: Array  # N×rows
    L: Array
    measured: Measured  # the trajectory itself

    def free(self, dx: Array) -> Array:
        """Change of the states without any move, for a first state that differs by dx (N×nx)."""
        found, at = np.empty_like(self.gaps), dx
        for k, (A, gap) in enumerate(zip(self.A, self.gaps, strict=True)):
            found[k] = at = A @ at + gap
        return found

    def stages(self, dx: Array, x: Array, u: Array) -> Array:
        """Step of the stage accelerations that goes with those of states and decisions (N×s·n)."""
        before = np.concatenate([dx[None], x[:-1]])
        return np.asarray(
            self.a_0 - (self.by_x @ before[:, :, None] + self.by_u @ u[:, :, None])[..., 0]
        )


class Linearisation:
    """The functions of one transcription that a solver by linearisation calls."""

    def __init__(self, t: Transcription, mode: str = "auto") -> None:
        self.t, self.mode = t, mode
        objective, ratios = t.objective, t.ocp.ratios
        rows = ca.vertcat(*(row.value for row in objective.rows))
        self.residuals = objective.residuals.numel()  # the rows of limits follow
        every = ca.vertcat(objective.residuals, rows)
        given = objective.symbols
        self.terms = Terms("terms", every, given, ratios, 2 * t.n, mode)
        end = objective.end_residuals
        self.end_terms = Terms("end_terms", end, given, ratios[-1:], 2 * t.n, mode)

    def make(self) -> None:
        """Make all functions now, so that the first solve need not."""
        _ = self._stages, self._residuals, self.drive, self._end_slopes, self._carried_drive
        self.terms.make()
        self.end_terms.make()

    # --- functions -------------------------------------------------------------------------------

    @cached_property
    def _stages(self) -> Buffered:
        """(q, dq, ddq, p) of all stages -> scaled residual, and its Jacobian (transposed)."""
        model = self.t.model
        kind: Any = ca.MX if model.residual_jacobian.is_a("MXFunction") else ca.SX
        given = [kind.sym(name, model.residual.size1_in(i)) for i, name in enumerate("qvap")]
        scaled = ca.diag(ca.DM(1 / model.layout.r.scale))
        outputs = [model.residual(*given), *model.residual_jacobian(*given)]
        outputs = [ca.densify(ca.mtimes(scaled, value)) for value in outputs]
        one = ca.Function("stage", given, outputs, {"cse": True} if kind is ca.SX else {})
        return Buffered(compiled(one.map(self.t.N * len(self.t.tableau.c)), self.mode))

    @cached_property
    def _residuals(self) -> Buffered:
        """The same without the Jacobian and not scaled, to measure how good a step was."""
        residual = self.t.model.residual
        return Buffered(compiled(residual.map(self.t.N * len(self.t.tableau.c)), self.mode))

    # --- numbers ---------------------------------------------------------------------------------

    @cached_property
    def drive(self) -> tuple[Array, Array]:
        """Hydraulics exactly over each interval up to each stage: z_s = Φ z + Γ u (N×s×…)."""
        pairs = [interval.drive for interval in self.t.intervals]
        phi, gamma = ([[pair[i] for pair in drive] for drive in pairs] for i in (0, 1))
        return np.array(phi), np.array(gamma)

    @cached_property
    def _forms(self) -> dict[str, Array]:
        """The forms of the steps of all intervals, by the names of their parts (N×…)."""
        forms = [interval.form for interval in self.t.intervals]
        names = ("of_rate", "to_strain", "kept", "to_rate", "accelerates")
        return {name: np.array([getattr(form, name) for form in forms], float) for name in names}

    def _disturbed(self, moment: Moment) -> tuple[Array | float, Array | float]:
        """Forces on the strains, scaled as residuals (N×n), and offsets of the inputs (N×k; SI)."""
        disturbance = self.t.ocp.disturbance
        if disturbance is None:
            return 0.0, 0.0
        d = moment.given[:, self.t.disturbance_columns]
        return d @ (disturbance.F.T / self.t.model.layout.r.scale), d @ disturbance.G.T

    def _at_stages(self, before: Array, at: Trajectory, offset: Array | float) -> tuple[Array, ...]:
        """q, dq, ddq (N×s×n), p (N×s×m) and z (N×s×h) at the stages, SI."""
        t, n, forms = self.t, self.t.n, self._forms
        X, U = before * t.x_scale, (at.u * t.u_scale)[:, : t.inputs] + offset
        a = (at.a * t.a_scale).reshape(t.N, -1, n)
        rate = X[:, None, n : 2 * n]
        q = X[:, None, :n] + forms["of_rate"][:, :, None] * rate + forms["to_strain"] @ a
        dq = forms["kept"][:, None, None] * rate + forms["to_rate"] @ a
        phi, gamma = self.drive
        z = (phi @ X[:, None, 2 * n :, None] + gamma @ U[:, None, :, None])[..., 0]
        p = z @ t.model.drive.C.T + (U @ t.model.drive.D.T)[:, None]
        return q, dq, a * forms["accelerates"][:, None, None], p, z

    def _end(self, stages: tuple[Array, ...]) -> Array:
        """State at the ends of the intervals, scaled: the last stage is stiffly accurate."""
        q, dq, _, _, z = (value[:, -1] for value in stages)
        return np.concatenate([q, dq, z], axis=1) / self.t.x_scale

    def measure(self, moment: Moment, at: Trajectory) -> Measured:
        """Cost, defects and limit rows of a trajectory."""
        before, u_before = moment.before(at)
        force, offset = self._disturbed(moment)
        stages = self._at_stages(before, at, offset)
        r = self._residuals(*_flat(stages))[0] / self.t.model.layout.r.scale
        r = self._less(r, force)
        given = u_before, at.u, at.x, moment.given
        every = self.terms.values(*given)
        end = self.end_terms.values(*(value[-1:] for value in given))
        return self._measured(at, r, self._end(stages) - at.x, every, end)

    def _less(self, r: Array, force: Array | float) -> Array:
        """Residuals of all stages less the disturbance's force (N × s·n)."""
        t = self.t
        if isinstance(force, float):
            return r.reshape(t.N, -1)
        return (r.reshape(t.N, -1, t.n) - force[:, None]).reshape(t.N, -1)

    def _measured(
        self, at: Trajectory, r: Array, gaps: Array, every: Array, end: Array
    ) -> Measured:
        e = every[:, : self.residuals]
        price = float(np.sum(at.u @ self.t.objective.price))
        cost = 0.5 * (float(np.vdot(e, e)) + float(np.vdot(end, end))) + price
        defects = np.concatenate([r, gaps], axis=1)
        return Measured(cost, defects, every[:, self.residuals :])

    def __call__(self, moment: Moment, at: Trajectory) -> Linearised:
        """The problem around a trajectory. Raises `numpy.linalg.LinAlgError` where it has none."""
        t, split = self.t, self.residuals
        before, u_before = moment.before(at)
        force, offset = self._disturbed(moment)
        stages = self._at_stages(before, at, offset)
        found = self._stages(*_flat(stages))
        r = self._less(found[0], force)
        shape = t.N, len(t.tableau.c), -1, t.n
        rows = self._slopes(*(J.reshape(shape).swapaxes(2, 3) for J in found[1:]))
        known, arm, ends = t.nx + t.nu, 2 * t.n, self._end_slopes
        inverse = np.linalg.inv(rows[:, :, known:])
        solved = inverse @ rows[:, :, :known]
        a_0 = -(inverse @ r[:, :, None])[:, :, 0]
        carry = ends[:, :arm, known:] @ inverse
        after = ends[:, :, :known].copy()
        after[:, :arm] -= ends[:, :arm, known:] @ solved
        gaps = self._end(stages) - at.x
        given = u_before, at.u, at.x, moment.given
        every, slopes = self.terms(*given)
        e_end, E_end = self.end_terms(*(value[-1:] for value in given))
        measured = self._measured(at, r, gaps, every, e_end)
        gaps[:, :arm] -= (carry @ r[:, :, None])[:, :, 0]
        return Linearised(
            A=after[:, :, : t.nx], B=after[:, :, t.nx :], gaps=gaps,
            a_0=a_0, by_x=solved[:, :, : t.nx], by_u=solved[:, :, t.nx :], carry=carry,
            e=every[:, :split], E=slopes[:, :split], e_end=e_end, E_end=E_end,
            c=every[:, split:], L=slopes[:, split:], measured=measured,
        )  # fmt: skip

    @cached_property
    def _carried_drive(self) -> tuple[Array, Array]:
        """Scaled ∂p/∂z and ∂p/∂u at each stage, constant (N×s×m×…)."""
        (phi, gamma), drive, n = self.drive, self.t.model.drive, self.t.n
        by_u = drive.C @ gamma + drive.D
        return drive.C @ phi * self.t.x_scale[2 * n :], by_u * self.t.u_scale[: self.t.inputs]

    def _slopes(self, K: Array, D: Array, M: Array, P: Array) -> Array:
        """Scaled Jacobian of the stage residuals in (x, u, a) (N × s·n × …)."""
        t, n, count, forms = self.t, self.t.n, len(self.t.tableau.c), self._forms
        by_z, by_u = self._carried_drive
        x, u, a = t.x_scale, t.nx + t.inputs, t.a_scale
        found = np.zeros((t.N, count, n, t.nx + t.nu + t.na))  # slacks move nothing
        kept = forms["kept"][:, None, None, None]
        found[..., :n] = K * x[:n]
        found[..., n : 2 * n] = (_wide(forms["of_rate"]) * K + kept * D) * x[n : 2 * n]
        found[..., 2 * n : t.nx] = P @ by_z
        found[..., t.nx : u] = P @ by_u
        for j in range(count):
            place = t.nx + t.nu + j * n
            part = _wide(forms["to_strain"][:, :, j]) * K + _wide(forms["to_rate"][:, :, j]) * D
            part[:, j] += forms["accelerates"][:, None, None] * M[:, j]
            found[..., place : place + n] = part * a[j * n : (j + 1) * n]
        return found.reshape(t.N, count * n, -1)

    @cached_property
    def _end_slopes(self) -> Array:
        """Scaled Jacobian of the state at the end in (x, u, a), constant (N×nx×…)."""
        t, n, eye = self.t, self.t.n, np.eye(self.t.n)
        phi, gamma = self.drive
        found = np.zeros((t.N, t.nx, t.nx + t.nu + t.na))
        for k, form in enumerate(interval.form for interval in t.intervals):
            found[k, :n, :n] = eye
            found[k, n : 2 * n, n : 2 * n] = form.kept * eye
            found[k, :n, n : 2 * n] = form.of_rate[-1] * eye
            found[k, 2 * n :, 2 * n : t.nx] = phi[k, -1]
            found[k, 2 * n :, t.nx : t.nx + t.inputs] = gamma[k, -1]
            for j in range(len(t.tableau.c)):
                place = t.nx + t.nu + j * n
                found[k, :n, place : place + n] = form.to_strain[-1, j] * eye
                found[k, n : 2 * n, place : place + n] = form.to_rate[-1, j] * eye
        columns = np.concatenate([t.x_scale, t.u_scale, t.a_scale])
        return np.asarray(found * columns / t.x_scale[:, None])


def _flat(stages: tuple[Array, ...]) -> list[Array]:
    """q, dq, ddq and p of all stages, one row each."""
    return [value.reshape(-1, value.shape[-1]) for value in stages[:4]]


def _wide(parts: Array) -> Array:
    """Numbers of the stages (N×s) as factors of their matrices."""
    return np.asarray(parts[:, :, None, None])
