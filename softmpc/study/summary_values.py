"""Numbers that papers print: angles, radii, pressures, settling times, as observations."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import degrees, isfinite
from typing import Any

import numpy as np

from softmpc.errors import InputError, SoftmpcError, unknown_name
from softmpc.model.hydraulics import screw_ratio
from softmpc.model.scene import STRAINS, Scene
from softmpc.model.shape import shape_parameters
from softmpc.simulation.inputs import InputProfile
from softmpc.simulation.settling import overshoot, settling_time
from softmpc.study.arm_at import ArmAt, Motion
from softmpc.study.observations import check_without, numbers_of, pressures_at_rest

__all__ = ["QUANTITIES", "SENSES", "MotionCase", "SummaryValue"]

MPA = 1e6
SENSES = ("=", "<", ">")


@dataclass(frozen=True, eq=False)
class MotionCase:
    """Inputs over time, and how long to watch: what [simulate] of a scene file says."""

    name: str
    profile: InputProfile
    duration: float
    sample_time: float = 0.01
    start: str = "rest"

    @property
    def times(self) -> np.ndarray:
        """Times of the samples (s)."""
        return self.sample_time * np.arange(1 + round(self.duration / self.sample_time))


@dataclass(frozen=True, eq=False)
class SummaryValue:
    """One number of `QUANTITIES`, printed as equal to `value`, below or above it.

    Rests need `pressures` (Pa) or `torques` (N·m), one a unit; shapes a `section`, pressures of the
    drive a `unit`, both counted from 1; settling times and overshoots a `motion`.
    """

    quantity: str
    value: float
    sigma: float
    sense: str = "="
    section: int = 1
    unit: int = 1
    pressures: Sequence[float] | None = None
    torques: Sequence[float] | None = None
    motion: MotionCase | None = None
    without: tuple[str, ...] = ()
    name: str = ""
    counts: bool = True

    @cached_property
    def names(self) -> tuple[str, ...]:
        return (self.name or self.quantity,)

    @cached_property
    def values(self) -> np.ndarray:
        return np.array([float(self.value)])

    @cached_property
    def sigmas(self) -> np.ndarray:
        return np.array([float(self.sigma)])

    @cached_property
    def senses(self) -> tuple[str, ...]:
        return (self.sense,)

    def check(self, scene: Scene) -> None:
        name = self.names[0]
        if self.quantity not in QUANTITIES:
            raise InputError(f"{name}: {unknown_name('quantity', self.quantity, QUANTITIES)}")
        if self.sense not in SENSES:
            raise InputError(f"{name}: {unknown_name('sense', self.sense, SENSES)}")
        if not (isfinite(self.value) and isfinite(self.sigma) and self.sigma > 0):
            raise InputError(
                f"{name}: {self.value:g} with sigma = {self.sigma:g}: must be finite, sigma above 0"
            )
        check_without(scene, self.without, name)
        for what, given, most in (
            ("section", self.section, len(scene.manipulator.sections)),
            ("unit", self.unit, scene.manipulator.units),
        ):
            if not 1 <= given <= most:
                raise InputError(f"{name}: {what} = {given}: this arm has 1 to {most}")
        QUANTITIES[self.quantity].needs(self, scene)

    def predict(self, arm: ArmAt) -> np.ndarray:
        found = QUANTITIES[self.quantity].value(self, arm)
        if not isfinite(found):
            raise SoftmpcError(f"{self.names[0]}: the arm has no {self.quantity}")
        return np.array([found])


@dataclass(frozen=True)
class Quantity:
    """How a named number is found, its unit, and a check that what it needs is given."""

    unit: str
    value: Callable[[SummaryValue, ArmAt], float]
    needs: Callable[[SummaryValue, Scene], None]
    meaning: str


def _of_rest(given: SummaryValue, scene: Scene) -> None:
    numbers_of(scene, given.names[0], given.pressures, given.torques)


def _of_motion(given: SummaryValue, scene: Scene) -> None:
    if given.motion is None:
        raise InputError(f"{given.names[0]}: {given.quantity} needs a motion")
    if given.motion.profile.units != scene.manipulator.units:
        raise InputError(f"{given.names[0]}: the motion's inputs are those of another arm")


def _of_drive(given: SummaryValue, scene: Scene) -> None:
    numbers_of(scene, given.names[0], None, given.torques)
    _with_screw(given, scene)


def _with_screw(given: SummaryValue, scene: Scene) -> None:
    if scene.actuation.input != "torque":
        raise InputError(
            f"{given.names[0]}: {given.quantity} needs a drive with torques, not "
            f"{scene.actuation.name!r}"
        )


def _shapes(given: SummaryValue, arm: ArmAt) -> list[Any]:
    """Shape of each segment of the section at rest."""
    q = arm.rest(pressures_at_rest(arm, given.pressures, given.torques), given.without)
    scene = arm.scene
    rows = q.reshape(-1, len(scene.strains))[scene.segments * (given.section - 1) :]
    rest = scene.manipulator.sections[given.section - 1].length / scene.segments
    named = [dict(zip(scene.strains, row, strict=True)) for row in rows[: scene.segments]]
    return [shape_parameters(rest, [row.get(k, 0.0) for k in STRAINS]) for row in named]


def _angle(given: SummaryValue, arm: ArmAt) -> float:
    return degrees(sum(shape.theta for shape in _shapes(given, arm)))


def _arc(given: SummaryValue, arm: ArmAt) -> float:
    return float(sum(shape.length for shape in _shapes(given, arm)))


def _radius(given: SummaryValue, arm: ArmAt) -> float:
    shapes = _shapes(given, arm)
    angle = sum(shape.theta for shape in shapes)
    return float(sum(shape.length for shape in shapes) / angle) if angle > 0 else float("inf")


def _pressure(given: SummaryValue, arm: ArmAt) -> float:
    """(η T/s - f)/A_c: the torque raises the pressure against the friction of the piston."""
    drive, torques = arm.scene.manipulator.hydraulics, np.asarray(given.torques, float)
    push = screw_ratio(drive) * torques[given.unit - 1] - drive.friction
    return float(max(push, 0.0) / drive.piston_area / MPA)


def _least_torque(given: SummaryValue, arm: ArmAt) -> float:
    drive = arm.scene.manipulator.hydraulics
    return drive.friction / screw_ratio(drive)


def _moved(given: SummaryValue, arm: ArmAt) -> Motion:
    case = given.motion
    assert case is not None  # checked by `needs`
    return arm.motion(id(case), case.profile, case.times, case.start, given.without)


def _settling(given: SummaryValue, arm: ArmAt) -> float:
    return settling_time(_moved(given, arm))


def _overshoot(given: SummaryValue, arm: ArmAt) -> float:
    return overshoot(_moved(given, arm))


QUANTITIES = {
    "bending_angle": Quantity("deg", _angle, _of_rest, "bending angle of a section at rest"),
    "arc_length": Quantity("m", _arc, _of_rest, "length of a section's centre line at rest"),
    "radius": Quantity("m", _radius, _of_rest, "its length over its bending angle"),
    "pressure": Quantity(
        "MPa", _pressure, _of_drive, "pressure up to which a torque moves the piston"
    ),
    "least_torque": Quantity(
        "N·m", _least_torque, _with_screw, "torque that just overcomes the piston's friction"
    ),
    "settling_time": Quantity(
        "s", _settling, _of_motion, "from the last move of the inputs to 2 % of the tip's way"
    ),
    "overshoot": Quantity("", _overshoot, _of_motion, "swing beyond the end, over the way there"),
}
