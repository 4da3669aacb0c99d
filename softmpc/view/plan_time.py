"""A plan over time: held inputs between their limits, clearance, speed of the tip, marked times."""

from __future__ import annotations

from string import ascii_lowercase
from typing import TYPE_CHECKING, Any

import numpy as np

from softmpc.control.clearance import arm_clearance
from softmpc.control.limits import Limit, PressureLimit, TorqueLimit
from softmpc.model.obstacles import obstacle_names
from softmpc.planning.result import PlanResult
from softmpc.view.motion import thinned
from softmpc.view.plan_space import goal_times, obstacles_of, replay_of
from softmpc.view.style import (
    ALARM,
    COLOURS,
    GREY,
    INK,
    LIMIT,
    TRACE,
    colour,
    dash,
    label,
    legend_right,
)
from softmpc.view.time_plots import MOST_NAMES, TIME, draw_pressures

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["draw_over_time", "letters"]

AT_GOAL: dict[str, Any] = {"color": GREY, "linewidth": 1.0, "linestyle": (0, (4, 2))}
TALL = 0.78  # of a lane
AT_LIMIT = 1e-3  # of the range between the limits
NEAR = 0.07  # of the whole time: names of marks so near to each other stand together

Array = np.ndarray


def draw_over_time(axes: list[Axes], result: PlanResult) -> None:
    """Inputs, pressures, clearance if there are four axes, and speed of the tip.

    Goals, and what gives way, are lines at their times.
    """
    replay = replay_of(result)
    _draw_lanes(axes[0], result)
    scene = result.problem.model.scene
    inputs = (TorqueLimit,) if scene.actuation.input == "pressure" else ()
    arm, bounds = scene.manipulator, _bounds(result, PressureLimit, *inputs)
    draw_pressures(axes[1], arm, thinned(replay.t), thinned(replay.pressures), bounds)
    if len(axes) == 4:
        _draw_clearance(axes[2], result)
    _draw_speed(axes[-1], result)
    for one in axes:
        one.margins(x=0.01)
        one.tick_params(labelbottom=True)
        if 0 < len(one.get_legend_handles_labels()[1]) <= MOST_NAMES:
            legend_right(one)
    _mark_times(axes, result)


def _draw_lanes(axes: Axes, result: PlanResult) -> None:
    """Inputs as held, each in a lane between its limits, and how long each is at one of them."""
    manipulator = result.problem.model.scene.manipulator
    torque = result.problem.model.scene.actuation.input == "torque"
    size, unit, what = (1.0, "N·m", "motor torques") if torque else (1e6, "MPa", "pressures")
    bounds = _bounds(result, TorqueLimit)
    owners = [s for s, section in enumerate(manipulator.sections) for _ in range(section.units)]
    ends = _range(result.u, bounds)
    for j, section in enumerate(owners):
        base = len(owners) - 1 - j
        look: dict[str, Any] = {"color": colour(section)}
        zero, *held = base + TALL * _share(np.append(0.0, result.u[:, j]).clip(*ends), ends)
        axes.stairs(held, result.t, baseline=zero, fill=True, alpha=0.3, **look)
        axes.stairs(held, result.t, baseline=None, linewidth=1.2, **look)
        for bound, place in zip(bounds, (base, base + TALL), strict=True):
            if np.isfinite(bound):
                axes.hlines(place, *result.t[[0, -1]], **LIMIT | {"linewidth": 0.7})
        name = f"section {section + 1}"
        if np.isfinite(bounds).any():
            name += f", at a limit {100 * _time_at(result.u[:, j], result.t, bounds):.0f} %"
        axes.text(
            1.012, base + TALL / 2, name, transform=axes.get_yaxis_transform(), va="center",
            fontsize=8, **look,
        )  # fmt: skip
    axes.set_ylim(-0.12, len(owners) - 1 + TALL + 0.12)
    numbers = [f"{len(owners) - k}" for k in range(len(owners))]
    axes.set_yticks(np.arange(len(owners)) + TALL / 2, numbers)
    axes.grid(visible=False, axis="y")
    low, high = (f"{end / size:.3g}" for end in ends)
    label(axes, TIME, "unit", f"{what}, each from {low} to {high} {unit}")


def _bounds(result: PlanResult, *kinds: type[Limit]) -> tuple[float, float]:
    """Between which limits of these kinds keep something; infinite without any."""
    limits = [one for one in result.problem.all_limits if isinstance(one, kinds)]
    low = max((one.low for one in limits), default=-np.inf)
    return low, min((one.high for one in limits), default=np.inf)


