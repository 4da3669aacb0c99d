"""The stages of one implicit step, solved by simplified Newton iterations, as CasADi functions.

The Newton matrix of all stages, I⊗B0 + h A⊗B1 + h² A²⊗B2, is never formed: the eigenvectors of the
tableau's A split it into one matrix of the size of one stage for each real eigenvalue λ and one
complex one for each pair, B0 + h λ B1 + h² λ² B2 (Hairer and Wanner, Solving ODEs II, IV.8).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from softmpc.simulation.system import System
from softmpc.simulation.tableau import Tableau

__all__ = ["Start", "Stages"]

REAL = 1e-12  # imaginary part of an eigenvalue below which it is real
RUNNING, CONVERGED, FAILED = 0, 1, 2
SLOWEST = 0.9  # a contraction above it says nothing about what is left
ROUNDING = 1e-10  # m
SURE = 0.2  # of the wanted size: small enough whatever the contraction


@dataclass(frozen=True)
class Start:
    """Where a step starts, q, dq (n), z (k), and its length h; MX."""

    q: Any
    dq: Any
    z: Any
    h: Any


class Stages:
    """The equations of the stages of one step of a method, and their solution."""

    def __init__(
        self, system: System, tableau: Tableau, iterations: int, patience: float = SLOWEST
    ) -> None:
        self.system, self.tableau, self.iterations = system, tableau, iterations
        self.patience = patience  # contraction above which the iterations are given up
        eigenvalues, vectors = np.linalg.eig(tableau.A)
        upper = eigenvalues.imag > -REAL  # of each complex pair, one is enough
        self._lambdas = eigenvalues[upper]
        self._to_modes = np.linalg.inv(vectors)[upper]
        # A pair's second member is the conjugate: twice the real part stands for both.
        self._back = vectors[:, upper] * np.where(_is_pair(self._lambdas), 2.0, 1.0)

    # --- the matrices --------------------------------------------------------------------------

    def inverse(self, blocks: list[Any], h: Any) -> Any:
        """The inverse matrices side by side (size×…), of a pair its real and imaginary part."""
        b0, b1, b2 = blocks
        eye = ca.MX(ca.DM.eye(self.system.size))
        found = []
        for value in self._lambdas:
            square = value**2
            real = b0 + (h * value.real) * b1 + (h**2 * square.real) * b2
            if not _is_pair(value):
                found.append(ca.solve(ca.densify(real), eye, "qr"))
                continue
            imag = (h * value.imag) * b1 + (h**2 * square.imag) * b2
            whole = ca.densify(ca.blockcat([[real, -imag], [imag, real]]))
            found += ca.vertsplit(ca.solve(whole, ca.vertcat(eye, 0 * eye), "qr"), self.system.size)
        return ca.horzcat(*found)

    def solve(self, inverse: Any, rows: Any) -> Any:
        """The Newton matrix solved for a right-hand side (size×s), by the inverses."""
        parts, total = iter(ca.horzsplit(inverse, self.system.size)), 0.0
        for j, value in enumerate(self._lambdas):
            to, back = self._to_modes[j], self._back[:, j]
            real, u = rows @ ca.DM(to.real), next(parts)
            if not _is_pair(value):
                total = total + (u @ real) @ ca.DM(back.real).T
                continue
            imag, v = rows @ ca.DM(to.imag), next(parts)
            x_real, x_imag = u @ real - v @ imag, v @ real + u @ imag
            total = total + x_real @ ca.DM(back.real).T - x_imag @ ca.DM(back.imag).T
        return total

    @property
    def _columns(self) -> int:
        return sum(2 if _is_pair(value) else 1 for value in self._lambdas) * self.system.size

    # --- one step ------------------------------------------------------------------------------

    def at(self, start: Start, y: Any) -> tuple[Any, Any, Any]:
        """Strains, rates and drive states at the stages (columns), for unknowns y (size×s)."""
        return self._states(start, y, self.tableau.A, self.tableau.A @ self.tableau.A)

    def end(self, start: Start, y: Any) -> tuple[Any, Any, Any]:
        """The same at the end of the step."""
        b = self.tableau.b[None, :]
        return self._states(start, y, b, b @ self.tableau.A)

    def _states(self, start: Start, y: Any, once: Any, twice: Any) -> tuple[Any, Any, Any]:
        n, h, count = self.system.n, start.h, len(once)
        first = h * (y @ ca.DM(once).T)
        z = ca.repmat(start.z, 1, count) + first[n:, :]
        if self.system.order == 1:
            return ca.repmat(start.q, 1, count) + first[:n, :], y[:n, :], z
        shares = ca.DM(once.sum(axis=1)[None, :])
        q = (
            ca.repmat(start.q, 1, count)
            + h * (start.dq @ shares)
            + h**2 * (y[:n, :] @ ca.DM(twice).T)
        )
        return q, ca.repmat(start.dq, 1, count) + first[:n, :], z

    def rows(self, start: Start, y: Any, w: Any) -> Any:
        """Scaled rows of all stages (size×s)."""
        return self.system.rows.map(self.tableau.stages)(*self.at(start, y), y, w)

    def size_of(self, h: Any, change: Any) -> Any:
        """How far (m) a change of scaled unknowns (size×s) moves the tip at the end of the step."""
        b = self.tableau.b[None, :] @ self.tableau.A if self.system.order == 2 else self.tableau.b
        n = self.system.n
        levers = ca.DM(self.system.levers * self.system.y_scale)
        power = h**2 if self.system.order == 2 else h
        strains = power * (change[:n, :] @ ca.DM(np.atleast_2d(b)).T)
        drive = h * (change[n:, :] @ ca.DM(self.tableau.b))
        return ca.dot(levers, ca.fabs(ca.vertcat(strains, drive)))

    # --- the iterations ------------------------------------------------------------------------

    @cached_property
    def _iterate(self) -> ca.Function:
        """One iteration, or nothing once the state says so."""
        s = self.system
        given = {
            "y": ca.MX.sym("y", s.size, self.tableau.stages),
            "state": ca.MX.sym("state", 3),  # running …, size of the last change, iterations
            "start": ca.MX.sym("start", 2 * s.n + s.k + 1),
            "w": ca.MX.sym("w", s.inputs, self.tableau.stages),
            "inverse": ca.MX.sym("inverse", s.size, self._columns),
            "wanted": ca.MX.sym("wanted"),
        }
        y, state = given["y"], given["state"]
        start = self._unpacked(given["start"])
        change = -self.solve(given["inverse"], self.rows(start, y, given["w"]))
        size = self.size_of(start.h, change)
        rate = ca.if_else(state[2] > 0, size / state[1], SLOWEST / 2)
        after = self._verdict(size, rate, state, given["wanted"])
        moved = y + change * ca.repmat(ca.DM(s.y_scale), 1, self.tableau.stages)
        outputs = [moved, ca.vertcat(after, size, state[2] + 1)]
        once = ca.Function("iterate", [*given.values()], outputs)
        still = ca.Function("still", [*given.values()], [y, state])
        return ca.Function.if_else("maybe_iterate", once, still)

    def _verdict(self, size: Any, rate: Any, state: Any, wanted: Any) -> Any:
        ahead = size * rate / (1 - rate)  # what all later changes add up to
        known = ca.logic_and(state[2] > 0, ca.logic_and(rate < SLOWEST, ahead <= wanted))
        # Where the changes no longer shrink, small ones are rounding errors.
        rounding = ca.logic_and(rate >= SLOWEST, size <= ROUNDING)
        done = ca.logic_or(size <= SURE * wanted, ca.logic_or(known, rounding))
        fine = ca.logic_or(state[2] < 1, rate < self.patience)
        bounded = size < 1e6  # false for NaN too
        return ca.if_else(done, CONVERGED, ca.if_else(ca.logic_and(fine, bounded), RUNNING, FAILED))

    def _unpacked(self, packed: Any) -> Start:
        n, k = self.system.n, self.system.k
        return Start(*ca.vertsplit(packed, [0, n, 2 * n, 2 * n + k, 2 * n + k + 1]))

    def newton(self, start: Start, guess: Any, w: Any, inverse: Any, wanted: Any) -> Any:
        """Unknowns y (size×s), whether they solve the stages to `wanted` (m), and iterations."""
        packed = ca.vertcat(start.q, start.dq, start.z, start.h)
        y, state = guess, ca.MX(ca.DM([RUNNING, 0.0, 0.0]))
        for _ in range(self.iterations):
            y, state = self._iterate(state[0] == RUNNING, y, state, packed, w, inverse, wanted)
        return y, state[0] == CONVERGED, state[2]


def _is_pair(value: Any) -> Any:
    """Whether an eigenvalue stands for itself and its conjugate."""
    return value.imag > REAL
