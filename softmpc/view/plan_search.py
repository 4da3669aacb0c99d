"""How a plan was found: its starts on the first mesh, and what finer meshes changed."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from softmpc.planning.result import NOT_LEAST, SOLVED, PlanResult, cost_unit
from softmpc.view.style import COLOURS, INK, LIMIT, figure, label, styled
from softmpc.view.time_plots import plain_log

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["draw_refinement"]

DOTS: dict[str, Any] = {"color": COLOURS[0], "marker": "o", "markersize": 5}
WON, MET, NOT_MET = COLOURS[0], "#9DC3DE", "#D9D9D9"
SHORT = 0.7  # of the longest: bars below have no room for their cost
ROWS = 6  # for starts, at least
SMALLEST = 1e-6  # mm: a defect below is rounding


@styled
def draw_refinement(result: PlanResult) -> Figure:
    """How the starts ended; cost, defect and least clearance over the number of intervals.

    A plan without a motion shows its starts alone.
    """
    levels = result.levels
    clear = any(np.isfinite(level.clearance) for level in levels)
    panels = 1 + (2 + clear if levels else 0)
    height = max(3.4, 1.6 + 0.3 * len(result.starts))
    title = f"{result.title or 'Plan'}: how it was found" + (
        "" if result.status == SOLVED else f" – {result.status}"
    )
    made = figure(4.6 + 2.9 * (panels - 1), height, title)
    widths = (1.35, *(1.0,) * (panels - 1))
    axes = list(made.subplots(1, panels, width_ratios=widths, squeeze=False)[0])
    _draw_starts(axes[0], result)
    if levels:
        _draw_cost(axes[1], result)
        _draw_defect(axes[2], result)
    if clear:
        _draw_clearance(axes[3], result)
    return made


def _draw_starts(axes: Axes, result: PlanResult) -> None:
    """The cost of each start on the first mesh, how it ended, and which one won."""
    starts = result.starts
    costs = np.array([start.cost for start in starts])
    longest = np.nanmax(costs, initial=0.0) if np.isfinite(costs).any() else 1.0
    axes.set_axisbelow(True)
    for k, (start, cost) in enumerate(zip(starts, costs, strict=True)):
        fill = WON if start.won else MET if start.status in (SOLVED, NOT_LEAST) else NOT_MET
        ink = "white" if start.won else INK
        axes.barh(k, cost if np.isfinite(cost) else 0.0, color=fill, height=0.7)
        words = f"{start.name}: {'won, ' * start.won}{start.status}"
        axes.text(0.02 * longest, k, words, va="center", fontsize=8, color=ink)
        if cost > SHORT * longest:
            axes.text(0.98 * cost, k, f"{cost:.4g}", va="center", ha="right", fontsize=8, color=ink)
    axes.set_ylim(max(len(starts), ROWS) - 0.4, -0.6)
    axes.set_yticks(range(len(starts)), [f"{k + 1}" for k in range(len(starts))])
    axes.grid(visible=False, axis="y")
    label(axes, _cost(result), "start", "starts on the first mesh")


def _cost(result: PlanResult) -> str:
    return f"{result.problem.least} ({cost_unit(result.problem)})"


def _draw_cost(axes: Axes, result: PlanResult) -> None:
    costs = [level.cost for level in result.levels]
    _over_intervals(axes, result, costs)
    spread = max(costs) - min(costs)
    if spread < 0.01 * abs(costs[-1]):  # or rounding looks like a trend
        middle, half = (max(costs) + min(costs)) / 2, 0.01 * abs(costs[-1])
        axes.set_ylim(middle - half, middle + half)
    share = 100 * result.cost_error / abs(costs[-1]) if costs[-1] else np.nan
    last = f", last change {share:.2g} %" if np.isfinite(share) else ""
    label(axes, "intervals", _cost(result), f"cost{last}")


def _draw_defect(axes: Axes, result: PlanResult) -> None:
    """Largest distance of a section tip between plan and replay."""
    defects = 1e3 * np.array([level.defect for level in result.levels])
    _over_intervals(axes, result, np.where(np.isfinite(defects), defects.clip(SMALLEST), np.nan))
    if np.isfinite(defects).any():
        axes.set_yscale("log")
        plain_log(axes)
    label(axes, "intervals", "defect (mm)", "section tips, plan to replay")


def _draw_clearance(axes: Axes, result: PlanResult) -> None:
    """Least clearance along arm and time, between nodes too."""
    _over_intervals(axes, result, [1e3 * level.clearance for level in result.levels])
    margin = 1e3 * result.problem.margin
    axes.axhline(margin, **LIMIT, label="margin")
    axes.legend(loc="best")
    label(axes, "intervals", "clearance (mm)", "least clearance in replay")


def _over_intervals(axes: Axes, result: PlanResult, values: Any) -> None:
    """A value of each round over its number of intervals."""
    from matplotlib.ticker import NullFormatter, NullLocator

    counts = [level.intervals for level in result.levels]
    axes.plot(counts, values, **DOTS)
    axes.set_xscale("log")
    axes.set_xlim(min(counts) / 1.4, max(counts) * 1.4)
    axes.set_xticks(sorted(set(counts)), [f"{count}" for count in sorted(set(counts))])
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_minor_formatter(NullFormatter())
