"""How the state and the disturbance of a model move from one time to the next, with slopes.

The augmented state is s = (x / scale, d). Strains take one implicit step, the linear drive goes
exactly, the disturbance stays as it is. All three are pushed by white noise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softmpc.control.discretise import held_input
from softmpc.control.transcription import require_linear_drive
from softmpc.estimation.arm_step import ArmStep, Length
from softmpc.model.disturbance import Disturbance
from softmpc.model.model import Model

__all__ = ["Process", "ProcessNoise", "Spread"]

Array = np.ndarray
KEPT = 64  # lengths of steps whose matrices are kept


@dataclass(frozen=True)
class ProcessNoise:
    """Standard deviations after a second, as shares of each variable's scale (white noise)."""

    strains: float = 1e-4
    rates: float = 3e-3
    drive: float = 1e-3
    forces: float = 0.01
    offsets: float = 3e-3


@dataclass(frozen=True)
class Spread:
    """Standard deviations at the start, as shares of each variable's scale."""

    strains: float = 0.01
    rates: float = 0.01
    drive: float = 0.02
    forces: float = 0.1
    offsets: float = 0.03


@dataclass(frozen=True)
class _Step:
    """All of a step of one length that does not depend on the state; s is scaled, the rest SI."""

    arm: Length
    drive_by_s: Array  # of the pressures at the stages, and of the drive's states at the end
    drive_by_u: Array
    slope: Array  # of s after the step in s, without what the unknowns bring
    ends: Array  # arm's rows of s by the unknowns
    enters: Array  # the unknowns' causes (q, dq, pressures at the stages, force) by s


class Process:
    """The motion of one model under a disturbance; compiled where that is possible."""

    def __init__(
        self, model: Model, disturbance: Disturbance, noise: ProcessNoise, mode: str = "auto"
    ) -> None:
        require_linear_drive(model)
        self.model, self.disturbance, self.noise = model, disturbance, noise
        self.n, self.nx = model.strains, len(model.layout.x)
        self.size = self.nx + len(disturbance)
        self.scale = np.concatenate([model.layout.x.scale, np.ones(len(disturbance))])
        self.arm = ArmStep(model, mode)
        self.unknowns = self.arm.unknowns  # of the stages of a step
        self._steps: dict[float, _Step] = {}
        self._intensity = self.variances(noise)  # a second

    def variances(self, shares: ProcessNoise | Spread) -> Array:
        """Of each entry of s."""
        forced = np.any(self.disturbance.F != 0, axis=0)
        parts = [
            np.full(self.n, shares.strains),
            np.full(self.n, shares.rates),
            np.full(self.nx - 2 * self.n, shares.drive),
            np.where(forced, shares.forces, shares.offsets),
        ]
        return np.concatenate(parts) ** 2

    def spread(self, length: float) -> Array:
        """Covariance that a time of `length` seconds adds, its diagonal."""
        return self._intensity * length

    def _step(self, length: float) -> _Step:
        key = round(length, 9)
        if key not in self._steps:
            if len(self._steps) >= KEPT:
                self._steps.clear()
            self._steps[key] = self._prepared(length)
        return self._steps[key]

    def _prepared(self, length: float) -> _Step:
        drive, d, arm = self.model.drive, self.disturbance, self.arm.length(length)
        pairs = [held_input(drive.A, drive.B, c * length) for c in self.arm.tableau.c]
        phi, gamma = ([pair[i] for pair in pairs] for i in (0, 1))
        by_z = np.vstack([*(drive.C @ one for one in phi), phi[-1]])
        by_u = np.vstack([*(drive.C @ one + drive.D for one in gamma), gamma[-1]])
        ends, wet = 2 * self.n, slice(2 * self.n, self.nx)
        drive_by_s = np.zeros((len(by_u), self.size))
        drive_by_s[:, wet], drive_by_s[:, self.nx :] = by_z, by_u @ d.G
        drive_by_s *= self.scale
        slope = np.diag(self.scale)
        slope[:ends, :ends] = arm.by_start * self.scale[:ends]
        slope[wet] = drive_by_s[len(by_u) - len(drive.A) :]
        enters = np.zeros((ends + len(by_u) - len(drive.A) + self.n, self.size))
        enters[:ends, :ends] = np.diag(self.scale[:ends])
        enters[ends : -self.n] = drive_by_s[: len(by_u) - len(drive.A)]
        enters[-self.n :, self.nx :] = d.F
        small = arm.by_unknowns / self.scale[:ends, None]
        return _Step(arm, drive_by_s, by_u, slope / self.scale[:, None], small, enters)

    def advance(self, s: Array, u: Array, length: float, a: Array) -> tuple[Array, Array, Array]:
        """s after `length` seconds under the input u (k, SI), its slope in s, and the new a.

        `a` holds unknowns of the stages of a step before, where the iterations begin. Raises
        `ArithmeticError` where they end nowhere.
        """
        of, ends = self._step(length), 2 * self.n
        wet = of.drive_by_s @ s + of.drive_by_u @ u
        stages = len(wet) - (self.nx - ends)
        force = self.disturbance.F @ s[self.nx :]
        y = s[:ends] * self.scale[:ends]
        a, slopes = self.arm.solve(y, wet[:stages], force, a, of.arm)
        after = s.copy()
        after[:ends] = of.slope[:ends, :ends] @ s[:ends] + of.ends @ a
        after[ends : self.nx] = wet[stages:] / self.scale[ends : self.nx]
        A = of.slope.copy()
        A[:ends] += of.ends @ (slopes @ of.enters)
        return after, A, a
