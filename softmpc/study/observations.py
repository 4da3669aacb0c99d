"""What was measured or printed, and what an arm would show instead.

Every observation has `names`, `values` and `sigmas` (N each, in the units of its names), and
`predict(arm)` says what the arm at hand gives in their place (N). `senses` says how a value is
meant: "=", or a limit "<" or ">" that costs nothing while it is kept. With `counts` False it is
only set beside the arm, and not fitted.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Protocol

import numpy as np

from softmpc.errors import InputError, unknown_name
from softmpc.model.effects import EFFECTS
from softmpc.model.scene import Scene
from softmpc.simulation.inputs import InputProfile
from softmpc.statics.reach import FAR, too_far
from softmpc.study.arm_at import ArmAt

__all__ = [
    "MotionRecord",
    "Observation",
    "StaticPose",
    "check_without",
    "coordinates_of",
    "numbers_of",
    "pressures_at_rest",
]

MPA = 1e6
ABSURD = 10.0  # times a limit: another unit is meant


class Observation(Protocol):
    """What every kind of data offers."""

    @property
    def names(self) -> tuple[str, ...]: ...
    @property
    def values(self) -> np.ndarray: ...
    @property
    def sigmas(self) -> np.ndarray: ...
    @property
    def senses(self) -> tuple[str, ...]: ...
    @property
    def counts(self) -> bool: ...

    def check(self, scene: Scene) -> None:
        """Raise `InputError` where it does not fit the scene."""
        ...

    def predict(self, arm: ArmAt) -> np.ndarray: ...


@dataclass(frozen=True, eq=False)
class StaticPose:
    """Section tips at rest under pressures (Pa) or torques (N·m), one value a unit.

    `tips` are the coordinates that were measured, by name: `{"x_1": 0.1, "z_2": 0.4}` in m.
    `sigma` is their standard deviation (m), for all or by name. `without` names effects that the
    scene has and the measurement had not.
    """

    tips: Mapping[str, float]
    pressures: Sequence[float] | None = None
    torques: Sequence[float] | None = None
    sigma: float | Mapping[str, float] = 1e-3
    without: tuple[str, ...] = ()
    name: str = "pose"
    counts: bool = True

    @cached_property
    def names(self) -> tuple[str, ...]:
        return tuple(f"{self.name} {key}" for key in self.tips)

    @cached_property
    def values(self) -> np.ndarray:
        return np.array([float(v) for v in self.tips.values()])

    @cached_property
    def sigmas(self) -> np.ndarray:
        return _sigmas(self.sigma, list(self.tips), self.name)

    @cached_property
    def senses(self) -> tuple[str, ...]:
        return ("=",) * len(self.tips)

    def check(self, scene: Scene) -> None:
        _check_values(self)
        check_without(scene, self.without, self.name)
        numbers_of(scene, self.name, self.pressures, self.torques)
        allowed = coordinates_of(scene)
        for key in self.tips:
            if key not in allowed:
                raise InputError(f"{self.name}: {unknown_name('coordinate', key, allowed)}")
            _check_near(scene, self.name, key, float(self.tips[key]))

    def predict(self, arm: ArmAt) -> np.ndarray:
        p = pressures_at_rest(arm, self.pressures, self.torques)
        tips = arm.tips(arm.rest(p, self.without), self.without)
        return np.array([_coordinate(tips, key) for key in self.tips])


@dataclass(frozen=True, eq=False)
class MotionRecord:
    """A motion: inputs over time, and what was measured at times (K, s), nan where nothing was.

    `columns` has K values for each name: tips `x_1`, `y_1`, … in m, unit pressures `P_1`, … in MPa.
    `sigmas_by_kind` are the standard deviations of `tips` (m) and `pressures` (MPa). The motion
    starts at t = 0, at `start` "rest" under the inputs before, or "straight".
    """

    profile: InputProfile
    time: np.ndarray
    columns: Mapping[str, np.ndarray]
    sigmas_by_kind: Mapping[str, float] = field(
        default_factory=lambda: {"tips": 1e-3, "pressures": 5e-3}
    )
    start: str = "rest"
    without: tuple[str, ...] = ()
    name: str = "motion"
    counts: bool = True

    @cached_property
    def _kept(self) -> list[tuple[str, np.ndarray]]:
        """Name of each column, and the indices of its values that are there."""
        return [(key, np.flatnonzero(np.isfinite(v))) for key, v in self.columns.items()]

    @cached_property
    def names(self) -> tuple[str, ...]:
        at = self.time
        return tuple(f"{self.name} {key} at {at[k]:g} s" for key, rows in self._kept for k in rows)

    @cached_property
    def values(self) -> np.ndarray:
        return np.concatenate([np.asarray(self.columns[key])[rows] for key, rows in self._kept])

    @cached_property
    def sigmas(self) -> np.ndarray:
        return np.concatenate([np.full(len(rows), self._sigma(key)) for key, rows in self._kept])

    def _sigma(self, key: str) -> float:
        kind = "pressures" if key.startswith("P") else "tips"
        if kind not in self.sigmas_by_kind:
            raise InputError(f"{self.name}: sigma of {kind} is missing, and {key} is measured")
        return float(self.sigmas_by_kind[kind])

    @cached_property
    def senses(self) -> tuple[str, ...]:
        return ("=",) * len(self.values)

    def check(self, scene: Scene) -> None:
        check_without(scene, self.without, self.name)
        units = scene.manipulator.units
        allowed = [*coordinates_of(scene), *(f"P_{j}" for j in range(1, units + 1))]
        for key in self.columns:
            if key not in allowed:
                raise InputError(f"{self.name}: {unknown_name('column', key, allowed)}")
        if not any(len(rows) for _, rows in self._kept):
            raise InputError(f"{self.name}: no value is measured; columns: {', '.join(allowed)}")
        _check_values(self)
        for key, rows in self._kept:
            if len(rows) and not key.startswith("P"):
                _check_near(scene, self.name, key, np.abs(self.columns[key][rows]).max())
        if self.start not in ("rest", "straight"):
            raise InputError(f"{self.name}: start = {self.start!r}: must be rest or straight")
        if self.profile.units != units:
            raise InputError(f"{self.name}: inputs for {self.profile.units} units, not {units}")
        if len(self.time) == 0 or self.time[0] < 0 or self.time[-1] <= 0:
            raise InputError(f"{self.name}: times must be at least 0 s, and the last one above")

    def predict(self, arm: ArmAt) -> np.ndarray:
        motion = arm.motion(id(self), self.profile, self.time, self.start, self.without)
        return np.concatenate([self._column(motion, key)[rows] for key, rows in self._kept])

    @staticmethod
    def _column(motion: Any, key: str) -> np.ndarray:
        letter, _, number = key.partition("_")
        if letter == "P":
            return np.asarray(motion.p[:, int(number) - 1]) / MPA
        return np.asarray(motion.tips[:, int(number) - 1, "xyz".index(letter)])


def pressures_at_rest(
    arm: ArmAt, pressures: Sequence[float] | None, torques: Sequence[float] | None
) -> np.ndarray:
    """Unit pressures (Pa), those of the drive at rest where torques are given."""
    if pressures is not None:
        return np.asarray(pressures, float)
    model, u = arm.model(), np.asarray(torques, float)
    return np.asarray(model.drive.C @ model.drive_rest(u) + model.drive.D @ u).ravel()


def numbers_of(
    scene: Scene, name: str, pressures: Sequence[float] | None, torques: Sequence[float] | None
) -> None:
    """Check that there is one pressure or one torque for each unit."""
    if (pressures is None) == (torques is None):
        raise InputError(f"{name}: give either pressures or torques")
    given = pressures if pressures is not None else torques
    numbers = np.asarray(given, float).ravel()
    if len(numbers) != scene.manipulator.units or not np.all(np.isfinite(numbers)):
        raise InputError(
            f"{name}: {numbers.tolist()}: must be {scene.manipulator.units} finite numbers, one a "
            "unit"
        )
    if torques is not None and scene.actuation.input != "torque":
        raise InputError(f"{name}: the drive {scene.actuation.name!r} takes pressures, not torques")
    limits, largest = scene.manipulator.limits, float(np.abs(numbers).max())
    what, most, scale, unit = ("pressure", limits.pressure_max, MPA, "MPa")
    if torques is not None:
        what, most, scale, unit = ("torque", limits.torque_max, 1.0, "N·m")
    if largest > ABSURD * abs(most) > 0:
        raise InputError(
            f"{name}: a {what} of {largest / scale:g} {unit} is far beyond the limits of the "
            f"scene, {most / scale:g} {unit} ({what}_max): are these {unit}?"
        )


def check_without(scene: Scene, without: Sequence[str], name: str) -> None:
    """Raise `InputError` for an effect that nobody knows."""
    known: list[Any] = [*scene.effects, *EFFECTS]
    allowed = dict.fromkeys(effect.name for effect in known)
    for effect in without:
        if effect not in allowed:
            raise InputError(f"{name}: without: {unknown_name('effect', effect, allowed)}")


def _check_values(observation: Any) -> None:
    values, sigmas = observation.values, observation.sigmas
    if len(values) == 0:
        raise InputError(f"{observation.name}: no value is measured")
    if not np.all(np.isfinite(values)):
        raise InputError(f"{observation.name}: values {values.tolist()}: must be finite numbers")
    if not (np.all(np.isfinite(sigmas)) and np.all(sigmas > 0)):
        raise InputError(f"{observation.name}: sigma = {sigmas.tolist()}: must be above 0")


def _check_near(scene: Scene, name: str, key: str, value: float) -> None:
    """Raise `InputError` for a coordinate that only another unit explains."""
    place = tuple(value if axis == key[0] else None for axis in "xyz")
    if why := too_far(scene, place, int(key[2:]), FAR):
        raise InputError(f"{name} {key}: {why}")


def _sigmas(sigma: float | Mapping[str, float], keys: list[str], name: str) -> np.ndarray:
    if not isinstance(sigma, Mapping):
        return np.full(len(keys), float(sigma))
    for key in keys:
        if key not in sigma:
            raise InputError(f"{name}: sigma of {key} is missing")
    return np.array([float(sigma[key]) for key in keys])


def coordinates_of(scene: Scene) -> list[str]:
    """Names of the section tips' coordinates."""
    count = len(scene.manipulator.sections)
    return [f"{axis}_{i}" for i in range(1, count + 1) for axis in "xyz"]


def _coordinate(tips: np.ndarray, key: str) -> float:
    letter, _, number = key.partition("_")
    return float(tips[int(number) - 1, "xyz".index(letter)])
