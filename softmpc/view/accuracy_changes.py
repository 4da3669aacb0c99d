"""What each part of a scene changes when it is another one, and what it costs, as bars."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from softmpc.accuracy.model_axes import AS_GIVEN
from softmpc.view.accuracy_style import (
    Mark,
    error_unit,
    log_scale,
    marks,
    metres,
    positive,
    situation,
)
from softmpc.view.style import INK, figure, label, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from softmpc.accuracy.points import FamilyResult, Point

__all__ = ["CHANGES", "change_m", "changed_points", "changes_figure"]

CHANGES = ("effects", "effects added", "drive", "strains", "elasticity")
HATCHES = ("", "////", "....", "xxxx", "----")
LETTERS = 48  # of a name


def change_m(point: Point) -> float | None:
    """What a choice changes (m): against the scene as given, or else its error."""
    return point.error.get("change_m", point.error_m)


def changed_points(family: FamilyResult) -> list[Point]:
    """Points of such parts with a change that can be shown: by axis, largest first."""
    found: list[Point] = []
    for axis in CHANGES:
        own = [point for point in family.axis(axis) if positive(change_m(point))]
        found += sorted(own, key=lambda p: -(change_m(p) or 0.0))
    return found


@styled
def changes_figure(family: FamilyResult) -> Figure:
    """Bars of what each part changes, and of its time beside the scene as given."""
    points = changed_points(family)
    made = figure(10.0, 1.7 + 0.24 * max(4, len(points)),
                  f"What each part of the scene changes {situation(family.name)}")  # fmt: skip
    known = marks(family)
    left, right = made.subplots(1, 2, sharey=True, width_ratios=(3, 2))
    places = np.arange(len(points), dtype=float)
    _draw_changes(left, known, points, places)
    _draw_ratios(right, known, points, places)
    left.set_yticks(places, [_short(point.name) for point in points])
    left.set_ylim(len(points) - 0.4, -0.6)
    for axes in (left, right):
        axes.grid(False, axis="y")
        axes.tick_params(axis="y", length=0)
    shown = list(dict.fromkeys(point.axis for point in points))
    handles = [left.barh(0, 0, **_bar(known[axis], axis), label=axis) for axis in shown]
    made.legend(handles=handles, loc="outside lower center", ncols=5)
    return made


def _draw_changes(
    axes: Axes, known: dict[str, Mark], points: Sequence[Point], places: np.ndarray
) -> None:
    values = np.array([change_m(point) for point in points], float)
    low = 10 ** np.floor(np.log10(values.min()) - 0.3)
    factor = error_unit().factor
    axes.set_xlim(low * factor, values.max() * 25 * factor)
    for point, place, value in zip(points, places, values, strict=True):
        style = _bar(known[point.axis], point.axis)
        axes.barh(place, (value - low) * factor, left=low * factor, **style)
        _write(axes, value * factor, place, metres(value))
    log_scale(axes, "x")
    label(axes, "largest change or error of the tip (mm)", "")


def _draw_ratios(
    axes: Axes, known: dict[str, Mark], points: Sequence[Point], places: np.ndarray
) -> None:
    """From 1 on a logarithmic scale: what is faster goes to the left."""
    shown = [(p, place, p.cost["ratio"]) for p, place in zip(points, places, strict=True)
             if positive(p.cost.get("ratio"))]  # fmt: skip
    ratios = [ratio for _, _, ratio in shown]
    low, high = min([0.5, *ratios]), max([2.0, *ratios])
    axes.set_xlim(low / (high / low) ** 0.25, high * (high / low) ** 0.25)
    for point, place, ratio in shown:
        axes.barh(place, ratio - 1, left=1.0, **_bar(known[point.axis], point.axis))
        _write(axes, ratio, place, f"{ratio:.2f}", before=ratio < 1)
    axes.axvline(1.0, color=INK, linewidth=1.0)
    log_scale(axes, "x")
    label(axes, f"time over that of the scene {AS_GIVEN} (ratio)", "")


def _bar(mark: Mark, axis: str) -> dict[str, Any]:
    hatch = HATCHES[CHANGES.index(axis)]
    return {"color": mark.colour, "hatch": hatch, "edgecolor": "white", "height": 0.7, "zorder": 2,
            "linewidth": 0}  # fmt: skip


def _short(name: str) -> str:
    name = name.replace("$", r"\$")
    return name if len(name) <= LETTERS else name[: LETTERS - 1] + "…"


def _write(axes: Axes, x: float, y: float, text: str, before: bool = False) -> None:
    """A value beside the end of its bar."""
    shift, side = (-3, "right") if before else (3, "left")
    axes.annotate(
        text, (x, y), xytext=(shift, 0), textcoords="offset points", va="center", ha=side,
        fontsize=7, color=INK, zorder=3,
        bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.5, "alpha": 0.8},
    )  # fmt: skip
