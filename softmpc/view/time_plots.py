"""Curves over time: section tips, strains, torques, pressures, solve times.

Each `draw_…` fills axes of a larger picture, each `…_figure` is a picture of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from softmpc.view.style import (
    DASHES,
    GREY,
    INK,
    LIMIT,
    REFERENCE,
    colour,
    dash,
    figure,
    label,
    legend_right,
    styled,
    width,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from softmpc.model.model import Model
    from softmpc.model.parameters import Manipulator

__all__ = [
    "draw_pressures", "draw_solve_times", "draw_torques", "errors_figure", "inputs_figure",
    "plain_log", "solve_times_figure", "strains_figure", "tips_figure",
]  # fmt: skip

TIME = "time (s)"
MOST_NAMES = 16  # in a legend
STRAIN_LABELS = {
    "epsilon": ("stretch", "ε (%)", 100.0),
    "kappa_x": ("bending about x", "κx (1/m)", 1.0),
    "kappa_y": ("bending about y", "κy (1/m)", 1.0),
    "kappa_z": ("twist", "κz (1/m)", 1.0),
}
LEAST = 1e-2  # of m, % or 1/m: what is smaller is rounding, and not blown up


def panels(count: int, title: str, height: float = 1.85) -> tuple[Figure, list[Axes]]:
    """A column of axes over one time axis."""
    made = figure(8.5, 0.9 + height * count, title)
    axes = made.subplots(count, 1, sharex=True, squeeze=False)[:, 0]
    return made, list(axes)


@styled
def tips_figure(
    time: np.ndarray,
    tips: np.ndarray,
    reference: np.ndarray | None = None,
    title: str = "Section tips",
    speeds: np.ndarray | None = None,
) -> Figure:
    """Coordinates of the section tips (K×S×3, m), and what the last one is to follow.

    With `speeds` (K×S, m/s) those have a panel of their own.
    """
    made, axes = panels(3 if speeds is None else 4, title)
    for k, (one, name) in enumerate(zip(axes[:3], "xyz", strict=True)):
        if reference is not None:
            one.plot(time, reference[:, k], **REFERENCE, label="reference")
        for s in range(tips.shape[1]):
            look = {"color": colour(s), "linestyle": dash(s), "linewidth": width(s)}
            one.plot(time, tips[:, s, k], **look, label=f"section {s + 1}")
        label(one, TIME, f"{name} (m)")
        _show_at_least(one)
    if speeds is not None:
        for s, speed in enumerate(speeds.T):
            axes[3].plot(time, speed, color=colour(s), linestyle=dash(s), linewidth=width(s))
        label(axes[3], TIME, "speed (m/s)")
        _show_at_least(axes[3])
    _finish(axes)
    return made


@styled
def strains_figure(model: Model, time: np.ndarray, q: np.ndarray, title: str = "Strains") -> Figure:
    """Strains (K×n) of all segments, a panel a kind."""
    scene = model.scene
    kinds = scene.strains
    made, axes = panels(len(kinds), title)
    by_segment = q.reshape(len(q), -1, len(kinds))
    for k, (one, kind) in enumerate(zip(axes, kinds, strict=True)):
        name, unit, factor = STRAIN_LABELS[kind]
        for i in range(by_segment.shape[1]):
            s, part = divmod(i, scene.segments)
            text = _segment_name(s, part, scene.segments)
            style = dash(part if scene.segments > 1 else s)
            look = {"color": colour(s), "linestyle": style, "linewidth": width(s)}
            one.plot(time, factor * by_segment[:, i, k], **look, label=text)
        label(one, TIME, unit, name)
        _show_at_least(one)
    _finish(axes)
    return made


def _segment_name(section: int, part: int, segments: int) -> str:
    """Name of a segment's curve in a legend: one a section where dashes would repeat."""
    if segments == 1:
        return f"section {section + 1}"
    if segments <= len(DASHES):
        return f"section {section + 1}, segment {part + 1}"
    return f"section {section + 1}, {segments} segments" if part == 0 else "_"  # not in the legend


@styled
def inputs_figure(
    model: Model, time: np.ndarray, u: np.ndarray, p: np.ndarray, title: str = "Drive"
) -> Figure:
    """Motor torques where there are any, and unit pressures, with their limits."""
    torque = model.scene.actuation.input == "torque"
    made, axes = panels(1 + torque, title, 2.3)
    if torque:
        draw_torques(axes[0], model.scene.manipulator, time, u)
    draw_pressures(axes[-1], model.scene.manipulator, time, p)
    _finish(axes)
    return made


