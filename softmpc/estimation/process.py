"""How the state and the disturbance of a model move from one time to the next, with slopes.

The augmented state is s = (x / scale, d). Strains take one implicit step, the linear drive goes
exactly, the disturbance stays as it is. All three are pushed by white noise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softmpc.control.discretise import held_input
from softmpc.control.transcription import require_linear_drive
from softmpc.errors import InputError
from softmpc.estimation.arm_step import ArmStep, Length, Stages
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

    def __post_init__(self) -> None:
        _require_deviations(self)


@dataclass(frozen=True)
class Spread:
    """Standard deviations at the start, as shares of each variable's scale."""

    strains: float = 0.01
    rates: float = 0.01
    drive: float = 0.02
    forces: float = 0.1
    offsets: float = 0.03

    def __post_init__(self) -> None:
        _require_deviations(self)


def _require_deviations(shares: ProcessNoise | Spread) -> None:
    """Raise `InputError` for what is no standard deviation."""
    for name, value in vars(shares).items():
        if not 0.0 <= value < np.inf:
            raise InputError(
                f"{type(shares).__name__}: {name} = {value!r}: must be a finite number from 0, a "
                "share of the scale"
            )


@dataclass(frozen=True)
class _Step:
    """All of a step of one length that does not depend on the state: its causes and its end by s
    and by u (SI), without what the unknowns of the stages bring, and that by these."""

    arm: Length
    causes: Array
    causes_by_u: Array
    end: Array
    end_by_u: Array
    unknowns: Array  # of the arm's part of s


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
        ends, n, nx = 2 * self.n, self.n, self.nx
        pressures = np.vstack(
            [np.hstack([drive.C @ phi, drive.C @ g + drive.D]) for phi, g in pairs]
        )
        by_z, by_u = pressures[:, : nx - ends], pressures[:, nx - ends :]
        phi, gamma = pairs[-1]
        causes = np.zeros((ends + len(by_u) + n, self.size))
        causes[:ends, :ends] = np.eye(ends)
        causes[ends:-n, ends:nx], causes[ends:-n, nx:] = by_z, by_u @ d.G
        causes[-n:, nx:] = d.F
        causes_by_u = np.zeros((len(causes), len(d.G)))
        causes_by_u[ends:-n] = by_u
        end, end_by_u = np.eye(self.size), np.zeros((self.size, len(d.G)))
        end[:ends, :ends] = arm.by_start
        end[ends:nx, ends:nx], end[ends:nx, nx:] = phi, gamma @ d.G
        end_by_u[ends:nx] = gamma
        size = self.scale[:, None]
        return _Step(
            arm, causes * self.scale, causes_by_u, end * self.scale / size, end_by_u / size,
            arm.by_unknowns / size[:ends],
        )  # fmt: skip

    def advance(
        self, s: Array, u: Array, length: float, before: Stages | None = None
    ) -> tuple[Array, Array, Stages]:
        """s after `length` seconds under the input u (k, SI), its slope in s, and its stages.

        `before` are the stages of a step before, which make it quicker. Raises `ArithmeticError`
        where the step has no solution.
        """
        of, ends = self._step(length), 2 * self.n
        stages = self.arm.solve(of.causes @ s + of.causes_by_u @ u, before, of.arm)
        after = of.end @ s + of.end_by_u @ u
        after[:ends] += of.unknowns @ stages.a
        A = of.end.copy()
        A[:ends] += of.unknowns @ (stages.slope @ of.causes)
        return after, A, stages
