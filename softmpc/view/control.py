"""What a controller did: inputs and their rates, pressures, and how long each step took."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from softmpc.view.style import (
    ALARM,
    GREY,
    LIMIT,
    colour,
    dash,
    figure,
    label,
    legend_right,
    styled,
    width,
)
from softmpc.view.time_plots import MOST_NAMES, TIME, draw_pressures, draw_solve_times, draw_torques

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from softmpc.model.model import Model

__all__ = ["control_figure", "shade_out_of_reach"]

MARKS = ("x", "+", "v", "s", "D")
MOST_POINTS = 4000
FEW_NAMES = 9  # beside one of the axes
SMALL: dict[str, Any] = {"fontsize": 7, "labelspacing": 0.2}


@styled
def control_figure(model: Model, result: Any) -> Figure:
    """Inputs with their limits, rates, pressures and times of the steps of a `TrackResult`."""
    driven = model.scene.actuation.input == "torque"
    made = figure(9.5, 9.5 if driven else 7.5, f"{result.title or 'Tip tracking'}: control")
    axes = list(made.subplots(3 + driven, 1, sharex=True))
    arm, every = model.scene.manipulator, max(1, len(result.time) // MOST_POINTS)
    if driven:
        draw_torques(axes[0], arm, result.control_time, result.u)
    _draw_rates(axes[-3], model, result)
    draw_pressures(axes[-2], arm, result.time[::every], result.p[::every])
    draw_solve_times(axes[-1], result.control_time, result.step_ms, result.budget_ms, "budget")
    _draw_statuses(axes[-1], result)
    for one in axes[:-1]:
        shade_out_of_reach(one, result)
    for one in axes:
        one.margins(x=0.01)
        one.tick_params(labelbottom=True)
    made.align_ylabels(axes)
    named = axes[0] if driven else axes[-2]  # torques or pressures
    names = len(named.get_legend_handles_labels()[1])
    if names <= MOST_NAMES:
        legend_right(named, **({} if names <= FEW_NAMES else SMALL))
    legend_right(axes[-1])
    return made


def shade_out_of_reach(axes: Axes, result: Any) -> None:
    """A light band over the times at which the reference is out of reach; lines where it jumps."""
    far = result.out_of_reach
    if far is None or not np.any(far > 0):
        return
    edges = np.diff(np.concatenate([[0], (far > 0).astype(int), [0]]))
    starts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1
    for k, (a, b) in enumerate(zip(starts, ends, strict=True)):
        name = "path out of reach" if k == 0 else "_nolegend_"
        axes.axvspan(
            result.time[a], result.time[b], color=ALARM, alpha=0.09, linewidth=0, label=name
        )
    for jump in result.jumps:
        axes.axvline(jump, color=GREY, linewidth=0.8)


def _draw_rates(axes: Axes, model: Model, result: Any) -> None:
    """Change of the inputs from step to step, over its length, and the limit of it."""
    if len(result.control_time) < 2:
        return
    step = result.control_time[1] - result.control_time[0]
    torque = model.scene.actuation.input == "torque"
    size, unit = (1.0, "N·m/s") if torque else (1e6, "MPa/s")
    before = result.u[:1] if result.u_start is None else result.u_start[None]
    rates = np.diff(np.vstack([before, result.u]), axis=0) / step / size
    unit_number = 0
    for s, section in enumerate(model.scene.manipulator.sections):
        for j in range(section.units):
            look: dict[str, Any] = {"color": colour(s), "linestyle": dash(j), "linewidth": width(s)}
            rate = rates[:, unit_number]
            axes.plot(result.control_time, rate, **look, drawstyle="steps-post")
            unit_number += 1
    if result.rate_limit is not None:
        for side in (-1, 1):
            axes.axhline(side * result.rate_limit / size, **LIMIT)
    name = "rate of motor torques" if torque else "rate of pressures"
    limit = "" if result.rate_limit is None else ", and its limit"
    label(axes, TIME, f"rate ({unit})", name + limit)


def _draw_statuses(axes: Axes, result: Any) -> None:
    """A mark on each step that was not solved, one kind of mark for each status."""
    words = np.array([_word(status) for status in result.statuses])
    kinds = [str(kind) for kind in np.unique(words) if kind != "solved"]
    for k, kind in enumerate(kinds):
        own = words == kind
        look: dict[str, Any] = {"marker": MARKS[k % len(MARKS)], "linestyle": "none"}
        name = f"{kind} ({int(own.sum())})"
        axes.plot(
            result.control_time[own],
            result.step_ms[own],
            **look,
            color=ALARM,
            markersize=5,
            label=name,
        )
    solved = int((words == "solved").sum())
    axes.set_title(f"controller: {solved} of {len(words)} steps solved", loc="left")


def _word(status: str) -> str:
    """A status without its reason."""
    return status.partition(":")[0]
