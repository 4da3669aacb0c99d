"""The constants of a controller in C: sizes, scales, forms of steps, and what never changes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from softmpc.codegen import c_text
from softmpc.control.costs import PLANNED_INPUT
from softmpc.control.input_guard import InputGuard
from softmpc.control.real_time import RealTime
from softmpc.control.terms import Terms
from softmpc.control.transcription import Transcription
from softmpc.errors import BuildError

__all__ = ["ControllerData"]

Array = np.ndarray
LARGEST_COLUMN = 65_535  # of a sparse matrix in C


@dataclass(frozen=True, eq=False)
class ControllerData:
    """All constants of one real-time iteration, as C text.

    `rows` is how many rows of limits the quadratic program has room for at once.
    """

    solver: RealTime
    rows: int

    @property
    def t(self) -> Transcription:
        return self.solver.transcription

    # --- sizes -----------------------------------------------------------------------------------

    @cached_property
    def sizes(self) -> dict[str, int]:
        """Macros of sizes by name, without the prefix."""
        t, solver = self.t, self.solver
        terms, end = solver.linearisation.terms, solver.linearisation.end_terms
        blocks, slacks = int(solver.blocks[-1]) + 1, t.nu - t.inputs
        bounded = solver.bounded
        rows = len(t.objective.rows)
        most_seen = max(len(self.moving_terms), end.rows, 1)
        return {
            "N": t.N, "STRAINS": t.n, "ARM": 2 * t.n, "DRIVE": t.nx - 2 * t.n, "NX": t.nx,
            "INPUTS": t.inputs, "SLACKS": slacks, "NU": t.nu, "STAGES": len(t.tableau.c),
            "NA": t.na, "PRESSURES": len(t.model.layout.p),
            "STAGED": len(t.tableau.c) * len(t.model.layout.p), "NR": t.nr,
            "PATH_SIZE": t.N * t.nw, "ACCELERATES": int(t.model.order == 2),
            "KINDS": len(self.kinds), "BLOCKS": blocks, "MOVED": t.inputs * blocks,
            "SLACKED": slacks * blocks, "MOVES": t.nu * blocks,
            "RESIDUALS": solver.linearisation.residuals, "ROWS": rows, "TERMS": terms.rows,
            "BENT": len(terms.bent_rows), "BENT_COLUMNS": len(terms.bent_columns),
            "END": end.rows, "END_BENT": len(end.bent_rows),
            "END_COLUMNS": len(end.bent_columns), "BOUNDED": len(bounded),
            "PROGRAM_ROWS": t.N * (len(bounded) + rows), "MOVING_TERMS": len(self.moving_terms),
            "MOVING_ROWS": len(self.moving_rows), "MOST_SEEN": most_seen,
            "MAX_ROWS": min(self.rows, t.N * (len(bounded) + rows)),
            "DISTURBANCES": 0 if t.ocp.disturbance is None else len(t.ocp.disturbance),
            "DISTURBANCE_AT": t.disturbance_columns.start or 0,
            "PLANNED": int(t.columns_of(PLANNED_INPUT).stop > 0),
            "PLANNED_AT": t.columns_of(PLANNED_INPUT).start,
            "PLAN_STEPS": self._plan_steps,
        }  # fmt: skip

    @property
    def _plan_steps(self) -> int:
        """Steps after which the last interval of a plan has passed."""
        ocp = self.t.ocp
        return int(np.ceil(ocp.nodes[-1] * (1 - 1e-9) / ocp.step - 1e-12))

    @property
    def moving_terms(self) -> Array:
        """Residuals whose slopes in the moves change from solve to solve."""
        split = self.solver.linearisation.residuals
        return np.flatnonzero(self.solver.linearisation.terms.moving[:split])

    @property
    def moving_rows(self) -> list[int]:
        """The same of the program's rows of an interval: terms, and states of the arm as -1 - i."""
        split, terms = self.solver.linearisation.residuals, self.solver.linearisation.terms
        states = [-1 - int(i) for i in self.solver.bounded if i < 2 * self.t.n]
        return states + [int(i) + split for i in np.flatnonzero(terms.moving[split:])]

    # --- grids -----------------------------------------------------------------------------------

    @cached_property
    def kinds(self) -> list[int]:
        """The first interval of each length."""
        return [int(k) for k in np.unique(self.t.ocp.ratios, return_index=True)[1]]

    @property
    def _kind_of(self) -> Array:
        return np.unique(self.t.ocp.ratios, return_inverse=True)[1]

    def _shifts(self) -> tuple[Array, Array, Array]:
        """Where a plan's decisions of an interval are a step later; the same of states, between
        two nodes."""
        t, N = self.t, self.t.N
        if not t.ocp.grid:
            later = np.minimum(np.arange(N) + 1, N - 1)
            return later, later, np.zeros(N)
        nodes, step = t.ocp.nodes, t.ocp.step
        starts = np.concatenate([[0.0], nodes[:-1]])
        later = np.minimum(np.searchsorted(nodes, starts + step, side="right"), N - 1)
        at = np.minimum(nodes + step, nodes[-1])
        low = np.clip(np.searchsorted(nodes, at, side="right") - 1, 0, max(N - 2, 0))
        length = nodes[np.minimum(low + 1, N - 1)] - nodes[low]
        return later, low, np.where(length > 0, (at - nodes[low]) / np.where(length, length, 1), 0)

    def _block_later(self) -> Array:
        """The block that begins an interval after the beginning of each; -1: none does."""
        starts = np.flatnonzero(np.diff(self.solver.blocks, prepend=-1))
        found = np.full(len(starts), -1)
        for b, start in enumerate(starts):
            if start == self.t.N - 1:
                found[b] = b
            elif b + 1 < len(starts) and starts[b + 1] == start + 1:
                found[b] = b + 1
        return found

    def _rate_rows(self) -> list[int]:
        """The row of the hard limit of each input's change, -1 where there is none."""
        t = self.t
        names = t.row_names()[t.na + t.nx :]
        wanted = [f"d{name}" for name in t.model.layout.u.names]
        return [names.index(name) if name in names else -1 for name in wanted]

    # --- matrices in the moves, inputs first ------------------------------------------------------

    @cached_property
    def _order(self) -> Array:
        """Python's moves in the order of C: inputs of all blocks, then slacks of all blocks."""
        blocks, t = int(self.solver.blocks[-1]) + 1, self.t
        place = np.arange(blocks * t.nu).reshape(blocks, t.nu)
        return np.concatenate([place[:, : t.inputs].ravel(), place[:, t.inputs :].ravel()])

    def _squares(self) -> tuple[Array, Array]:
        """The constant part of H: the lower half of the inputs', the diagonal of the slacks'."""
        moved = self.sizes["MOVED"]
        H = self.solver.condensing.still_H[np.ix_(self._order, self._order)]
        slacks = H[moved:, moved:]
        terms, t = self.solver.linearisation.terms, self.t
        pattern = terms.constant[:, self.moving_terms][:, :, : 2 * t.nu]
        touched = pattern.reshape(-1, 2, t.nu)[:, :, t.inputs :]
        if H[moved:, :moved].any() or (slacks - np.diag(np.diag(slacks))).any() or touched.any():
            raise BuildError("codegen: a cost couples a slack with other decisions; make it hard")
        return np.tril(H[:moved, :moved]), np.diag(slacks)

    def _pressures(self) -> Array:
        """∂(scaled pressures at the stages)/∂(moves of the inputs), constant (N·s·m × …)."""
        t, grid = self.t, self.solver.linearisation.dynamics.grid
        drive, arm, k = t.model.drive, 2 * t.n, t.inputs
        scale = t.model.layout.p.scale[:, None]
        by_z = drive.C @ grid.phi * t.x_scale[arm:] / scale
        by_u = (drive.C @ grid.gamma + drive.D) * t.u_scale[:k] / scale
        z = self._drive()
        found = np.zeros((t.N, *by_z.shape[1:3], self.sizes["MOVED"]))
        for i, block in enumerate(self.solver.blocks):
            if i:
                found[i] = by_z[i] @ z[i - 1]
            found[i][:, :, block * k : (block + 1) * k] += by_u[i]
        return found.reshape(-1, self.sizes["MOVED"])

    def _drive(self) -> Array:
        """∂z⁺/∂(moves of the inputs), constant (N × states of the drive × …)."""
        return self.solver.condensing.drive[:, :, self._order[: self.sizes["MOVED"]]]

    def _rows(self) -> tuple[Array, Array]:
        """The program's rows that are constant (zero where they move), and the place of the others
        among those that move, -1 where they do not."""
        t, solver, size = self.t, self.solver, self.sizes
        states = np.zeros((t.N, len(solver.bounded), size["MOVES"]))
        limits = solver.condensing.still_rows.copy()
        moving = self.moving_rows
        place = [np.full((t.N, len(solver.bounded)), -1), np.full((t.N, size["ROWS"]), -1)]
        step = np.arange(t.N) * len(moving)
        for b, i in enumerate(solver.bounded):
            if i < 2 * t.n:
                place[0][:, b] = step + moving.index(-1 - int(i))
            else:
                states[:, b] = solver.condensing.drive[:, i - 2 * t.n]
        for j, term in enumerate(moving):
            if term >= 0:
                limits[:, term - size["RESIDUALS"]] = 0.0
                place[1][:, term - size["RESIDUALS"]] = step + j
        rows = np.concatenate([part.reshape(-1, size["MOVES"]) for part in (states, limits)])
        return rows[:, self._order], np.concatenate([part.ravel() for part in place])

    def _drive_seen(self) -> Array:
        """∂z⁺/∂moves where a term that moves sees the drive; nothing elsewhere."""
        t, lin = self.t, self.solver.linearisation
        split, first = lin.residuals, 2 * t.nu + 2 * t.n
        every = [*self.moving_terms, *(i for i in self.moving_rows if i >= split)]
        seen = lin.terms.pattern[every][:, first:].any(axis=0)
        at_end = lin.end_terms.pattern[:, first:].any(axis=0)
        found = self._drive()
        found[:-1, ~seen] = 0.0
        found[-1, ~(seen | at_end)] = 0.0
        return found.reshape(-1, self.sizes["MOVED"])

    # --- text ------------------------------------------------------------------------------------

    def text(self) -> tuple[str, str]:
        """data.h and data.c."""
        header, source = ['#include "sizes.h"', '#include "sparse.h"', ""], []
        for name, values, kind in self._arrays():
            header.append(c_text.declaration(f"smpc_{name}", np.size(values), kind))
            source.append(c_text.array(f"smpc_{name}", values, kind))
        for name, values in self._tables():
            header.append(_declared(f"smpc_{name}", values.shape[1:]))
            source.append(_table(f"smpc_{name}", values))
        for name, matrices in self._sparse().items():
            header.append(f"extern const smpc_sparse smpc_{name}{_many(matrices)};\n")
            source.append(_sparse(f"smpc_{name}", matrices))
        return (
            c_text.guard("data.h", "\n".join(header)),
            '/* Constants of one scene. */\n#include "data.h"\n\n' + "\n".join(source),
        )

    def _arrays(self) -> list[tuple[str, Array, str]]:
        t, solver = self.t, self.solver
        guard, layout, n = InputGuard(t.ocp), t.model.layout, t.n
        low, high = t.variable_bounds()
        row_low, row_high = (bound[t.na + t.nx :] for bound in t.row_bounds())
        terms, end = solver.linearisation.terms, solver.linearisation.end_terms
        later, low_node, share = self._shifts()
        q, dq, a = t.x_scale[:n], t.x_scale[n : 2 * n], t.a_scale[:n]
        real, short = "smpc_real", "short"
        assert len(layout.q) == n
        return [
            ("x_scale", t.x_scale, real), ("u_scale", t.u_scale[: t.inputs], real),
            ("rate_to_strain", dq / q, real), ("unknown_to_strain", a / q, real),
            ("unknown_to_rate", a / dq, real), ("price", t.objective.price, real),
            ("ratio", t.ocp.ratios, real), ("nodes", t.ocp.nodes, real),
            ("u_low", low[: t.nu], real), ("u_high", high[: t.nu], real),
            ("x_low", low[t.nu + t.na :], real), ("x_high", high[t.nu + t.na :], real),
            ("row_low", row_low, real), ("row_high", row_high, real),
            ("slack_squares", self._squares()[1], real),
            ("rate_row", self._rate_rows(), short), ("least_input", guard.low, real),
            ("most_input", guard.high, real),
            ("most_fall", guard.fall, real), ("most_rise", guard.rise, real),
            ("share", share, real), ("kind_of", self._kind_of, short),
            ("block_of", solver.blocks, short), ("block_later", self._block_later(), short),
            ("later", later, short), ("between", low_node, short),
            ("bent", terms.bent_rows, short), ("bent_columns", terms.bent_columns, short),
            ("end_bent", end.bent_rows, short), ("end_columns", end.bent_columns, short),
            ("moving_terms", self.moving_terms, short),
            ("moving_rows", np.array(self.moving_rows, int), short),
            ("row_place", self._rows()[1], short), ("bounded", solver.bounded, short),
            ("kept", solver.linearisation.dynamics.grid.kept[self.kinds], real),
        ]  # fmt: skip

    def _tables(self) -> list[tuple[str, Array]]:
        """Numbers of the forms of steps, one row for each length."""
        grid, stages = self.solver.linearisation.dynamics.grid, len(self.t.tableau.c)
        return [
            ("of_rate", grid.of_rate[self.kinds]),
            ("to_strain", grid.to_strain[self.kinds].reshape(-1, stages**2)),
            ("to_rate", grid.to_rate[self.kinds].reshape(-1, stages**2)),
        ]

    def _sparse(self) -> dict[str, list[Array]]:
        """Constant matrices; those in a list of several have one for each length of interval."""
        t, lin, kinds = self.t, self.solver.linearisation, self.kinds
        grid, drive, arm, k = lin.dynamics.grid, t.model.drive, 2 * t.n, t.inputs
        x, u, p = t.x_scale[arm:], t.u_scale[:k], t.model.layout.p.scale[:, None]
        staged = self.sizes["STAGED"]
        by_z = (drive.C @ grid.phi * x / p).reshape(t.N, staged, -1)
        by_u = ((drive.C @ grid.gamma + drive.D) * u / p).reshape(t.N, staged, k)
        z_by_z, z_by_u = grid.phi[:, -1] * x / x[:, None], grid.gamma[:, -1] * u / x[:, None]
        found = {
            "p_by_z": _PerKind(by_z[kinds]), "p_by_u": _PerKind(by_u[kinds]),
            "z_by_z": _PerKind(z_by_z[kinds]), "z_by_u": _PerKind(z_by_u[kinds]),
            "terms_by": _PerKind(_slopes(lin.terms, i) for i in kinds),
            "end_by": [_slopes(lin.end_terms, 0)],
            "pressures_by": [self._pressures()], "drive_by": [self._drive_seen()],
            "still_squares": [self._squares()[0]], "rows_by": [self._rows()[0]],
        }  # fmt: skip
        if t.ocp.disturbance is not None:
            d = t.ocp.disturbance
            found["force_by_d"] = [d.F / t.model.layout.r.scale[:, None]]
            found["offset_by_d"] = [d.G / t.u_scale[:k, None]]
        return found


