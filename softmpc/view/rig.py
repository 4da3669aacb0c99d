"""What happened on a rig: the tip and its estimate, disturbance, innovations, supervision."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from softmpc.rig.supervision import State
from softmpc.view.style import ALARM, COLOURS, GREY, INK, figure, label, legend_right, styled
from softmpc.view.time_plots import TIME

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from softmpc.rig.result import RigResult

__all__ = ["estimate_figure", "rig_figure"]

BAND: dict[str, Any] = {"alpha": 0.25, "linewidth": 0}
LEAST = 1e-3  # of what is drawn of innovations: sensors without noise are off by next to nothing
TOGETHER = 0.02  # of the run
STATE_COLOURS = ("#DDEBDD", "#F5E6B8", "#F3C9A5", "#E8A6A6")


@styled
def rig_figure(result: RigResult) -> Figure:
    """Errors of tip and estimate, disturbance if any, innovations of each sensor, state, faults."""
    some = bool(result.names[1])
    made = figure(9.5, 9.0 if some else 6.8, result.track.title or "Tip tracking on a rig")
    heights = (3, *(3,) * some, 3, 1.6)
    axes = list(made.subplots(len(heights), 1, sharex=True, height_ratios=heights))
    _draw_errors(axes[0], result)
    if some:
        _draw_disturbance(axes[1], result)
    _draw_innovations(axes[-2], result)
    _draw_states(axes[-1], result)
    for one in axes[:-1]:
        _shade_faults(one, result)
    for one in axes:
        one.margins(x=0.01)
        one.tick_params(labelbottom=True)
    return made


def _draw_errors(axes: Axes, result: RigResult) -> None:
    track = result.track
    every = max(1, len(track.time) // 4000)
    places = np.minimum(np.searchsorted(track.time, track.control_time - 1e-9), len(track.tip) - 1)
    off = 1e3 * np.linalg.norm(result.tips[:, -1] - track.tip[places], axis=1)
    spread = 2e3 * np.sqrt((result.tips_spread[:, -1] ** 2).sum(axis=1))
    axes.plot(
        track.time[::every],
        1e3 * track.reachable_error[::every],
        color=ALARM,
        label="tip from path",
    )
    axes.plot(track.control_time, off, color=COLOURS[0], linewidth=1.0, label="estimate from tip")
    axes.plot(
        track.control_time, spread, color=GREY, linewidth=1.0, linestyle="--",
        label="two deviations of it",
    )  # fmt: skip
    axes.set_ylim(bottom=0.0)
    label(axes, TIME, "distance (mm)", "tip")
    legend_right(axes)


def _draw_disturbance(axes: Axes, result: RigResult) -> None:
    time = result.track.control_time
    for i, name in enumerate(result.names[1]):
        offset = name.startswith("offset")
        look: dict[str, Any] = {"color": COLOURS[i % len(COLOURS)]}
        axes.plot(
            time, 100 * result.d[:, i], **look, linewidth=0.8 if offset else 1.3,
            linestyle=":" if offset else "-", label=name.replace("force on ", ""),
        )  # fmt: skip
        low, high = (100 * (result.d[:, i] + s * 2 * result.d_spread[:, i]) for s in (-1, 1))
        if not offset:
            axes.fill_between(time, low, high, **look, **(BAND | {"alpha": 0.12}))
    label(axes, TIME, "% of full", "disturbance as estimated, bands of two deviations")
    legend_right(axes, fontsize=7)


def _draw_innovations(axes: Axes, result: RigResult) -> None:
    for number, name in enumerate(result.sensors):
        own = result.innovation_sensor == number
        if not own.any():
            continue
        time, nis = result.innovation_time[own], result.nis[own] / result.sizes[number]
        good = result.accepted[own]
        colour = COLOURS[number % len(COLOURS)]
        title = name.replace("_", " ")
        axes.plot(time[good], nis[good], ".", markersize=2, color=colour, label=title)
        axes.plot(time[~good], nis[~good], "x", markersize=4, color=colour)
        axes.axhline(result.gate_of(number), color=colour, linewidth=0.8, linestyle="--")
    if not result.accepted.all():
        axes.plot([], [], "x", color=GREY, label="refused")
    axes.plot([], [], "--", color=GREY, linewidth=0.8, label="95 % below, if consistent")
    axes.set_yscale("log")
    axes.set_ylim(bottom=max(axes.get_ylim()[0], LEAST))
    label(axes, TIME, "square per number", "innovations, normalised: 1 on average")
    legend_right(axes)


def _draw_states(axes: Axes, result: RigResult) -> None:
    """The state of supervision as a staircase, faults as bars below it."""
    time = result.track.control_time
    step = time[1] - time[0] if len(time) > 1 else 1.0
    for state in State:
        axes.axhspan(state - 0.5, state + 0.5, color=STATE_COLOURS[state], linewidth=0)
    axes.plot(
        np.append(time, time[-1] + step), np.append(result.state, result.state[-1]),
        drawstyle="steps-post", color=INK,
    )  # fmt: skip
    axes.set_yticks(list(State), [str(state) for state in State])
    axes.set_ylim(-0.5, len(State) - 0.5)
    axes.grid(visible=False)
    label(axes, TIME, "", "supervision")
    _shade_faults(axes, result, named=True)


def _shade_faults(axes: Axes, result: RigResult, named: bool = False) -> None:
    """A band over what of each fault is in the run; with `named` its number, and a legend.

    Numbers of faults that begin together stand side by side.
    """
    last, starts = float(result.track.time[-1]), [start for _, start, _ in result.faults]
    for number, (what, start, end) in enumerate(result.faults, 1):
        if start >= last:
            continue
        name = f"{number}: {what.partition(' from ')[0]}" if named else None
        axes.axvspan(start, min(end, last), color=GREY, alpha=0.25, linewidth=0, label=name)
        beside = sum(abs(start - other) < TOGETHER * last for other in starts[: number - 1])
        if named:
            axes.annotate(
                str(number), (start, len(State) - 0.6), (8 * beside, 0), va="top", fontsize=8,
                textcoords="offset points", color=INK,
            )  # fmt: skip
    if axes.get_legend_handles_labels()[1] and named:
        legend_right(axes, handlelength=0.8)


@styled
def estimate_figure(result: RigResult) -> Figure:
    """Strains as estimated, with a band of two deviations, beside those of the plant."""
    names, time = result.names[0], result.track.control_time
    kinds = list(dict.fromkeys(name.rsplit("_", 2)[0] for name in names))
    made = figure(9.5, 1.0 + 1.9 * len(kinds), result.track.title or "Strains on a rig")
    axes = list(made.subplots(len(kinds), 1, sharex=True, squeeze=False)[:, 0])
    for one, kind in zip(axes, kinds, strict=True):
        own = [i for i, name in enumerate(names) if name.rsplit("_", 2)[0] == kind]
        for k, i in enumerate(own):
            colour = COLOURS[k % len(COLOURS)]
            _, section, segment = names[i].rsplit("_", 2)
            mean, spread = result.strains[:, i], 2 * result.strains_spread[:, i]
            one.fill_between(time, mean - spread, mean + spread, color=colour, **BAND)
            one.plot(
                time, mean, color=colour, linewidth=1.0,
                label=f"section {section}, segment {segment}",
            )  # fmt: skip
            one.plot(time, result.strains_true[:, i], color=colour, linewidth=1.0, linestyle=":")
        one.margins(x=0.01)
        one.tick_params(labelbottom=True)
        label(one, TIME, kind + ("" if kind == "epsilon" else " (1/m)"))
    axes[0].plot([], [], color=GREY, linewidth=1.0, linestyle=":", label="plant")
    axes[0].set_title("lines: estimate, with two deviations; dotted: the plant", loc="left")
    legend_right(axes[0])
    made.align_ylabels(axes)
    return made
