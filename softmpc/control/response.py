"""How the tip answers small changes of the inputs near a posture at rest, over frequency.

    tip(ω) = G(ω) u(ω),  G = J (K + iω D - ω² M)⁻¹ (∂τ/∂P) (C (iω - A)⁻¹ B + D_u)

K, D, M are the derivatives of the residual, A to D_u the matrices of the drive.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from softmpc.model.model import Model

__all__ = ["Response"]

LOG = logging.getLogger(__name__)

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Response:
    """A model linearised at rest with strains `q` (n) and unit pressures (m, Pa)."""

    model: Model
    q: Array
    pressures: Array

    @cached_property
    def _slopes(self) -> tuple[Array, Array, Array, Array]:
        """K, D, M (n×n) and ∂τ/∂P (n×m)."""
        still = np.zeros(self.model.strains)
        K, D, M, by_p = self.model.residual_jacobian(self.q, still, still, self.pressures)
        return np.asarray(K), np.asarray(D), np.asarray(M), -np.asarray(by_p)

    @cached_property
    def _tip(self) -> Array:
        return np.asarray(self.model.tip_jacobian(self.q))[-3:]

    def __call__(self, omega: float) -> Array:
        """G (3×k, complex), m per unit of input, at an angular frequency (rad/s)."""
        return np.asarray(self._tip @ self.strains(omega))

    def strains(self, omega: float) -> Array:
        """The same of the strains (n×k)."""
        K, D, M, by_p = self._slopes
        drive, s = self.model.drive, 1j * omega
        pressures = drive.D + 0 * s
        if len(drive.A):
            pressures = pressures + drive.C @ np.linalg.solve(
                s * np.eye(len(drive.A)) - drive.A, drive.B
            )
        return np.asarray(np.linalg.solve(K + s * D + s**2 * M, by_p @ pressures))

    @cached_property
    def arm_poles(self) -> Array:
        """Poles of the arm (1/s), slowest first; empty where it follows at once."""
        K, D, M, _ = self._slopes
        n, order = len(K), self.model.order
        if order == 0:
            return np.zeros(0, complex)
        if order == 1:
            poles = np.linalg.eigvals(-np.linalg.solve(D, K))
        else:
            to_rates = -np.linalg.solve(M, np.hstack([K, D]))
            poles = np.linalg.eigvals(np.block([[np.zeros((n, n)), np.eye(n)], [to_rates]]))
        return _slowest_first(poles)

    def warn_of_short_sight(self, ahead: float) -> None:
        """Say where a horizon (s) ends before the arm has answered: the loop may swing."""
        poles = np.abs(self.arm_poles[:1])
        if len(poles) and ahead * poles[0] < 1:
            LOG.warning(
                "the controller looks %.3g s ahead and the arm takes %.3g s to answer: if it "
                "swings, give it a longer horizon or step in [track.controller]",
                ahead, 1 / poles[0] if poles[0] else np.inf,
            )  # fmt: skip

    @cached_property
    def drive_poles(self) -> Array:
        """Poles of the drive (1/s), slowest first; empty where it follows at once."""
        return _slowest_first(np.linalg.eigvals(self.model.drive.A))


def _slowest_first(poles: Array) -> Array:
    return np.asarray(poles)[np.argsort(np.abs(poles))]
