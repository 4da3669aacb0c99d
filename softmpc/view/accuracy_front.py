"""Work and precision of one family of a study: errors over costs, the Pareto front named."""

from __future__ import annotations

import re
import textwrap
from typing import TYPE_CHECKING, Any

import numpy as np

from softmpc.accuracy.families import FAMILIES
from softmpc.accuracy.front import front
from softmpc.accuracy.model_axes import AS_GIVEN
from softmpc.view.accuracy_labels import place_labels
from softmpc.view.accuracy_style import (
    DOUBT,
    GIVEN,
    Mark,
    Unit,
    error_unit,
    log_scale,
    marks,
    metres,
    outside,
    paler,
    positive,
    time_unit,
)
from softmpc.view.style import INK, dash, figure, label, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from softmpc.accuracy.points import FamilyResult, Point, Study

__all__ = ["front_figure", "seen", "work_precision_figure"]

FRONT: dict[str, Any] = {"color": INK, "linewidth": 2.2, "zorder": 3}
HOLLOW: dict[str, Any] = {"color": "white", "linestyle": "none", "label": "_hollow"}
PALEST = 0.85  # share of white
LETTERS = 22  # of a name in one line
FAR = 10.0  # a doubt that many times below the least error is not in the picture
TITLES = {
    "rest": "The arm at rest: error over the cost of a call",
    "motion": "The arm in motion: error over the time to simulate",
    "loop": "The arm under control: error over the time of a step",
}
Line = tuple["list[Point]", dict[str, Any]]


def seen(family: FamilyResult) -> list[Point]:
    """The points with an error and a time that logarithmic scales can show."""
    return [p for p in family.points if positive(p.proved_m) and positive(p.time_s)]


@styled
def work_precision_figure(family: FamilyResult) -> Figure:
    """All points of a family, an axis a mark, and its front with names.

    Points below the doubt of the reference are drawn at it, and hollow. Labels have their units.
    """
    made = figure(11.0, 6.4, TITLES.get(family.name, f"{family.name}: error over time"))
    axes: Axes = made.subplots()
    units = _units(family)
    lines = _lines(family, marks(family))
    for points, style in lines:
        x, y = _data(points, units)
        axes.plot(x, y, **style)
        hollow = [i for i, point in enumerate(points) if point.at_floor]
        axes.plot(x[hollow], y[hollow], **style | HOLLOW)
    _finish(axes, family, units, [_array(points, units) for points, _ in lines])
    return made


@styled
def front_figure(study: Study, family: str) -> Figure:
    """The front of one family of a study, small, for a page 800 pixels wide.

    Raises `KeyError` for a family that the study has not.
    """
    found = study.family(family)
    made = figure(5.34, 3.9)
    axes: Axes = made.subplots()
    units = _units(found)
    x, y = _data(seen(found), units)
    axes.plot(x, y, "o", color="#B5B5B5", markersize=3, label="all that was measured")
    axes.set_title(_wrapped(TITLES[family], 60), loc="left")
    _finish(axes, found, units, [np.column_stack([x, y])], below=True)
    return made


def _finish(
    axes: Axes, family: FamilyResult, units: tuple[Unit, Unit], lines: list[np.ndarray],
    below: bool = False,
) -> None:  # fmt: skip
    """Front, doubt, the scene as given, scales, legend and names."""
    best = [point for point in front(family).points if point in seen(family)]
    x, y = _data(best, units)
    axes.plot(x, y, drawstyle="steps-post", label="Pareto front: nothing is cheaper and better",
              **FRONT)  # fmt: skip
    axes.plot(x, y, "o", markersize=9, color="none", markeredgecolor=INK, label="_front", zorder=4)
    if family.as_given and family.as_given in seen(family):
        axes.plot(*_data([family.as_given], units), **GIVEN, label="the scene as given", zorder=5)
    _draw_doubt(axes, family, units[1], hollow=not below)
    axes.margins(0.12, 0.14)
    axes.autoscale_view()
    log_scale(axes, "x")
    log_scale(axes, "y")
    known = FAMILIES[family.name]
    label(axes, units[0].label(known.cost_label), units[1].label(known.error_label))
    if below:
        made = axes.get_figure(root=True)
        assert made is not None
        made.legend(loc="outside lower center", ncols=2, fontsize=7)
    else:
        outside(axes)
    names = [(a, b, _wrapped(_name(p))) for p, a, b in zip(best, x, y, strict=True)]
    place_labels(axes, names, [*lines, _steps(x, y)])


def _lines(family: FamilyResult, known: dict[str, Mark]) -> list[Line]:
    """The series and lone points of each axis, with how they are drawn; later series are paler."""
    lines: list[Line] = []
    shown = seen(family)
    for axis in family.axes:
        if axis == AS_GIVEN:
            continue
        points = [point for point in shown if point.axis == axis]
        names = dict.fromkeys(p.configuration.series for p in points)
        for i, series in enumerate(names):
            mark = known[axis]
            style: dict[str, Any] = {
                "color": paler(mark.colour, PALEST * i / len(names)), "marker": mark.marker,
                "markeredgecolor": mark.colour, "markersize": 5.5, "linewidth": 1.1,
                "linestyle": dash(i) if series else "none",
                "label": f"{axis}: {series}" if series else axis,
            }  # fmt: skip
            lines.append(([p for p in points if p.configuration.series == series], style))
    return lines


def _draw_doubt(axes: Axes, family: FamilyResult, unit: Unit, hollow: bool) -> None:
    """A line; where it is far below all points the legend tells how large it is."""
    shown = seen(family)
    doubts = [p.doubt_m for p in shown if p.doubt_m is not None and positive(p.doubt_m)]
    if not doubts:
        return
    doubt, least = max(doubts), min(p.proved_m for p in shown if p.proved_m is not None)
    text = f"doubt of the reference, {metres(doubt)}"
    if hollow and any(point.at_floor for point in shown):
        text += " (hollow: at or below)"
    if doubt > least / FAR:
        axes.axhline(doubt * unit.factor, label=text, **DOUBT)
    else:
        axes.plot([], [], label=text + " (off scale)", **DOUBT)


def _units(family: FamilyResult) -> tuple[Unit, Unit]:
    """Those of costs and of errors."""
    return time_unit(p.time_s for p in seen(family) if p.time_s is not None), error_unit()


def _data(points: list[Point], units: tuple[Unit, Unit]) -> np.ndarray:
    """Costs and errors, 2×n, in what they are shown in."""
    values = [(p.time_s, p.proved_m) for p in points]
    return np.array(values, float).reshape(-1, 2).T * np.array([[u.factor] for u in units])


def _array(points: list[Point], units: tuple[Unit, Unit]) -> np.ndarray:
    return _data(points, units).T


def _steps(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """The corners of the front as it is drawn."""
    corners = [(x[0], y[0])] if len(x) else []
    for a, b, before in zip(x[1:], y[1:], y[:-1], strict=True):
        corners += [(a, before), (a, b)]
    return np.array(corners, float).reshape(-1, 2)


def _name(point: Point) -> str:
    return point.name.replace("$", r"\$")


def _wrapped(name: str, letters: int = LETTERS) -> str:
    """On lines that are no longer than that, broken at commas where it can be."""
    if len(name) <= letters:
        return name
    lines: list[str] = []
    for part in re.split(r"(?<=,) ", name):
        if lines and len(lines[-1]) + len(part) < letters:
            lines[-1] += f" {part}"
        else:
            lines += textwrap.wrap(part, letters)
    return "\n".join(lines)
