"""The linear drive solved exactly, so that integrators see only the arm.

Its fast poles (-10485 1/s for the paper's drive, the arm's slowest mode is near 10 1/s) would force
small steps on every method. Under an input that is linear in time the drive's motion is known in
closed form, and the pressures become known smooth functions of time.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from softmpc.model.hydraulics import DriveMatrices

__all__ = ["DriveLaw", "DriveMotion"]


@dataclass(frozen=True, eq=False)
class DriveLaw:
    """z(t) = constant + slope t + Re Σ_j modes_j exp(λ_j t), t from the start of the interval.

    `constant`, `slope` (h), `modes` (h × eigenvalues, complex); `u0`, `u_slope` (k) the input. Many
    motions at once have these shapes behind their own (…).
    """

    constant: np.ndarray
    slope: np.ndarray
    modes: np.ndarray
    u0: np.ndarray
    u_slope: np.ndarray


class DriveMotion:
    """Closed-form motion of ż = A z + B u, P = C z + D u, for u linear in time.

    `scale` (h) is the typical size of the drive's states; h = 0 for a drive that follows at once.
    """

    def __init__(self, drive: DriveMatrices, scale: np.ndarray) -> None:
        self.drive, self.scale = drive, scale
        rates, shapes = np.linalg.eig(drive.A * scale / scale[:, None])
        self._shapes, self._upper = shapes, rates.imag >= 0  # of each complex pair, one is enough
        self.rates = rates[self._upper]
        self._weight = np.where(self.rates.imag > 0, 2.0, 1.0)

    @property
    def condition(self) -> float:
        """Condition of the eigenvectors: huge where modes coincide and the form below fails."""
        return float(np.linalg.cond(self._shapes)) if len(self._shapes) else 1.0

    def law(self, z: np.ndarray, u0: np.ndarray, u_slope: np.ndarray) -> DriveLaw:
        """The motion from state z (…×h) under the input u0 + u_slope t (…×k)."""
        A, B = self.drive.A, self.drive.B
        slope = -_solve(A, u_slope @ B.T)
        constant = _solve(A, slope - u0 @ B.T)
        share = _solve(self._shapes, (z - constant) / self.scale)
        modes = self._shapes[:, self._upper] * share[..., None, self._upper] * self._weight
        return DriveLaw(constant, slope, self.scale[:, None] * modes, u0, u_slope)

    def states(self, law: DriveLaw, times: np.ndarray) -> np.ndarray:
        """States z (…×K×h) at the times (…×K)."""
        waves = np.exp(times[..., None] * self.rates) @ np.swapaxes(law.modes, -1, -2)
        straight = law.constant[..., None, :] + times[..., None] * law.slope[..., None, :]
        return np.asarray(straight + waves.real)

    def pressures(self, z: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Unit pressures (K×m, Pa) at states z (K×h) and inputs u (K×k)."""
        return np.asarray(z @ self.drive.C.T + u @ self.drive.D.T)

    # --- as CasADi expressions -----------------------------------------------------------------

    @property
    def _oscillates(self) -> np.ndarray:
        return np.flatnonzero(self.rates.imag > 0)

    @property
    def coefficients(self) -> int:
        """Length of `pressure_coefficients`."""
        return len(self.drive.C) * (2 + len(self.rates) + len(self._oscillates))

    def pressure_coefficients(self, law: DriveLaw) -> np.ndarray:
        """What `pressure` needs to know of a motion."""
        C, D = self.drive.C, self.drive.D
        waves = C @ law.modes
        columns = [C @ law.constant + D @ law.u0, C @ law.slope + D @ law.u_slope]
        parts = [np.stack(columns, 1), waves.real, -waves.imag[:, self._oscillates]]
        return np.hstack(parts).ravel(order="F")

    def pressure(self, coefficients: Any, time: Any) -> Any:
        """Unit pressures (m, Pa) at a time, both symbolic."""
        decays, turns = self.rates.real, self.rates.imag
        cosines = [ca.cos(turn * time) if turn else 1.0 for turn in turns]
        basis = [ca.MX(1), time]
        basis += [ca.exp(decays[j] * time) * cosines[j] for j in range(len(decays))]
        basis += [ca.exp(decays[j] * time) * ca.sin(turns[j] * time) for j in self._oscillates]
        return ca.reshape(coefficients, len(self.drive.C), len(basis)) @ ca.vertcat(*basis)


def _solve(matrix: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Solutions (…×h) for vectors (…×h)."""
    found = np.linalg.solve(matrix, np.atleast_2d(vectors)[..., None])[..., 0]
    return np.asarray(found.reshape(vectors.shape))
