"""The motion between the samples of a simulation, as smooth as the motion itself.

Time is cut into pieces over which the input is linear. A linear drive is known there in closed form;
the strains follow the polynomial that takes at both ends of its piece the recorded strains and
rates, and the accelerations and jerks that the equations of motion give for them (degree 7).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import factorial
from typing import Any

import numpy as np

from softmpc.errors import BuildError
from softmpc.model.model import Model
from softmpc.simulation.drive_motion import DriveMotion
from softmpc.simulation.inputs import InputProfile
from softmpc.simulation.result import Simulation
from softmpc.simulation.run import integrator_for

__all__ = ["MotionBetween"]

Array = np.ndarray
FINER = 16  # parts of a piece after a jump, in which fast modes die out


@dataclass(frozen=True, eq=False)
class MotionBetween:
    """A recorded motion at any time: `motion(piece, time)` is (q, dq, p).

    `time` (I+1, s) are the ends of I pieces, `x` (I+1 × nx) the states there; `u0`, `u1` (I×k) the
    inputs at the start and the end of each piece.
    """

    model: Model
    time: Array
    x: Array
    u0: Array
    u1: Array

    @classmethod
    def of(cls, model: Model, simulation: Simulation, profile: InputProfile) -> MotionBetween:
        """Pieces between samples and breakpoints of the input.

        The state at a breakpoint that is no sample is integrated from the sample before. Raises
        `BuildError` for an arm with neither inertia nor damping: it jumps where pressures do.
        """
        if model.order == 0:
            raise BuildError(
                "an arm without inertia and damping has no motion of its own between samples: add "
                "inertia or material_damping"
            )
        if model.order == 2:
            model.require_mass("an energy audit")
        first, last = simulation.time[[0, -1]]
        bends = np.round(profile.breakpoints, 12)
        time = np.union1d(simulation.time, bends[(bends > first) & (bends < last)])
        ends = [profile.over(a, b) for a, b in zip(time[:-1], time[1:], strict=True)]
        u0, u1 = (np.array(u).reshape(len(ends), -1) for u in zip(*ends, strict=True))
        motion = cls(model, time, _recorded(simulation, time), u0, u1)
        return motion._filled()

    def _filled(self) -> MotionBetween:
        """With the states that were not recorded, and finer pieces after each jump of the input.

        Both by integration from the sample before.
        """
        integrator, time, x, u0, u1 = integrator_for(self.model), [], [], [], []
        state, before = self.x[0], None
        for k, (start, end) in enumerate(zip(self.time[:-1], self.time[1:], strict=True)):
            jumps = before is None or not np.allclose(self.u0[k], before, rtol=1e-9, atol=0)
            known, before = self.x[k + 1], self.u1[k]
            parts = FINER if jumps else 1
            states = [state]
            if jumps or np.isnan(known).any():
                span = float(end - start)
                states += [*integrator.advance(state, self.u0[k], span, parts, self.u1[k])]
            state = states[-1] if np.isnan(known).any() else known
            share = np.arange(parts + 1)[:, None] / parts
            inputs = self.u0[k] + share * (self.u1[k] - self.u0[k])
            time.append(start + (end - start) * share[:-1, 0])
            x.append(states[:parts])
            u0.append(inputs[:-1])
            u1.append(inputs[1:])
        time.append(self.time[-1:])
        x.append([state])
        return MotionBetween(self.model, *(np.concatenate(each) for each in (time, x, u0, u1)))

    @property
    def lengths(self) -> Array:
        """Length of each piece (I, s)."""
        return np.diff(self.time)

    @cached_property
    def _slopes(self) -> Array:
        return (self.u1 - self.u0) / self.lengths[:, None]

    @cached_property
    def _drive(self) -> DriveMotion:
        return DriveMotion(self.model.drive, self.model.layout.z.scale)

    @property
    def fastest(self) -> float:
        """Largest rate of the drive (1/s); 0 for one that follows at once."""
        return float(np.abs(self._drive.rates).max(initial=0.0))

    def _split(self, x: Array) -> tuple[Array, Array, Array]:
        q, dq, z = np.split(x, [self.model.strains, 2 * self.model.strains], axis=1)
        return q, dq, z

    # --- at given times ------------------------------------------------------------------------

    def __call__(self, piece: Array, time: Array) -> tuple[Array, Array, Array]:
        """(q, dq, p), each N×G×…, at times (N×G, s) that lie in the pieces (N)."""
        length = self.lengths[piece]
        share = (time - self.time[piece, None]) / length[:, None]
        c = self._polynomials[piece]
        power = np.arange(c.shape[1])
        q = np.einsum("ngk,nki->ngi", share[..., None] ** power, c)
        slope = power[1:] * share[..., None] ** power[:-1]
        dq = np.einsum("ngk,nki->ngi", slope, c[:, 1:]) / length[:, None, None]
        return q, dq, self._pressures(piece, time - self.time[piece, None])

    def _pressures(self, piece: Array, since: Array) -> Array:
        """Unit pressures (N×G×m) at times (N×G, s) since the start of the pieces (N)."""
        z = self._split(self.x[:-1])[2][piece]
        law = self._drive.law(z, self.u0[piece], self._slopes[piece])
        u = self.u0[piece, None] + since[..., None] * self._slopes[piece, None]
        return self._drive.pressures(self._drive.states(law, since), u)

    # --- the polynomials -----------------------------------------------------------------------

    @cached_property
    def _polynomials(self) -> Array:
        """Coefficients (I×2d×n) in the share of the piece, from d derivatives at each end."""
        starts = self._derivatives(self.x[:-1], self.u0)
        ends = self._derivatives(self.x[1:], self.u1)
        count = starts.shape[1]
        scale = self.lengths[:, None] ** np.arange(count)
        known = np.concatenate([starts * scale[..., None], ends * scale[..., None]], axis=1)
        return np.asarray(np.linalg.solve(_osculation(count), known))

    def _derivatives(self, x: Array, u: Array) -> Array:
        """Strains and their derivatives in time (I×d×n) at one end of each piece."""
        q, dq, z = self._split(x)
        rates = z @ self.model.drive.A.T + u @ self.model.drive.B.T
        p, dp = self._drive.pressures(z, u), self._drive.pressures(rates, self._slopes)
        return np.stack((_accelerated if self.model.order == 2 else _damped)(self.model, q, dq, p, dp), 1)


def _recorded(simulation: Simulation, time: Array) -> Array:
    """The states (K×nx) at times of which some are samples; nan at the others."""
    x = np.full((len(time), simulation.x.shape[1]), np.nan)
    x[np.isin(time, simulation.time)] = simulation.x
    return x


def _osculation(count: int) -> Array:
    """Matrix (2d×2d) from coefficients to derivatives 0 … d-1 at 0 and at 1."""
    size = 2 * count
    rows = np.zeros((size, size))
    for j in range(count):
        rows[j, j] = factorial(j)
        for k in range(j, size):
            rows[count + j, k] = factorial(k) / factorial(k - j)
    return rows


def _accelerated(model: Model, q: Array, dq: Array, p: Array, dp: Array) -> list[Array]:
    """q, dq, ddq, dddq of an arm with inertia: from r = 0 and dr/dt = 0."""
    M = matrices(model.M, q)
    ddq = -_solve(M, values(model.residual, q, dq, 0 * q, p))
    dr = values(model.residual_along, q, dq, ddq, p, dq, ddq, 0 * q, dp)
    return [q, dq, ddq, -_solve(M, dr)]


def _damped(model: Model, q: Array, dq: Array, p: Array, dp: Array) -> list[Array]:
    """q, dq, ddq of an arm without inertia; dq jumps with the pressures, so it is solved for."""
    none = 0 * q
    for _ in range(3):  # linear in dq but for drag
        D = matrices(model.residual_jacobian, q, dq, none, p, output=1)
        dq = dq - _solve(D, values(model.residual, q, dq, none, p))
    return [q, dq, -_solve(D, values(model.residual_along, q, dq, none, p, dq, none, none, dp))]


def _solve(matrix: Array, vector: Array) -> Array:
    return np.asarray(np.linalg.solve(matrix, vector[..., None])[..., 0])


def values(function: Any, *arguments: Array) -> Array:
    """A CasADi function of vectors at many arguments (N×size each): its vectors (N×size)."""
    mapped = function.map(len(arguments[0]))
    return np.asarray(mapped(*(a.T for a in arguments))).T


def matrices(function: Any, *arguments: Array, output: int = 0) -> Array:
    """One square output (N×n×n) of a CasADi function at many arguments (N×size each)."""
    count = len(arguments[0])
    found = function.map(count)(*(a.T for a in arguments))
    flat = np.asarray(found[output] if isinstance(found, tuple) else found)
    return np.moveaxis(flat.reshape(len(flat), count, -1), 1, 0)
