"""A plan in space: postures coloured by time, the tip's way, goals and obstacles."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from softmpc.errors import InputError
from softmpc.model.obstacles import Obstacle
from softmpc.planning.goals import Goal
from softmpc.planning.replay import Replay
from softmpc.planning.result import PlanResult
from softmpc.statics.targets import Direction, Orientation, Position, Target
from softmpc.view.arm import Arm, box_of, draw_base, draw_tube, even_ticks, space
from softmpc.view.motion import moments, thinned
from softmpc.view.obstacles import NEAR, draw_obstacles, draw_outlines, obstacle_key, widened
from softmpc.view.style import ALARM, GOAL, INK, label
from softmpc.view.time_plots import TIME

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.cm import ScalarMappable

    from softmpc.model.model import Model

__all__ = [
    "Mark",
    "draw_goals",
    "draw_space",
    "goal_marks",
    "goal_times",
    "obstacles_of",
    "replay_of",
]

POSTURES = 7
FRONT, ZOOM = (16, -64), 0.97  # elevation and azimuth (deg)
PALE = 0.35  # colour of a tube
ARROW = 0.12  # lengths of the arm
START: dict[str, Any] = {
    "color": "white", "marker": "o", "markeredgecolor": INK, "markersize": 6, "linestyle": "none",
}  # fmt: skip

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Mark:
    """A place (3, m) that a goal asks for, and the direction (3) in which the tip should point."""

    goal: int
    place: Array
    axis: Array | None = None


def replay_of(result: PlanResult) -> Replay:
    """The replay; raises `InputError` where a plan has no motion."""
    if result.found is None or result.replay is None:
        raise InputError(
            f"a plan with the status {result.status!r} has no motion to draw: draw_refinement "
            "shows how its starts ended"
        )
    return result.replay


def obstacles_of(result: PlanResult) -> tuple[Obstacle, ...]:
    """What the plan keeps clear of, and what else the arm may touch."""
    kept = result.problem.obstacles
    return kept + tuple(one for one in Arm(result.problem.model).obstacles if one not in kept)


def goal_times(result: PlanResult) -> Array:
    """When the goals are to be met, s."""
    found = result.found
    return np.zeros(0) if found is None else np.asarray(found.t[found.ends])


def goal_marks(result: PlanResult) -> list[Mark]:
    """Where the goals are; what they leave free is where the replay is at their time."""
    model, replay = result.problem.model, replay_of(result)
    times = goal_times(result)
    found = []
    for number, (goal, time) in enumerate(zip(result.problem.goals, times, strict=True), 1):
        q = replay.x[np.abs(replay.t - time).argmin(), : model.strains]
        found += [Mark(number, place, axis) for place, axis in _asked(model, goal, q)]
    return found


def _asked(model: Model, goal: Goal, q: Array) -> Iterator[tuple[Array, Array | None]]:
    """Places and directions that a goal asks for; `q` is the posture that was reached."""
    if goal.state is not None:
        q = goal.state[: model.strains]
    tips = np.asarray(model.frames(q)[0]).T
    if goal.state is not None:
        yield tips[-1], None
    by_section: dict[int, list[Target]] = {}
    for target in goal.targets:
        by_section.setdefault(target.index(len(tips)), []).append(target)
    for section, targets in by_section.items():
        place, axis = tips[section].copy(), None
        for target in targets:
            if isinstance(target, Position):
                place = np.array(
                    [x if x is not None else at for x, at in zip(target.place, place, strict=True)]
                )
            elif isinstance(target, Direction):
                axis = np.array(target.axis)
            elif isinstance(target, Orientation):
                axis = np.array(target.rotation)[:, 2]
        yield place, axis


def draw_space(made: Any, result: PlanResult) -> None:
    """The motion in space and from above, with a colour bar of time and a legend."""
    arm, replay, marks = Arm(result.problem.model), replay_of(result), goal_marks(result)
    picks = moments(replay.tips, len(replay.t), POSTURES)
    shapes = [arm.sections(q) for q in replay.x[picks, : arm.model.strains]]
    lines = [line for shape in shapes for line in shape]
    box = box_of(*lines, *(mark.place for mark in marks), margin=1.2 * max(arm.radii))
    box = widened(box, obstacles_of(result), NEAR * arm.model.scene.manipulator.length)
    shades = _shades(result.t)
    # A gap for the names of the axes in space, of which the layout does not know.
    grid = made.add_gridspec(3, 1, height_ratios=(2.0, 0.2, 1))
    room = space(made, grid[0], box, arm.hangs, FRONT, ZOOM)
    flat = made.add_subplot(grid[2])
    seen = draw_obstacles(room, obstacles_of(result), box)
    draw_outlines(flat, obstacles_of(result), box)
    draw_base(room, 1.8 * max(arm.radii))
    for k in (0, -1):
        pale = 1 - PALE * (1 - np.array(shades.to_rgba(replay.t[picks[k]])[:3]))
        draw_tube(room, shapes[k], arm.radii, alpha=0.6, of_all=pale)
    for axes, size in ((room, 3), (flat, 2)):
        _draw_postures(axes, shapes, shades.to_rgba(replay.t[picks]), size)
        _draw_way(axes, replay, shades, size)
        draw_goals(axes, marks, arm, size)
    _frame(flat, box, arm.hangs)
    made.colorbar(shades, ax=[room, flat], label=TIME, location="bottom", shrink=0.7, aspect=40)
    handles, names = room.get_legend_handles_labels()
    if seen:
        handles, names = [*handles, obstacle_key()], [*names, "obstacle"]
    made.legend(handles, names, loc="outside lower center", ncols=4)


def _frame(axes: Axes, box: Array, hangs: bool) -> None:
    """The view from above; where z points down, x to the right and y towards the spectator."""
    axes.set_aspect("equal", adjustable="box")
    axes.set_xlim(*box[:, 0])
    axes.set_ylim(*(box[::-1, 1] if hangs else box[:, 1]))
    for axis, ends in ((axes.xaxis, box[:, 0]), (axes.yaxis, box[:, 1])):
        even_ticks(axis, ends, box)
    label(axes, "x (m)", "y (m)", "from above")


def _shades(time: Array) -> ScalarMappable:
    """Colours of times, without the pale ones."""
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import LinearSegmentedColormap, Normalize

    dark = colormaps["viridis"](np.linspace(0.0, 0.9, 64))
    return ScalarMappable(
        Normalize(time[0], time[-1]), LinearSegmentedColormap.from_list("time", dark)
    )


def _draw_postures(axes: Any, shapes: list[list[Array]], colours: Array, size: int) -> None:
    """Centre lines, the first and the last one thick, with dots at section tips."""
    for k, (shape, colour) in enumerate(zip(shapes, colours, strict=True)):
        wide = 4.0 if k in (0, len(shapes) - 1) else 1.8
        axes.plot(*np.vstack(shape)[:, :size].T, color=colour, linewidth=wide)
        ends = np.array([line[-1, :size] for line in shape])
        axes.plot(*ends.T, color=colour, marker="o", markersize=1 + wide, linestyle="none")


def _draw_way(axes: Any, replay: Replay, shades: ScalarMappable, size: int) -> None:
    """The way of the tip, and where it begins."""
    from matplotlib.collections import LineCollection
    from mpl_toolkits.mplot3d.art3d import Line3DCollection

    way, time = thinned(replay.tips[:, -1, :size]), thinned(replay.t)
    pieces: Any = np.stack([way, np.vstack([way[1:], way[-1:]])], axis=1)
    look: dict[str, Any] = {"colors": shades.to_rgba(time), "linewidths": 1.4, "zorder": 9}
    if size == 3:
        axes.add_collection3d(Line3DCollection(pieces, **look))
    else:
        axes.add_collection(LineCollection(pieces, **look))
    axes.plot(*way[:1].T, **START, zorder=10, label="start of the tip")


def draw_goals(axes: Any, marks: list[Mark], arm: Arm, size: int = 3) -> None:
    """A cross at each goal, with its number where there are several; lines show directions."""
    length = ARROW * arm.model.scene.manipulator.length
    numbers: dict[tuple[float, ...], list[str]] = {}  # goals at one place share their words
    for k, mark in enumerate(marks):
        place = mark.place[:size]
        axes.plot(*place[:, None], **GOAL, zorder=11, label="goal" if k == 0 else None)
        if mark.axis is not None:
            end = place + length * mark.axis[:size]
            axes.plot(*zip(place, end, strict=True), color=ALARM, linewidth=1.5, zorder=11)
        words = numbers.setdefault(tuple(place.round(3).tolist()), [])
        words += [f"{mark.goal}"] * (f"{mark.goal}" not in words)
    if len({mark.goal for mark in marks}) > 1:
        for at, words in numbers.items():
            axes.text(*at, f"  {', '.join(words)}", fontsize=9, color=ALARM, zorder=12)
