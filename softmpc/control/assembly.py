"""From the functions of one interval to the sparse matrices of the whole horizon.

A mapped function returns its Jacobians side by side. Their nonzeros, together with constants, are
all there is in the Jacobian of the program: a permutation computed once puts each where it goes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

if TYPE_CHECKING:
    from softmpc.control.transcription import NonlinearProgram, Transcription

__all__ = ["assemble"]


class Scatter:
    """Collects nonzeros of blocks and their places in a large sparse matrix; places may repeat."""

    def __init__(self, rows: int, columns: int) -> None:
        self.shape = (rows, columns)
        self.values: list[ca.MX] = []
        self.rows: list[np.ndarray] = []
        self.columns: list[np.ndarray] = []

    def add(self, values: Any, rows: np.ndarray, columns: np.ndarray) -> None:
        """Values (a column) and where each goes; rows or columns of -1 drop the value."""
        self.values.append(ca.MX(values))
        self.rows.append(np.asarray(rows).ravel())
        self.columns.append(np.asarray(columns).ravel())

    def matrix(self) -> ca.MX:
        rows, columns = np.concatenate(self.rows), np.concatenate(self.columns)
        kept = np.flatnonzero((rows >= 0) & (columns >= 0))
        keys = columns[kept] * self.shape[0] + rows[kept]
        unique, place = np.unique(keys, return_inverse=True)
        sparsity = ca.Sparsity.triplet(
            *self.shape, (unique % self.shape[0]).tolist(), (unique // self.shape[0]).tolist()
        )
        gather = ca.Sparsity.triplet(len(unique), len(rows), place.tolist(), kept.tolist())
        nonzeros = ca.mtimes(ca.MX(ca.DM(gather, 1.0)), ca.vertcat(*self.values))
        return ca.MX(sparsity, ca.densify(nonzeros))


def assemble(t: Transcription) -> NonlinearProgram:
    """The program of a transcription, with its Gauss-Newton derivatives."""
    from softmpc.control.transcription import NonlinearProgram

    w = ca.MX.sym("w", t.N * t.nw)
    p = ca.MX.sym("p", t.nx + t.nu + t.nr * t.N)
    parts = _trajectory(t, w, p)
    f, gradient, hessian = _costs(t, parts)
    g, jacobian = _constraints(t, parts)
    lam_f, lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", g.shape[0])
    derivatives = {
        "grad_f": ca.Function("grad_f", [w, p], [f, gradient], ["x", "p"], ["f", "grad_f_x"]),
        "jac_g": ca.Function("jac_g", [w, p], [g, jacobian], ["x", "p"], ["g", "jac_g_x"]),
        "hess_lag": ca.Function(
            "hess_lag",
            [w, p, lam_f, lam_g],
            [lam_f * hessian],
            ["x", "p", "lam_f", "lam_g"],
            ["triu_hess_gamma_x_x"],
        ),
    }
    bounds = tuple(np.tile(b, t.N) for b in t.variable_bounds())
    bounds_g = tuple(np.tile(b, t.N) for b in t.row_bounds())
    names = tuple(f"{n} at interval {k + 1}" for k in range(t.N) for n in t.variable_names())
    names_g = tuple(f"{n} at interval {k + 1}" for k in range(t.N) for n in t.row_names())
    return NonlinearProgram(w, p, f, g, bounds, bounds_g, names, names_g, derivatives)  # type: ignore[arg-type]


def _trajectory(t: Transcription, w: ca.MX, p: ca.MX) -> dict[str, ca.MX]:
    """Variables side by side, one column an interval."""
    columns = ca.reshape(w, t.nw, t.N)
    u = columns[: t.nu, :]
    a = columns[t.nu : t.nu + t.na, :]
    x = columns[t.nu + t.na :, :]
    x_now, u_now = p[: t.nx], p[t.nx : t.nx + t.nu]
    return {
        "u": u,
        "a": a,
        "x": x,
        "x_before": ca.horzcat(x_now, x[:, :-1]),
        "u_before": ca.horzcat(u_now, u[:, :-1]),
        "given": ca.reshape(p[t.nx + t.nu :], t.nr, t.N),
        "ratio": ca.MX(ca.DM(t.ocp.ratios).T),
    }


_TERMS = ("u_before", "u", "x", "given", "ratio")  # arguments of costs and limits


def _stage_columns(t: Transcription) -> np.ndarray:
    """Columns of (u_before, u, x) of each interval in w (N × their number); -1: a parameter."""
    start = np.arange(t.N)[:, None] * t.nw
    u = start + np.arange(t.nu)
    x = start + t.nu + t.na + np.arange(t.nx)
    before = np.where(start > 0, u - t.nw, -1)
    return np.hstack([before, u, x])


def _costs(t: Transcription, parts: dict[str, ca.MX]) -> tuple[ca.MX, ca.MX, ca.MX]:
    columns, size = _stage_columns(t), t.N * t.nw
    f, gradient, hessian = ca.MX(0), Scatter(size, 1), Scatter(size, size)

    def add(function: ca.Function, found: Any, places: np.ndarray) -> ca.MX:
        values, gradients, hessians = found
        gradient.add(ca.vec(gradients), places, np.zeros_like(places))
        sparsity = function.sparsity_out(2)
        rows, cols = np.array(sparsity.row()), np.array(sparsity.get_col())
        # The order of the columns makes u_before < u < x, so an upper half stays an upper half.
        hessian.add(_nonzeros(hessians), places[:, rows], places[:, cols])
        return ca.sum2(values)

    every, end = t.objective.cost, t.objective.end_cost
    f += add(every, every.map(t.N)(*(parts[name] for name in _TERMS)), columns)
    if end is not None:
        f += add(end, end(*(parts[name][:, -1] for name in _TERMS)), columns[-1:])
    return f, ca.densify(gradient.matrix()), hessian.matrix()


def _intervals(t: Transcription, parts: dict[str, ca.MX]) -> tuple[ca.MX, ca.MX]:
    """Defects side by side, and the nonzeros of their Jacobians; one map a run of equal lengths."""
    defects, nonzeros, first = [], [], 0
    for k in range(1, t.N + 1):
        if k < t.N and t.intervals[k] is t.intervals[first]:
            continue
        columns = [parts[name][:, first:k] for name in ("x_before", "u", "a")]
        if t.ocp.disturbance is not None:
            columns.append(parts["given"][t.disturbance_columns, first:k])
        found, jacobians = t.intervals[first].function.map(k - first)(*columns)
        defects.append(found)
        nonzeros.append(_nonzeros(jacobians))
        first = k
    return ca.horzcat(*defects), ca.vertcat(*nonzeros)


def _constraints(t: Transcription, parts: dict[str, ca.MX]) -> tuple[ca.MX, ca.MX]:
    defects, nonzeros = _intervals(t, parts)
    g = [ca.vertcat(defects[: t.na, :], defects[t.na :, :] - parts["x"])]
    height, limit = t.na + t.nx, t.objective.limit
    total = height + len(t.objective.rows)
    jacobian = Scatter(t.N * total, t.N * t.nw)
    start = np.arange(t.N)[:, None]
    x_before = (start - 1) * t.nw + t.nu + t.na + np.arange(t.nx)
    x_before[0] = -1
    columns = np.hstack([x_before, start * t.nw + np.arange(t.nu + t.na)])
    sparsity = t.interval.sparsity_out(1)
    rows, cols = np.array(sparsity.row()), np.array(sparsity.get_col())
    jacobian.add(nonzeros, start * total + rows, columns[:, cols])
    after = start * t.nw + t.nu + t.na + np.arange(t.nx)
    jacobian.add(-np.ones(t.N * t.nx), start * total + t.na + np.arange(t.nx), after)
    if limit is not None:
        values, slopes = limit.map(t.N)(*(parts[name] for name in _TERMS))
        g.append(values)
        sparsity = limit.sparsity_out(1)
        rows, cols = np.array(sparsity.row()), np.array(sparsity.get_col())
        jacobian.add(_nonzeros(slopes), start * total + height + rows, _stage_columns(t)[:, cols])
    return ca.vec(ca.vertcat(*g)), jacobian.matrix()


def _nonzeros(matrix: ca.MX) -> ca.MX:
    """Nonzeros of mapped matrices, which stand side by side, as one column."""
    return matrix.nz[:]
