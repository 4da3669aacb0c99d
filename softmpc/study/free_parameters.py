"""What a calibration may change: numbers of a scene with bounds, priors and scales.

The solver sees x: the logarithm of a number, or the number over its scale.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from math import exp, isfinite, log

import numpy as np

from softmpc.errors import InputError, errors_in
from softmpc.model.scene import Scene
from softmpc.model.scene_paths import Place, resolve, value_at, with_values

__all__ = ["FreeParameter", "ParameterSpace", "Tie"]


@dataclass(frozen=True)
class FreeParameter:
    """A number of a scene, by its path (`softmpc.model.scene_paths`), all in SI.

    `start` is the scene's own value where it is not given, `low` and `high` the validity range of
    the quantity. `prior` is a mean and a standard deviation. With `log` the logarithm is fitted
    (for numbers that must be positive), and the prior is normal in it, with the standard deviation
    over the mean. `scale` is a change that matters; a start that is not zero is a good one.
    """

    path: str
    start: float | None = None
    low: float | None = None
    high: float | None = None
    prior: tuple[float, float] | None = None
    log: bool = False
    scale: float | None = None

    def __post_init__(self) -> None:
        for name in ("start", "low", "high", "scale"):
            value = getattr(self, name)
            if value is not None and not isfinite(value):
                raise InputError(f"{self.path}: {name} = {value!r}: must be a finite number")
        if self.scale is not None and not self.scale > 0:
            raise InputError(f"{self.path}: scale = {self.scale:g}: must be above 0")
        if self.prior is not None and not (
            len(self.prior) == 2 and all(map(isfinite, self.prior)) and self.prior[1] > 0
        ):
            raise InputError(
                f"{self.path}: prior = {self.prior!r}: must be a mean and a standard deviation "
                "above 0"
            )


@dataclass(frozen=True)
class Tie:
    """The number at `path` is `factor` times the one at `to`, whatever that becomes."""

    path: str
    to: str
    factor: float = 1.0


@dataclass(frozen=True)
class _Resolved:
    place: Place
    start: float
    low: float
    high: float
    log: bool
    scale: float
    prior: tuple[float, float] | None

    def x(self, value: float) -> float:
        if self.log:
            return log(value) if value > 0 else -np.inf
        return value / self.scale

    def value(self, x: float) -> float:
        """The number; at the start and at a bound that itself, without rounding."""
        for known in (self.start, self.low, self.high):
            if x == self.x(known):
                return known
        return min(max(exp(x) if self.log else x * self.scale, self.low), self.high)

    @property
    def prior_x(self) -> tuple[float, float]:
        """Mean and standard deviation of x; nan, inf where there is no prior."""
        if self.prior is None:
            return float("nan"), float("inf")
        mean, deviation = self.prior
        return self.x(mean), deviation / (mean if self.log else self.scale)


class ParameterSpace:
    """Free parameters of a scene as a vector x (P), and the scene at any x.

    Raises `InputError` for a path that the scene does not have, for bounds out of order or outside
    the quantity's range, and for a start or prior outside its bounds.
    """

    def __init__(
        self, scene: Scene, parameters: Sequence[FreeParameter], ties: Sequence[Tie] = ()
    ) -> None:
        if not parameters:
            raise InputError("no free parameter is given: a calibration needs at least one")
        self.scene = scene
        self._free = [_resolved(scene, parameter) for parameter in parameters]
        self._ties = [_tied(scene, tie) for tie in ties]
        self.names = tuple(free.place.path for free in self._free)
        taken = [*self.names, *(place.path for place, _, _ in self._ties)]
        for name in taken:
            if taken.count(name) > 1:
                raise InputError(f"{name}: is given twice, as a parameter or in a tie")
            of_all = re.sub(r"\[\d+\]", "", name)
            if of_all != name and of_all in taken:
                raise InputError(
                    f"{name}: is one of {of_all}, which is given too: give {of_all}, or each "
                    "section's own"
                )

    def __len__(self) -> int:
        return len(self._free)

    @property
    def units(self) -> tuple[str, ...]:
        """Unit of each parameter."""
        return tuple(free.place.span.unit for free in self._free)

    @property
    def logarithmic(self) -> tuple[bool, ...]:
        """Whether x is the logarithm."""
        return tuple(free.log for free in self._free)

    @property
    def start(self) -> np.ndarray:
        """x to start from (P)."""
        return np.array([free.x(free.start) for free in self._free])

    @property
    def starts(self) -> tuple[float, ...]:
        """The numbers to start from, SI."""
        return tuple(free.start for free in self._free)

    @property
    def limits(self) -> tuple[tuple[float, float], ...]:
        """Lowest and highest number of each parameter, SI."""
        return tuple((free.low, free.high) for free in self._free)

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest x (P each)."""
        low = np.array([free.x(free.low) for free in self._free])
        return low, np.array([free.x(free.high) for free in self._free])

    @property
    def prior(self) -> tuple[np.ndarray, np.ndarray]:
        """Mean and standard deviation of x by the priors (P each); nan and inf where none is."""
        pairs = np.array([free.prior_x for free in self._free])
        return pairs[:, 0], pairs[:, 1]

    @property
    def priors(self) -> tuple[tuple[float, float] | None, ...]:
        """Mean and standard deviation of the numbers themselves."""
        return tuple(free.prior for free in self._free)

    def values(self, x: np.ndarray) -> np.ndarray:
        """The numbers (P) at x, SI."""
        return np.array([f.value(float(v)) for f, v in zip(self._free, x, strict=True)])

    def slopes(self, x: np.ndarray) -> np.ndarray:
        """Derivative of each number by its x (P)."""
        values = self.values(x)
        return np.array([v if f.log else f.scale for f, v in zip(self._free, values, strict=True)])

    def scene_at(self, x: np.ndarray) -> Scene:
        """The scene with the numbers at x, and those tied to them.

        Raises `InputError` where the scene may not have them.
        """
        places = [free.place for free in self._free]
        scene = with_values(self.scene, dict(zip(places, self.values(x).tolist(), strict=True)))
        for place, to, factor in self._ties:
            scene = with_values(scene, {place: factor * value_at(scene, to)})
        return scene

    def random_start(self, generator: np.random.Generator) -> np.ndarray:
        """A start anywhere within the bounds; no further than a factor 2 (log), or the scale."""
        low, high = self.bounds
        start = self.start
        reach = np.where(self.logarithmic, log(2.0), 1.0)
        return generator.uniform(np.maximum(low, start - reach), np.minimum(high, start + reach))


