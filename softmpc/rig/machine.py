"""The rig itself, simulated: the plant, the way of inputs to it, and of readings from it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from softmpc.estimation.sensing import Sample, Sensing
from softmpc.estimation.sensors import TICK, Sensor, require_ticks
from softmpc.model.model import Model
from softmpc.rig.faults import ActuatorFault, Fault, PayloadDropped, SensorFault
from softmpc.simulation.integrator import Integrator

__all__ = ["Link", "Machine", "check_faults"]

Array = np.ndarray


@dataclass(frozen=True)
class Link:
    """The way of an input to the motors: `delay` (s) and the share that is `lost`."""

    delay: float = 0.0
    lost: float = 0.0

    def __post_init__(self) -> None:
        require_ticks("command_delay", self.delay)

    @property
    def ticks(self) -> int:
        return round(self.delay / TICK)


def check_faults(faults: Sequence[Fault], sensors: Sequence[Sensor], plant: Model) -> None:
    """Raise `InputError` for a fault of what is not there."""
    for fault in faults:
        fault.check([sensor.name for sensor in sensors], len(plant.layout.u))


class Machine:
    """A plant with sensors, motors and faults; moves by whole ticks.

    `plants` are integrators of scenes with equal states: "" the usual one, "payload_dropped" that
    without payload.
    """

    def __init__(
        self,
        plants: Mapping[str, Integrator],
        sensors: Sequence[Sensor],
        link: Link | None = None,
        faults: Sequence[Fault] = (),
        seed: int = 0,
    ) -> None:
        self.plants, self.link, self.faults = dict(plants), link or Link(), tuple(faults)
        self.sensors, self.seed = tuple(sensors), seed
        self.model = self.plants[""].model
        check_faults(self.faults, self.sensors, self.model)

    def reset(self, x: Array, u: Array, tick: int = 0) -> None:
        """Begin at a state and an input of the plant."""
        self.tick, self.x, self.told, self.acting = tick, x.copy(), u.copy(), u.copy()
        self._sensing = Sensing(self.sensors, self.model, self.seed)
        self._random = np.random.default_rng([self.seed, 1 << 20])
        self._commands: list[tuple[int, Array]] = []
        self._stuck_at: dict[int, Array] = {}
        self._under_way: list[Sample] = []
        self._last: list[Sample | None] = [None] * len(self.sensors)
        self.lost = 0  # commands
        self._read()

    # --- to the motors ---------------------------------------------------------------------------

    def command(self, u: Array) -> None:
        """Send an input now."""
        if self._random.random() < self.link.lost:
            self.lost += 1
            return
        self._commands.append((self.tick + self.link.ticks, np.asarray(u, float)))

    def _act(self) -> None:
        """Let inputs act that have come through, and what faults make of them."""
        while self._commands and self._commands[0][0] <= self.tick:
            self.told = self._commands.pop(0)[1]
        u = self.told.copy()
        for number, fault in enumerate(self.faults):
            if isinstance(fault, ActuatorFault) and fault.active(self.tick):
                before = self._stuck_at.setdefault(number, self.acting)
                u = fault.acting(u, before)
        self.acting = u

    # --- in time ---------------------------------------------------------------------------------

    def run(self, ticks: int) -> tuple[Array, Array]:
        """States (ticks×nx) and acting inputs (ticks×k) at each tick to come."""
        end = self.tick + ticks
        states, inputs = [], []
        while self.tick < end:
            self._act()
            stop = min([end, *(t for t in self._turns() if t > self.tick)])
            count = stop - self.tick
            moved = self._plant().advance(self.x, self.acting, count * TICK, count)
            for x in moved:
                self.tick += 1
                self.x = x
                self._read()
            states.append(moved)
            inputs.append(np.tile(self.acting, (count, 1)))
        return np.vstack(states), np.vstack(inputs)

    def _turns(self) -> list[int]:
        """Ticks at which inputs, motors or the plant change."""
        kinds = (ActuatorFault, PayloadDropped)
        turns = [tick for fault in self.faults if isinstance(fault, kinds) for tick in fault.ticks]
        return turns + [tick for tick, _ in self._commands]

    def _plant(self) -> Integrator:
        dropped = any(isinstance(f, PayloadDropped) and f.active(self.tick) for f in self.faults)
        return self.plants[PayloadDropped.name if dropped else ""]

    # --- from the sensors ------------------------------------------------------------------------

    def _read(self) -> None:
        """Take the samples that are due."""
        for number in self._sensing.due(self.tick):
            sample = self._sensing.sample(number, self.tick, self.x, self.acting)
            if sample is None:
                continue
            name = self.sensors[number].name
            wrong = [
                fault for fault in self.faults
                if isinstance(fault, SensorFault) and fault.sensor == name
                and fault.active(self.tick)
            ]  # fmt: skip
            if not wrong:
                self._last[number] = sample
            for fault in wrong:
                found = fault.changed(sample, self._last[number])
                if found is None:
                    break
                sample = found
            else:
                self._under_way.append(sample)

    def arrived(self) -> list[Sample]:
        """Samples that have arrived since the last call."""
        here = [sample for sample in self._under_way if sample.arrival <= self.tick]
        self._under_way = [sample for sample in self._under_way if sample.arrival > self.tick]
        return here
