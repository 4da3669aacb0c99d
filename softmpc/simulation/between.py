"""The motion between the samples of a simulation, as smooth as the motion itself.

Time is cut into pieces over which the input is linear. Strains follow the polynomial that has, at
both ends of its piece, the recorded strains and rates, and the accelerations and jerks that the
equations of motion give for them (degree 7). A linear drive is known in closed form, another one
follows a polynomial like the strains (degree 5).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from softmpc.errors import BuildError
from softmpc.model.model import Model
from softmpc.simulation.drive_motion import DriveMotion
from softmpc.simulation.hermite import Hermite
from softmpc.simulation.inputs import InputProfile
from softmpc.simulation.many import matrices, solve, values
from softmpc.simulation.methods import integrator_for
from softmpc.simulation.result import Simulation

__all__ = ["MotionBetween"]

Array = np.ndarray
TIGHT = 2e-7  # of the arm's length, at the tip, where states are integrated anew
LONG = 0.5  # m; a longer arm is followed as closely
WORST_MODES = 1e8  # condition of the drive's modes up to which the closed form is trusted


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

        States there that were not recorded are integrated from the sample before. Raises
        `BuildError` for an arm with neither inertia nor damping: it jumps where pressures do.
        """
        if model.order == 0:
            raise BuildError(
                "an arm without inertia and damping has no motion of its own between samples; add "
                "inertia or material_damping"
            )
        if model.order == 2:
            model.require_mass("an energy audit")
        bends = np.round(profile.breakpoints, 12)
        first, last = simulation.time[[0, -1]]
        time = np.union1d(simulation.time, bends[(bends > first) & (bends < last)])
        x = np.full((len(time), simulation.x.shape[1]), np.nan)
        x[np.isin(time, simulation.time)] = simulation.x
        motion = cls(model, time, x, *profile.over(time[:-1], time[1:]))
        return motion.refined(np.isnan(x[1:, 0]), 1)

    def refined(self, which: Array, parts: int) -> MotionBetween:
        """With some pieces (mask) integrated anew from their start, in equal parts.

        Their last state stays what it was, unless it is nan.
        """
        if not which.any():
            return self
        tolerance = TIGHT * min(self.model.scene.manipulator.length, LONG)
        integrator = integrator_for(self.model, tip_tolerance=tolerance)
        share = np.arange(parts)[:, None] / parts
        times, x, inputs = [], [self.x[:1]], [self.u0[:0]]
        for k, length in enumerate(self.lengths.tolist()):
            end = self.x[k + 1 : k + 2]
            if not which[k]:
                times.append(self.time[k : k + 1])
                inputs.append(self.u0[k : k + 1])
            else:
                found = integrator.advance(x[-1][-1], self.u0[k], length, parts, self.u1[k])
                x.append(found[:-1])
                end = found[-1:] if np.isnan(end).any() else end
                times.append(self.time[k] + share[:, 0] * length)
                inputs.append(self.u0[k] + share * (self.u1[k] - self.u0[k]))
            x.append(end)
        time, u0 = np.append(np.concatenate(times), self.time[-1]), np.concatenate(inputs)
        u1 = np.vstack([u0[1:], self.u1[-1:]])
        ends = np.isin(time[1:], self.time[1:])  # there the input may jump
        u1[ends] = self.u1
        return MotionBetween(self.model, time, np.concatenate(x), u0, u1)

    @property
    def lengths(self) -> Array:
        """Length of each piece (I, s)."""
        return np.diff(self.time)

    @property
    def fastest(self) -> float:
        """Largest rate of the drive (1/s); 0 for one that follows at once."""
        return float(np.abs(self._drive.rates).max(initial=0.0))

    # --- at given times ------------------------------------------------------------------------

    def __call__(self, piece: Array, time: Array) -> tuple[Array, Array, Array]:
        """(q, dq, p), each N×G×…, at times (N×G, s) that lie in the pieces (N)."""
        since = time - self.time[piece, None]
        q, dq = self._strains(piece, since)
        return q, dq, self._pressures(piece, since)

    def _pressures(self, piece: Array, since: Array) -> Array:
        """Unit pressures (N×G×m) at times (N×G, s) since the start of the pieces (N)."""
        u = self.u0[piece, None] + since[..., None] * self._slopes[piece, None]
        if self._drive_states is not None:
            return self._drive.pressures(self._drive_states(piece, since)[0], u)
        z = self._split(self.x)[2][piece]
        law = self._drive.law(z, self.u0[piece], self._slopes[piece])
        return self._drive.pressures(self._drive.states(law, since), u)

    # --- what it is made of --------------------------------------------------------------------

    def _split(self, x: Array) -> tuple[Array, Array, Array]:
        n = self.model.strains
        q, dq, z = np.split(x, [n, 2 * n], axis=1)
        return q, dq, z

    @cached_property
    def _slopes(self) -> Array:
        return (self.u1 - self.u0) / self.lengths[:, None]

    @cached_property
    def _drive(self) -> DriveMotion:
        return DriveMotion(self.model.drive, self.model.layout.z.scale)

    @cached_property
    def _strains(self) -> Hermite:
        starts = self._derivatives(self.x[:-1], self.u0)
        return Hermite.of(self.lengths, starts, self._derivatives(self.x[1:], self.u1))

    @cached_property
    def _drive_states(self) -> Hermite | None:
        """Drive states of a drive that has no closed form."""
        if self.model.drive_is_linear and self._drive.condition <= WORST_MODES:
            return None
        starts = self._drive_derivatives(self.x[:-1], self.u0)
        return Hermite.of(self.lengths, starts, self._drive_derivatives(self.x[1:], self.u1))

    def _derivatives(self, x: Array, u: Array) -> list[Array]:
        """Strains and their derivatives in time (I×n each) at one end of each piece."""
        q, dq, z = self._split(x)
        rates = values(self.model.drive_rate, z, u, q, dq)
        p, dp = self._drive.pressures(z, u), self._drive.pressures(rates, self._slopes)
        return (_accelerated if self.model.order == 2 else _damped)(self.model, q, dq, p, dp)

    def _drive_derivatives(self, x: Array, u: Array) -> list[Array]:
        """z, dz, ddz (I×h each) at one end of each piece."""
        q, dq, z = self._split(x)
        ddq = self._derivatives(x, u)[2]
        rates = values(self.model.drive_rate, z, u, q, dq)
        by = [matrices(self.model.drive_jacobian, z, u, q, dq, output=i) for i in range(3)]
        moves = zip(by, (rates, dq, ddq), strict=True)
        second = sum((np.einsum("nij,nj->ni", *each) for each in moves), 0 * z)
        return [z, rates, second + self._slopes @ self.model.drive.B.T]


def _accelerated(model: Model, q: Array, dq: Array, p: Array, dp: Array) -> list[Array]:
    """q, dq, ddq, dddq of an arm with inertia: from r = 0 and dr/dt = 0."""
    M = matrices(model.M, q)
    ddq = -solve(M, values(model.residual, q, dq, 0 * q, p))
    return [q, dq, ddq, -solve(M, values(model.residual_along, q, dq, ddq, p, dq, ddq, 0 * q, dp))]


def _damped(model: Model, q: Array, dq: Array, p: Array, dp: Array) -> list[Array]:
    """q, dq, ddq of an arm without inertia; dq jumps with the pressures, so it is solved for."""
    none = 0 * q
    for _ in range(3):  # linear in dq but for drag
        D = matrices(model.residual_jacobian, q, dq, none, p, output=1)
        dq = dq - solve(D, values(model.residual, q, dq, none, p))
    return [q, dq, -solve(D, values(model.residual_along, q, dq, none, p, dq, none, none, dp))]
