"""Sensors at work in a simulation: samples of a plant with noise, bias, delay and dropout."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from softmpc.estimation.sensors import Sensor
from softmpc.model.model import Model

__all__ = ["Sample", "Sensing"]

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Sample:
    """A reading of the sensor of that number: when it was taken, when it arrives (ticks)."""

    sensor: int
    stamp: int
    arrival: int
    value: Array


class Sensing:
    """The sensors of one plant. Each has its own random numbers, so that one more changes none."""

    def __init__(self, sensors: Sequence[Sensor], plant: Model, seed: int = 0) -> None:
        self.sensors = tuple(sensors)
        self.readings = [sensor.reading(plant) for sensor in self.sensors]
        self._offsets = [
            sensor.offset(len(reading.names))
            for sensor, reading in zip(self.sensors, self.readings, strict=True)
        ]
        self._random = [
            np.random.default_rng([seed, sensor.seed, number])
            for number, sensor in enumerate(self.sensors)
        ]

    def due(self, tick: int) -> list[int]:
        """Numbers of the sensors that sample at this tick."""
        return [i for i, sensor in enumerate(self.sensors) if tick % sensor.period == 0]

    def sample(self, number: int, tick: int, x: Array, u: Array) -> Sample | None:
        """What a sensor reads of the plant's state and input; None where it is lost."""
        sensor, random = self.sensors[number], self._random[number]
        y = self.readings[number](x, u)[0]
        value = y + self._offsets[number] + sensor.noise * random.standard_normal(len(y))
        lost = random.random() < sensor.dropout
        return None if lost else Sample(number, tick, tick + sensor.delay, value)
