"""Inputs over time: steps, ramps and tables, one curve a unit, linear between knots.

A step or ramp starts from the value its unit then has, zero before the first, and the value it ends
with is held. Values are motor torques in N·m, or pressures in Pa where the scene's drive takes
pressures.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from softmpc.errors import InputError
from softmpc.model.model import Model

__all__ = ["Curve", "InputProfile", "Ramp", "Step", "TableInput"]

SLACK = 1e-9  # of the largest input, for limits: rounding of a slope times a time


@dataclass(frozen=True)
class Step:
    """The input of `unit` (1, 2, …) becomes `to` at the time `at` (s)."""

    unit: int
    at: float
    to: float

    def __post_init__(self) -> None:
        _check_finite(self)

    @property
    def end(self) -> float:
        return self.at

    def value(self, before: float) -> float:
        """Value held afterwards."""
        return self.to


@dataclass(frozen=True)
class Ramp:
    """The input of `unit` (1, 2, …) changes by `slope` (a second) from `start` to `end` (s)."""

    unit: int
    start: float
    end: float
    slope: float

    def __post_init__(self) -> None:
        _check_finite(self)
        if not self.start < self.end:
            raise InputError(f"{self}: must start before it ends")

    @property
    def at(self) -> float:
        return self.start

    def value(self, before: float) -> float:
        """Value held afterwards."""
        return before + self.slope * (self.end - self.start)


@dataclass(frozen=True, eq=False)
class TableInput:
    """Values (K×units) at times (K, s); linear between them, or with `hold` kept until the next.

    Before the first and after the last time their values are kept.
    """

    times: Any
    values: Any
    hold: bool = False

    def curves(self) -> tuple[Curve, ...]:
        """One curve a unit."""
        times, values = np.asarray(self.times, float), np.asarray(self.values, float)
        if values.ndim != 2 or times.shape != values.shape[:1] or len(times) == 0:
            raise InputError(
                f"a table of inputs with times of shape {times.shape} and values of shape "
                f"{values.shape}: must be (K,) and (K, units)"
            )
        if np.any(np.diff(times) <= 0):
            where = int(np.argmax(np.diff(times) <= 0))
            raise InputError(
                f"table of inputs: t = {times[where + 1]:g} s follows t = {times[where]:g} s: "
                "times must increase"
            )
        if self.hold:  # each value again, just before the next
            times, values = np.repeat(times, 2)[1:], np.repeat(values, 2, axis=0)[:-1]
        return tuple(Curve(times, column) for column in values.T)


@dataclass(frozen=True, eq=False)
class Curve:
    """A function of time, linear between knots (`times`, `values`); a time given twice is a jump.

    Constant before the first and after the last knot. Raises `InputError` for a knot not finite.
    """

    times: np.ndarray
    values: np.ndarray

    def __post_init__(self) -> None:
        for time, value in zip(self.times, self.values, strict=True):
            if not (np.isfinite(time) and np.isfinite(value)):
                raise InputError(f"input {value:g} at t = {time:g} s: both must be finite numbers")

    @property
    def starts(self) -> np.ndarray:
        """Times at which the value begins to change after it was constant."""
        moving = np.append(np.diff(self.values) != 0, False)
        return self.times[moving & ~np.append(False, moving[:-1])]

    def after(self, t: Any) -> np.ndarray:
        """Values at times t; at a jump, the new one."""
        return np.asarray(np.interp(t, self.times, self.values))

    def before(self, t: Any) -> np.ndarray:
        """Values at times t; at a jump, the old one."""
        return np.asarray(np.interp(-np.asarray(t), -self.times[::-1], self.values[::-1]))


@dataclass(frozen=True, eq=False)
class InputProfile:
    """The inputs of all units: `profile(t)` is (units) at a time, (K×units) at K times (s)."""

    curves: tuple[Curve, ...]

    @classmethod
    def of(cls, units: int, moves: Iterable[Step | Ramp] = ()) -> InputProfile:
        """Profile of an arm with that many units, from steps and ramps in any order."""
        each: list[list[Step | Ramp]] = [[] for _ in range(units)]
        for move in moves:
            if move.unit not in range(1, units + 1):
                raise InputError(f"{move}: this arm has units 1 to {units}")
            each[int(move.unit) - 1].append(move)
        return cls(tuple(_curve(own) for own in each))

    @classmethod
    def from_table(cls, times: Any, values: Any, hold: bool = False) -> InputProfile:
        """Profile of values (K×units) at times (K, s)."""
        return cls(TableInput(times, values, hold).curves())

    @classmethod
    def constant(cls, values: Sequence[float]) -> InputProfile:
        """Profile that stays at values (units)."""
        return cls.from_table([0.0], [values])

    @property
    def units(self) -> int:
        """Number of units."""
        return len(self.curves)

    def __call__(self, t: Any) -> np.ndarray:
        return np.stack([curve.after(t) for curve in self.curves], axis=-1)

    def before(self, t: Any) -> np.ndarray:
        """As the call, but at a jump the value before it."""
        return np.stack([curve.before(t) for curve in self.curves], axis=-1)

    def over(self, start: Any, end: Any) -> tuple[np.ndarray, np.ndarray]:
        """Inputs (…×units) at both ends of intervals (…, s) without breakpoints inside.

        Extended from inside the interval: a breakpoint at an end, or a rounding beyond it, is not
        seen.
        """
        a, b = self(start + np.multiply.outer([0.25, 0.75], np.subtract(end, start)))
        return 1.5 * a - 0.5 * b, 1.5 * b - 0.5 * a

    @property
    def breakpoints(self) -> np.ndarray:
        """Times (s, increasing) at which an input jumps or changes its slope."""
        return np.unique(np.concatenate([_bends(curve) for curve in self.curves]))

    def check(self, model: Model) -> None:
        """Raise `InputError` where an input leaves the limits of the arm or units do not match."""
        limits, kind = model.scene.manipulator.limits, model.scene.actuation.input
        low, high = getattr(limits, f"{kind}_min"), getattr(limits, f"{kind}_max")
        per, unit = (1.0, "N·m") if kind == "torque" else (1e6, "MPa")
        if self.units != model.scene.manipulator.units:
            raise InputError(
                f"inputs for {self.units} units: this arm has {model.scene.manipulator.units}"
            )
        slack = SLACK * max(abs(low), abs(high))
        for number, curve in enumerate(self.curves, 1):
            for time, value in zip(curve.times, curve.values, strict=True):
                if not low - slack <= value <= high + slack:
                    raise InputError(
                        f"{kind} of unit {number} at t = {time:g} s = {value / per:g} {unit}: must "
                        f"be between {low / per:g} and {high / per:g} {unit}, see [limits]"
                    )


def _check_finite(move: Step | Ramp) -> None:
    if not np.all(np.isfinite(list(vars(move).values()))):
        raise InputError(f"{move}: all must be finite numbers")


def _curve(moves: list[Step | Ramp]) -> Curve:
    """Knots of one unit's moves, one after the other."""
    times, values, last = [0.0], [0.0], None  # this knot only stands for a unit without moves
    for move in sorted(moves, key=lambda move: (move.at, move.end)):
        if last and (move.at < last.end or move.end == last.at):
            raise InputError(f"{move}: is at the same time as {last}")
        times += [move.at, move.end]
        values += [values[-1], move.value(values[-1])]
        last = move
    first = 1 if moves else 0
    return Curve(np.array(times[first:]), np.array(values[first:]))


def _bends(curve: Curve) -> np.ndarray:
    """Knots where something changes."""
    t, v = curve.times, curve.values
    if len(t) == 1:
        return np.zeros(0)
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = np.concatenate([[0.0], np.diff(v) / np.diff(t), [0.0]])
    slope = np.where(np.isnan(slope), 0.0, slope)
    return t[slope[1:] != slope[:-1]]
