"""An arm without inertia and damping: it is always in the equilibrium of its pressures."""

from __future__ import annotations

from typing import Any

import numpy as np

from softmpc.errors import BuildError
from softmpc.model.model import Model
from softmpc.simulation.drive_motion import DriveMotion
from softmpc.simulation.integrator import IntegrationError, Interval
from softmpc.statics.equilibrium import refine_equilibrium

__all__ = ["Following"]


class Following:
    """Integrator of a model of order 0: only the drive moves in time, and that exactly.

    Raises `BuildError` for a drive that is not linear or that the arm acts back on.
    """

    def __init__(self, model: Model) -> None:
        if not model.drive_is_linear:
            raise BuildError(
                "an arm without inertia and damping follows a linear drive only: leave out "
                f"{', '.join(model.drive_nonlinear)}, or add the effect 'material_damping'"
            )
        self.model = model
        self.drive = DriveMotion(model.drive, model.layout.z.scale)

    def advance(
        self, x: Any, u: Any, duration: float, samples: int = 1, u_end: Any = None
    ) -> np.ndarray:
        """States (samples×nx) after x = (q, dq, z); see `Integrator.advance`.

        q is where the equilibrium is looked for; dq is not used.
        """
        given = Interval(self.model, x, u, duration, samples, u_end)
        law = self.drive.law(given.z, given.u0, given.u_slope)
        z = self.drive.states(law, given.times)
        inputs = given.u0 + np.multiply.outer(given.times, given.u_slope)
        rates = z @ self.model.drive.A.T + inputs @ self.model.drive.B.T
        states, q = [], given.q
        for k in range(samples):
            q = self._posture(self.drive.pressures(z[k], inputs[k]), q)
            dp = self.drive.pressures(rates[k], given.u_slope)
            states.append(np.concatenate([q, self._rate(q, z[k], inputs[k], dp), z[k]]))
        return np.stack(states)

    def prepare(self) -> None:
        """Make the functions now, not with the first step."""
        _ = self.model.balance, self.model.stiffness

    def _posture(self, p: np.ndarray, guess: np.ndarray) -> np.ndarray:
        found = refine_equilibrium(self.model, p.tolist(), guess.tolist())
        if not found.converged:
            raise IntegrationError(f"statics: {found.status} at {np.round(p / 1e6, 4)} MPa")
        return found.q

    def _rate(self, q: np.ndarray, z: np.ndarray, u: np.ndarray, dp: np.ndarray) -> np.ndarray:
        """dq/dt (n) from K dq + ∂r/∂p dp = 0."""
        K, by_p = (np.asarray(x) for x in self.model.stiffness(q, self.drive.pressures(z, u)))
        return -np.linalg.solve(K, by_p @ dp)