@styled
def solve_times_figure(
    time: np.ndarray,
    step_ms: np.ndarray,
    budget_ms: float | None = None,
    title: str = "Solve times",
) -> Figure:
    """How long each step of the controller took."""
    made, axes = panels(1, title, 2.6)
    draw_solve_times(axes[0], time, step_ms, budget_ms)
    _finish(axes)
    return made


@styled
def errors_figure(time: np.ndarray, errors: np.ndarray, title: str = "Distance of tips") -> Figure:
    """ERR_i of Eq. (37) for each section (K×S, m), and their sum."""
    made, axes = panels(1, title, 2.8)
    for s, error in enumerate(errors.T):
        axes[0].plot(
            time, 1e3 * error, color=colour(s), linestyle=dash(s), label=f"section {s + 1}"
        )
    if errors.shape[1] > 1:
        total = 1e3 * errors.sum(axis=1)
        axes[0].plot(time, total, color=INK, linewidth=0.9, label="sum of sections")
    label(axes[0], TIME, "distance (mm)")
    _finish(axes)
    return made


def draw_torques(axes: Axes, arm: Manipulator, time: np.ndarray, u: np.ndarray) -> None:
    """Motor torques (K×units, N·m), held from sample to sample."""
    limits = arm.limits.torque_min, arm.limits.torque_max
    _draw_units(axes, arm, time, u, limits, drawstyle="steps-post")
    label(axes, TIME, "torque (N·m)", "motor torques")


def draw_pressures(
    axes: Axes,
    arm: Manipulator,
    time: np.ndarray,
    p: np.ndarray,
    limits: Sequence[float] | None = None,
) -> None:
    """Unit pressures (K×units, Pa), with these limits (Pa) or the arm's; infinite ones are none."""
    low, high = limits or (arm.limits.pressure_min, arm.limits.pressure_max)
    _draw_units(axes, arm, time, p / 1e6, (low / 1e6, high / 1e6))
    label(axes, TIME, "pressure (MPa)", "unit pressures")


def _draw_units(
    axes: Axes,
    arm: Manipulator,
    time: np.ndarray,
    values: np.ndarray,
    limits: Sequence[float],
    **how: Any,
) -> None:
    """One curve a unit: colour for the section, dashes for the unit in it; limits as lines."""
    unit = 0
    for s, section in enumerate(arm.sections):
        for j in range(section.units):
            look = {"color": colour(s), "linestyle": dash(j), "linewidth": width(s), **how}
            axes.plot(time, values[:, unit], **look, label=f"unit {unit + 1} (section {s + 1})")
            unit += 1
    shown = [limit for limit in limits if np.isfinite(limit)]
    for limit, name in zip(shown, ("limits", "_nolegend_"), strict=False):
        axes.axhline(limit, **LIMIT, label=name)


def draw_solve_times(
    axes: Axes,
    time: np.ndarray,
    step_ms: np.ndarray,
    budget_ms: float | None = None,
    of: str = "sampling",
) -> None:
    """Solve times (ms) on a logarithmic scale, the median, and the time there is for a step."""
    axes.semilogy(time, step_ms, ".", color=GREY, markersize=4, label="step")
    median = float(np.median(step_ms))
    axes.axhline(median, color=INK, linewidth=1.2, label=f"median {median:.3g} ms")
    if budget_ms:
        axes.axhline(budget_ms, **LIMIT, label=f"{of} {budget_ms:.3g} ms")
    label(axes, TIME, "solve time (ms)", "controller")
    plain_log(axes)


def _show_at_least(axes: Axes, span: float = LEAST) -> None:
    """Widen the y axis to `span`, so that rounding errors look like zero."""
    low, high = axes.get_ylim()
    if high - low < span:
        axes.set_ylim((low + high - span) / 2, (low + high + span) / 2)


def plain_log(axes: Axes) -> None:
    """Plain numbers at 1, 2, 5 of each decade on a logarithmic y axis, which spans at least one."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    low, high = axes.get_ylim()
    spread = max(1.0, np.sqrt(10 * low / high))
    axes.set_ylim(low / spread, high * spread)
    axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5) if high / low < 1e3 else (1,)))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())


def _finish(axes: list[Axes]) -> None:
    """Tight time axes with their numbers, and one legend beside the first axes."""
    for one in axes:
        one.margins(x=0.01)
        one.tick_params(labelbottom=True)
    axes[0].figure.align_ylabels(axes)
    _, names = axes[0].get_legend_handles_labels()
    if len(names) <= MOST_NAMES:
        legend_right(axes[0])
