"""An extended Kalman filter for strains, rates, pressures and a disturbance.

Readings come at their own rates and late. Each counts for the time at which it was taken: the
filter goes back to what it knew then and comes forward again through all that it has heard since,
so the order of arrival does not matter.

A reading that is not finite, frozen, or too far from what is expected is left out. Where those of
one sensor stay too far for long it is the filter that is wrong, and it opens its covariance.
"""

from __future__ import annotations

from bisect import bisect_right, insort
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from softmpc.errors import InputError
from softmpc.estimation.kalman import Innovation, gate, predicted, updated
from softmpc.estimation.plausibility import Plausibility
from softmpc.estimation.process import Process
from softmpc.estimation.sensing import Sample
from softmpc.estimation.sensors import TICK, Sensor
from softmpc.model.model import Model

__all__ = ["Estimate", "Estimator", "Spread"]

Array = np.ndarray
MEMORY = 250  # ticks that a reading may be late
MISS = 1e-6  # share of good readings that the gate turns away
OPEN_AFTER = 100  # ticks for which all readings of one sensor are turned away
LONGEST = 0.02  # s, of one step of the model
FLOOR = 1e-9  # of a sensor's values: noise of one that says it has none


@dataclass(frozen=True)
class Spread:
    """Standard deviations at the start, as shares of each variable's scale."""

    strains: float = 0.01
    rates: float = 0.01
    drive: float = 0.02
    forces: float = 0.1
    offsets: float = 0.03


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


@dataclass(frozen=True)
class _Knot:
    """What was known at a time, with all readings taken until then."""

    tick: int
    s: Array
    P: Array
    a: Array


@dataclass
class _Health:
    """Of one sensor: when its last good reading was taken, and since when all are turned away."""

    good: int
    refused_since: int | None = None
    reasons: Counter[str] = field(default_factory=Counter)