def _slopes(terms: Terms, k: int) -> Array:
    return terms.constant[k] if terms.rows else np.zeros((0, 1))


def _declared(name: str, shape: tuple[int, ...]) -> str:
    return f"extern const smpc_real {name}[SMPC_KINDS][{shape[0]}];\n"


def _table(name: str, values: Array) -> str:
    rows = ",\n    ".join("{" + ", ".join(map(c_text.number, row)) + "}" for row in values)
    return f"const smpc_real {name}[SMPC_KINDS][{values.shape[1]}] = {{\n    {rows}}};\n"


def _many(matrices: list[Array]) -> str:
    return "[SMPC_KINDS]" if isinstance(matrices, _PerKind) else ""


class _PerKind(list):
    """Matrices of which there is one for each length of interval."""


def _sparse(name: str, matrices: list[Array]) -> str:
    """A sparse matrix, or one for each length."""
    text, instances = "", []
    for i, matrix in enumerate(matrices):
        rows, columns = np.nonzero(matrix)
        if matrix.shape[1] > LARGEST_COLUMN:
            raise BuildError(f"codegen: {name} has {matrix.shape[1]} columns: too many for C")
        start = np.concatenate([[0], np.cumsum(np.bincount(rows, minlength=len(matrix)))])
        parts = f"{name}_{i}_start", f"{name}_{i}_column", f"{name}_{i}_value"
        text += "static " + c_text.array(parts[0], start, "int")
        text += "static " + c_text.array(parts[1], columns, "unsigned short")
        text += "static " + c_text.array(parts[2], matrix[rows, columns])
        instances.append("{" + ", ".join(parts) + "}")
    if _many(matrices):
        return text + f"const smpc_sparse {name}[SMPC_KINDS] = {{{', '.join(instances)}}};\n"
    return text + f"const smpc_sparse {name} = {instances[0]};\n"
