"""The sparse quadratic program of one step, solved by PIQP, an interior-point method, in CasADi.

    min  ½ v·H v + f·v + price · (s⁺ + s⁻)
    with D v = d,  low ≤ J v + s⁺ - s⁻ ≤ high,  lowest ≤ v ≤ highest,  s ≥ 0

Slacks at a price make it feasible always, and say which limit gives way where nothing else helps.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
from scipy import sparse

from softmpc.errors import BuildError

__all__ = ["Elastic", "Step", "require_solver"]

PIQP = {"eps_abs": 1e-7, "eps_rel": 1e-7, "max_iter": 200, "reg_lower_limit": 1e-8}
SOFTENING = 1e-6  # curvature of a slack
MISSING = (
    "plans need the solver PIQP, which this build of CasADi has not: install casadi 3.8 or later "
    "from PyPI; all else works without"
)

Array = np.ndarray


def require_solver() -> None:
    """Raise `BuildError` where CasADi has no PIQP, as in 3.7."""
    if not ca.has_conic("piqp"):
        raise BuildError(MISSING)


@dataclass(frozen=True)
class Step:
    """Moves, what each row gave way, and multipliers of steps, rows and bounds (CasADi's signs)."""

    solved: bool
    v: Array
    slack: Array
    of_steps: Array
    of_rows: Array
    of_bounds: Array


@dataclass(frozen=True, eq=False)
class Elastic:
    """One program; see the module."""

    H: sparse.csc_matrix
    f: Array
    D: sparse.csr_matrix
    d: Array
    J: sparse.csr_matrix
    low: Array
    high: Array
    price: Array
    lowest: Array
    highest: Array

    def solve(self) -> Step:
        """Solve it; where the solver fails the step says so."""
        n, e = len(self.f), len(self.d)
        under, over = np.flatnonzero(np.isfinite(self.low)), np.flatnonzero(np.isfinite(self.high))
        count = len(under) + len(over)
        H = _dm(sparse.block_diag([self.H, SOFTENING * sparse.eye(count)]))
        A = _dm(sparse.bmat([[self.D, None], [self.J, self._slacks(under, over)]]))
        shape = {"h": H.sparsity(), "a": A.sparsity()}
        solver = ca.conic("step", "piqp", shape, {"piqp": PIQP, "error_on_fail": False})
        found = solver(
            h=H, a=A, g=np.concatenate([self.f, self.price[under], self.price[over]]),
            lbx=np.concatenate([self.lowest, np.zeros(count)]),
            ubx=np.concatenate([self.highest, np.full(count, np.inf)]),
            lba=np.concatenate([self.d, self.low]), uba=np.concatenate([self.d, self.high]),
        )  # fmt: skip
        x, of_a, of_x = (np.asarray(found[name]).ravel() for name in ("x", "lam_a", "lam_x"))
        slack = np.zeros(len(self.low))
        np.add.at(slack, np.concatenate([under, over]), x[n:])
        solved = bool(solver.stats()["success"]) and bool(np.all(np.isfinite(x)))
        return Step(solved, x[:n], slack, of_a[:e], of_a[e:], of_x[:n])

    def _slacks(self, under: Array, over: Array) -> sparse.csr_matrix:
        """Slopes of the rows in the slacks."""
        signs = np.concatenate([np.ones(len(under)), -np.ones(len(over))])
        places = np.concatenate([under, over]), np.arange(len(signs))
        return sparse.csr_matrix((signs, places), (len(self.low), len(signs)))


def _dm(matrix: sparse.spmatrix) -> ca.DM:
    """A CasADi matrix with the same pattern, in linear time."""
    m = matrix.tocsc()
    m.sort_indices()
    pattern = ca.Sparsity(m.shape[0], m.shape[1], m.indptr.tolist(), m.indices.tolist())
    return ca.DM(pattern, m.data)
