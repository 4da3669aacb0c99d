"""The KKT conditions of a program whose active rows are known, solved in inputs and durations.

    H v + f + Dᵀ λ + Jᵀ μ = 0,   D v = d,   J v = what is left to the bound of each active row

The states follow from the inputs by D; what is left is dense and has an orthogonal factorisation,
which also finds active rows that depend on others, as a pressure on a motor that pushes with none.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import linalg, sparse
from scipy.sparse.linalg import SuperLU, splu

from softmpc.planning.attempt import Attempt
from softmpc.planning.sensitivity_constraints import Constraints, Multipliers

__all__ = ["FLAT", "Kkt"]

FLAT = 1e-4  # curvature that a plan does not look at: it is least to some 1e-4
DEPENDENT = 1e-5  # of the largest, what a row has of its own

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Kkt:
    """H and constraints around a motion; `active` rows are 1 at an upper bound, -1 at a lower one.

    `states` are the moves that D settles.
    """

    H: sparse.csc_matrix
    here: Constraints
    active: Array
    states: slice

    @classmethod
    def of(cls, attempt: Attempt, H: sparse.csc_matrix, here: Constraints, active: Array) -> Kkt:
        mesh = attempt.mesh
        return cls(H, here, active.copy(), slice(mesh.inputs, mesh.inputs + mesh.of_x.size))

    @cached_property
    def rows(self) -> Array:
        """The active rows."""
        return np.flatnonzero(self.active)

    @cached_property
    def _steps(self) -> tuple[int, Array, sparse.csc_matrix]:
        """How many equations are steps; places of the other moves; the steps' slopes in those."""
        moves = np.arange(self.H.shape[0])
        others = np.concatenate([moves[: self.states.start], moves[self.states.stop :]])
        count = self.states.stop - self.states.start
        return count, others, self.here.D[:count].tocsc()[:, others]

    @cached_property
    def _by_states(self) -> SuperLU:
        count = self._steps[0]
        return splu(self.here.D[:count].tocsc()[:, self.states])

    @cached_property
    def _follow(self) -> Array:
        """All moves as others of them determine it, dense."""
        _, others, by_others = self._steps
        found = np.zeros((self.H.shape[0], len(others)))
        found[others, np.arange(len(others))] = 1.0
        found[self.states] = -self._by_states.solve(by_others.toarray())
        return found

    @cached_property
    def _held(self) -> sparse.csr_matrix:
        """Slopes of all that is held beside the steps: known durations, active rows."""
        return sparse.vstack([self.here.D[self._steps[0] :], self.here.J[self.rows]]).tocsr()

    @cached_property
    def _factors(self) -> tuple[Array, Array, Array, Array]:
        """Of the transpose of these: Q, R, independent rows of them; and moves they leave free."""
        Q, R, order = linalg.qr((self._held @ self._follow).T, pivoting=True)
        sizes = np.abs(np.diag(R))
        rank = int(np.sum(sizes > DEPENDENT * sizes[0])) if len(sizes) else 0
        return Q[:, :rank], R[:rank, :rank], order[:rank], Q[:, rank:]

    @cached_property
    def _curved(self) -> Array:
        """H in the other moves."""
        return self._follow.T @ (self.H @ self._follow)

    @cached_property
    def _free(self) -> tuple[Array, Array]:
        """Curvatures among the moves that are left free, and these moves."""
        Z = self._factors[3]
        return (
            linalg.eigh(Z.T @ self._curved @ Z) if Z.shape[1] else (np.zeros(0), np.zeros((0, 0)))
        )

    @property
    def freedom(self) -> int:
        """How many moves are left to H; 0 where what is held determines all."""
        return self._factors[3].shape[1]

    @property
    def flat(self) -> int:
        """In how many of them the objective hardly tells one motion from others."""
        return int(np.sum(self._free[0] < FLAT))

    def newton(self, f: Array) -> tuple[Array, Multipliers]:
        """The moves to where all of them hold, and the multipliers there.

        Flat ways count as if they were curved by `FLAT`, and those that bend down as if up: so the
        moves lead down.
        """
        here, curved = self.here, np.maximum(np.abs(self._free[0]), FLAT)
        left = np.where(self.active > 0, here.high, here.low) - here.value
        return self._solve(f, here.d, left, 1 / curved)

    def change(self, gradient: Array, d: Array, left: Array) -> tuple[Array, Multipliers]:
        """Moves and changes of multipliers as the gradient of the Lagrangian, d and what is left to
        the bounds of rows change. There is none along flat ways.
        """
        curvatures = self._free[0]
        yields = np.where(curvatures < FLAT, 0.0, 1 / np.where(curvatures < FLAT, 1.0, curvatures))
        return self._solve(gradient, d, left, yields)

    def _solve(self, f: Array, d: Array, left: Array, yields: Array) -> tuple[Array, Multipliers]:
        count = self._steps[0]
        Q, R, kept, Z = self._factors
        S, H = self._follow, self._curved
        start = np.zeros(len(f))
        start[self.states] = self._by_states.solve(d[:count])
        g = S.T @ (f + self.H @ start)
        b = np.concatenate([d[count:], left[self.rows]]) - self._held @ start
        w = Q @ linalg.solve_triangular(R, b[kept], trans="T")
        Y = Z @ self._free[1]
        w = w - Y @ (yields * (Y.T @ (g + H @ w)))
        v = start + S @ w
        held = np.zeros(len(b))
        held[kept] = linalg.solve_triangular(R, -(Q.T @ (g + H @ w)))
        slope = f + self.H @ v + self._held.T @ held
        of_steps = -self._by_states.solve(slope[self.states], "T")
        known = len(d) - count
        of_rows = np.zeros(len(left))
        of_rows[self.rows] = held[known:]
        return v, Multipliers(np.concatenate([of_steps, held[:known]]), of_rows)
