"""Faults that a run can be given by name and time: of sensors, of motors, of time, of the solver.

Each is a small object that is active from `start` for `duration` seconds and changes one thing on
its way: a sample, the input that acts, the ticks at which the controller wakes, the controller.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from softmpc.errors import InputError, unknown_name
from softmpc.estimation.sensing import Sample
from softmpc.estimation.sensors import SENSORS, TICK

__all__ = [
    "FAULTS", "Absent", "ActuatorFault", "BudgetOverrun", "Fault", "Frozen", "Jitter",
    "NotANumber", "PayloadDropped", "Scaled", "SensorFault", "SolverCap", "Spike", "Stuck",
]  # fmt: skip

Array = np.ndarray
LONGEST = 3600.0  # s


@dataclass(frozen=True)
class Fault:
    """Something that goes wrong at `start` (s) for `duration` (s)."""

    name: ClassVar[str]

    start: float
    duration: float

    def __post_init__(self) -> None:
        self._require("start", 0.0, LONGEST, "s")
        self._require("duration", 0.0, LONGEST, "s")

    def _require(self, key: str, low: float, high: float, unit: str) -> None:
        value = getattr(self, key)
        if not low <= value <= high:
            raise InputError(
                f"fault {self.name!r}: {key} = {value!r}: must be from {low:g} to {high:g} {unit}"
            )

    @property
    def ticks(self) -> tuple[int, int]:
        """Its first tick, and the first after it."""
        return round(self.start / TICK), round((self.start + self.duration) / TICK)

    def active(self, tick: int) -> bool:
        first, after = self.ticks
        return first <= tick < after

    def check(self, sensors: Sequence[str], inputs: int) -> None:
        """Raise `InputError` where a rig with these sensors and so many inputs cannot have it."""

    def __str__(self) -> str:
        return f"{self.name} from {self.start:g} s for {self.duration:g} s"


# ---------------------------------------------------------------- of sensors


@dataclass(frozen=True)
class SensorFault(Fault, ABC):
    """Something wrong with the readings of one kind of sensor."""

    sensor: str = "section_tips"

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.sensor not in SENSORS:
            raise InputError(unknown_name(f"sensor of fault {self.name!r}", self.sensor, SENSORS))

    def check(self, sensors: Sequence[str], inputs: int) -> None:
        if self.sensor not in sensors:
            raise InputError(
                f"fault {self.name!r}: the rig has no sensor {self.sensor!r}, only "
                f"{', '.join(sensors)}"
            )

    @abstractmethod
    def changed(self, sample: Sample, before: Sample | None) -> Sample | None:
        """The sample that arrives instead; `before` is the last one ahead of the fault."""

    def __str__(self) -> str:
        return f"{self.sensor}: {super().__str__()}"


@dataclass(frozen=True)
class NotANumber(SensorFault):
    """Readings are NaN."""

    name: ClassVar[str] = "nan"

    def changed(self, sample: Sample, before: Sample | None) -> Sample:
        return replace(sample, value=np.full_like(sample.value, np.nan))


@dataclass(frozen=True)
class Frozen(SensorFault):
    """Readings stay as the last one was."""

    name: ClassVar[str] = "frozen"

    def changed(self, sample: Sample, before: Sample | None) -> Sample:
        return sample if before is None else replace(sample, value=before.value.copy())


@dataclass(frozen=True)
class Absent(SensorFault):
    """Readings do not arrive."""

    name: ClassVar[str] = "absent"

    def changed(self, sample: Sample, before: Sample | None) -> None:
        return None


@dataclass(frozen=True)
class Spike(SensorFault):
    """Readings are off by `size` (SI), every value in the same direction."""

    name: ClassVar[str] = "spike"
    size: float = 0.1

    def __post_init__(self) -> None:
        super().__post_init__()
        self._require("size", -1e12, 1e12, "in the sensor's unit")

    def changed(self, sample: Sample, before: Sample | None) -> Sample:
        return replace(sample, value=sample.value + self.size)


# ---------------------------------------------------------------- of motors


@dataclass(frozen=True)
class ActuatorFault(Fault, ABC):
    """Something wrong with the input on its way to the arm; `units` from 1, all without any."""

    units: tuple[int, ...] = ()

    def rows(self, inputs: int) -> list[int]:
        """Places of its units among the inputs."""
        chosen = self.units or tuple(range(1, inputs + 1))
        if not set(chosen) <= set(range(1, inputs + 1)):
            raise InputError(f"fault {self.name!r}: units = {chosen}: must be from 1 to {inputs}")
        return [unit - 1 for unit in chosen]

    def check(self, sensors: Sequence[str], inputs: int) -> None:
        self.rows(inputs)

    @abstractmethod
    def acting(self, u: Array, before: Array) -> Array:
        """What acts instead of u (k); `before` acted when the fault began."""


@dataclass(frozen=True)
class Stuck(ActuatorFault):
    """Motors hold what they did when the fault began."""

    name: ClassVar[str] = "stuck"

    def acting(self, u: Array, before: Array) -> Array:
        rows = self.rows(len(u))
        found = u.copy()
        found[rows] = before[rows]
        return found


@dataclass(frozen=True)
class Scaled(ActuatorFault):
    """Motors give `factor` times what they are told."""

    name: ClassVar[str] = "scaled"
    factor: float = 0.7

    def __post_init__(self) -> None:
        super().__post_init__()
        self._require("factor", 0.0, 10.0, "times")

    def acting(self, u: Array, before: Array) -> Array:
        found = u.copy()
        found[self.rows(len(u))] *= self.factor
        return found


# ---------------------------------------------------------------- of time, load and controller


@dataclass(frozen=True)
class Jitter(Fault):
    """The controller wakes up to `most` seconds late, and does not know."""

    name: ClassVar[str] = "jitter"
    most: float = 5e-3

    def __post_init__(self) -> None:
        super().__post_init__()
        self._require("most", 0.0, 1.0, "s")


@dataclass(frozen=True)
class PayloadDropped(Fault):
    """The payload of the plant's scene is gone, and comes back after `duration`."""

    name: ClassVar[str] = "payload_dropped"


@dataclass(frozen=True)
class SolverCap(Fault):
    """The solver stops before it is done."""

    name: ClassVar[str] = "solver_cap"


@dataclass(frozen=True)
class BudgetOverrun(Fault):
    """No time is left to the controller."""

    name: ClassVar[str] = "budget_overrun"


FAULTS: dict[str, type[Fault]] = {
    kind.name: kind
    for kind in (
        NotANumber, Frozen, Absent, Spike, Stuck, Scaled, Jitter, PayloadDropped, SolverCap,
        BudgetOverrun,
    )
}  # fmt: skip
