"""Orders of convergence: fitted to what was measured, and put beside theory."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Any

import numpy as np

from softmpc.accuracy.families import FAMILIES
from softmpc.accuracy.points import FamilyResult, Point

__all__ = [
    "AGREES", "AS_THEORY", "AT_FLOOR", "DIFFERS", "DIVERGES", "NO_THEORY", "TOO_FEW", "VERDICTS",
    "Fit", "fit_series", "fits",
]  # fmt: skip

FINEST = 3  # sizes that are fitted
CLEAR = 4.0  # times its doubt, which then moves an order by 0.2 at most: log(4/3)/log(4) = 0.2
ROUNDING = 1e-12  # of any error: below, it is that of the numbers
AGREES = 0.2  # how far from theory an order may be
NEARER, NEAR = 0.7, 0.4  # what a step leaves of its distance from theory, and the last one at most
WEAKEST = 0.25  # below, an order is none

AS_THEORY, DIFFERS, DIVERGES = "as theory says", "differs from theory", "does not converge"
APPROACHES = "approaches theory"
AT_FLOOR, TOO_FEW, NO_THEORY = "at the floor", "too few points", "no theory"
VERDICTS = {
    AS_THEORY: f"the order is within {AGREES} of what theory says",
    APPROACHES: "it is further off, but each step comes closer: the sizes are not small enough yet",
    DIFFERS: "it is further off",
    DIVERGES: "the errors do not become smaller, whatever theory says",
    NO_THEORY: "it converges, and there is no order to compare with",
    AT_FLOOR: "most errors are no larger than the doubt of what they are measured against",
    TOO_FEW: f"less than {FINEST} sizes were measured",
}


@dataclass(frozen=True)
class Fit:
    """error = `scale` · size^`order` along a series, by least squares of the logarithms.

    `sizes` are those fitted, the finest ones with errors above the floor. Without enough of them
    there is no order.
    """

    axis: str
    series: str
    key: str  # of the error that is fitted
    theory: float | None
    verdict: str
    sizes: tuple[float, ...] = ()
    order: float | None = None
    standard_error: float | None = None  # of the order
    scale: float | None = None

    def summary(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return {**vars(self), "sizes": list(self.sizes)}


def fits(family: FamilyResult) -> list[Fit]:
    """The fits of all series of a family, axis by axis, for each error that has an order.

    A series has none for an error that nobody measured.
    """
    found = []
    for axis in family.axes:
        points = [point for point in family.axis(axis) if point.configuration.series]
        for name in dict.fromkeys(point.configuration.series for point in points):
            own = [point for point in points if point.configuration.series == name]
            keys = FAMILIES[family.name].fitted(axis)
            found += [fit_series(own, key) for key in keys if any(key in p.error for p in own)]
    return found


def fit_series(points: Sequence[Point], key: str = "error_m") -> Fit:
    """The order of one error along the points of one series; they may be in any order.

    An error below 4 times its doubt is at the floor and not fitted. Its doubt is what stands beside
    it, "doubt_m" for "error_m" and "integration_doubt_m" for "integration_m".
    """
    first = points[0].configuration
    by_size = {_size(point): point for point in points if _is_measured(point, key)}
    known = [by_size[size] for size in sorted(by_size, reverse=True)]
    clear = [point for point in known if _error(point, key) > _floor(point.error, key)]
    about = (first.axis, first.series, key, first.order)
    if len(clear) < FINEST:
        return Fit(*about, TOO_FEW if len(known) < FINEST else AT_FLOOR)
    sizes = np.array([_size(point) for point in clear])
    errors = np.array([_error(point, key) for point in clear])
    order, deviation, scale = _line(sizes[-FINEST:], errors[-FINEST:])
    verdict = _beside(order, first.order, _slopes(sizes[-FINEST:], errors[-FINEST:]))
    verdict = DIVERGES if _diverges(sizes, errors, order) else verdict
    return Fit(*about, verdict, tuple(sizes[-FINEST:].tolist()), order, deviation, scale)


def _beside(order: float, theory: float | None, slopes: np.ndarray) -> str:
    """The fitted order, and those of the steps it is fitted to, beside theory."""
    if theory is None:
        return NO_THEORY
    if abs(order - theory) <= AGREES:
        return AS_THEORY
    away = np.abs(slopes - theory)
    nearing = bool(np.all(away[1:] <= NEARER * away[:-1])) and away[-1] <= NEAR
    return APPROACHES if nearing else DIFFERS


def _slopes(sizes: np.ndarray, errors: np.ndarray) -> np.ndarray:
    """The order of each step to the next finer size."""
    return np.diff(np.log(errors)) / np.diff(np.log(sizes))


def _diverges(sizes: np.ndarray, errors: np.ndarray, order: float) -> bool:
    """Whether the errors do not become smaller, by the errors alone.

    The finest sizes show no order, and neither does the last step, or the way from the coarsest to
    the finest. The latter two are there for errors that pass through zero on their way, or have
    noise: one that is small by chance makes those after it look as if they grew.
    """
    steps = [(-2, -1), (0, -1)]
    between = [_slopes(sizes[[a, b]], errors[[a, b]])[0] < WEAKEST for a, b in steps]
    return order < WEAKEST and any(between)


def _line(sizes: np.ndarray, errors: np.ndarray) -> tuple[float, float, float]:
    """Slope of log(error) over log(size), its standard error, and the error at size 1."""
    x, y = np.log(sizes), np.log(errors)
    away = x - x.mean()
    slope = float(away @ y / (away @ away))
    rest = y - y.mean() - slope * away
    deviation = float(np.sqrt(rest @ rest / (len(x) - 2) / (away @ away)))
    return slope, deviation, float(np.exp(y.mean() - slope * x.mean()))


def _is_measured(point: Point, key: str) -> bool:
    value, size = point.error.get(key), point.configuration.size
    return value is not None and isfinite(value) and size is not None and size > 0


def _size(point: Point) -> float:
    assert point.configuration.size is not None
    return point.configuration.size


def _error(point: Point, key: str) -> float:
    return abs(float(point.error[key]))


def _floor(error: Mapping[str, Any], key: str) -> float:
    """Below, an error says nothing about the order."""
    doubt = error.get(_doubt_of(key))
    return max(CLEAR * (doubt or 0.0), ROUNDING)


def _doubt_of(key: str) -> str:
    """ "doubt_m" of "error_m", "integration_doubt_m" of "integration_m"."""
    return key.replace("error", "doubt") if "error" in key else f"{key.removesuffix('_m')}_doubt_m"