def _resolved(scene: Scene, given: FreeParameter) -> _Resolved:
    place = resolve(scene, given.path)
    span = place.span
    start = value_at(scene, place) if given.start is None else float(given.start)
    low = span.low if given.low is None else float(given.low)
    high = span.high if given.high is None else float(given.high)
    with errors_in(given.path):
        if not span.low <= low < high <= span.high:
            raise InputError(
                f"bounds {low:g} to {high:g}: must be in order, and {span}, as the quantity"
            )
        if given.log and not (low > 0 or (low == 0 and start > 0)):
            raise InputError(f"log = true needs positive bounds, low = {low:g}")
        for what, value in (("start", start), ("mean of the prior", (given.prior or (start,))[0])):
            if not low <= value <= high or (given.log and value <= 0):
                raise InputError(f"{what} = {value:g}: must be between {low:g} and {high:g}")
    spread = given.prior[1] if given.prior else (high - low) / 4 if isfinite(high - low) else 1.0
    scale = given.scale or abs(start) or spread
    return _Resolved(place, start, low, high, given.log, scale, given.prior)


def _tied(scene: Scene, tie: Tie) -> tuple[Place, Place, float]:
    with errors_in(f"tie of {tie.path}"):
        if not isfinite(tie.factor):
            raise InputError(f"factor = {tie.factor!r}: must be a finite number")
        return resolve(scene, tie.path), resolve(scene, tie.to), float(tie.factor)
