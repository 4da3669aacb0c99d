"""What can be said of a reading without a model: finite, of the right size, alive, no jump.

A jump tells a wrong reading from a wrong model: the arm moves, however wrong the estimate is, and
a camera that was hit or sees something else is there at once. What follows a jump is left out until
readings jump again, or for some time.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite

import numpy as np

from softmpc.estimation.sensing import Sample
from softmpc.estimation.sensors import TICK, Reading, Sensor

__all__ = ["Plausibility"]

FROZEN_AFTER = 3  # equal readings in a row, of a sensor with noise
AWAY = 2000  # ticks after a jump for which readings are left out
SURE = 8.0  # deviations of the noise that no jump is


class Plausibility:
    """Looks at the readings of all sensors in the order in which they arrive."""

    def __init__(self, sensors: Sequence[Sensor], readings: Sequence[Reading]) -> None:
        self._noisy = [sensor.noise > 0 for sensor in sensors]
        self._fastest = [sensor.fastest * TICK for sensor in sensors]
        self._margin = [SURE * sensor.noise for sensor in sensors]
        self._sizes = [len(reading.names) for reading in readings]
        self.reset()

    def reset(self) -> None:
        """Forget the readings before."""
        self._last = [b""] * len(self._sizes)
        self._equal = [1] * len(self._sizes)
        self._moved: list[tuple[int, np.ndarray] | None] = [None] * len(self._sizes)
        self._away: list[int | None] = [None] * len(self._sizes)  # since a jump

    def fault(self, sample: Sample) -> str:
        """Why a reading cannot be used; empty where it can."""
        i, value = sample.sensor, np.asarray(sample.value, float)
        if value.shape != (self._sizes[i],):
            return "wrong size"
        if not isfinite(value @ value):
            return "not finite"
        bits = value.tobytes()
        self._equal[i] = self._equal[i] + 1 if bits == self._last[i] else 1
        self._last[i] = bits
        if self._noisy[i] and self._equal[i] >= FROZEN_AFTER:
            return "frozen"
        if self._equal[i] == 1:
            self._follow(i, sample.stamp, value)
        return "" if self._away[i] is None else "after a jump"

    def _follow(self, i: int, stamp: int, value: np.ndarray) -> None:
        """See whether a sensor's readings have jumped away, or back."""
        before, away = self._moved[i], self._away[i]
        if before is not None and stamp <= before[0]:
            return
        self._moved[i] = stamp, value
        if before is not None:
            most = self._fastest[i] * (stamp - before[0]) + self._margin[i]
            if float(np.abs(value - before[1]).max()) > most:
                self._away[i] = stamp if away is None else None
                return
        if away is not None and stamp - away >= AWAY:
            self._away[i] = None
