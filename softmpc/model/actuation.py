"""What drives the arm: the actuation slot of a scene.

Each kind turns an input, one a unit, into unit pressures through linear matrices:
ż = A z + B u, P = C z + D u. A kind without states has none: empty matrices, not zero ones.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from softmpc.errors import BuildError
from softmpc.model.hydraulics import UNIT_STATES, DriveMatrices, unit_matrices

if TYPE_CHECKING:
    from softmpc.model.parameters import Manipulator

__all__ = ["Actuation", "HydraulicDrive", "PressureDrive", "StaticDrive"]


class Actuation(ABC):
    """How inputs become pressures."""

    name: ClassVar[str]
    input: ClassVar[str] = "torque"  # or "pressure"
    states: ClassVar[tuple[str, ...]] = ()  # of one unit

    @abstractmethod
    def matrices(self, arm: Manipulator) -> DriveMatrices:
        """Matrices of all units; states ordered by kind, then by unit."""


@dataclass(frozen=True)
class PressureDrive(Actuation):
    """Unit pressures are the inputs (Pa)."""

    name: ClassVar[str] = "pressure"
    input: ClassVar[str] = "pressure"

    def matrices(self, arm: Manipulator) -> DriveMatrices:
        return _stateless(np.eye(arm.units))


@dataclass(frozen=True)
class StaticDrive(Actuation):
    """Pressure follows torque at once, with the static gain of the hydraulics."""

    name: ClassVar[str] = "static"

    def matrices(self, arm: Manipulator) -> DriveMatrices:
        full = HydraulicDrive().matrices(arm)
        return _stateless(full.D - full.C @ np.linalg.solve(full.A, full.B))


@dataclass(frozen=True)
class HydraulicDrive(Actuation):
    """Motor, screw, piston, cylinder, tube and chamber: (32)-(36) without Coulomb friction."""

    name: ClassVar[str] = "hydraulic"
    states: ClassVar[tuple[str, ...]] = UNIT_STATES

    def matrices(self, arm: Manipulator) -> DriveMatrices:
        if arm.hydraulics.friction != 0.0:
            raise BuildError(
                f"hydraulics.friction = {arm.hydraulics.friction:g} N: the linear drive "
                "'hydraulic' has no Coulomb friction; set it to 0 or leave it out"
            )
        units = [
            unit_matrices(section, arm.hydraulics)
            for section in arm.sections
            for _ in range(section.units)
        ]
        return DriveMatrices(
            *(_by_kind([getattr(u, name) for u in units]) for name in ("A", "B", "C", "D", "X"))
        )


def _stateless(gain: np.ndarray) -> DriveMatrices:
    n = len(gain)
    return DriveMatrices(
        np.zeros((0, 0)), np.zeros((0, n)), np.zeros((n, 0)), gain, np.zeros((0, 0))
    )


def _by_kind(blocks: list[np.ndarray]) -> np.ndarray:
    """Block-diagonal matrix whose rows and columns are ordered by kind first, then by unit."""
    n = len(blocks)
    rows, columns = blocks[0].shape
    whole = np.zeros((rows * n, columns * n))
    for unit, block in enumerate(blocks):
        whole[unit::n, unit::n] = block
    return whole
