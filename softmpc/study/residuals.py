"""Residuals of a calibration in standard deviations, and their derivatives by differences.

What the arm shows is computed once for each x and kept: line searches, several starts and other
data on the same arm come back to the same places.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from softmpc.errors import InputError, SoftmpcError
from softmpc.study.arm_at import ArmAt
from softmpc.study.free_parameters import ParameterSpace
from softmpc.study.observations import Observation

__all__ = ["Data", "Predictions"]

# Of x, for central differences: measured by `python -m tests.benchmarks.calibrating`.
STEP = 1e-4
CLOSE = 0.1  # of x, up to which an arm borrows from another
MOST_KEPT = 4000  # vectors of predictions
Which = tuple[bool, ...]  # one an observation


class Data:
    """The observations as vectors: names, values, sigmas, senses (N), and which are fitted."""

    def __init__(self, observations: Sequence[Observation]) -> None:
        self.names = tuple(name for o in observations for name in o.names)
        self.values = np.concatenate([o.values for o in observations])
        self.sigmas = np.concatenate([o.sigmas for o in observations])
        self.senses = tuple(sense for o in observations for sense in o.senses)
        self.counts = np.concatenate([np.full(len(o.names), o.counts) for o in observations])
        self._owners = np.repeat(np.arange(len(observations)), [len(o.names) for o in observations])
        self._observations = len(observations)
        self._low = np.array([sense == ">" for sense in self.senses])
        self._high = np.array([sense == "<" for sense in self.senses])

    def residuals(self, shown: np.ndarray) -> np.ndarray:
        """(shown - measured)/sigma (N); 0 where a limit is kept."""
        r = (shown - self.values) / self.sigmas
        r = np.where(self._high, np.maximum(r, 0.0), r)
        return np.where(self._low, np.minimum(r, 0.0), r)

    def active(self, shown: np.ndarray) -> np.ndarray:
        """Which values are fitted and, of limits, broken (N)."""
        kept = self._high & (shown <= self.values) | self._low & (shown >= self.values)
        return np.asarray(self.counts & ~kept)

    def weighing(self, active: np.ndarray) -> tuple[bool, ...]:
        """Which observations have an active value: only their derivatives matter."""
        there = np.bincount(self._owners[active], minlength=self._observations) > 0
        return tuple(there.tolist())


class Predictions:
    """What the arm shows in place of each value, by x."""

    def __init__(
        self,
        space: ParameterSpace,
        observations: Sequence[Observation],
        tell: Callable[[], None] | None = None,
    ) -> None:
        self.space, self.observations = space, tuple(observations)
        self.tell = tell or _nobody
        self.arms = 0  # how many were made
        self._shown: dict[bytes, np.ndarray | SoftmpcError] = {}
        self._slopes: dict[tuple[bytes, Which], np.ndarray | SoftmpcError] = {}
        self._last: tuple[np.ndarray, ArmAt] | None = None  # one that made its own functions
        self._here: tuple[bytes, ArmAt] | None = None

    def at(self, x: np.ndarray) -> np.ndarray:
        """What the arm shows at x (N); raises `SoftmpcError` where it cannot be computed."""
        key = x.tobytes()
        if key not in self._shown:
            if len(self._shown) > MOST_KEPT:
                self._shown.clear()
            self._shown[key] = self._computed(x)
        return _or_raise(self._shown[key])

    def slopes(self, x: np.ndarray, which: Which) -> np.ndarray:
        """Derivatives by x (N×P), by central differences, one-sided at a bound.

        Those of some observations alone, by `which`; the others' rows are zero.
        """
        key = (x.tobytes(), which)
        if key not in self._slopes:
            if len(self._slopes) > MOST_KEPT:
                self._slopes.clear()
            try:
                self.at(x)
                here = self._arm(x)
                middle = self._predicted(here, which)
                columns = [self._slope(x, k, middle, here, which) for k in range(len(x))]
                self._slopes[key] = np.stack(columns, axis=1)
            except SoftmpcError as error:
                self._slopes[key] = error
        return _or_raise(self._slopes[key])

    def _slope(
        self, x: np.ndarray, k: int, middle: np.ndarray, here: ArmAt, which: Which
    ) -> np.ndarray:
        low, high = (bound[k] for bound in self.space.bounds)
        h = np.zeros(len(x))
        h[k] = min(STEP, (high - low) / 4)
        if low <= x[k] - h[k] and x[k] + h[k] <= high:
            above, below = (self._beside(y, here, which) for y in (x + h, x - h))
            return np.asarray((above - below) / (2 * h[k]))
        if x[k] + 2 * h[k] > high:
            h = -h
        one, two = (self._beside(y, here, which) for y in (x + h, x + 2 * h))
        return np.asarray((4 * one - two - 3 * middle) / (2 * h[k]))

    def _beside(self, x: np.ndarray, here: ArmAt, which: Which) -> np.ndarray:
        self.arms += 1
        self.tell()
        return self._predicted(ArmAt(self.space.scene_at(x), here), which)

    def _computed(self, x: np.ndarray) -> np.ndarray | SoftmpcError:
        self.arms += 1
        self.tell()
        try:
            return self._predicted(self._arm(x), (True,) * len(self.observations))
        except (InputError, SoftmpcError) as error:
            return error

    def _arm(self, x: np.ndarray) -> ArmAt:
        """The arm at x, beside the last one that is close."""
        key = x.tobytes()
        if self._here is None or self._here[0] != key:
            close = self._last is not None and np.abs(x - self._last[0]).max() < CLOSE
            arm = ArmAt(self.space.scene_at(x), self._last[1] if close and self._last else None)
            if not close:
                self._last = (x.copy(), arm)
            self._here = (key, arm)
        return self._here[1]

    def _predicted(self, arm: ArmAt, which: Which) -> np.ndarray:
        pairs = zip(self.observations, which, strict=True)
        return np.concatenate([o.predict(arm) if w else np.zeros(len(o.names)) for o, w in pairs])


def _or_raise(found: np.ndarray | SoftmpcError) -> np.ndarray:
    if isinstance(found, SoftmpcError):
        raise found
    return found


def _nobody() -> None:
    """Nobody wants to see how far it is."""
