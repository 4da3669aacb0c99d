"""The drive of a model as functions: its motion, its rest, the place of its pistons.

A linear drive is dz/dt = A z + B u, whatever the arm does. Effects may bend that law or let the arm
act back; then `drive_rate` holds, and A and B are its linearisation at rest. P = C z + D u always.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

if TYPE_CHECKING:
    from softmpc.model.chain import Chain
    from softmpc.model.hydraulics import DriveMatrices
    from softmpc.model.scene import Scene

__all__ = ["DriveFunctions", "sparse_times"]


def sparse_times(matrix: np.ndarray, vector: Any) -> Any:
    """Constant matrix times a CasADi vector; its zeros leave no instruction."""
    return ca.mtimes(ca.sparsify(ca.DM(matrix)), vector)


class DriveFunctions:
    """What a model knows of its drive; h drive states z, k inputs u, n strains q and rates dq."""

    scene: Scene
    chain: Chain
    drive: DriveMatrices

    @property
    def drive_is_linear(self) -> bool:
        """Whether dz/dt = A z + B u holds exactly and the arm does not act back on the drive."""
        return not self.drive_nonlinear

    @property
    def drive_nonlinear(self) -> tuple[str, ...]:
        """Names of what keeps the drive from being linear and one-way."""
        return ()

    @cached_property
    def _drive_symbols(self) -> dict[str, ca.SX]:
        h, k, n = len(self.drive.A), self.drive.D.shape[1], self.chain.size
        sizes = {"z": h, "u": k, "q": n, "dq": n}
        return {name: ca.SX.sym(name, size) for name, size in sizes.items()}

    @cached_property
    def _drive_rate(self) -> ca.SX:
        z, u, _, _ = self._drive_symbols.values()
        if not len(self.drive.A):
            return ca.SX(0, 1)
        return sparse_times(self.drive.A, z) + sparse_times(self.drive.B, u)

    def _drive_function(self, name: str, outputs: dict[str, Any], *inputs: str) -> ca.Function:
        given = {key: self._drive_symbols[key] for key in inputs or self._drive_symbols}
        return ca.Function(
            name, [*given.values()], [*outputs.values()], [*given], [*outputs], {"cse": True}
        )

    @cached_property
    def drive_rate(self) -> ca.Function:
        """(z, u, q, dq) -> dz/dt (h)."""
        return self._drive_function("drive_rate", {"dz": self._drive_rate})

    @cached_property
    def drive_jacobian(self) -> ca.Function:
        """(z, u, q, dq) -> ∂(dz/dt)/∂z (h×h), /∂q and /∂dq (h×n); no nonzero where none is."""
        s = self._drive_symbols
        blocks = {f"by_{x}": ca.jacobian(self._drive_rate, s[x]) for x in ("z", "q", "dq")}
        return self._drive_function("drive_jacobian", blocks)

    def drive_rest(self, u: Any, q: Any = None) -> np.ndarray:
        """States z (h) in balance with held inputs u (k), at the posture q (n; straight)."""
        return np.asarray(self.drive.at_rest(np.asarray(u, dtype=float)))

    def pressures(self, z: Any, u: Any) -> Any:
        """Unit pressures P = C z + D u (Pa), of CasADi expressions."""
        parts = [sparse_times(G, v) for G, v in ((self.drive.C, z), (self.drive.D, u)) if np.any(G)]
        return sum(parts[1:], parts[0])
