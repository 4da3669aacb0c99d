"""The planning problem: from a start through goals, what is least, and within which limits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from softmpc.control.clearance import KeepClear
from softmpc.control.limits import (
    CurvatureLimit,
    Limit,
    PressureLimit,
    StrainLimit,
    StrokeLimit,
    TorqueLimit,
)
from softmpc.control.transcription import require_linear_drive
from softmpc.errors import InputError, unknown_name
from softmpc.model.model import Model
from softmpc.model.obstacles import Obstacle
from softmpc.planning.goals import Goal, Start

__all__ = ["LEAST", "PlanProblem", "arm_limits", "check_times"]

LEAST = ("time", "effort", "jerk")
PLACES = 10  # a section, where a plan looks for obstacles; the replay looks closer
LIMITLESS = 1e4  # 1/m, the default of `Limits.curvature_max`
OF_THE_ARM = TorqueLimit, PressureLimit, StrokeLimit, StrainLimit, CurvatureLimit


@dataclass(frozen=True, eq=False)
class PlanProblem:
    """What a plan must do.

    `least` is "time" (s), "effort" (∫ Σ T² dt) or "jerk" (∫ Σ (dT/dt)² dt: torque is to the arm
    what acceleration is to a mass). Without times of all goals, effort and jerk need the `duration`
    of the whole (s). `rate` (N·m/s, or Pa/s) bounds how fast inputs change. `limits` hold along the
    way; None: those of the arm. Those of input, pressure, stroke and strain are closer by
    `back_off`, a share of their range, at both ends: room for a controller that follows
    the plan. The whole arm keeps `margin` (m) clear of `obstacles`.
    """

    model: Model
    start: Start
    goals: tuple[Goal, ...]
    least: str = "time"
    duration: float | None = None
    rate: float | None = None
    limits: tuple[Limit, ...] | None = None
    obstacles: tuple[Obstacle, ...] = ()
    margin: float = 0.0
    back_off: float = 0.0

    def __post_init__(self) -> None:
        require_linear_drive(self.model)
        self.start.check(self.model)
        if not self.goals:
            raise InputError("PlanProblem.goals is empty: give at least one Goal")
        for goal in self.goals:
            goal.check(self.model)
        if self.least not in LEAST:
            raise InputError(unknown_name("PlanProblem.least", self.least, LEAST))
        for name, value in (("duration", self.duration), ("rate", self.rate)):
            if value is not None and not 0 < value < np.inf:
                raise InputError(f"PlanProblem.{name} = {value!r}: must be a number above 0")
        if not 0 <= self.back_off < 0.5:
            raise InputError(
                f"PlanProblem.back_off = {self.back_off!r}: must be from 0 to below 0.5, the share "
                "of their range by which limits are closer at both ends"
            )
        check_times(self.least, [goal.after for goal in self.goals], self.duration)
        if self.obstacles:
            _ = KeepClear(self.obstacles, self.margin)  # checks them

    @property
    def all_limits(self) -> tuple[Limit, ...]:
        """Those along the way, backed off, obstacles among them."""
        limits = arm_limits(self.model) if self.limits is None else self.limits
        limits = tuple(_backed_off(one, self.back_off) for one in limits)
        clear = (KeepClear(self.obstacles, self.margin, PLACES),) if self.obstacles else ()
        return (*limits, *clear)

    @property
    def timing(self) -> tuple[np.ndarray, np.ndarray]:
        """Rows M and values of M · durations = values: the times that are given."""
        count = len(self.goals)
        rows = [np.eye(count)[i] for i, goal in enumerate(self.goals) if goal.after is not None]
        values = [goal.after for goal in self.goals if goal.after is not None]
        if self.duration is not None and len(rows) < count:
            rows.append(np.ones(count))
            values.append(self.duration)
        return np.array(rows).reshape(-1, count), np.array(values, float)


def _backed_off(limit: Limit, share: float) -> Limit:
    """A limit that is closer by a share of its range, where it is of the arm and has one."""
    margin = share * (limit.high - limit.low)
    if not (isinstance(limit, OF_THE_ARM) and 0 < margin < np.inf):
        return limit
    return replace(limit, low=limit.low + margin, high=limit.high - margin)


def check_times(least: str, times: Sequence[float | None], duration: float | None) -> None:
    """Raise `InputError` where times of goals (s, None: free) and of the whole contradict."""
    given, free = sum(time for time in times if time is not None), None in times
    if least == "time" and not (free and duration is None):
        raise InputError(
            "least time chooses the time: leave out the duration, or the time of a goal at least; "
            "with given times take least effort or jerk"
        )
    if least != "time" and free and duration is None:
        raise InputError(
            f"least {least} needs a time: give the duration of the whole, or each goal "
            "its time; without any, waiting for ever would be best"
        )
    if duration is None:
        return
    if not free and abs(given - duration) > 1e-9:
        raise InputError(f"the goals take {given:g} s and the whole {duration:g} s: leave out one")
    if free and given >= duration:
        raise InputError(
            f"goals with times take {given:g} s already, the whole shall take {duration:g} s: must "
            "be less"
        )


def arm_limits(model: Model) -> tuple[Limit, ...]:
    """Limits of the arm itself: input, pressure, stroke, stretch, curvature."""
    arm, drive = model.scene.manipulator.limits, model.scene.actuation.input
    pressure = arm.pressure_min, arm.pressure_max
    found: list[Limit] = [
        TorqueLimit(*((arm.torque_min, arm.torque_max) if drive == "torque" else pressure))
    ]
    if drive == "torque":
        found.append(PressureLimit(*pressure))
    if len(model.drive.X):
        found.append(StrokeLimit(-arm.stroke_max, arm.stroke_max))
    if any(name.startswith("epsilon_") for name in model.layout.q.names):
        found.append(StrainLimit(arm.stretch_min, arm.stretch_max, kind="epsilon"))
    if arm.curvature_max < LIMITLESS:
        found.append(CurvatureLimit(-arm.curvature_max, arm.curvature_max))
    return tuple(found)
