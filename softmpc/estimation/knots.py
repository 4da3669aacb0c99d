"""What a filter believes at a time, and the times between which it moves."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from softmpc.estimation.arm_step import Stages
from softmpc.estimation.kalman import Innovation
from softmpc.estimation.weighing import ABSURD

__all__ = ["Belief", "Estimate", "Health", "Knot", "Trust"]

Array = np.ndarray


@dataclass(frozen=True)
class Estimate:
    """State x (nx, SI) and disturbance d (scaled), their covariance scaled, and its time (s)."""

    time: float
    x: Array
    d: Array
    P: Array

    def deviations(self, scale: Array) -> Array:
        """Standard deviations of x in SI; `scale` is that of the model's states."""
        n = len(self.x)
        return np.asarray(np.sqrt(np.diag(self.P)[:n]) * scale)


class Trust(NamedTuple):
    """Of one sensor: tick of its last reading that counted, and how many in a row were too far."""

    good: int
    beyond: int = 0

    def after(self, tick: int, far: float) -> Trust:
        """After a reading at that distance from what was expected, 1 being the edge."""
        good = tick if far <= ABSURD else self.good
        return Trust(good, self.beyond + 1 if far > 1.0 else 0)


class Belief(NamedTuple):
    """Scaled state and covariance, the last step's stages, trust in each sensor."""

    s: Array
    P: Array
    stages: Stages | None
    trust: tuple[Trust, ...]


@dataclass(slots=True)
class Knot:
    """A time at which readings were taken or an input changed: what is believed before them and,
    once that was asked for, after them."""

    tick: int
    before: Belief
    after: Belief | None = None
    seen: list[Innovation] = field(default_factory=list)
    contradicted: bool = False  # whether its readings were too far, as those before


@dataclass(frozen=True)
class Health:
    """Of one sensor: tick of its last good reading, and how many were left out, by reason."""

    good: int
    reasons: Counter[str]
