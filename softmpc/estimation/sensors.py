"""Sensors of a rig: what each reads of a model's state, how often, how late and how well.

One description serves twice: a plant's model says what the sensor would read, the estimator's
model what it is expected to read.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from softmpc.compiled import compiled
from softmpc.control.buffered import Buffered
from softmpc.errors import InputError
from softmpc.model.model import Model

__all__ = [
    "SENSORS", "TICK", "CylinderPressures", "MotorTorque", "PistonSpeed", "Reading", "Sensor",
    "SectionTips", "UnitPressures", "require_ticks",
]  # fmt: skip

Array = np.ndarray
TICK = 1e-3  # s: sensors sample, and their readings arrive, at whole ticks
LEAST = 1e-6  # noise of a sensor that has none, as a share of what a variable of full size changes


@dataclass(frozen=True)
class Sensor(ABC):
    """A kind of sensor: `rate` (Hz), `latency` (s), `noise` (standard deviation, SI).

    `dropout` is the share of samples that never arrive, `bias` (SI) is added to each value, and
    `seed` makes its noise differ from that of other sensors and runs. Raises `InputError` for a
    period that is no whole number of milliseconds.
    """

    name: ClassVar[str]
    unit: ClassVar[str]
    fastest: ClassVar[float] = np.inf  # change a second of a value that no arm exceeds

    rate: float = 100.0
    latency: float = 0.0
    noise: float = 0.0
    dropout: float = 0.0
    bias: tuple[float, ...] = ()
    seed: int = 0

    def __post_init__(self) -> None:
        _require(self, "rate", 0.1, 1000.0, "Hz")
        _require(self, "latency", 0.0, 1.0, "s")
        _require(self, "noise", 0.0, np.inf, self.unit)
        _require(self, "dropout", 0.0, 1.0, "")
        ticks = 1.0 / (self.rate * TICK)
        if abs(ticks - round(ticks)) > 1e-6 * ticks:
            raise InputError(
                f"{self.name}: rate = {self.rate:g} Hz is a sample every {ticks:.4g} ms; "
                f"must be a whole number of them, such as {1e3 / max(1, round(ticks)):.4g} Hz"
            )
        require_ticks(f"{self.name}: latency", self.latency)
        if not np.all(np.isfinite(self.bias)):
            raise InputError(f"{self.name}: bias = {self.bias}: all must be finite numbers")

    @property
    def period(self) -> int:
        """Ticks between two samples."""
        return round(1.0 / (self.rate * TICK))

    @property
    def delay(self) -> int:
        """Ticks from a sample to its arrival."""
        return round(self.latency / TICK)

    @abstractmethod
    def reading(self, model: Model) -> Reading:
        """What it reads of this model; raises `InputError` where the model has no such thing."""

    def variances(self, reading: Reading, model: Model) -> Array:
        """Of each value it reads of a model.

        One that says it has no noise gets a little, so that a filter has something to weigh.
        """
        layout = model.layout
        slope = reading(np.zeros(len(layout.x)), np.zeros(len(layout.u)))[1] * layout.x.scale
        size = max(np.abs(slope).max(), np.abs(reading.by_u * layout.u.scale).max())
        return np.full(len(slope), max(self.noise, LEAST * size) ** 2)

    def offset(self, size: int) -> Array:
        """The bias of each value."""
        if len(self.bias) not in (0, 1, size):
            raise InputError(
                f"{self.name}: bias has {len(self.bias)} numbers; it needs one, or {size}"
            )
        return np.zeros(size) + (np.array(self.bias) if self.bias else 0.0)


def require_ticks(what: str, seconds: float) -> None:
    """Raise `InputError` for a time that is not a whole number of milliseconds."""
    ticks = seconds / TICK
    if abs(ticks - round(ticks)) > 1e-6 * max(ticks, 1.0):
        raise InputError(
            f"{what} = {seconds:g} s: must be a whole number of milliseconds, such as "
            f"{round(ticks) * TICK:g} s"
        )


def _require(sensor: Sensor, key: str, low: float, high: float, unit: str) -> None:
    value = getattr(sensor, key)
    if not low <= value <= high:
        raise InputError(
            f"{sensor.name}: {key} = {value!r}: must be from {low:g} to {high:g} {unit}".rstrip()
        )


@dataclass(frozen=True)
class Reading:
    """Values y (ny) as a function of state x and input u: `by_x x + by_u u`, and of strains."""

    names: tuple[str, ...]
    by_x: Array  # ny×nx
    by_u: Array  # ny×k
    strains: int = 0
    of_strains: Buffered | None = field(default=None, compare=False)  # q -> y and its slope

    def __call__(self, x: Array, u: Array) -> tuple[Array, Array]:
        """Values, and their slope in x; SI."""
        if self.of_strains is None:
            return self.by_x @ x + self.by_u @ u, self.by_x
        y, J = self.of_strains(x[: self.strains])
        slope = np.zeros((y.size, len(x)))
        slope[:, : self.strains] = J.reshape(self.strains, -1).T
        return y.ravel().copy(), slope


# ---------------------------------------------------------------- the kinds


@dataclass(frozen=True)
class SectionTips(Sensor):
    """Places of the tips of sections in the base frame, by a camera; (x, y, z) of each."""

    name: ClassVar[str] = "section_tips"
    unit: ClassVar[str] = "m"
    fastest: ClassVar[float] = 3.0
    noise: float = 5e-4
    sections: tuple[int, ...] = ()  # 1, 2, …; all without any

    def rows(self, model: Model) -> list[int]:
        """Which of the coordinates (3S) of the tips of all sections it reads."""
        count = len(model.scene.manipulator.sections)
        chosen = self.sections or tuple(range(1, count + 1))
        if not set(chosen) <= set(range(1, count + 1)):
            raise InputError(f"section_tips: sections = {chosen}: must be from 1 to {count}")
        return [3 * (section - 1) + axis for section in chosen for axis in range(3)]

    def reading(self, model: Model) -> Reading:
        rows = self.rows(model)
        names = tuple(f"{'xyz'[row % 3]} of tip {row // 3 + 1}" for row in rows)
        none = (
            np.zeros((len(rows), len(model.layout.x))),
            np.zeros((len(rows), len(model.layout.u))),
        )
        return Reading(names, *none, model.strains, _tips(model, rows))


def _tips(model: Model, rows: Sequence[int]) -> Buffered:
    import casadi as ca

    q = ca.SX.sym("q", model.strains)
    places = ca.vec(model.frames(q)[0])[list(rows)]
    J = ca.densify(model.tip_jacobian(q)[list(rows), :])
    return Buffered(compiled(ca.Function("tips_seen", [q], [places, J], {"cse": True})))


@dataclass(frozen=True)
class UnitPressures(Sensor):
    """Pressures in the units of the arm."""

    name: ClassVar[str] = "unit_pressures"
    unit: ClassVar[str] = "Pa"
    noise: float = 5e3

    def reading(self, model: Model) -> Reading:
        names = model.layout.p.names
        by_x = np.zeros((len(names), len(model.layout.x)))
        by_x[:, 2 * model.strains :] = model.drive.C
        return Reading(names, by_x, model.drive.D)


@dataclass(frozen=True)
class _DriveState(Sensor):
    """One kind of drive state of each unit."""

    state: ClassVar[str]

    def reading(self, model: Model) -> Reading:
        names = model.layout.x.names
        rows = [i for i, name in enumerate(names) if name.rsplit("_", 1)[0] == self.state]
        if not rows:
            raise InputError(
                f"{self.name}: the drive {model.scene.actuation.name!r} has no {self.state}; "
                "leave this sensor out, or take a drive with pistons"
            )
        return Reading(
            tuple(names[i] for i in rows), np.eye(len(names))[rows],
            np.zeros((len(rows), len(model.layout.u))),
        )  # fmt: skip


@dataclass(frozen=True)
class CylinderPressures(_DriveState):
    """Pressures in the cylinders of the drive."""

    name: ClassVar[str] = "cylinder_pressures"
    unit: ClassVar[str] = "Pa"
    state: ClassVar[str] = "P_c"
    noise: float = 5e3


@dataclass(frozen=True)
class PistonSpeed(_DriveState):
    """Speeds of the pistons."""

    name: ClassVar[str] = "piston_speed"
    unit: ClassVar[str] = "m/s"
    state: ClassVar[str] = "piston_speed"
    noise: float = 1e-3


@dataclass(frozen=True)
class MotorTorque(Sensor):
    """Torques of the motors, or the pressures that take their place."""

    name: ClassVar[str] = "motor_torque"
    unit: ClassVar[str] = "N·m"
    noise: float = 0.02

    def reading(self, model: Model) -> Reading:
        names = model.layout.u.names
        return Reading(names, np.zeros((len(names), len(model.layout.x))), np.eye(len(names)))


SENSORS: dict[str, type[Sensor]] = {
    kind.name: kind
    for kind in (SectionTips, UnitPressures, CylinderPressures, PistonSpeed, MotorTorque)
}
