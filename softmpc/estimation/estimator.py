"""An extended Kalman filter for strains, rates, pressures and a disturbance.

Readings come at their own rates and late. Each counts for the time at which it was taken: the
filter goes back to what it believed just before and comes forward again through all that it has
heard since. It moves between the times of readings and of new inputs alone, so that the result
depends on these, not on the order of arrival or on when it was asked.

A reading that is not finite, frozen, or absurdly far from what is expected is left out. One that is
only too far counts as if it were at the edge of what is likely: it pulls, but no harder than a good
one may. The covariance is left alone: a larger one would make the filter follow motions that its
model does not have, and the loop with it unstable. Only where all readings of one sensor have been
absurd for long does it grow by that at the start, until they count again.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections import Counter, deque
from collections.abc import Iterable, Sequence

import numpy as np

from softmpc.control.closed_loop import start_at
from softmpc.errors import InputError
from softmpc.estimation.kalman import Innovation, gate, predicted, updated
from softmpc.estimation.knots import Belief, Estimate, Health, Knot, Trust
from softmpc.estimation.observability import observability
from softmpc.estimation.plausibility import Plausibility
from softmpc.estimation.process import Process, Spread
from softmpc.estimation.sensing import Sample
from softmpc.estimation.sensors import TICK, Reading, Sensor
from softmpc.estimation.weighing import Look, weighed
from softmpc.model.model import Model
from softmpc.statics.equilibrium import find_equilibrium

__all__ = ["Estimate", "Estimator", "Spread"]

Array = np.ndarray
MEMORY = 250  # ticks that a reading may be late
FAR = 1e-4  # share of good readings that are farther than the edge
DOUBTED = 3  # readings beyond it in a row, from which on they contradict the estimate
LOST = 800  # ticks without a good reading of a sensor after which it is the filter that is lost
LONGEST = 0.02  # s, of one step of the model
CURVATURE = 4.0  # relative error of a slope for a strain that is off by its whole scale
BENT = 1e-3, 0.1  # of that, squared: what is nothing, and what more would feed on itself
KEPT = 100_000  # innovations


class Estimator:
    """Estimates the state of one model from samples of its sensors.

    What these can tell is looked at when it is made, at the state and input of rest `at`, that of
    no input if it is not given: the attribute `observability`. Raises `InputError` where a part of
    the disturbance can never be known.
    """

    def __init__(
        self,
        process: Process,
        sensors: Sequence[Sensor],
        spread: Spread | None = None,
        at: tuple[Array, Array] | None = None,
    ) -> None:
        if not sensors:
            raise InputError("Estimator: needs one sensor at least, such as SectionTips()")
        self.process, self.sensors = process, tuple(sensors)
        self.model: Model = process.model
        self.readings = [sensor.reading(self.model) for sensor in self.sensors]
        self._linear = [self._constant_slope(reading) for reading in self.readings]
        self._R = [
            sensor.variances(reading, self.model)
            for sensor, reading in zip(self.sensors, self.readings, strict=True)
        ]
        self._gates = [gate(len(reading.names), FAR) for reading in self.readings]
        self._spread = process.variances(spread or Spread())
        self._plausibility = Plausibility(self.sensors, self.readings)
        at = _resting(self.model) if at is None else at
        self.observability = observability(process, self.sensors, self.readings, *at)
        self.observability.require_detectable()
        self.observability.tell()

    def _constant_slope(self, reading: Reading) -> Array | None:
        """Slope of a reading in s where it is linear."""
        p = self.process
        if reading.of_strains is not None:
            return None
        return np.hstack([reading.by_x, reading.by_u @ p.disturbance.G]) * p.scale

    # --- what it is told -------------------------------------------------------------------------

    def reset(self, x: Array, u: Array, tick: int = 0) -> None:
        """Begin at a state (nx) and input (k), SI, with no disturbance known."""
        p = self.process
        s = np.concatenate([_finite("x", x, p.nx), np.zeros(len(p.disturbance))]) / p.scale
        trust = tuple(Trust(tick) for _ in self.sensors)
        start = Belief(s, np.diag(self._spread), None, trust)
        self._knots = [Knot(tick, start)]
        self._tail: tuple[Belief, int, Belief] | None = None  # a knot's belief moved to a tick
        self._now = tick, start  # of the last estimate
        self._times, self._inputs = [tick - 1], [_finite("u", u, len(self.model.layout.u))]
        self._samples: dict[int, dict[int, Sample]] = {}  # by tick and sensor
        self._plausibility.reset()
        self._reasons: list[Counter[str]] = [Counter() for _ in self.sensors]
        self._settled: deque[Innovation] = deque(maxlen=KEPT)
        self._contradicted: list[int] = []

    def applied(self, u: Array, tick: int) -> None:
        """The input (k, SI) from this time on."""
        u, place = _finite("u", u, len(self.model.layout.u)), bisect_left(self._times, tick)
        self._forget_after(tick)
        if self._tail is not None and self._tail[1] > tick:
            self._tail = None
        same = self._times[place : place + 1] == [tick]
        self._times[place : place + same] = [tick]
        self._inputs[place : place + same] = [u]

    def receive(self, samples: Iterable[Sample]) -> None:
        """Readings that have arrived."""
        for sample in samples:
            reason = self._plausibility.fault(sample)
            if not reason and sample.stamp < self._knots[0].tick:
                reason = "too late"
            if not reason and sample.sensor in self._samples.get(sample.stamp, ()):
                reason = "twice"
            if reason:
                self._reasons[sample.sensor][reason] += 1
                continue
            self._samples.setdefault(sample.stamp, {})[sample.sensor] = sample
            self._forget_after(sample.stamp)
            if self._knots[-1].tick == sample.stamp:
                self._knots[-1] = Knot(sample.stamp, self._knots[-1].before)

    def _forget_after(self, tick: int) -> None:
        """Drop what was worked out for later times."""
        while len(self._knots) > 1 and self._knots[-1].tick > tick:
            self._knots.pop()

    # --- what it knows ---------------------------------------------------------------------------

    def estimate(self, tick: int) -> Estimate:
        """What is known of this time, with all readings taken until then.

        Raises `InputError` for a time before all that is remembered.
        """
        if tick < self._knots[0].tick:
            raise InputError(
                f"Estimator.estimate: tick = {tick}: must be {self._knots[0].tick} at least; "
                "what was before is forgotten"
            )
        self._forget_after(tick)
        for stop in self._stops(self._knots[-1].tick, tick):
            self._knots.append(Knot(stop, self._moved(stop)))
        self._now = tick, self._moved(tick)
        self._prune(tick)
        return self._as_estimate(*self._now)

    def ahead(self, tick: int, inputs: Sequence[tuple[int, Array]] = ()) -> Estimate:
        """The last estimate, moved on to a later time under inputs from their ticks on.

        For the delay between a measurement and the input that follows from it. Nothing is kept.
        """
        now, belief = self._now
        known = dict(zip(self._times, self._inputs, strict=True)) | dict(inputs)
        for stop in [*sorted(t for t in known if now < t < tick), tick]:
            u = known[max(t for t in known if t <= now)]
            belief, now = self._advanced(belief, u, now, stop), stop
        return self._as_estimate(now, belief)

    @property
    def innovations(self) -> list[Innovation]:
        """Of the readings that were looked at since the start, by their times; the last 100,000."""
        return [*self._settled, *(one for knot in self._knots for one in knot.seen)]

    @property
    def contradicted(self) -> list[int]:
        """Ticks of readings that were too far, some in a row."""
        return [*self._contradicted, *(knot.tick for knot in self._knots if knot.contradicted)]

    @property
    def health(self) -> list[Health]:
        """Of each sensor, as of the last estimate."""
        reasons = [counter.copy() for counter in self._reasons]
        for one in (one for knot in self._knots for one in knot.seen if not one.accepted):
            reasons[one.sensor]["too far"] += 1
        trust = self._now[1].trust
        return [Health(one.good, why) for one, why in zip(trust, reasons, strict=True)]

    def _as_estimate(self, tick: int, belief: Belief) -> Estimate:
        whole = belief.s * self.process.scale
        return Estimate(tick * TICK, whole[: self.process.nx], whole[self.process.nx :], belief.P)

    # --- steps -----------------------------------------------------------------------------------

    def _stops(self, now: int, tick: int) -> list[int]:
        """Times of readings and new inputs after `now` until `tick`."""
        stops = {t for t in self._samples if now < t <= tick}
        stops.update(t for t in self._times if now < t <= tick)
        return sorted(stops)

    def _input(self, tick: int) -> Array:
        """The input that holds from this time on."""
        return self._inputs[max(bisect_right(self._times, tick) - 1, 0)]

    def _moved(self, tick: int) -> Belief:
        """The last knot's belief after its readings, moved on to a time."""
        knot = self._knots[-1]
        if knot.after is None:
            self._take_readings(knot)
        after = knot.after
        assert after is not None
        if self._tail is None or self._tail[0] is not after or self._tail[1] != tick:
            there = self._advanced(after, self._input(knot.tick), knot.tick, tick)
            self._tail = after, tick, there
        return self._tail[2]

    def _advanced(self, belief: Belief, u: Array, now: int, tick: int) -> Belief:
        if tick <= now:
            return belief
        length = (tick - now) * TICK
        pieces = max(1, int(np.ceil(length / LONGEST - 1e-9)))
        s, P, stages, trust = belief
        for _ in range(pieces):
            s, A, stages = self.process.advance(s, u, length / pieces, stages)
            P = predicted(P, A, self.process.spread(length / pieces), self._bent(P))
        return Belief(s, P, stages, trust)

    def _bent(self, P: Array) -> float:
        """Share of a variance that linearising leaves: as large as the uncertainty of the strains.

        Nothing where the state is known well, and what keeps the filter honest where it is not.
        """
        worst = float(P.diagonal()[: self.process.n].max())
        share = min(CURVATURE**2 * worst, BENT[1])
        return share if BENT[0] < share and worst < 1.0 else 0.0

    def _take_readings(self, knot: Knot) -> None:
        """Let the readings of a knot's time count, all at once."""
        s, P, stages, trust = knot.before
        taken = self._samples.get(knot.tick)
        if taken:
            u = self._input(knot.tick - 1)  # what was applied until then
            looks = [self._look(taken[i], s, P, u) for i in sorted(taken)]
            found, knot.seen, far = weighed(P, looks)
            if found is not None:
                s, P = updated(s, P, found)
            for one, distance in zip(looks, far, strict=True):
                now = trust[one.sensor].after(knot.tick, distance)
                trust = (*trust[: one.sensor], now, *trust[one.sensor + 1 :])
                knot.contradicted |= now.beyond >= DOUBTED
                if knot.tick - now.good >= LOST:
                    P = P + np.diag(self._spread)
        knot.after = Belief(s, P, stages, trust)

    def _look(self, sample: Sample, s: Array, P: Array, u: Array) -> Look:
        """A reading beside what was expected of it."""
        i, p = sample.sensor, self.process
        reading, H, R = self.readings[i], self._linear[i], self._R[i]
        if H is not None:
            y = H @ s + reading.by_u @ u
        else:
            y, slope = reading(s[: p.nx] * p.scale[: p.nx], u)
            H = np.zeros((len(y), p.size))
            H[:, : p.nx] = slope * p.scale[: p.nx]
            bent = self._bent(P)
            if bent:
                R = R + bent * np.sum(H @ P * H, axis=1)
        return Look(i, sample.stamp, sample.value - y, H, R, self._gates[i])

    def _prune(self, tick: int) -> None:
        """Forget what no reading can come before any more."""
        first = self._knots[0].tick
        while len(self._knots) > 1 and self._knots[1].tick <= tick - MEMORY:
            knot = self._knots.pop(0)
            self._settled += knot.seen
            self._contradicted += [knot.tick] * knot.contradicted
            for one in knot.seen:
                if not one.accepted:
                    self._reasons[one.sensor]["too far"] += 1
        if first == self._knots[0].tick:
            return
        first = self._knots[0].tick
        for old in [t for t in self._samples if t < first]:
            del self._samples[old]
        past = max(bisect_right(self._times, first - 1) - 1, 0)
        del self._times[:past], self._inputs[:past]


def _resting(model: Model) -> tuple[Array, Array]:
    """State and input of the arm at rest without pressure."""
    start = start_at(model, find_equilibrium(model, np.zeros(len(model.layout.p))))
    return start.x, start.u


def _finite(name: str, value: Array, size: int) -> Array:
    """A copy of a vector; raises `InputError` for another size, or numbers that are not finite."""
    found = np.array(value, float).ravel()
    if len(found) != size or not np.all(np.isfinite(found)):
        raise InputError(f"Estimator: {name} = {value!r}: must be {size} finite numbers")
    return found