class Estimator:
    """Estimates the state of one model from samples of its sensors."""

    def __init__(
        self, process: Process, sensors: Sequence[Sensor], spread: Spread | None = None
    ) -> None:
        if not sensors:
            raise InputError("Estimator: needs one sensor at least, such as SectionTips()")
        self.process, self.sensors = process, tuple(sensors)
        self.model: Model = process.model
        self.readings = [sensor.reading(self.model) for sensor in self.sensors]
        self._R = [
            np.full(len(reading.names), max(sensor.noise, FLOOR) ** 2)
            for sensor, reading in zip(self.sensors, self.readings, strict=True)
        ]
        self._spread = self._variances(spread or Spread())
        self._plausibility = Plausibility(self.sensors, self.readings)

    def _variances(self, spread: Spread) -> Array:
        p, layout = self.process, self.model.layout
        forced = np.any(p.disturbance.F != 0, axis=0)
        parts = [
            np.full(p.n, spread.strains),
            np.full(p.n, spread.rates),
            np.full(len(layout.z), spread.drive),
            np.where(forced, spread.forces, spread.offsets),
        ]
        return np.concatenate(parts) ** 2

    # --- what it is told -------------------------------------------------------------------------

    def reset(self, x: Array, u: Array, tick: int = 0) -> None:
        """Begin at a state (nx) and input (k), SI, with no disturbance known."""
        s = np.concatenate([x, np.zeros(len(self.process.disturbance))]) / self.process.scale
        P = np.diag(self._spread)
        self._knots = [_Knot(tick - 1, s, P, np.zeros(self.process.unknowns))]
        self._inputs: list[tuple[int, Array]] = [(tick - 1, np.asarray(u, float))]
        self._samples: list[Sample] = []
        self._plausibility.reset()
        self.health = [_Health(tick) for _ in self.sensors]
        self._settled: list[Innovation] = []
        self._recent: list[Innovation] = []
        self.opened: list[int] = []  # ticks at which the covariance was opened

    def applied(self, u: Array, tick: int) -> None:
        """The input from this time on."""
        self._forget_from(tick)
        self._inputs.append((tick, np.asarray(u, float)))

    def receive(self, samples: Iterable[Sample]) -> None:
        """Readings that have arrived."""
        for sample in samples:
            reason = self._plausibility.fault(sample)
            if not reason and sample.stamp <= self._knots[0].tick:
                reason = "too late"
            if reason:
                self.health[sample.sensor].reasons[reason] += 1
                continue
            self._forget_from(sample.stamp)
            insort(self._samples, sample, key=_stamp)

    def _forget_from(self, tick: int) -> None:
        """Drop what was worked out for this time and later."""
        keep = 1
        while keep < len(self._knots) and self._knots[keep].tick < tick:
            keep += 1
        del self._knots[keep:]
        self._recent = [one for one in self._recent if one.stamp < tick]

    @property
    def innovations(self) -> list[Innovation]:
        """Of all readings that were looked at since the start, by their times."""
        return [*self._settled, *self._recent]

    # --- what it knows ---------------------------------------------------------------------------

    def estimate(self, tick: int) -> Estimate:
        """What is known of this time, which is not before any reading that counts."""
        for stamp in self._stops(tick):
            knot = self._moved(self._knots[-1], stamp)
            for sample in self._taken(stamp):
                knot = self._corrected(knot, sample)
            self._knots.append(knot)
        self._prune(tick)
        return self._as_estimate(self._knots[-1])

    def ahead(self, tick: int, inputs: Sequence[tuple[int, Array]] = ()) -> Estimate:
        """The last estimate, moved on to a later time under inputs from their ticks on.

        For the delay between a measurement and the input that follows from it. Nothing is kept.
        """
        knot = self._knots[-1]
        known = [*self._inputs, *inputs]
        for stop in [*sorted(t for t, _ in inputs if knot.tick < t < tick), tick]:
            u = [u for t, u in known if t <= knot.tick][-1]
            knot = self._advanced(knot, u, stop)
        return self._as_estimate(knot)

    def _as_estimate(self, knot: _Knot) -> Estimate:
        nx = self.process.nx
        whole = knot.s * self.process.scale
        return Estimate(knot.tick * TICK, whole[:nx], whole[nx:], knot.P)

    def _stops(self, tick: int) -> list[int]:
        """Times to come until `tick`: readings, new inputs, and `tick`."""
        now = self._knots[-1].tick
        stops = {sample.stamp for sample in self._samples} | {t for t, _ in self._inputs} | {tick}
        return sorted(t for t in stops if now < t <= tick)

    def _taken(self, tick: int) -> list[Sample]:
        return [sample for sample in self._samples if sample.stamp == tick]

    # --- steps -----------------------------------------------------------------------------------

    def _input(self, tick: int) -> Array:
        """The input that holds from this time on."""
        place = bisect_right([t for t, _ in self._inputs], tick) - 1
        return self._inputs[max(place, 0)][1]

    def _moved(self, knot: _Knot, tick: int) -> _Knot:
        return self._advanced(knot, self._input(knot.tick), tick)

    def _advanced(self, knot: _Knot, u: Array, tick: int) -> _Knot:
        if tick == knot.tick:
            return knot
        length = (tick - knot.tick) * TICK
        pieces = max(1, int(np.ceil(length / LONGEST - 1e-9)))
        s, P, a = knot.s, knot.P, knot.a
        for _ in range(pieces):
            s, A, a = self.process.advance(s, u, length / pieces, a)
            P = predicted(P, A, self.process.spread(length / pieces))
        return _Knot(tick, s, P, a)

    def _corrected(self, knot: _Knot, sample: Sample) -> _Knot:
        i, p = sample.sensor, self.process
        u = self._input(knot.tick - 1)  # what was applied until then
        x = knot.s[: p.nx] * p.scale[: p.nx]
        given = u + p.disturbance.G @ knot.s[p.nx :]
        y, slope = self.readings[i](x, given)
        H = np.hstack([slope * p.scale[: p.nx], self.readings[i].by_u @ p.disturbance.G])
        e = sample.value - y
        S = H @ knot.P @ H.T + np.diag(self._R[i])
        nis = float(e @ np.linalg.solve(S, e))
        accepted = nis <= gate(len(e), MISS)
        spread = np.sqrt(np.diag(S))
        self._recent.append(Innovation(i, sample.stamp, e, spread, nis, accepted))
        if not accepted:
            return self._refused(knot, i)
        self.health[i].good, self.health[i].refused_since = knot.tick, None
        s, P = updated(knot.s, knot.P, e, H, self._R[i], S)
        return _Knot(knot.tick, s, P, knot.a)

    def _refused(self, knot: _Knot, sensor: int) -> _Knot:
        """Turn a reading away; after some time, doubt the estimate instead."""
        health = self.health[sensor]
        if health.refused_since is None or health.refused_since > knot.tick:
            health.refused_since = knot.tick
        if knot.tick - health.refused_since < OPEN_AFTER:
            return knot
        health.refused_since = None
        self.opened.append(knot.tick)
        P = knot.P.copy()
        P[np.diag_indices_from(P)] += self._spread
        return _Knot(knot.tick, knot.s, P, knot.a)

    def _prune(self, tick: int) -> None:
        """Forget what no reading can come before any more."""
        oldest = tick - MEMORY
        while len(self._knots) > 1 and self._knots[1].tick <= oldest:
            del self._knots[0]
        first = self._knots[0].tick
        self._samples = [sample for sample in self._samples if sample.stamp > first]
        settled = [one for one in self._recent if one.stamp <= first]
        self._settled += settled
        del self._recent[: len(settled)]
        for one in settled:
            if not one.accepted:
                self.health[one.sensor].reasons["too far"] += 1
        while len(self._inputs) > 1 and self._inputs[1][0] <= first:
            del self._inputs[0]


def _stamp(sample: Sample) -> int:
    return sample.stamp
