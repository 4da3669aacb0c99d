"""Tip paths: curves in space over a phase that counts laps, and the time law along them.

A path knows nothing of time, a time law nothing of space; a `Reference` joins them. Lengths in m,
times in s, places in the base frame.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path as File
from typing import ClassVar

import numpy as np

from softmpc.errors import SceneError

__all__ = [
    "Circle",
    "FigureEight",
    "Helix",
    "Line",
    "Point",
    "Reference",
    "TimeLaw",
    "TipPath",
    "Waypoints",
    "read_waypoints",
]

Vector = tuple[float, float, float]
DOWN: Vector = (0.0, 0.0, 1.0)


class TipPath(ABC):
    """A curve over its phase; closed ones repeat with every whole number."""

    name: ClassVar[str]

    @abstractmethod
    def position(self, phase: np.ndarray) -> np.ndarray:
        """Places (K×3) at phases (K)."""


def _plane(normal: Vector) -> tuple[np.ndarray, np.ndarray]:
    """Two unit vectors across `normal`; along x and y where it is the z axis."""
    n = np.asarray(normal, float)
    length = np.linalg.norm(n)
    if length == 0:
        raise SceneError(f"normal = {tuple(normal)}: must not be zero")
    n = n / length
    first = np.array([1.0, 0, 0]) if abs(n[0]) < 0.9 else np.array([0, 1.0, 0])
    first = first - n * (first @ n)
    first /= np.linalg.norm(first)
    return first, np.cross(n, first)


@dataclass(frozen=True)
class Circle(TipPath):
    """A circle of a given diameter about `center`, in the plane across `normal`."""

    name: ClassVar[str] = "circle"
    center: Vector
    diameter: float
    normal: Vector = DOWN

    def position(self, phase: np.ndarray) -> np.ndarray:
        a, b = _plane(self.normal)
        angle = 2 * np.pi * np.asarray(phase)[:, None]
        return np.asarray(self.center) + self.diameter / 2 * (np.cos(angle) * a + np.sin(angle) * b)


@dataclass(frozen=True)
class FigureEight(TipPath):
    """A lying eight (Lissajous 1:2) about `center`: `width` by `height`, across `normal`."""

    name: ClassVar[str] = "figure-eight"
    center: Vector
    width: float
    height: float
    normal: Vector = DOWN

    def position(self, phase: np.ndarray) -> np.ndarray:
        a, b = _plane(self.normal)
        angle = 2 * np.pi * np.asarray(phase)[:, None]
        along, across = np.sin(angle) * self.width, np.sin(2 * angle) * self.height
        return np.asarray(self.center) + (along * a + across * b) / 2


@dataclass(frozen=True)
class Helix(TipPath):
    """A circle that rises by `pitch` along `normal` with every lap."""

    name: ClassVar[str] = "helix"
    center: Vector
    diameter: float
    pitch: float
    normal: Vector = DOWN

    def position(self, phase: np.ndarray) -> np.ndarray:
        rise = np.asarray(self.normal, float) / np.linalg.norm(self.normal) * self.pitch
        circle = Circle(self.center, self.diameter, self.normal).position(phase)
        return circle + np.asarray(phase)[:, None] * rise


@dataclass(frozen=True)
class Line(TipPath):
    """From `start` to `end` and back in a lap, with cosine speed."""

    name: ClassVar[str] = "line"
    start: Vector
    end: Vector

    def position(self, phase: np.ndarray) -> np.ndarray:
        share = (1 - np.cos(2 * np.pi * np.asarray(phase)[:, None])) / 2
        return np.asarray(self.start) + share * (np.asarray(self.end) - np.asarray(self.start))


@dataclass(frozen=True)
class Point(TipPath):
    """One place that is to be held."""

    name: ClassVar[str] = "point"
    place: Vector

    def position(self, phase: np.ndarray) -> np.ndarray:
        return np.tile(np.asarray(self.place, float), (len(np.asarray(phase)), 1))


@dataclass(frozen=True)
class Waypoints(TipPath):
    """A smooth curve through points, at even speed; `closed` returns to the first one."""

    name: ClassVar[str] = "waypoints"
    points: tuple[Vector, ...]
    closed: bool = False
    _curve: object = field(default=None, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        from scipy.interpolate import CubicSpline

        points = np.asarray(self.points, float)
        if points.ndim != 2 or points.shape[1] != 3 or len(points) < 2:
            raise SceneError(f"waypoints: must be two or more rows of x, y, z, not {points.shape}")
        if self.closed and not np.allclose(points[0], points[-1]):
            points = np.vstack([points, points[:1]])
        steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
        if np.any(steps == 0):
            row = int(np.argmin(steps)) + 1
            raise SceneError(f"waypoints {row} and {row + 1} are the same place: leave one out")
        at = np.concatenate([[0.0], np.cumsum(steps)]) / steps.sum()
        ends = "periodic" if self.closed else "natural"
        object.__setattr__(self, "_curve", CubicSpline(at, points, bc_type=ends))

    def position(self, phase: np.ndarray) -> np.ndarray:
        phase = np.asarray(phase, float)
        # An open curve is run to its end and back, so that laps join without a jump.
        turned = phase % 1.0 if self.closed else 1 - np.abs(1 - (2 * phase) % 2.0)
        return self._curve(turned)  # type: ignore[operator]


def read_waypoints(path: str | File, closed: bool) -> Waypoints:
    """Waypoints from a CSV file with a header and columns x, y, z in m."""
    if not File(path).is_file():
        raise SceneError(f"waypoints file {path}: no such file")
    try:
        table = np.genfromtxt(path, delimiter=",", names=True, dtype=float)
    except (OSError, ValueError) as error:
        raise SceneError(f"waypoints file {path}: {str(error).splitlines()[0]}") from None
    names = table.dtype.names or ()
    if not {"x", "y", "z"} <= set(names):
        raise SceneError(f"waypoints file {path}: needs columns x, y, z, has {', '.join(names)}")
    points = np.column_stack([np.atleast_1d(table[n]) for n in ("x", "y", "z")])
    if not np.all(np.isfinite(points)):
        row = int(np.argwhere(~np.isfinite(points))[0][0]) + 2
        raise SceneError(f"waypoints file {path}, line {row}: every value must be a number")
    return Waypoints(tuple(map(tuple, points.tolist())), closed)


@dataclass(frozen=True)
class TimeLaw:
    """Laps over time: at rest for t ≤ 0, full speed 1/`lap_time` after `smooth_start` seconds."""

    lap_time: float
    laps: float
    smooth_start: float = 1.0

    @property
    def duration(self) -> float:
        """Time until the last lap is done; the start costs half its length."""
        return self.laps * self.lap_time + self.smooth_start / 2

    def phase(self, t: np.ndarray) -> np.ndarray:
        """Phase at times `t`; its acceleration is smooth (the speed is a quintic step)."""
        t = np.maximum(np.asarray(t, float), 0.0)
        if self.smooth_start == 0:
            return t / self.lap_time
        s = np.minimum(t / self.smooth_start, 1.0)
        started = self.smooth_start * (2.5 * s**4 - 3 * s**5 + s**6)
        return (started + np.maximum(t - self.smooth_start, 0.0)) / self.lap_time


@dataclass(frozen=True)
class Reference:
    """Where the tip should be when."""

    path: TipPath
    law: TimeLaw

    @property
    def duration(self) -> float:
        return self.law.duration

    def position(self, t: Sequence[float] | np.ndarray) -> np.ndarray:
        """Places (K×3) at times (K)."""
        return self.path.position(self.law.phase(np.atleast_1d(np.asarray(t, float))))
