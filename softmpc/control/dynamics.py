"""The steps of all intervals around a trajectory: residuals at the stages, and their slopes.

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
from softmpc.control.grid import Grid
from softmpc.control.trajectory import Moment, Trajectory
from softmpc.control.transcription import Transcription

__all__ = ["Dynamics", "Steps"]

Array = np.ndarray


@dataclass(frozen=True)
class Steps:
    """The dynamics around a trajectory, scaled; one row an interval.

    x⁺ = A x + B u + what is missing (`gaps`), a step a = a_0 - (by_x x + by_u u) of the stage
    accelerations. `carry` is ∂x⁺/∂(stage residuals) for strains and rates.
    """

    A: Array  # N×nx×nx
    B: Array  # N×nx×nu
    gaps: Array  # N×nx
    a_0: Array  # N×s·n
    by_x: Array
    by_u: Array
    carry: Array  # N×2n×s·n
    defects: Array  # N × (s·n + nx), of the trajectory itself
    G: Array | None = None  # N×nx, ∂x⁺/∂(length), and by_h of the stages: where lengths may change
    by_h: Array | None = None

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


class Dynamics:
    """The functions of one transcription's steps, on its grid or another one."""

    def __init__(self, t: Transcription, mode: str = "auto") -> None:
        self.t, self.mode = t, mode
        self._accelerates = float(t.model.order == 2)
        self.use(t.ocp.step * t.ocp.ratios)

    def use(self, lengths: Array) -> None:
        """From now on, intervals of other lengths (N, s)."""
        self.grid = Grid.of(self.t.model, self.t.tableau, lengths)
        for name in ("_carried_drive", "_end_slopes"):
            self.__dict__.pop(name, None)

    def make(self) -> None:
        """Make all functions now, so that the first call need not."""
        _ = self._stages, self._residuals, self._first_residuals
        _ = self._end_slopes, self._carried_drive

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
        return self._mapped(one, self.t.N)

    @cached_property
    def _residuals(self) -> Buffered:
        """The same without the Jacobian and not scaled, to measure how good a step was."""
        return self._mapped(self.t.model.residual, self.t.N)

    @cached_property
    def _first_residuals(self) -> Buffered:
        """Those of the first interval."""
        return self._mapped(self.t.model.residual, 1)

    def _mapped(self, one: ca.Function, intervals: int) -> Buffered:
        """Over all stages of some intervals; what is compiled serves any number of them."""
        return Buffered(compiled(one, self.mode).map(intervals * len(self.t.tableau.c)))

    # --- numbers ---------------------------------------------------------------------------------

    def _disturbed(self, moment: Moment) -> tuple[Array | float, Array | float]:
        """Forces on the strains, scaled as residuals (N×n), and offsets of the inputs (N×k; SI)."""
        disturbance = self.t.ocp.disturbance
        if disturbance is None:
            return 0.0, 0.0
        d = moment.given[:, self.t.disturbance_columns]
        return d @ (disturbance.F.T / self.t.model.layout.r.scale), d @ disturbance.G.T

    def _at_stages(self, before: Array, at: Trajectory, offset: Array | float) -> tuple[Array, ...]:
        """q, dq, ddq (N×s×n), p (N×s×m) and z (N×s×h) at the stages, SI.

        A trajectory of fewer intervals is that of the first ones.
        """
        t, n, grid, some = self.t, self.t.n, self.grid, slice(len(before))
        X, U = before * t.x_scale, (at.u * t.u_scale)[:, : t.inputs] + offset
        a = (at.a * t.a_scale).reshape(len(X), -1, n)
        rate = X[:, None, n : 2 * n]
        q = X[:, None, :n] + grid.of_rate[some, :, None] * rate + grid.to_strain[some] @ a
        dq = grid.kept[some, None, None] * rate + grid.to_rate[some] @ a
        z = grid.phi[some] @ X[:, None, 2 * n :, None] + grid.gamma[some] @ U[:, None, :, None]
        z = z[..., 0]
        p = z @ t.model.drive.C.T + (U @ t.model.drive.D.T)[:, None]
        return q, dq, a * self._accelerates, p, z

    def _end(self, stages: tuple[Array, ...]) -> Array:
        """State at the ends of the intervals, scaled: the last stage is stiffly accurate."""
        q, dq, _, _, z = (value[:, -1] for value in stages)
        return np.concatenate([q, dq, z], axis=1) / self.t.x_scale

    def defects(self, moment: Moment, at: Trajectory) -> Array:
        """What a trajectory breaks: residuals of the stages, then gaps (N × (s·n + nx)), scaled."""
        return self._defects(self._residuals, moment, at)

    def first_defects(self, moment: Moment, at: Trajectory) -> Array:
        """Those of the first interval, the only ones that depend on the state now (s·n + nx)."""
        return self._defects(self._first_residuals, moment.first, at.first)[0]

    def _defects(self, residuals: Buffered, moment: Moment, at: Trajectory) -> Array:
        before, _ = moment.before(at)
        force, offset = self._disturbed(moment)
        stages = self._at_stages(before, at, offset)
        r = residuals(*_flat(stages))[0] / self.t.model.layout.r.scale
        return np.concatenate([self._less(r, force), self._end(stages) - at.x], axis=1)

    def _less(self, r: Array, force: Array | float) -> Array:
        """Residuals of all stages less the disturbance's force (N × s·n)."""
        by_stage = r.reshape(-1, len(self.t.tableau.c), self.t.n)
        if not isinstance(force, float):
            by_stage = by_stage - force[:, None]
        return by_stage.reshape(len(by_stage), -1)

    def __call__(self, moment: Moment, at: Trajectory, by_length: bool = False) -> Steps:
        """The steps around a trajectory. Raises `numpy.linalg.LinAlgError` where there are none.

        `by_length` also asks for the slopes in the lengths of the intervals (1/s).
        """
        t = self.t
        before, _ = moment.before(at)
        force, offset = self._disturbed(moment)
        stages = self._at_stages(before, at, offset)
        found = self._stages(*_flat(stages))
        r = self._less(found[0], force)
        shape = t.N, len(t.tableau.c), -1, t.n
        slopes = [J.reshape(shape).swapaxes(2, 3) for J in found[1:]]
        rows = self._slopes(*slopes)
        known, arm, ends = t.nx + t.nu, 2 * t.n, self._end_slopes
        inverse = np.linalg.inv(rows[:, :, known:])
        solved = inverse @ rows[:, :, :known]
        a_0 = -(inverse @ r[:, :, None])[:, :, 0]
        carry = ends[:, :arm, known:] @ inverse
        after = ends[:, :, :known].copy()
        after[:, :arm] -= ends[:, :arm, known:] @ solved
        gaps = self._end(stages) - at.x
        defects = np.concatenate([r, gaps], axis=1)
        gaps[:, :arm] -= (carry @ r[:, :, None])[:, :, 0]
        G = by_h = None
        if by_length:
            moved, G = self._by_length(before, at, offset, stages, slopes)
            by_h = (inverse @ moved[:, :, None])[:, :, 0]
            G[:, :arm] -= (carry @ moved[:, :, None])[:, :, 0]
        return Steps(
            A=after[:, :, : t.nx], B=after[:, :, t.nx :], gaps=gaps, a_0=a_0,
            by_x=solved[:, :, : t.nx], by_u=solved[:, :, t.nx :], carry=carry, defects=defects,
            G=G, by_h=by_h,
        )  # fmt: skip

    def _by_length(
        self,
        before: Array,
        at: Trajectory,
        offset: Array | float,
        stages: tuple[Array, ...],
        slopes: list[Array],
    ) -> tuple[Array, Array]:
        """∂(stage residuals)/∂(length) (N × s·n) and ∂(end)/∂(length) (N×nx), a held; scaled."""
        t, n, drive = self.t, self.t.n, self.t.model.drive
        of_rate, to_strain, to_rate = self.grid.by_length
        rate = (before * t.x_scale)[:, None, n : 2 * n]
        U = ((at.u * t.u_scale)[:, : t.inputs] + offset)[:, None]
        a = (at.a * t.a_scale).reshape(t.N, -1, n)
        q, dq = of_rate[:, :, None] * rate + to_strain @ a, to_rate @ a
        z = (stages[4] @ drive.A.T + U @ drive.B.T) * t.tableau.c[:, None]
        parts = zip(slopes, (q, dq, None, z @ drive.C.T), strict=True)
        moved = sum((J @ part[..., None])[..., 0] for J, part in parts if part is not None)
        end = np.concatenate([q[:, -1], dq[:, -1], z[:, -1]], axis=1) / t.x_scale
        return np.asarray(moved).reshape(t.N, -1), end

    @cached_property
    def _carried_drive(self) -> tuple[Array, Array]:
        """Scaled ∂p/∂z and ∂p/∂u at each stage, constant (N×s×m×…)."""
        grid, drive, n = self.grid, self.t.model.drive, self.t.n
        by_u = drive.C @ grid.gamma + drive.D
        return drive.C @ grid.phi * self.t.x_scale[2 * n :], by_u * self.t.u_scale[: self.t.inputs]

    def _slopes(self, K: Array, D: Array, M: Array, P: Array) -> Array:
        """Scaled Jacobian of the stage residuals in (x, u, a) (N × s·n × …)."""
        t, n, count, grid = self.t, self.t.n, len(self.t.tableau.c), self.grid
        by_z, by_u = self._carried_drive
        x, u, a = t.x_scale, t.nx + t.inputs, t.a_scale
        found = np.zeros((t.N, count, n, t.nx + t.nu + t.na))  # slacks move nothing
        kept = grid.kept[:, None, None, None]
        found[..., :n] = K * x[:n]
        found[..., n : 2 * n] = (_wide(grid.of_rate) * K + kept * D) * x[n : 2 * n]
        found[..., 2 * n : t.nx] = P @ by_z
        found[..., t.nx : u] = P @ by_u
        for j in range(count):
            place = t.nx + t.nu + j * n
            part = _wide(grid.to_strain[:, :, j]) * K + _wide(grid.to_rate[:, :, j]) * D
            part[:, j] += self._accelerates * M[:, j]
            found[..., place : place + n] = part * a[j * n : (j + 1) * n]
        return found.reshape(t.N, count * n, -1)

    @cached_property
    def _end_slopes(self) -> Array:
        """Scaled Jacobian of the state at the end in (x, u, a), constant (N×nx×…)."""
        t, n, grid = self.t, self.t.n, self.grid
        found = np.zeros((t.N, t.nx, t.nx + t.nu + t.na))
        strain, rate = np.arange(n), n + np.arange(n)
        found[:, strain, strain] = 1.0
        found[:, rate, rate] = grid.kept[:, None]
        found[:, strain, rate] = grid.of_rate[:, -1:]
        found[:, 2 * n :, 2 * n : t.nx] = grid.phi[:, -1]
        found[:, 2 * n :, t.nx : t.nx + t.inputs] = grid.gamma[:, -1]
        for j in range(len(t.tableau.c)):
            place = t.nx + t.nu + j * n + strain
            found[:, strain, place] = grid.to_strain[:, -1, j, None]
            found[:, rate, place] = grid.to_rate[:, -1, j, None]
        columns = np.concatenate([t.x_scale, t.u_scale, t.a_scale])
        return np.asarray(found * columns / t.x_scale[:, None])


def _flat(stages: tuple[Array, ...]) -> list[Array]:
    """q, dq, ddq and p of all stages, one row each."""
    return [value.reshape(-1, value.shape[-1]) for value in stages[:4]]


def _wide(parts: Array) -> Array:
    """Numbers of the stages (N×s) as factors of their matrices."""
    return np.asarray(parts[:, :, None, None])
