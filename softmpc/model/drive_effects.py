"""Effects of the hydraulics that (32)-(36) leave out: what each is and its parameters.

The laws are in `hydraulics` (those that stay linear) and in `drive_laws`. A scene that leaves an
effect out has no state and no instruction for it. All need a drive with pistons.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, TypeVar

from softmpc.model.effect import Effect
from softmpc.model.quantities import quantity

if TYPE_CHECKING:
    from softmpc.model.parameters import Manipulator

__all__ = [
    "DRIVE_EFFECTS",
    "BackDriving",
    "Cavitation",
    "ChamberCoupling",
    "DriveEffect",
    "EndStops",
    "RotorInertia",
    "TubeInertance",
    "TurbulentLoss",
    "find",
]

E = TypeVar("E", bound=Effect)


@dataclass(frozen=True)
class DriveEffect(Effect):
    """An effect of the drive, not of the arm; `linear` where dz/dt = A z + B u still holds."""

    linear: ClassVar[bool] = False


@dataclass(frozen=True)
class TubeInertance(DriveEffect):
    """Mass of the water in the tube: its flow Q becomes a state, I dQ/dt = P_c − P_a − loss(Q)."""

    name: ClassVar[str] = "tube_inertance"
    linear: ClassVar[bool] = True


@dataclass(frozen=True)
class TurbulentLoss(DriveEffect):
    """Turbulent loss in the tube: laminar at small Reynolds numbers, f = coefficient·Re^(−1/4)."""

    # fmt: off
    name: ClassVar[str] = "turbulent_loss"
    coefficient: float = quantity(
        0.3164, unit="", source="assumed: Blasius, smooth tube", low=0.05, high=5.0,
        doc="Darcy friction factor times Re^(1/4)",
    )
    # fmt: on


@dataclass(frozen=True)
class RotorInertia(DriveEffect):
    """Inertia of motor and screw, which the piston feels as a mass η J/s²."""

    # fmt: off
    name: ClassVar[str] = "rotor_inertia"
    linear: ClassVar[bool] = True
    inertia: float = quantity(
        1e-4, unit="kg·m²", source="assumed: servo motors of 2 to 3 N·m", low=0.0, low_open=True,
        high=10.0, doc="moment of inertia J of all that turns with the motor",
    )
    # fmt: on


@dataclass(frozen=True)
class Cavitation(DriveEffect):
    """Water does not pull: below the vapour pressure a cavity opens, and closes again."""

    # fmt: off
    name: ClassVar[str] = "cavitation"
    vapour_pressure: float = quantity(
        -99e3, unit="Pa", source="assumed: water at 20 °C, 2.3 kPa absolute", low=-1.01e5,
        high=-1e3, doc="vapour pressure of the fluid, gauge",
    )
    band: float = quantity(
        1e3, unit="Pa", source="assumed: absolute pressure stays above zero", low=1.0, high=1e4,
        doc="how far below it the pressure is when the cavity is as large as the chamber",
    )
    # fmt: on


@dataclass(frozen=True)
class EndStops(DriveEffect):
    """Stops at both ends of the piston's travel, from 0 to `limits.stroke_max`."""

    # fmt: off
    name: ClassVar[str] = "end_stops"
    stiffness: float = quantity(
        1e7, unit="N/m", source="assumed: full force of the screw gives 0.2 mm", low=1e3,
        high=1e10, doc="stiffness of a stop",
    )
    rounding: float = quantity(
        1e-4, unit="m", source="assumed: half the travel into the stop", low=1e-7, high=1e-2,
        doc="travel into the stop over which its stiffness builds up",
    )
    start: float = quantity(
        0.0, unit="m", source="deduced: V_2 = A_c stroke_max, the cylinder starts full", low=0.0,
        high=100.0, doc="place of the piston with the arm straight and all pressures zero",
    )
    # fmt: on

    def misfit(self, arm: Manipulator) -> str:
        stroke = arm.limits.stroke_max
        if self.start <= stroke:
            return ""
        return (
            f"EndStops.start = {self.start:g} m: must be at most stroke_max = {stroke:g} m, the "
            "travel of the piston, see [limits]"
        )


@dataclass(frozen=True)
class BackDriving(DriveEffect):
    """Another efficiency of the screw while the load drives it back."""

    # fmt: off
    name: ClassVar[str] = "back_driving"
    efficiency: float = quantity(
        0.13, unit="", source="deduced: 2 − 1/η, a screw with the friction that gives η = 0.535",
        low=0.0, low_open=True, high=1.0, doc="efficiency from piston to motor",
    )
    velocity: float = quantity(
        1e-3, unit="m/s", source="assumed: small against 0.05 m/s of the pistons", low=1e-7,
        high=1.0, doc="backward speed of the piston from which the other efficiency is complete",
    )
    torque: float = quantity(
        1e-2, unit="N·m", source="assumed: small against 2.5 N·m", low=1e-9, high=1e3,
        doc="torque in the screw below which its direction fades out",
    )
    # fmt: on


@dataclass(frozen=True)
class ChamberCoupling(DriveEffect):
    """The arm acts back: its own volume replaces the constant compliance of the wall in (34)."""

    name: ClassVar[str] = "chamber_coupling"


DRIVE_EFFECTS: tuple[type[DriveEffect], ...] = (
    TubeInertance,
    TurbulentLoss,
    RotorInertia,
    Cavitation,
    EndStops,
    BackDriving,
    ChamberCoupling,
)


def find(effects: Iterable[Effect], kind: type[E]) -> E | None:
    """The effect of that class, or None when it is absent."""
    return next((effect for effect in effects if isinstance(effect, kind)), None)
