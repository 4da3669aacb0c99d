"""How a motion comes to rest: the time it takes, and how far it swings beyond its end."""

from __future__ import annotations

from typing import Any

import numpy as np

from softmpc.simulation.inputs import InputProfile

__all__ = ["last_move", "overshoot", "settling_time"]

BAND = 0.02  # of the travel
STILL = 0.1  # share of the time after the last move in which the tip must have stayed in the band
SMALLEST = 1e-6  # m; less travel than this is no motion


def settling_time(motion: Any, band: float = BAND) -> float:
    """Time (s) from the end of the last move of the inputs until the arm's tip stays near its end.

    Near means within `band` of its travel, the largest distance from its end since the move began.
    `motion` is a `Simulation`. Returns nan where the tip has not travelled or was not seen to
    settle: it was still outside the band in the last tenth of the time after the move.
    """
    time, away, over = _since(motion)
    if len(time) < 2 or away.max() < SMALLEST:
        return float("nan")
    last = int(np.flatnonzero(away > band * away.max())[-1])
    settled = float(time[min(last + 1, len(time) - 1)])
    return max(settled - over, 0.0) if settled <= time[-1] - STILL * (time[-1] - over) else np.nan


def overshoot(motion: Any) -> float:
    """How far the tip swings beyond its end, over its way there since the last move began.

    Measured along the straight line from start to end; 0 where it never goes beyond, nan where it
    has not travelled.
    """
    start, _ = _last_move(motion)
    tip = motion.tips[motion.time >= start - 1e-9, -1]
    way = tip[-1] - tip[0] if len(tip) else np.zeros(3)
    travel = float(np.linalg.norm(way))
    if travel < SMALLEST:
        return float("nan")
    return max(0.0, float(((tip - tip[-1]) @ way).max()) / travel**2)


def last_move(profile: InputProfile) -> tuple[float, float]:
    """When the inputs last began to change, and when they came to rest (s); 0, 0 if they never do.

    Both are the same for a step.
    """
    bends = profile.breakpoints
    if not len(bends):
        return 0.0, 0.0
    starts, ends = profile.over(bends[:-1], bends[1:])
    moving = np.any(starts != ends, axis=1)
    first = len(bends) - 1
    while first > 0 and moving[first - 1]:
        first -= 1
    return float(bends[first]), float(bends[-1])


def _last_move(motion: Any) -> tuple[float, float]:
    profile = getattr(motion, "profile", None)
    first = float(motion.time[0])
    start, end = (first, first) if profile is None else last_move(profile)
    return max(start, first), max(end, first)


def _since(motion: Any) -> tuple[np.ndarray, np.ndarray, float]:
    """Times since the last move began, how far the tip then is from its end, and the move's end."""
    start, over = _last_move(motion)
    kept = motion.time >= start - 1e-9
    tip = motion.tips[kept, -1]
    away = np.linalg.norm(tip - tip[-1], axis=1) if len(tip) else np.zeros(0)
    return motion.time[kept], away, over
