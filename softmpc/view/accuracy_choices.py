"""Errors and times over one number, or over names: controllers, compilation, derivatives."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from softmpc.accuracy.configuration import changed
from softmpc.accuracy.families import FAMILIES
from softmpc.accuracy.model_axes import AS_GIVEN
from softmpc.view.accuracy_style import (
    GIVEN,
    MARKERS,
    Unit,
    error_unit,
    log_scale,
    marks,
    outside,
    positive,
    read_key,
    ticks_at,
    time_unit,
    varied_keys,
)
from softmpc.view.style import COLOURS, GREY, LIMIT, dash, figure, label, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from softmpc.accuracy.points import FamilyResult, Point, Study

__all__ = ["controller_axes", "controllers_figure", "times_axes", "times_figure"]

STEP = "track.controller.step"
OWN_SCENE = "track.controller.scene."
IDEAL = "own_plant_m"  # error without an error of the model
LETTERS = 18  # of a name in one line
TIMED = ("compilation", "derivatives")
ACROSS = 4  # panels side by side
NARROWEST = 6.4  # inches: title and legend of the controllers are that wide
ERROR, TIME = "largest tip error (m)", "step time, 95 % (s)"  # room is small
NUMBERS = {  # what numbers of scene files are called, with units
    "horizon": "horizon (steps)",
    "step": "step of the controller (s)",
    "segments": "segments a section (number)",
    "stages": "stages an interval (number)",
    "tip_deviation": "deviation of the tip that costs ½ (m)",
}


@dataclass
class Over:
    """The points of an axis over places: numbers, or names one after the other."""

    points: list[Point]
    places: np.ndarray
    label: str
    given: list[int]  # which of them are the scene as given
    names: list[str] = field(default_factory=list)  # empty where places are numbers


def controller_axes(family: FamilyResult) -> list[str]:
    """Axes of the arm under control with something to show."""
    if family.name != "loop":
        return []
    given = {point.configuration.identity for point in family.points[:1]}
    return [
        axis
        for axis in family.axes
        if axis != AS_GIVEN
        and {point.configuration.identity for point in _shown(family.axis(axis))} - given
    ]


@styled
def controllers_figure(study: Study, family: FamilyResult) -> Figure:
    """Error and step time over what each axis varies, with the time a step may take."""
    axes_names = controller_axes(family)
    rows = -(-len(axes_names) // ACROSS)
    made = figure(max(NARROWEST, 3.2 * min(ACROSS, len(axes_names)) + 0.4), 0.9 + 5.0 * rows,
                  "Controllers: error in closed loop, and time of a step")  # fmt: skip
    grid = made.subplots(2 * rows, min(ACROSS, len(axes_names)), squeeze=False)
    unit = time_unit(p.time_s for p in family.points if positive(p.time_s) and p.time_s)
    for axes in grid.flat:
        axes.set_visible(False)
    for i, name in enumerate(axes_names):
        row, column = 2 * (i // ACROSS), i % ACROSS
        pair = grid[row, column], grid[row + 1, column]
        _draw_pair(pair, study, family, name, unit)
    _legend_of(made, grid)
    return made


def _draw_pair(
    pair: tuple[Axes, Axes], study: Study, family: FamilyResult, axis: str, unit: Unit
) -> None:
    """Errors above, times below, over the same places."""
    over = _over(study, family, axis)
    mark = marks(family)[axis]
    ideal = [p.error.get(IDEAL) for p in over.points]
    _plot(pair[0], over, ideal, error_unit(), color=GREY, marker=".",
          linestyle="none" if over.names else (0, (2, 1.5)),
          label="on the controller's own model")  # fmt: skip
    line = {"color": mark.colour, "marker": mark.marker, "linestyle": "none" if over.names else "-"}
    errors, times = [p.proved_m for p in over.points], [p.time_s for p in over.points]
    for axes, scale, values, text in (
        (pair[0], error_unit(), errors, ERROR),
        (pair[1], unit, times, TIME),
    ):
        axes.set_visible(True)
        _plot(axes, over, values, scale, **line)
        given = [v if i in over.given else None for i, v in enumerate(values)]
        _plot(axes, over, given, scale, **GIVEN, label="the scene as given")
        label(axes, over.label, _broken(scale.label(text)))
    pair[0].set_title(axis, loc="left")
    _draw_budget(pair[1], study, over, unit)
    for axes in pair:
        _set_scales(axes, over)


def _plot(axes: Axes, over: Over, values: Sequence[Any], unit: Unit, **style: Any) -> None:
    """Values that can be shown, over their places."""
    ok = [i for i, value in enumerate(values) if positive(value)]
    if ok:
        y = np.array([values[i] for i in ok], float) * unit.factor
        axes.plot(over.places[ok], y, **style)


def _draw_budget(axes: Axes, study: Study, over: Over, unit: Unit) -> None:
    """What a step may take: the step itself, which the points of some axes change."""
    steps = [read_key(changed(study.document, p.configuration.changes), STEP) for p in over.points]
    ok = [i for i, step in enumerate(steps) if positive(step)]
    if not ok:
        return
    x, y = over.places[ok], np.array([steps[i] for i in ok], float) * unit.factor
    if np.ptp(y) == 0:
        axes.axhline(y[0], label="budget: the step", **LIMIT)
    else:
        axes.plot(x, y, label="budget: the step", **LIMIT)


def _over(study: Study, family: FamilyResult, axis: str) -> Over:
    """Where the points of an axis are drawn, the scene as given among them."""
    points, given = _shown(family.axis(axis)), family.as_given
    same = [p for p in points if given and p.configuration.identity == given.configuration.identity]
    if given and not same and _shown([given]):
        points, same = [given, *points], [given]
    for key in varied_keys(points):
        values = [_value(study, point, key) for point in points]
        if all(positive(value) for value in values) and len(set(values)) == len(values):
            order = np.argsort(values)
            last = key.rpartition(".")[2]
            text = NUMBERS.get(last, f"{last.replace('_', ' ')} (as in the scene file)")
            points, places = [points[i] for i in order], np.array(values, float)[order]
            return Over(points, places, text, [points.index(p) for p in same])
    names = ["\n".join(textwrap.wrap(_plain(p.name), LETTERS)) for p in points]
    places = np.arange(len(points), dtype=float)
    return Over(points, places, f"{axis} (by name)", [points.index(p) for p in same], names)


def _value(study: Study, point: Point, key: str) -> Any:
    """Of a key of scene files; a controller without a scene of its own has that of the file."""
    value = read_key(changed(study.document, point.configuration.changes), key)
    return read_key(study.document, key.removeprefix(OWN_SCENE)) if value is None else value


def _set_scales(axes: Axes, over: Over) -> None:
    axes.margins(0.12, 0.15)
    axes.autoscale_view()
    if over.names:
        axes.set_xlim(-0.6, len(over.names) - 0.4)
        axes.set_xticks(over.places, over.names, rotation=30, ha="right", fontsize=7)
    else:
        ticks_at(axes, over.places)
    log_scale(axes, "y", 1.0)


def _legend_of(made: Figure, grid: np.ndarray) -> None:
    """One legend below for all panels."""
    found: dict[str, Any] = {}
    for axes in grid.flat:
        for handle, text in zip(*axes.get_legend_handles_labels(), strict=True):
            found.setdefault(text, handle)
    made.legend(list(found.values()), list(found), loc="outside lower center", ncols=3)


def times_axes(family: FamilyResult) -> list[str]:
    """Axes of how a model is run, not of what it is, with times."""
    if family.name == "loop":  # controllers have them among their own
        return []
    return [axis for axis in TIMED if any(positive(p.time_s) for p in family.axis(axis))]


@styled
def times_figure(study: Study, family: FamilyResult) -> Figure:
    """Time over segments, a line for each variant of compilation or derivatives."""
    shown = times_axes(family)
    made = figure(9.0, 0.6 + 3.2 * len(shown), "What compilation and derivatives cost")
    unit = time_unit(p.time_s for a in shown for p in family.axis(a) if positive(p.time_s))
    for axes, axis in zip(made.subplots(len(shown), 1, squeeze=False)[:, 0], shown, strict=True):
        points = [point for point in family.axis(axis) if positive(point.time_s)]
        if len({_segments(study, point) for point in points}) > 1:
            _draw_over_segments(axes, study, points, unit)
        else:
            _draw_by_name(axes, points, unit)
        log_scale(axes, "y", 1.0)
        x = axes.get_xlabel() or f"{axis} (by name)"
        label(axes, x, unit.label(FAMILIES[family.name].cost_label), axis)
    return made


def _draw_over_segments(axes: Axes, study: Study, points: Sequence[Point], unit: Unit) -> None:
    for i, name in enumerate(dict.fromkeys(_variant(point) for point in points)):
        own = sorted((_segments(study, p), p.time_s) for p in points if _variant(p) == name)
        x, y = np.array(own, float).T
        axes.plot(x, y * unit.factor, color=COLOURS[i % len(COLOURS)], linestyle=dash(i),
                  marker=MARKERS[i % len(MARKERS)], label=name)  # fmt: skip
    axes.margins(0.08, 0.12)
    axes.autoscale_view()
    ticks_at(axes, [_segments(study, point) for point in points])
    axes.set_xlabel("segments a section (number)")
    outside(axes)


def _draw_by_name(axes: Axes, points: Sequence[Point], unit: Unit) -> None:
    """All have as many segments."""
    places = np.arange(len(points), dtype=float)
    axes.plot(places, [unit.factor * (p.time_s or 0.0) for p in points], "o", color=COLOURS[0])
    axes.set_xticks(places, [_plain(point.name) for point in points])
    axes.set_xlim(-0.6, len(points) - 0.4)


def _plain(name: str) -> str:
    return name.replace("$", r"\$")  # no formulas


def _variant(point: Point) -> str:
    """Its name without its segments."""
    return re.sub(r", \d+ segments?$", "", point.name)


def _segments(study: Study, point: Point) -> float:
    value = read_key(changed(study.document, point.configuration.changes), "model.segments")
    return float(value) if positive(value) else 1.0


def _shown(points: Sequence[Point]) -> list[Point]:
    return [point for point in points if positive(point.proved_m) or positive(point.time_s)]


def _broken(text: str) -> str:
    """A long label on two lines, the unit on the second."""
    head, bracket, tail = text.rpartition(" (")
    return f"{head}\n({tail}" if bracket and len(text) > 30 else text
