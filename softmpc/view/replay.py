"""A flight log and what came out of it again: inputs and their differences."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from softmpc.view.style import (
    ALARM,
    COLOURS,
    LIMIT,
    dash,
    figure,
    label,
    legend_right,
    styled,
)
from softmpc.view.time_plots import TIME

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["replay_figure"]

MARKS = ("o", "x", "+")
BAND: dict[str, Any] = {"color": "#BDBDBD", "linewidth": 3.5}
LEAST = 1e-18  # what counts as nothing


@styled
def replay_figure(
    title: str,
    time: np.ndarray,
    recorded: np.ndarray,
    replayed: Mapping[str, np.ndarray],
    comparisons: Sequence[Any],
    torque: bool = True,
) -> Figure:
    """Inputs as recorded (K×k) and as replayed, by name, and by how much they differ.

    `comparisons` are those of `softmpc.codegen.replay`; inputs are SI.
    """
    made = figure(9.5, 7.0, f"{title}: replay")
    axes = list(made.subplots(2, 1, sharex=True, height_ratios=(3, 2)))
    size, unit, what = (1.0, "N·m", "torques") if torque else (1e6, "MPa", "pressures")
    _draw_inputs(axes[0], time, recorded / size, {n: u / size for n, u in replayed.items()})
    label(axes[0], TIME, f"{what[:-1]} ({unit})", f"{what}, recorded and replayed")
    _draw_differences(axes[1], time, comparisons)
    about = "largest difference in a step; at the lower edge: none"
    label(axes[1], TIME, f"difference ({'N·m' if torque else 'Pa'})", about)
    for one in axes:
        one.margins(x=0.01)
        one.tick_params(labelbottom=True)
        legend_right(one)
    made.align_ylabels(axes)
    return made


def _draw_inputs(
    axes: Axes, time: np.ndarray, recorded: np.ndarray, replayed: Mapping[str, np.ndarray]
) -> None:
    """Broad bands for what was recorded, thin lines upon them for each replay."""
    for i, values in enumerate(recorded.T):
        axes.plot(time, values, **BAND, label="_" if i else "recorded", drawstyle="steps-post")
    for n, (name, u) in enumerate(replayed.items()):
        look: dict[str, Any] = {"color": COLOURS[n], "linestyle": dash(n), "linewidth": 1.0}
        for i, values in enumerate(u.T):
            axes.plot(time, values, **look, label="_" if i else name, drawstyle="steps-post")


def _draw_differences(axes: Axes, time: np.ndarray, comparisons: Sequence[Any]) -> None:
    """Differences on a logarithmic scale; those that are none at its lower end."""
    found = [c.difference[np.isfinite(c.difference)] for c in comparisons]
    some = np.concatenate([values[values > LEAST] for values in found])
    tolerances = [c.tolerance for c in comparisons if c.tolerance > 0]
    every = [*some, *tolerances, 1e-16]
    low, high = 10.0 ** np.floor(np.log10(min(every)) - 1), 10.0 ** np.ceil(np.log10(max(every)))
    if any(one.statuses for one in comparisons):
        high *= (high / low) ** 0.25  # room for their marks
    axes.set_yscale("log")
    axes.set_ylim(low, max(10 * low, 10 * high))
    for n, one in enumerate(comparisons):
        look: dict[str, Any] = {"color": COLOURS[n], "marker": MARKS[n % 3], "linestyle": "none"}
        name = f"{one.name}: {one.same_bits} of {one.steps} the same bits"
        shown = np.clip(one.difference, low, high)  # infinite ones too
        axes.plot(time, shown, **look, markersize=3.5, label=name, clip_on=False)
        _draw_tolerance(axes, one)
        _draw_statuses(axes, time, one, n)


def _draw_tolerance(axes: Axes, one: Any) -> None:
    if one.tolerance > 0:
        axes.axhline(one.tolerance, **LIMIT, label=f"tolerance {one.tolerance:g}")


def _draw_statuses(axes: Axes, time: np.ndarray, one: Any, row: int) -> None:
    """A mark at the upper edge for each step whose status is another one, a row each replay."""
    places = [place for place, _, _ in one.statuses]
    if places:
        height = np.full(len(places), 0.97 - 0.06 * row)
        look: dict[str, Any] = {"color": ALARM, "marker": "|", "linestyle": "none", "markersize": 9}
        name = f"{one.name}: another status ({len(places)})"
        axes.plot(time[places], height, **look, transform=axes.get_xaxis_transform(), label=name)
