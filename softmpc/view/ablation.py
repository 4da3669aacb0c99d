"""What each part of a scene changes and costs, as bars side by side."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from softmpc.study.changes import ADDED, COARSER, FINER, LEFT_OUT, OTHER
from softmpc.study.lengths import length_text
from softmpc.view.style import ALARM, COLOURS, GREY, INK, figure, label, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from softmpc.study.ablate import Ablation, Row

__all__ = ["ablation_figure"]

KINDS = dict(zip((LEFT_OUT, COARSER, OTHER, FINER, ADDED), COLOURS, strict=False))
LONGEST_NAME = 44  # letters in one line
LINE: dict[str, Any] = {"color": ALARM, "linewidth": 1.0, "linestyle": (0, (8, 3, 1, 3))}


@styled
def ablation_figure(found: Ablation, tolerance_m: float | None = None) -> Figure:
    """Largest error of the tip on a logarithmic scale, and time against the scene as given.

    Rows that could not be run are left out; the numerical floor and the tolerance are lines.
    """
    rows = [row for row in found.rows if row.errors and row.cost]
    names = [_wrapped(row.change.name) for row in rows]
    lines = sum(1 + name.count("\n") for name in names)
    made = figure(10.0, 1.6 + 0.21 * max(4, lines), found.title)
    errors, times = made.subplots(1, 2, sharey=True, width_ratios=(3, 2))
    places = _places(names)
    _draw_errors(errors, found, rows, places, tolerance_m)
    _draw_times(times, rows, places)
    errors.set_yticks(places, names)
    errors.set_ylim((places[-1] if rows else 0) + 0.8, -0.3)
    kinds = [kind for kind in KINDS if kind in {row.change.kind for row in rows}]
    handles = [errors.barh(0, 0, color=KINDS[kind], label=kind) for kind in kinds]
    made.legend(handles=handles, loc="outside lower center", ncols=len(kinds) or 1)
    for axes in (errors, times):
        axes.grid(False, axis="y")
        axes.tick_params(axis="y", length=0)
    return made


def _wrapped(name: str) -> str:
    """Long names on two lines, broken where what is taken along begins."""
    head, bracket, tail = name.partition(" (")
    return f"{head}\n({tail}" if bracket and len(name) > LONGEST_NAME else name


def _places(names: list[str]) -> np.ndarray:
    """Middle of each bar: names of two lines take more room."""
    heights = np.array([1.0 if "\n" not in name else 1.7 for name in names])
    return np.cumsum(heights) - heights / 2


def _draw_errors(
    axes: Axes, found: Ablation, rows: list[Row], places: np.ndarray, tolerance_m: float | None
) -> None:
    values = np.array([row.errors.largest[-1] for row in rows if row.errors])
    floor = max(found.baseline.floor_m, 1e-12)
    low = floor / 3
    shown = np.where(values > floor, values, low)
    _bars(axes, rows, places, shown - low, left=low)
    axes.set_xscale("log")
    most = max([*shown.tolist(), tolerance_m or 0.0, 100 * floor])
    axes.set_xlim(low, most * 30)
    for place, value in zip(places, values, strict=True):
        text = length_text(value) if value > floor else "below the floor"
        _write(axes, value if value > floor else low, place, text)
    axes.axvline(floor, color=GREY, linewidth=1.0)
    _name_line(axes, floor, f"numerical floor {length_text(floor)}", GREY)
    if tolerance_m:
        axes.axvline(tolerance_m, **LINE)
        _name_line(axes, tolerance_m, f"tolerance {length_text(tolerance_m)}", ALARM)
    label(axes, "largest change of the tip", "")
    axes.xaxis.set_major_formatter(lambda value, _: length_text(value))


def _draw_times(axes: Axes, rows: list[Row], places: np.ndarray) -> None:
    """Bars from 1 on a logarithmic scale: to the left what is faster."""
    from matplotlib.ticker import LogLocator, NullFormatter

    ratios = np.array([row.time_ratio for row in rows])
    axes.set_xscale("log")
    _bars(axes, rows, places, ratios - 1, left=1.0)
    for place, ratio in zip(places, ratios, strict=True):
        _write(axes, ratio, place, f"{ratio:.2f}", before=ratio < 1)
    low, high = min([0.5, *ratios.tolist()]), max([2.0, *ratios.tolist()])
    axes.set_xlim(low / (high / low) ** 0.2, high * (high / low) ** 0.2)
    axes.axvline(1.0, color=INK, linewidth=1.0)
    label(axes, "time over that of the scene as given", "")
    axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axes.xaxis.set_minor_formatter(NullFormatter())


def _bars(axes: Axes, rows: list[Row], places: np.ndarray, widths: Any, **more: Any) -> None:
    colours = [KINDS[row.change.kind] for row in rows]
    axes.barh(places, widths, height=0.7, color=colours, zorder=2, **more)


def _write(axes: Axes, x: float, y: float, text: str, before: bool = False) -> None:
    """A value beside the end of its bar."""
    shift, side = (-3, "right") if before else (3, "left")
    axes.annotate(
        text, (x, y), xytext=(shift, 0), textcoords="offset points",
        va="center", ha=side, fontsize=7,
        bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.5, "alpha": 0.8}, zorder=3,
    )  # fmt: skip


def _name_line(axes: Axes, x: float, text: str, colour: str) -> None:
    axes.annotate(
        text, (x, 1.0), xycoords=("data", "axes fraction"), xytext=(2, 3),
        textcoords="offset points", color=colour, fontsize=7, ha="left",
    )  # fmt: skip
