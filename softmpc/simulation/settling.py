"""How a motion comes to rest: the time it takes, and how far it swings beyond its end."""

from __future__ import annotations

from typing import Any

import numpy as np

from softmpc.simulation.inputs import InputProfile

__all__ = ["has_moved", "last_move", "overshoot", "settling_time", "time_watched"]

BAND = 0.02  # of the travel
SMALLEST = 1e-6  # m; less travel than this is no motion


def settling_time(motion: Any, band: float = BAND) -> float:
    """Time (s) from the end of the last move of the inputs until the arm's tip stays near its end.

    Near means within `band` of its travel, the largest distance from its end since the move began.
    `motion` is a `Simulation`. Returns nan where the tip has not travelled, or did not stay there
    for as long as it took to come there: then nobody knows whether that was its end.
    """
    since, over = _last_move(motion)
    time, tip = _from(motion, since)
    away = np.linalg.norm(tip - tip[-1:], axis=1)
    if not has_moved(motion):
        return float("nan")
    beyond = away - band * away.max()
    last = int(np.flatnonzero(beyond > 0)[-1])
    share = beyond[last] / (beyond[last] - beyond[last + 1])  # of the sample time, to the crossing
    settled = float(time[last] + share * (time[last + 1] - time[last]))
    taken = max(settled - over, 0.0)
    return taken if time[-1] - settled >= taken else float("nan")


def overshoot(motion: Any) -> float:
    """How far the tip swings beyond its end, over its way there since the last move began.

    Measured along the straight line from start to end; 0 where it never goes beyond, nan where it
    has not settled.
    """
    if np.isnan(settling_time(motion)):
        return float("nan")
    _, tip = _from(motion, _last_move(motion)[0])
    way = tip[-1] - tip[0]
    return max(0.0, float(((tip - tip[-1]) @ way).max() / max(way @ way, SMALLEST**2)))


def has_moved(motion: Any) -> bool:
    """Whether the tip travels at all from the last move of the inputs on."""
    _, tip = _from(motion, _last_move(motion)[0])
    return len(tip) > 1 and bool(np.linalg.norm(tip - tip[-1:], axis=1).max() >= SMALLEST)


def time_watched(motion: Any) -> float:
    """Time (s) from the end of the last move of the inputs to the end of the motion, at least 0."""
    return max(float(motion.time[-1]) - _last_move(motion)[1], 0.0)


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
    """Start and end of the last move, none of it before the motion."""
    first = float(motion.time[0])
    start, end = last_move(motion.profile) if motion.profile else (first, first)
    return max(start, first), max(end, first)


def _from(motion: Any, start: float) -> tuple[np.ndarray, np.ndarray]:
    """Times from `start` on, and the arm's tip there (K×3, m)."""
    kept = motion.time >= start - 1e-9
    return motion.time[kept], motion.tips[kept, -1]
