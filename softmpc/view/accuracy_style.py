"""How pictures of an accuracy study look: units, marks of an axis, logarithmic scales."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from math import isfinite
from typing import TYPE_CHECKING, Any, TypeGuard

import numpy as np

from softmpc.accuracy.model_axes import AS_GIVEN
from softmpc.study.lengths import length_text
from softmpc.view.style import ALARM, COLOURS, INK

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis

    from softmpc.accuracy.points import FamilyResult, Point

__all__ = [
    "DOUBT", "GIVEN", "MARKERS", "Mark", "Unit", "error_unit", "log_scale", "marks", "situation",
    "metres", "outside", "paler", "positive", "read_key", "ticks_at", "time_unit", "varied_keys",
]  # fmt: skip

_PLACES = {"rest": "at rest", "motion": "in motion", "loop": "in closed loop"}
MARKERS = "os^DvPXph<>d"  # no star, which is the scene as given
SMALL = 1e-7  # m
MOST_TICKS, APART = 8, 1.3
MORE_COLOURS = (*COLOURS, "#5E3C99", "#9A9A9A")
GIVEN: dict[str, Any] = {
    "marker": "*", "markersize": 14, "color": "white", "markeredgecolor": INK, "linestyle": "none",
    "markeredgewidth": 1.2,
}  # fmt: skip
DOUBT: dict[str, Any] = {
    "color": ALARM,
    "linewidth": 1.0,
    "linestyle": (0, (8, 3, 1, 3)),
    "zorder": 1,
}
MANTISSAS = {1.5: (1, 2, 5), 2.6: (1, 3)}  # ticks a decade, by decades shown


@dataclass(frozen=True)
class Mark:
    """Colour and shape of the points of an axis: shapes differ, so that they are told in grey."""

    colour: str
    marker: str


@dataclass(frozen=True)
class Unit:
    """What SI values are multiplied by to be read in `name`."""

    name: str
    factor: float

    def label(self, text: str) -> str:
        """A label of axes that ends in an SI unit in brackets, in this unit."""
        head, bracket, _ = text.rpartition(" (")
        return f"{head} ({self.name})" if bracket else f"{text} ({self.name})"


def marks(family: FamilyResult) -> dict[str, Mark]:
    """The mark of each axis, the same in all pictures of a family."""
    axes = [axis for axis in family.axes if axis != AS_GIVEN]
    return {
        axis: Mark(MORE_COLOURS[i % len(MORE_COLOURS)], MARKERS[i % len(MARKERS)])
        for i, axis in enumerate(axes)
    }


def situation(family: str) -> str:
    """Where the arm of a family is, in words; a family of one's own goes by its name."""
    return _PLACES.get(family, family)


def positive(value: Any) -> TypeGuard[float]:
    """Whether it is a number that a logarithmic scale can show."""
    return isinstance(value, int | float) and isfinite(value) and value > 0


def error_unit() -> Unit:
    """Errors are read in millimetres."""
    return Unit("mm", 1e3)


def metres(value: float) -> str:
    """A length for people, in nm too: doubts may be as small."""
    return f"{value * 1e9:.3g} nm" if 0.0 < value < SMALL else length_text(value)


def time_unit(values: Iterable[float]) -> Unit:
    """The unit in which most times are above 1."""
    middle = float(np.median([*values] or [1.0]))
    for unit in (Unit("s", 1.0), Unit("ms", 1e3), Unit("µs", 1e6)):
        if middle * unit.factor >= 0.5:
            return unit
    return Unit("µs", 1e6)


def paler(colour: str, white: float) -> tuple[float, ...]:
    """A colour with so much white in it."""
    from matplotlib.colors import to_rgb

    return tuple((1.0 - white) * part + white for part in to_rgb(colour))


def log_scale(axes: Axes, which: str, least_decades: float = 0.7) -> None:
    """A logarithmic scale of axis "x" or "y" with few ticks, plain numbers where they are short."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    getattr(axes, f"set_{which}scale")("log")
    low, high = getattr(axes, f"get_{which}lim")()
    if low <= 0.0:  # nothing is drawn
        low, high = 0.1, 10.0
    spread = max(1.0, np.sqrt(10**least_decades * low / high))
    getattr(axes, f"set_{which}lim")(low / spread, high * spread)
    decades = np.log10(high / low) + 2 * np.log10(spread)
    subs = next((subs for most, subs in MANTISSAS.items() if decades <= most), (1,))
    axis: Axis = getattr(axes, f"{which}axis")
    axis.set_major_locator(LogLocator(subs=subs, numticks=12))
    axis.set_major_formatter(FuncFormatter(lambda value, _: _plain(value)))
    axis.set_minor_formatter(NullFormatter())


def ticks_at(axes: Axes, numbers: Iterable[float]) -> None:
    """A logarithmic x axis whose ticks are these numbers, where they are few and far apart."""
    from matplotlib.ticker import NullLocator

    log_scale(axes, "x", 0.3)
    shown = sorted(set(numbers))
    if len(shown) <= MOST_TICKS and all(b > APART * a for a, b in pairwise(shown)):
        axes.set_xticks(shown, [_plain(number) for number in shown])
        axes.xaxis.set_minor_locator(NullLocator())


def _plain(value: float) -> str:
    power = round(np.log10(value))
    if 1e-3 <= value < 1e5 or not np.isclose(value, 10.0**power):
        return f"{value:g}"
    return f"$10^{{{power}}}$"


def read_key(document: Mapping[str, Any], key: str) -> Any:
    """The value of a dotted key of a scene file; None where there is none."""
    found: Any = document
    for name in key.split("."):
        found = found.get(name) if isinstance(found, Mapping) else None
    return found


def varied_keys(points: Iterable[Point]) -> list[str]:
    """Dotted keys of scene files in which points differ, those that all of them change first."""
    changes = [dict(point.configuration.changes) for point in points]
    keys = dict.fromkeys(key for one in changes for key in one)
    varied = [key for key in keys if len({repr(one.get(key)) for one in changes}) > 1]
    return sorted(varied, key=lambda key: sum(key not in one for one in changes))


def outside(axes: Axes, **options: Any) -> None:
    """A legend beside the axes, without frame."""
    axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), borderaxespad=0.0, **options)
