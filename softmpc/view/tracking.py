"""The picture of a closed-loop run: the arm along its path, its error, torques and pressures."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from softmpc.view.arm import Arm, box_of, draw_base, draw_line, draw_tube, space
from softmpc.view.control import shade_out_of_reach
from softmpc.view.style import ALARM, GREY, INK, REFERENCE, TRACE, figure, label, styled
from softmpc.view.time_plots import TIME, draw_pressures, draw_torques, plain_log

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from softmpc.model.model import Model

__all__ = ["tracking_figure"]

GHOSTS = 7
OUT_OF_REACH: dict[str, Any] = {"color": ALARM, "linewidth": 4.0, "alpha": 0.35}
NEAREST: dict[str, Any] = {"color": INK, "linewidth": 1.0, "linestyle": (0, (2, 1.5))}
MOST_POINTS = 2000


@styled
def tracking_figure(model: Model, result: Any) -> Figure:
    """The run as one picture; `result` is a `TrackResult`, `model` that of the plant."""
    made = figure(12.5, 7, _title(result))
    halves: Any = made.subfigures(1, 2, width_ratios=(1, 1.75))
    left, right = halves
    _draw_space(left, Arm(model), result)
    grid = right.add_gridspec(3, 2, width_ratios=(1, 2.1))
    path, *over_time = (
        right.add_subplot(place) for place in (grid[0, 0], grid[0, 1], grid[1, :], grid[2, :])
    )
    _draw_path(path, result)
    _draw_error(over_time[0], result)
    _draw_drive(over_time[1:], model, result)
    for axes in over_time:
        axes.margins(x=0.01)
        shade_out_of_reach(axes, result)
    right.align_ylabels([path, *over_time[1:]])
    handles, names = over_time[2].get_legend_handles_labels()
    if len(names) <= 13:
        right.legend(handles, names, loc="outside lower center", ncols=4)
    return made


def _draw_drive(axes: list[Axes], model: Model, result: Any) -> None:
    """Torques and pressures; where pressures are the input, tip coordinates instead of torques."""
    arm = model.scene.manipulator
    if model.scene.actuation.input == "torque":
        draw_torques(axes[0], arm, result.control_time, result.u)
    else:
        _draw_coordinates(axes[0], result)
    draw_pressures(axes[1], arm, _thin(result.time), _thin(result.p))


def _title(result: Any) -> str:
    title = result.title or "Tip tracking"
    projected = _projected(result)
    error = 1e3 * (
        result.reachable_error[result.counted]
        if projected
        else result.error[result.time >= result.settle]
    )
    if not len(error):
        return str(title)
    found = float(np.sqrt(np.mean(error**2)))
    rms = f"{found:{'.2g' if found < 100 else '.0f'}} mm RMS after {result.settle:g} s"
    return f"{title}: {rms}" + (" from what is in reach" if projected else "")


def _projected(result: Any) -> bool:
    """Whether something else than the path is followed."""
    return result.followed is not None and not np.array_equal(result.followed, result.reference)


def _draw_space(made: Any, arm: Arm, result: Any) -> None:
    """Postures along the last part of the run, the reference path and the tip's trace."""
    shapes = [arm.sections(q) for q in result.q[_moments(result)]]
    tips = np.array([shape[-1][-1] for shape in shapes])
    solid = int(np.argmax(np.linalg.norm(tips - tips.mean(axis=0), axis=1)))
    lines = [line for shape in shapes for line in shape]
    box = box_of(*lines, result.reference, result.tip, margin=1.5 * max(arm.radii))
    wide, deep, high = box[1] - box[0]
    zoom = 1.2 if wide + deep < 1.4 * high else 0.95  # or the name of z leaves its half
    axes = space(made, 111, box, arm.hangs, view=(18, -64), zoom=zoom)
    draw_base(axes, 1.8 * max(arm.radii))
    draw_tube(axes, shapes[solid], [0.6 * radius for radius in arm.radii], alpha=0.75)
    for shape in [shape for k, shape in enumerate(shapes) if k != solid]:
        draw_line(axes, shape, width=2.0, alpha=0.45)
    axes.plot(*_thin(result.reference).T, **REFERENCE, label="reference")
    if _projected(result):
        axes.plot(*_thin(result.followed).T, **NEAREST, label="nearest in reach")
    axes.plot(*_thin(result.tip).T, **TRACE, label="tip")
    made.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=3)


