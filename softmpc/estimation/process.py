"""How the state and the disturbance of a model move from one time to the next, with slopes.

The augmented state is s = (x / scale, d). Strains take one implicit step, the linear drive goes
exactly, the disturbance stays as it is. All three are pushed by white noise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softmpc.control.discretise import held_input
from softmpc.control.step_form import StepForm
from softmpc.control.transcription import require_linear_drive
from softmpc.estimation.arm_step import ArmStep, Moved
from softmpc.model.disturbance import Disturbance
from softmpc.model.model import Model

__all__ = ["Process", "ProcessNoise"]

Array = np.ndarray
CONVERGED = 0.01  # scaled change of the stages in the last of quadratically converging iterations
ROUNDS = 4  # of those iterations
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
class _Length:
    """What belongs to one length of a step."""

    form: StepForm
    phi: list[Array]
    gamma: list[Array]


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
        self.unknowns = len(self.arm.tableau.c) * self.n  # of the stages of a step
        self._lengths: dict[float, _Length] = {}
        self._intensity = self._intensities()

    def _intensities(self) -> Array:
        """Variance a second of each entry of s."""
        noise, d = self.noise, self.disturbance
        forced = np.any(d.F != 0, axis=0)
        parts = [
            np.full(self.n, noise.strains),
            np.full(self.n, noise.rates),
            np.full(self.nx - 2 * self.n, noise.drive),
            np.where(forced, noise.forces, noise.offsets),
        ]
        return np.concatenate(parts) ** 2

    def spread(self, length: float) -> Array:
        """Covariance that a time of `length` seconds adds, its diagonal."""
        return self._intensity * length

    def _length(self, length: float) -> _Length:
        key = round(length, 9)
        if key not in self._lengths:
            if len(self._lengths) >= KEPT:
                self._lengths.clear()
            drive = self.model.drive
            pairs = [held_input(drive.A, drive.B, c * length) for c in self.arm.tableau.c]
            phi, gamma = ([pair[i] for pair in pairs] for i in (0, 1))
            self._lengths[key] = _Length(self.arm.form(length), phi, gamma)
        return self._lengths[key]

    def _moved(self, q: Array, dq: Array, p: Array, f: Array, a: Array, form: StepForm) -> Moved:
        for _ in range(ROUNDS):
            moved = self.arm.advance(q, dq, p, f, a, form)
            if moved.change <= CONVERGED:
                return moved
            a = moved.a if np.all(np.isfinite(moved.a)) else np.zeros_like(a)
        raise ArithmeticError(f"the stages of a step end {moved.change:.3g} of their size apart")

    def advance(self, s: Array, u: Array, length: float, a: Array) -> tuple[Array, Array, Array]:
        """s after `length` seconds under the input u (k, SI), its slope in s, and the new a.

        `a` holds unknowns of the stages of a step before, where the iterations begin. Raises
        `ArithmeticError` where they end nowhere.
        """
        n, of, drive = self.n, self._length(length), self.model.drive
        x, d = (s * self.scale)[: self.nx], s[self.nx :]
        q, dq, z = x[:n], x[n : 2 * n], x[2 * n :]
        given = u + self.disturbance.G @ d
        states = [phi @ z + gamma @ given for phi, gamma in zip(of.phi, of.gamma, strict=True)]
        p = np.array([drive.C @ state + drive.D @ given for state in states])
        moved = self._moved(q, dq, p, self.disturbance.F @ d, a, of.form)
        after = np.concatenate([moved.q, moved.dq, states[-1], d]) / self.scale
        A = np.zeros((self.size, self.size))
        arm, wet = slice(0, 2 * n), slice(2 * n, self.nx)
        A[arm, :n], A[arm, n : 2 * n] = moved.by_q, moved.by_dq
        A[arm, wet] = moved.by_p @ np.vstack([drive.C @ phi for phi in of.phi])
        by_given = moved.by_p @ np.vstack([drive.C @ gamma + drive.D for gamma in of.gamma])
        A[arm, self.nx :] = moved.by_f @ self.disturbance.F + by_given @ self.disturbance.G
        A[wet, wet], A[wet, self.nx :] = of.phi[-1], of.gamma[-1] @ self.disturbance.G
        A[self.nx :, self.nx :] = np.eye(len(d))
        return after, A * self.scale / self.scale[:, None], moved.a
