"""The drive of a model as functions: its motion, its rest, the place of its pistons.

A linear drive is dz/dt = A z + B u, whatever the arm does. Effects may bend that law or let the arm
act back; then `drive_rate` holds, and A and B are its linearisation at rest. P = C z + D u always.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from softmpc.model.drive import chamber_volumes
from softmpc.model.drive_effects import EndStops, find
from softmpc.model.drive_laws import UnitLaw

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
        return self.scene.actuation.nonlinear(self.scene.manipulator, self.scene.effects)

    @cached_property
    def _drive_symbols(self) -> dict[str, ca.SX]:
        h, k, n = len(self.drive.A), self.drive.D.shape[1], self.chain.size
        sizes = {"z": h, "u": k, "q": n, "dq": n}
        return {name: ca.SX.sym(name, size) for name, size in sizes.items()}

    @cached_property
    def _unit_laws(self) -> list[UnitLaw]:
        """One a unit; of a drive with pistons."""
        scene, arm = self.scene, self.scene.manipulator
        friction = "friction" in self.drive_nonlinear
        laws = [UnitLaw(arm, section, scene.effects, friction) for section in arm.sections]
        return [law for law in laws for _ in range(law.section.units)]

    @cached_property
    def _swollen(self) -> ca.SX:
        """How much larger than at the straight arm the arm makes each unit, m³ (m)."""
        arm, q = self.scene.manipulator, self._drive_symbols["q"]
        volumes: list[Any] = [
            ca.SX(ca.DM([-section.unit_area * section.length] * section.units))
            for section in arm.sections
        ]
        for segment in self.chain.segments:
            strains = segment.strains(q)
            parts = chamber_volumes(segment.section, segment.rest, strains[0], strains[1:4])
            volumes[segment.section_index] += ca.vertcat(*parts)
        return ca.vertcat(*volumes)

    @cached_property
    def _drive_rate(self) -> ca.SX:
        z, u, q, dq = self._drive_symbols.values()
        if self.drive_nonlinear:
            swelling = ca.jtimes(self._swollen, q, dq)
            columns = ca.reshape(z, len(self._unit_laws), -1)
            rates = [
                ca.horzcat(
                    *law.rate(ca.horzsplit(columns[j, :]), u[j], swelling[j], self._swollen[j])
                )
                for j, law in enumerate(self._unit_laws)
            ]
            return ca.vec(ca.vertcat(*rates))
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

    @cached_property
    def piston_places(self) -> ca.Function:
        """(z, q) -> x (m, in m), the pistons' places; none for a drive without pistons."""
        z = self._drive_symbols["z"]
        if self.drive_nonlinear:
            columns = ca.reshape(z, len(self._unit_laws), -1)
            places = [
                law.place(columns[j, 1], columns[j, 2], self._swollen[j])
                for j, law in enumerate(self._unit_laws)
            ]
            x = ca.vertcat(*places)
        else:
            x = sparse_times(self.drive.X, z) if len(self.drive.X) else ca.SX(0, 1)
        return self._drive_function("piston_places", {"x": x}, "z", "q")

    @cached_property
    def tube_flows(self) -> ca.Function:
        """z -> flow from cylinder to unit through each tube (m, m³/s); none without tubes."""
        columns = ca.reshape(self._drive_symbols["z"], self.drive.C.shape[0], -1)
        if not len(self.drive.X):
            flows = ca.SX(0, 1)
        elif columns.shape[1] > 3:
            flows = columns[:, 3]
        else:
            parts = [
                law.flow(columns[j, 2] - columns[j, 1]) for j, law in enumerate(self._unit_laws)
            ]
            flows = ca.vertcat(*parts)
        return self._drive_function("tube_flows", {"Q": flows}, "z")

    def drive_rest(self, u: Any, q: Any = None) -> np.ndarray:
        """States z (h) in balance with held inputs u (k), at the posture q (n; straight).

        Only end stops make it another balance than the linear drive's: the pressure at which they
        hold the piston. With `chamber_coupling` that depends on the posture.
        """
        z = np.asarray(self.drive.at_rest(np.asarray(u, dtype=float)))
        if find(self.scene.effects, EndStops) is None:
            return z
        posture = np.zeros(self.chain.size) if q is None else np.asarray(q, dtype=float)
        swollen = self._swelling_at(posture)
        m = len(self._unit_laws)
        for j, law in enumerate(self._unit_laws):
            z[m + j] = z[2 * m + j] = law.rest_pressure(float(z[m + j]), float(swollen[j]))
        return z

    def _swelling_at(self, q: np.ndarray) -> np.ndarray:
        volumes = ca.Function("swollen", [self._drive_symbols["q"]], [self._swollen])
        return np.asarray(volumes(q)).ravel()

    def pressures(self, z: Any, u: Any) -> Any:
        """Unit pressures P = C z + D u (Pa), of CasADi expressions."""
        parts = [sparse_times(G, v) for G, v in ((self.drive.C, z), (self.drive.D, u)) if np.any(G)]
        return sum(parts[1:], parts[0])