def _range(values: Array, bounds: tuple[float, float]) -> tuple[float, float]:
    """The bounds, or what values reach where there are none; never empty."""
    reached = float(min(values.min(), 0.0)), float(max(values.max(), 0.0))
    low, high = (b if np.isfinite(b) else r for b, r in zip(bounds, reached, strict=True))
    return low, high if high > low else low + 1.0


def _share(values: Array, ends: tuple[float, float]) -> Array:
    """Where values are between two ends, 0 to 1."""
    return np.asarray((values - ends[0]) / (ends[1] - ends[0]))


def _time_at(u: Array, t: Array, bounds: tuple[float, float]) -> float:
    """The share of the time for which an input is at one of its bounds."""
    near = AT_LIMIT * np.diff(_range(u, bounds))
    at = (u <= bounds[0] + near) | (u >= bounds[1] - near)
    return float(np.diff(t)[at].sum() / (t[-1] - t[0]))


def _draw_clearance(axes: Axes, result: PlanResult) -> None:
    """The whole arm's clearance of each obstacle (mm), and the margin that it should keep."""
    replay, model, obstacles = replay_of(result), result.problem.model, obstacles_of(result)
    time, q = thinned(replay.t), thinned(replay.x)[:, : model.strains]
    rooms = 1e3 * arm_clearance(model, obstacles)(q).clearance
    names = obstacle_names(obstacles)
    for k, (name, room) in enumerate(zip(names, rooms.T, strict=True)):
        look: dict[str, Any] = {"color": COLOURS[(k + 2) % len(COLOURS)], "linestyle": dash(k)}
        axes.plot(time, room, **look, label=f"{name}, least {_mm(room.min())} mm")
        least = int(room.argmin())
        axes.plot(time[least], room[least], "o", color=look["color"], markersize=4)
    margin = 1e3 * result.problem.margin
    if result.problem.obstacles:
        axes.axhline(margin, **LIMIT, label=f"margin {margin:.3g} mm")
    low, high = min(0.0, rooms.min()), rooms.max()
    axes.set_ylim(low - 0.08 * (high - low))
    label(axes, TIME, "clearance (mm)", "clearance of the whole arm")


def _mm(value: float) -> str:
    """A tenth of a millimetre is what matters."""
    return f"{value:.1f}" if abs(value) < 100 else f"{value:.0f}"


def _draw_speed(axes: Axes, result: PlanResult) -> None:
    """Speed of the tip, between the samples of the replay."""
    replay = replay_of(result)
    way = np.linalg.norm(np.diff(replay.tips[:, -1], axis=0), axis=1)
    time = (replay.t[1:] + replay.t[:-1]) / 2
    axes.plot(thinned(time), thinned(way / np.diff(replay.t)), **TRACE)
    axes.set_ylim(bottom=0.0)
    label(axes, TIME, "speed (m/s)", "speed of the tip")


def letters(result: PlanResult) -> list[str]:
    """The names of what gives way: a, b, …"""
    return [ascii_lowercase[k % 26] for k in range(len(result.gives_way))]


def _mark_times(axes: list[Axes], result: PlanResult) -> None:
    """Lines at the goals' times and where something gives way, named above the first two axes."""
    goals = goal_times(result)
    wrong = np.array([one.time for one in result.gives_way])
    for one in axes:
        for time in goals:
            one.axvline(time, **AT_GOAL)
        for time in wrong:
            one.axvline(time, color=ALARM, linewidth=1.2)
    few = len(goals) <= 4
    names = [f"goal {k}" if few else f"{k}" for k in range(1, len(goals) + 1)]
    _name_above(axes[0], goals, ["goal"] if len(goals) == 1 else names, INK)
    _name_above(axes[1], wrong, letters(result), ALARM)


def _name_above(axes: Axes, times: Array, names: list[str], colour: str) -> None:
    """Names above the axes at their times; those close together are one."""
    if not len(times):
        return
    near = NEAR * float(np.diff(axes.get_xlim())[0])
    groups: list[tuple[float, list[str]]] = []
    for time, name in sorted(zip(times.tolist(), names, strict=True)):
        if groups and time - groups[-1][0] < near:
            groups[-1][1].append(name)
        else:
            groups.append((time, [name]))
    above = axes.secondary_xaxis("top")
    above.set_xticks([time for time, _ in groups], [", ".join(words) for _, words in groups])
    above.tick_params(colors=colour, length=3)
    above.spines["top"].set_visible(False)
