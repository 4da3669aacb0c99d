"""What a plan is least in: time, effort or jerk, and its quadratic model.

    time    Σ durations + a little smoothing
    effort  ∫ Σ T² dt = Σ h_k |u_k|²
    jerk    ∫ Σ (dT/dt)² dt, for held inputs Σ |u_k - u_(k-1)|²/h_k

The last two are squares ½|e|², so that eᵀe has an exact Gauss-Newton Hessian for given durations.
All are relative to `size`, what a first motion has.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse

from softmpc.control.trajectory import Moment
from softmpc.planning.mesh import Mesh
from softmpc.planning.motion import Motion

__all__ = ["Objective"]

SMOOTHING = 1e-5  # of the squared changes of scaled inputs, in relative cost: settles what time
# leaves open
ROUNDING = 1e-9  # curvature of the model in every move

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Objective:
    """The objective `least` on one mesh; inputs count in their scales."""

    mesh: Mesh
    moment: Moment
    least: str
    size: float = 1.0

    def amount(self, motion: Motion) -> float:
        """What is least: time (s), effort or jerk (in scaled inputs)."""
        if self.least == "time":
            return motion.time
        e, _ = self._squares(motion)
        return 0.5 * float(e @ e)

    def __call__(self, motion: Motion) -> float:
        """Relative cost."""
        cost = self.amount(motion) / self.size
        if self.least == "time":
            e, _ = self._smoothing(motion)
            cost += 0.5 * float(e @ e)
        return cost

    def model(self, motion: Motion) -> tuple[sparse.csc_matrix, Array]:
        """Hessian and slope of the relative cost in the moves."""
        time = self.least == "time"
        e, E = self._smoothing(motion) if time else self._squares(motion)
        scale = 1.0 if time else 1.0 / self.size
        H = scale * (E.T @ E) + ROUNDING * sparse.eye(self.mesh.moves)
        f = scale * (E.T @ e)
        if time:
            f[-len(motion.durations) :] += 1.0 / self.size
        return H.tocsc(), np.asarray(f).ravel()

    def _change(self, motion: Motion) -> Array:
        _, before = self.moment.before(motion.at)
        return np.asarray((motion.at.u - before).ravel())

    def _smoothing(self, motion: Motion) -> tuple[Array, sparse.csr_matrix]:
        root = np.sqrt(SMOOTHING)
        return root * self._change(motion), root * self.mesh.input_change

    def _squares(self, motion: Motion) -> tuple[Array, sparse.csr_matrix]:
        """e and its slopes in the moves."""
        mesh = self.mesh
        h = np.repeat(mesh.phases.lengths(motion.durations), mesh.t.nu)
        if self.least == "effort":
            u, w = motion.at.u.ravel(), np.sqrt(2 * h)
            return w * u, sparse.diags(w) @ mesh.input_itself + sparse.diags(u / w) @ mesh.length
        change, w = self._change(motion), np.sqrt(2 / h)
        by_time = sparse.diags(-0.5 * w * change / h) @ mesh.length
        return w * change, sparse.diags(w) @ mesh.input_change + by_time
