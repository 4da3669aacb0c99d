"""What can be said of a reading by itself, before any model: finite, of the right size, alive."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite

import numpy as np

from softmpc.estimation.sensing import Sample
from softmpc.estimation.sensors import Reading, Sensor

__all__ = ["Plausibility"]

FROZEN_AFTER = 3  # equal readings in a row, of a sensor with noise


class Plausibility:
    """Looks at the readings of all sensors in the order in which they arrive."""

    def __init__(self, sensors: Sequence[Sensor], readings: Sequence[Reading]) -> None:
        self._noisy = [sensor.noise > 0 for sensor in sensors]
        self._sizes = [len(reading.names) for reading in readings]
        self.reset()

    def reset(self) -> None:
        """Forget the readings before."""
        self._last = [b""] * len(self._sizes)
        self._equal = [1] * len(self._sizes)

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
        return "frozen" if self._noisy[i] and self._equal[i] >= FROZEN_AFTER else ""
