"""What drives the arm: the actuation slot of a scene.

Each kind turns an input, one a unit, into unit pressures: ż = A z + B u, P = C z + D u. Where
friction or an effect bends the first, A and B hold close to rest. A kind without states has empty
matrices, not zero ones.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from softmpc.errors import BuildError, SceneError
from softmpc.model.drive_effects import DriveEffect
from softmpc.model.hydraulics import (
    UNIT_STATES,
    DriveMatrices,
    slow_mode,
    unit_matrices,
    unit_states,
)

if TYPE_CHECKING:
    from softmpc.model.effect import Effect
    from softmpc.model.parameters import Manipulator, Section

__all__ = [
    "Actuation",
    "FrictionDrive",
    "HydraulicDrive",
    "PressureDrive",
    "SlowDrive",
    "StaticDrive",
]


class Actuation(ABC):
    """How inputs become pressures."""

    name: ClassVar[str]
    input: ClassVar[str] = "torque"  # or "pressure"
    states: ClassVar[tuple[str, ...]] = ()  # of one unit, without effects
    takes: ClassVar[str] = "no"  # of the effects of the drive: "no", "linear" or "all" ones

    def unit_states(self, effects: Iterable[Effect]) -> tuple[str, ...]:
        """Names of the states of one unit in a scene with these effects."""
        return self.states

    @abstractmethod
    def matrices(self, arm: Manipulator, effects: Iterable[Effect] = ()) -> DriveMatrices:
        """Matrices of all units, at rest where it is not linear; states by kind, then by unit."""

    def nonlinear(self, arm: Manipulator, effects: Iterable[Effect]) -> tuple[str, ...]:
        """Names of what keeps ż = A z + B u from being exact."""
        return tuple(e.name for e in effects if isinstance(e, DriveEffect) and not e.linear)

    def check(self, effects: Iterable[Effect]) -> None:
        """Raise `SceneError` for an effect of the drive that this drive has no place for."""
        for effect in effects:
            if not isinstance(effect, DriveEffect) or self.takes == "all":
                continue
            if self.takes == "no" or not effect.linear:
                raise SceneError(
                    f"effect {effect.name!r} needs the whole drive, not actuation {self.name!r}: "
                    "set [actuation] kind = 'hydraulic' (or 'hydraulic-friction'), or leave "
                    "the effect out"
                )


@dataclass(frozen=True)
class PressureDrive(Actuation):
    """Unit pressures are the inputs (Pa)."""

    name: ClassVar[str] = "pressure"
    input: ClassVar[str] = "pressure"

    def matrices(self, arm: Manipulator, effects: Iterable[Effect] = ()) -> DriveMatrices:
        return _stateless(np.eye(arm.units))


@dataclass(frozen=True)
class StaticDrive(Actuation):
    """Pressure follows torque at once, with the static gain of the hydraulics."""

    name: ClassVar[str] = "static"

    def matrices(self, arm: Manipulator, effects: Iterable[Effect] = ()) -> DriveMatrices:
        return _stateless(HydraulicDrive().matrices(arm).static_gain)


@dataclass(frozen=True)
class HydraulicDrive(Actuation):
    """Motor, screw, piston, cylinder, tube and chamber: (32)-(36) without Coulomb friction."""

    name: ClassVar[str] = "hydraulic"
    states: ClassVar[tuple[str, ...]] = UNIT_STATES
    takes: ClassVar[str] = "all"

    def unit_states(self, effects: Iterable[Effect]) -> tuple[str, ...]:
        return unit_states(effects)

    def matrices(self, arm: Manipulator, effects: Iterable[Effect] = ()) -> DriveMatrices:
        _refuse_friction(arm, self.name)
        return _all_units(arm, lambda section: unit_matrices(section, arm.hydraulics, effects))


@dataclass(frozen=True)
class FrictionDrive(HydraulicDrive):
    """As `hydraulic`, with Coulomb friction of the piston: f tanh(speed/friction_velocity)."""

    name: ClassVar[str] = "hydraulic-friction"

    def matrices(self, arm: Manipulator, effects: Iterable[Effect] = ()) -> DriveMatrices:
        h = arm.hydraulics
        slope = h.friction / h.friction_velocity  # friction close to rest
        return _all_units(arm, lambda section: unit_matrices(section, h, effects, slope))

    def nonlinear(self, arm: Manipulator, effects: Iterable[Effect]) -> tuple[str, ...]:
        friction = ("friction",) if arm.hydraulics.friction else ()
        return (*friction, *super().nonlinear(arm, effects))


@dataclass(frozen=True)
class SlowDrive(Actuation):
    """The slowest mode of the hydraulics, one state a unit; the faster ones follow at once."""

    name: ClassVar[str] = "slow-mode"
    states: ClassVar[tuple[str, ...]] = ("P_slow",)
    takes: ClassVar[str] = "linear"

    def matrices(self, arm: Manipulator, effects: Iterable[Effect] = ()) -> DriveMatrices:
        _refuse_friction(arm, self.name)
        return _all_units(arm, lambda section: slow_mode(section, arm.hydraulics, effects))


def _refuse_friction(arm: Manipulator, name: str) -> None:
    if arm.hydraulics.friction != 0.0:
        raise BuildError(
            f"hydraulics.friction = {arm.hydraulics.friction:g} N: the linear drive "
            f"{name!r} has no Coulomb friction; take actuation 'hydraulic-friction', "
            "or set it to 0 or leave it out"
        )


def _all_units(arm: Manipulator, unit: Callable[[Section], DriveMatrices]) -> DriveMatrices:
    units = []
    for section in arm.sections:
        units += [unit(section)] * section.units
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