def _draw_path(axes: Axes, result: Any) -> None:
    """The path seen face on, in mm, with equal scales."""
    across, up = places = _plane(result.reference)
    axes.plot(*1e3 * _thin(result.reference).T[places], **REFERENCE)
    _draw_infeasible(axes, result, places)
    axes.plot(*1e3 * _thin(result.tip).T[places], **TRACE)
    axes.set_aspect("equal", adjustable="datalim")
    label(axes, f"{'xyz'[across]} (mm)", f"{'xyz'[up]} (mm)", "tip path")


def _draw_infeasible(axes: Axes, result: Any, places: list[int]) -> None:
    """What of the path is out of reach, and what is followed there instead."""
    far = result.out_of_reach
    if far is None or not np.any(far > 0):
        return
    asked = 1e3 * np.where(far[:, None] > 0, result.reference, np.nan)
    axes.plot(*_thin(asked).T[places], **OUT_OF_REACH)
    if result.followed is not None:
        nearest = 1e3 * np.where(far[:, None] > 0, result.followed, np.nan)
        axes.plot(*_thin(nearest).T[places], **NEAREST)


def _plane(path: np.ndarray) -> list[int]:
    """The two coordinates in which a path (K×3) extends most."""
    return sorted(np.argsort(np.ptp(path, axis=0), kind="stable")[1:].tolist())


def _moments(result: Any) -> np.ndarray:
    """Indices of a few moments, evenly spread from the settling time to the end."""
    first = int(np.searchsorted(result.time, min(result.settle, result.time[-1] / 2)))
    return np.linspace(first, len(result.time) - 1, GHOSTS).round().astype(int)


def _draw_error(axes: Axes, result: Any) -> None:
    """Distance of the tip from its reference (mm), and from when on it counts.

    It ripples with each step of the controller: a band from least to most, a line for the mean.
    """
    projected = _projected(result)
    error = 1e3 * (result.reachable_error if projected else result.error)
    count = max(1, len(result.control_time))
    steps = np.array_split(np.arange(len(error)), min(count, len(error)))
    low, mean, high = (np.array([f(error[k]) for k in steps]) for f in (np.min, np.mean, np.max))
    time = np.array([result.time[k].mean() for k in steps])
    axes.fill_between(time, low, high, color=GREY, alpha=0.45, linewidth=0)
    axes.plot(time, mean, color=INK, linewidth=1.1)
    axes.axvline(result.settle, color=GREY, linewidth=1.0, linestyle=(0, (4, 2)))
    what = "tip to nearest place in reach" if projected else "tip error"
    counted = f"mean and range a step, counted from {result.settle:g} s on (dashed)"
    label(axes, TIME, "tip error (mm)", f"{what}\n{counted}")
    settled = error[result.time >= result.settle]
    if len(settled) and error.max() > 10 * settled.max():  # a start from afar
        axes.set_yscale("log")
        axes.set_ylim(max(settled.min(), settled.max() / 30) / 2, 1.5 * error.max())
        plain_log(axes)
    else:
        axes.set_ylim(0, 1.05 * max(error.max(), 1e-6))


def _draw_coordinates(axes: Axes, result: Any) -> None:
    """Tip coordinates and their reference, where there is no torque to show."""
    time = _thin(result.time)
    start = result.reference[0]
    for k, look in enumerate(("-", (0, (5, 1.5)), (0, (1.2, 1.2)))):
        axes.plot(time, 1e3 * (_thin(result.reference)[:, k] - start[k]), **REFERENCE)
        axes.plot(time, 1e3 * (_thin(result.tip)[:, k] - start[k]), **TRACE, linestyle=look)
    label(
        axes, TIME, "way of the tip (mm)", "tip: x solid, y dashed, z dotted, from the path's start"
    )


def _thin(values: np.ndarray) -> np.ndarray:
    """Every so manieth sample: no more than a picture can show."""
    return values[:: max(1, len(values) // MOST_POINTS)]
