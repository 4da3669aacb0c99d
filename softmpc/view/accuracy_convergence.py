"""Convergence along one axis of a study: errors over sizes, with fitted orders beside theory."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from softmpc.accuracy.families import FAMILIES
from softmpc.accuracy.orders import AS_THEORY, AT_FLOOR, DIVERGES, TOO_FEW, Fit, fits
from softmpc.view.accuracy_style import (
    DOUBT,
    MARKERS,
    Unit,
    error_unit,
    log_scale,
    outside,
    positive,
    situation,
    ticks_at,
    varied_keys,
)
from softmpc.view.style import ALARM, COLOURS, figure, label, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from softmpc.accuracy.points import FamilyResult, Point

__all__ = ["convergence_axes", "convergence_figure", "key_label", "order_text"]

# What goes to zero, by the last part of the key of scene files that is varied.
SIZES = {
    "segments": "length of a segment (lengths of a section)",
    "step": "step (s)",
    "sample_time": "step (s)",
    "tip_tolerance": "tolerance (m)",
    "tolerance": "tolerance (of scaled states)",
}
KEYS = {
    "frequency_error": "error of frequencies (relative)",
    "integration_m": "error of integration alone (m)",
}
PANEL = 3.3  # inches
# What other formulations and arcs are to be compared with: their series has it beside them.
COMPARED = ("formulation", "kinematics")
BESIDE = ("segments and mass", "2 Gauss points")  # axis and series
BESIDE_NAME = "virtual power, constant strain, 2 Gauss points"
Series = list[tuple[Fit, "list[Point]"]]


def convergence_axes(family: FamilyResult) -> list[str]:
    """The axes with a series of which two errors or more can be shown."""
    return [axis for axis in family.axes if _panels(family, axis)]


@styled
def convergence_figure(family: FamilyResult, axis: str) -> Figure:
    """A panel for each error with an order along the axis, and for each kind of size.

    Legends have the fitted orders with theory.
    """
    panels = _panels(family, axis)
    title = f"Convergence along “{axis}”, {situation(family.name)}"
    made = figure(10.0, 0.6 + PANEL * len(panels), title)
    drawn = made.subplots(len(panels), 1, squeeze=False)[:, 0]
    for axes, ((key, size), own) in zip(drawn, panels.items(), strict=True):
        _draw_panel(axes, key, own)
        unit = _unit(key)
        label(axes, size, unit.label(key_label(family.name, key)))
        outside(axes, labelspacing=0.9)
    return made


def order_text(fit: Fit) -> str:
    """An order beside theory, or why there is none."""
    theory = "no theory" if fit.theory is None else f"theory {fit.theory:g}"
    if fit.verdict in (AT_FLOOR, TOO_FEW) or fit.order is None:
        return f"no order, {fit.verdict} ({theory})"
    if fit.verdict == DIVERGES:
        return f"does not converge, order {_signed(fit.order)} ({theory})"
    return f"order {_signed(fit.order)} ({theory})"


def _signed(order: float) -> str:
    return f"{order:.2f}".replace("-", "−")


def key_label(family: str, key: str) -> str:
    """What an error is called, with its SI unit."""
    if key == "error_m":
        return FAMILIES[family].error_label
    return KEYS.get(key, f"{key.removesuffix('_m').replace('_', ' ')} ({_si(key)})")


def _si(key: str) -> str:
    return "m" if key.endswith("_m") else "relative"


def _unit(key: str) -> Unit:
    return error_unit() if key.endswith("_m") else Unit("relative", 1.0)


def _panels(family: FamilyResult, axis: str) -> dict[tuple[str, str], Series]:
    """For each error and each kind of size the fits of series, with points that can be shown."""
    panels: dict[tuple[str, str], Series] = {}
    known = fits(family)
    for fit in known:
        if fit.axis != axis:
            continue
        shown = _shown(family, fit)
        if len(shown) > 1:
            panels.setdefault((fit.key, _size_label(shown)), []).append((fit, shown))
    for (key, size), series in panels.items():
        for fit in known:
            same = (fit.axis, fit.series, fit.key) == (*BESIDE, key) and axis in COMPARED
            if same and _size_label(_shown(family, fit)) == size:
                series.append((replace(fit, series=BESIDE_NAME), _shown(family, fit)))
    return panels


def _shown(family: FamilyResult, fit: Fit) -> list[Point]:
    """The points of a series that can be shown, the finest first."""
    own = [p for p in family.axis(fit.axis) if p.configuration.series == fit.series]
    shown = [p for p in own if positive(p.configuration.size) and _error(p, fit.key)]
    return sorted(shown, key=lambda p: p.configuration.size or 0.0)


def _draw_panel(axes: Axes, key: str, series: Series) -> None:
    unit = _unit(key)
    for i, (fit, points) in enumerate(series):
        sizes = np.array([point.configuration.size for point in points], float)
        errors = unit.factor * np.array([_error(point, key) for point in points])
        style = _style(fit, i)
        axes.plot(sizes, errors, **style, label=f"{fit.series}:\n{order_text(fit)}")
        if fit.order is not None and fit.scale is not None and fit.verdict != DIVERGES:
            ends = np.array([sizes[0] / 1.15, min(sizes[-1], max(fit.sizes) * 1.6)])
            axes.plot(ends, unit.factor * fit.scale * ends**fit.order, color=style["color"],
                      linewidth=1.0, linestyle="-" if fit.verdict == AS_THEORY else (0, (4, 2)),
                      label="_fit")  # fmt: skip
    _draw_floor(axes, key, [point for _, points in series for point in points], unit)
    ticks_at(axes, (p.configuration.size or 0.0 for _, points in series for p in points))
    log_scale(axes, "y")


def _style(fit: Fit, index: int) -> dict[str, Any]:
    """Marks without line, whose fit is the line; what does not converge is joined, in red.

    Later ones are larger and hollow, so that all are seen where one is on another.
    """
    style: dict[str, Any] = {
        "color": COLOURS[index % len(COLOURS)], "marker": MARKERS[index % len(MARKERS)],
        "linestyle": "none", "markersize": min(5.0 + 2.2 * index, 14.0), "markeredgewidth": 1.3,
        "fillstyle": "none" if index else "full",
    }  # fmt: skip
    if fit.verdict == DIVERGES:
        style |= {"color": ALARM, "marker": "X", "linestyle": (0, (1.5, 1.5)), "linewidth": 1.8,
                  "fillstyle": "full"}  # fmt: skip
    return style


def _draw_floor(axes: Axes, key: str, points: Sequence[Point], unit: Unit) -> None:
    """The doubt of the reference, where errors come near it."""
    own = key.replace("error", "doubt") if "error" in key else f"{key.removesuffix('_m')}_doubt_m"
    doubts = [value for point in points if positive(value := point.error.get(own))]
    least = min(_error(point, key) for point in points)
    if doubts and max(doubts) * 20 > least:
        axes.axhline(unit.factor * max(doubts), label="doubt of the reference", **DOUBT)


def _size_label(points: Sequence[Point]) -> str:
    last = [key.rpartition(".")[2] for key in varied_keys(points)]
    return next((SIZES[name] for name in last if name in SIZES), "size (relative)")


def _error(point: Point, key: str) -> float:
    """Its size; 0 where there is none that can be shown."""
    value = point.error.get(key)
    return abs(value) if value is not None and positive(abs(value)) else 0.0
