"""What drives the arm: the actuation slot of a scene.

Each kind turns an input, one a unit, into unit pressures through linear matrices:
ż = A z + B u, P = C z + D u. A kind without states has none: empty matrices, not zero ones.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from softmpc.errors import BuildError
from softmpc.model.hydraulics import UNIT_STATES, DriveMatrices, slow_mode, unit_matrices

if TYPE_CHECKING:
    from softmpc.model.parameters import Hydraulics, Manipulator, Section

__all__ = ["Actuation", "HydraulicDrive", "PressureDrive", "SlowDrive", "StaticDrive"]


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
        return _stateless(HydraulicDrive().matrices(arm).static_gain)


@dataclass(frozen=True)
class HydraulicDrive(Actuation):
    """Motor, screw, piston, cylinder, tube and chamber: (32)-(36) without Coulomb friction."""

    name: ClassVar[str] = "hydraulic"
    states: ClassVar[tuple[str, ...]] = UNIT_STATES

    def matrices(self, arm: Manipulator) -> DriveMatrices:
        _refuse_friction(arm, self.name)
        return _all_units(arm, unit_matrices)


@dataclass(frozen=True)
class SlowDrive(Actuation):
    """The slowest mode of the hydraulics, one state a unit; the faster ones follow at once."""

    name: ClassVar[str] = "slow-mode"
    states: ClassVar[tuple[str, ...]] = ("P_slow",)

    def matrices(self, arm: Manipulator) -> DriveMatrices:
        _refuse_friction(arm, self.name)
        return _all_units(arm, slow_mode)


def _refuse_friction(arm: Manipulator, name: str) -> None:
    if arm.hydraulics.friction != 0.0:
        raise BuildError(
            f"hydraulics.friction = {arm.hydraulics.friction:g} N: the linear drive "
            f"{name!r} has no Coulomb friction; set it to 0 or leave it out"
        )


def _all_units(
    arm: Manipulator, unit: Callable[[Section, Hydraulics], DriveMatrices]
) -> DriveMatrices:
    units = []
    for section in arm.sections:
        units += [unit(section, arm.hydraulics)] * section.units
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
