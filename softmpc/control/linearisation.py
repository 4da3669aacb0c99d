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
from softmpc.control.trajectory import Moment, Trajectory
from softmpc.control.transcription import Transcription

__all__ = ["Linearisation", "Linearised", "Measured"]

Array = np.ndarray


@dataclass(frozen=True)
class Linearised:
    """The problem around a trajectory, scaled; one row an interval.

    x⁺ = A x + B u + what is missing (`gaps`), a step a = a_0 - (by_x x + by_u u) of the stage
    accelerations, cost ½|e + E (u_before, u, x⁺)|², limits c + L (u_before, u, x⁺); the same at the
    end of the horizon.
    """

    A: Array  # N×nx×nx
    B: Array  # N×nx×k
    gaps: Array  # N×nx
    a_0: Array  # N×s·n
    by_x: Array
    by_u: Array
    e: Array  # N×residuals
    E: Array
    e_end: Array  # 1×residuals, of the last interval
    E_end: Array
    c: Array  # N×rows
    L: Array


@dataclass(frozen=True)
class Measured:
    """How good a trajectory is, scaled."""

    cost: float
    defects: Array  # N × (s·n + nx)
    rows: Array  # of the limits, N×rows


class Linearisation:
    """The functions of one transcription that a solver by linearisation calls."""

    def __init__(self, t: Transcription, mode: str = "auto") -> None:
        self.t, self.mode = t, mode

    def make(self) -> None:
        """Make all functions now, so that the first solve need not."""
        _ = self._stages, self._residuals, self._cost, self._end_cost, self._limit
        _ = self._drive, self._end_slopes

    # --- functions -------------------------------------------------------------------------------

    @cached_property
    def _stages(self) -> ca.Function:
        """(q, dq, ddq, p) side by side -> r and its Jacobian, at all stages of all intervals."""
        model = self.t.model
        kind: Any = ca.MX if model.residual_jacobian.is_a("MXFunction") else ca.SX
        given = [kind.sym(name, model.residual.size1_in(i)) for i, name in enumerate("qvap")]
        outputs = [
            model.residual(*given),
            *(ca.densify(J) for J in model.residual_jacobian(*given)),
        ]
        one = ca.Function("stage", given, outputs, {"cse": True} if kind is ca.SX else {})
        return compiled(one.map(self.t.N * len(self.t.tableau.c)), self.mode)

    @cached_property
    def _residuals(self) -> ca.Function:
        """The same without the Jacobian, to measure how good a step was."""
        return compiled(self.t.model.residual.map(self.t.N * len(self.t.tableau.c)), self.mode)

    def _term(self, name: str, value: ca.SX, times: int) -> ca.Function:
        """A value of the intervals and its Jacobian in (u_before, u, x), dense."""
        symbols = self.t.objective.symbols
        J = ca.densify(ca.jacobian(value, ca.vertcat(*symbols[:3])))
        one = ca.Function(name, symbols, [ca.densify(value), J], {"cse": True})
        return compiled(one.map(times), self.mode)

    @cached_property
    def _cost(self) -> ca.Function:
        return self._term("costs", self.t.objective.residuals, self.t.N)

    @cached_property
    def _end_cost(self) -> ca.Function:
        return self._term("end_costs", self.t.objective.end_residuals, 1)

    @cached_property
    def _limit(self) -> ca.Function:
        values = [row.value for row in self.t.objective.rows]
        return self._term("limits", ca.vertcat(*values), self.t.N)

    # --- numbers ---------------------------------------------------------------------------------

    @cached_property
    def _drive(self) -> tuple[Array, Array]:
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

    def _at_stages(self, before: Array, at: Trajectory) -> tuple[Array, ...]:
        """q, dq, ddq (N×s×n), p (N×s×m) and z (N×s×h) at the stages, SI."""
        t, n, forms = self.t, self.t.n, self._forms
        X, U = before * t.x_scale, (at.u * t.u_scale)[:, : t.inputs]
        a = (at.a * t.a_scale).reshape(t.N, -1, n)
        rate = X[:, None, n : 2 * n]
        q = X[:, None, :n] + forms["of_rate"][:, :, None] * rate + forms["to_strain"] @ a
        dq = forms["kept"][:, None, None] * rate + forms["to_rate"] @ a
        phi, gamma = self._drive
        z = (phi @ X[:, None, 2 * n :, None] + gamma @ U[:, None, :, None])[..., 0]
        p = z @ t.model.drive.C.T + (U @ t.model.drive.D.T)[:, None]
        return q, dq, a * forms["accelerates"][:, None, None], p, z

    def _end(self, stages: tuple[Array, ...]) -> Array:
        """State at the ends of the intervals, scaled: the last stage is stiffly accurate."""
        q, dq, _, _, z = (value[:, -1] for value in stages)
        return np.hstack([q, dq, z]) / self.t.x_scale

    def measure(self, moment: Moment, at: Trajectory) -> Measured:
        """Cost, defects and limit rows of a trajectory."""
        t = self.t
        before, u_before = moment.before(at)
        stages = self._at_stages(before, at)
        r = np.asarray(self._residuals(*_flat(stages))).T / t.model.layout.r.scale
        defects = np.hstack([r.reshape(t.N, -1), self._end(stages) - at.x])
        given = self._given(moment, at, u_before)
        e, e_end = self._values(self._cost, given), self._values(self._end_cost, _last(given))
        cost = 0.5 * float(np.sum(e**2) + np.sum(e_end**2)) + float(
            np.sum(at.u @ t.objective.price)
        )
        return Measured(cost, defects, self._values(self._limit, given).T)

    def __call__(self, moment: Moment, at: Trajectory) -> Linearised:
        """The problem around a trajectory."""
        t = self.t
        before, u_before = moment.before(at)
        stages = self._at_stages(before, at)
        found = [np.asarray(value) for value in self._stages(*_flat(stages))]
        scale = t.model.layout.r.scale
        r = (found[0].T / scale).reshape(t.N, -1)
        blocks = [_apart(J, t.N, len(t.tableau.c)) / scale[:, None] for J in found[1:]]
        rows, ends = self._slopes(*blocks), self._end_slopes
        x, u = slice(0, t.nx), slice(t.nx, t.nx + t.nu)
        known = np.concatenate([rows[:, :, : u.stop], r[:, :, None]], axis=2)
        solved = np.linalg.solve(rows[:, :, u.stop :], known)
        carried = ends[:, :, u.stop :] @ solved
        given = self._given(moment, at, u_before)
        e, E = self._matrices(self._cost, given)
        e_end, E_end = self._matrices(self._end_cost, _last(given))
        c, L = self._matrices(self._limit, given)
        return Linearised(
            A=ends[:, :, x] - carried[:, :, x],
            B=ends[:, :, u] - carried[:, :, u],
            gaps=self._end(stages) - at.x - carried[:, :, -1],
            a_0=-solved[:, :, -1],
            by_x=solved[:, :, x],
            by_u=solved[:, :, u],
            e=e, E=E, e_end=e_end, E_end=E_end, c=c, L=L,
        )  # fmt: skip

    def _given(self, moment: Moment, at: Trajectory, u_before: Array) -> list[Array]:
        """Arguments of costs and limits, one column an interval."""
        ratios = self.t.ocp.ratios[:, None]
        return [value.T for value in (u_before, at.u, at.x, moment.given, ratios)]

    def _values(self, function: ca.Function, given: list[Array]) -> Array:
        return np.asarray(function(*given)[0])

    def _matrices(self, function: ca.Function, given: list[Array]) -> tuple[Array, Array]:
        value, J = (np.asarray(part) for part in function(*given))
        return value.T, _apart(J, value.shape[1], 1)[:, 0]

    def _slopes(self, K: Array, D: Array, M: Array, P: Array) -> Array:
        """Scaled Jacobian of the stage residuals in (x, u, a) (N × s·n × …)."""
        t, n, count, forms = self.t, self.t.n, len(self.t.tableau.c), self._forms
        phi, gamma = self._drive
        C, wide = t.model.drive.C, (slice(None), slice(None), None, None)
        by_dq = forms["of_rate"][wide] * K + forms["kept"][:, None, None, None] * D
        parts = [K, by_dq, P @ (C @ phi), P @ (C @ gamma + t.model.drive.D)]
        for j in range(count):
            part = forms["to_strain"][:, :, j][wide] * K + forms["to_rate"][:, :, j][wide] * D
            part[:, j] += forms["accelerates"][:, None, None] * M[:, j]
            parts.append(part)
        parts.insert(4, np.zeros((t.N, count, n, t.nu - t.inputs)))  # slacks move nothing
        rows = np.concatenate(parts, axis=3).reshape(t.N, count * n, -1)
        return np.asarray(rows * self._columns)

    @cached_property
    def _columns(self) -> Array:
        return np.concatenate([self.t.x_scale, self.t.u_scale, self.t.a_scale])

    @cached_property
    def _end_slopes(self) -> Array:
        """Scaled Jacobian of the state at the end in (x, u, a), constant (N×nx×…)."""
        t, n, eye = self.t, self.t.n, np.eye(self.t.n)
        phi, gamma = self._drive
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
        return np.asarray(found * self._columns / t.x_scale[:, None])


def _flat(stages: tuple[Array, ...]) -> list[Array]:
    """q, dq, ddq and p of all stages side by side."""
    return [value.reshape(-1, value.shape[-1]).T for value in stages[:4]]


def _last(given: list[Array]) -> list[Array]:
    return [value[:, -1:] for value in given]


def _apart(side_by_side: Array, intervals: int, stages: int) -> Array:
    """Matrices that a mapped function returns side by side (N×s×rows×columns)."""
    rows, columns = side_by_side.shape
    shape = rows, intervals, stages, columns // (intervals * stages)
    return side_by_side.reshape(shape).transpose(1, 2, 0, 3)
