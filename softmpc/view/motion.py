"""The picture of a motion: postures and tips in space and in a plane, curvatures, tip speeds."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from softmpc.view.arm import Arm, box_of, draw_base, draw_line, draw_tube, even_ticks, space
from softmpc.view.obstacles import draw_cuts, draw_obstacles, obstacle_key
from softmpc.view.style import (
    GREY,
    INK,
    TRACE,
    colour,
    dash,
    figure,
    label,
    legend_right,
    styled,
    width,
)
from softmpc.view.time_plots import MOST_NAMES, TIME

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from softmpc.model.model import Model

__all__ = ["MOST_POINTS", "draw_traces", "moments", "motion_figure", "thinned"]

GHOSTS = 5
MOST_POINTS = 2000
CURVATURES = {"kappa_x": "κx", "kappa_y": "κy", "kappa_z": "κz (twist)"}


@styled
def motion_figure(model: Model, motion: Any, title: str = "Motion") -> Figure:
    """Where the arm goes, how it bends and how fast its tips are; `motion` is a `Simulation`."""
    made = figure(12.5, 4.9, title)
    arm, tips = Arm(model), thinned(motion.tips)
    shapes = [arm.sections(q) for q in motion.q[moments(tips, len(motion.time))]]
    lines = [line for shape in shapes for line in shape]
    box = box_of(*lines, tips, margin=1.2 * max(arm.radii))
    gap = 0.12  # for the name of the z axis, of which the layout does not know
    grid = made.add_gridspec(2, 4, width_ratios=(1.25, gap, 0.9, 1.4))
    room = space(made, grid[:, 0], box, arm.hangs, (16, -64), 1.02)
    obstructed = draw_obstacles(room, arm.obstacles, box)
    _draw_space(room, arm, shapes, tips)
    plane = made.add_subplot(grid[:, 2])
    _draw_plane(plane, arm, shapes, tips, box)
    over_time = [made.add_subplot(grid[row, 3]) for row in (0, 1)]
    _draw_curvatures(over_time[0], model, motion)
    _draw_speeds(over_time[1], motion)
    made.align_ylabels(over_time)
    handles, names = plane.get_legend_handles_labels()
    if obstructed:
        handles, names = [*handles, obstacle_key()], [*names, "obstacle"]
    made.legend(handles, names, loc="outside lower center", ncols=min(len(names), 6))
    return made


def thinned(values: np.ndarray) -> np.ndarray:
    """Every so manieth row: no more than a picture can show, the last one always among them."""
    count = min(len(values), MOST_POINTS)
    return values[np.linspace(0, len(values) - 1, count).round().astype(int)]


def draw_traces(axes: Any, tips: np.ndarray) -> list[Any]:
    """The way of each section tip (K×S×3) in space; returns the lines."""
    last = tips.shape[1] - 1
    return [
        axes.plot(*tips[:, s].T, **(TRACE if s == last else _faint(s)), zorder=9)[0]
        for s in range(last + 1)
    ]


def _faint(section: int) -> dict[str, Any]:
    return {"color": colour(section), "linewidth": 1.0, "linestyle": (0, (3, 1))}


def moments(tips: np.ndarray, count: int, picked: int = GHOSTS) -> np.ndarray:
    """Indices of a few of `count` samples, between which the tip has gone equally far.

    The ends are among them; `tips` (K×S×3) may be thinned.
    """
    steps = np.linalg.norm(np.diff(tips[:, -1], axis=0), axis=1)
    gone = np.concatenate([[0.0], np.cumsum(steps)])
    wanted = np.linspace(0, gone[-1], picked) if gone[-1] > 0 else np.zeros(1)
    picks = np.searchsorted(gone, wanted).clip(0, len(gone) - 1)
    scale = (count - 1) / max(len(tips) - 1, 1)
    return np.unique(np.append((picks * scale).round().astype(int), count - 1))


def _draw_space(axes: Any, arm: Arm, shapes: list[list[np.ndarray]], tips: np.ndarray) -> None:
    """The arm where it ends, thin where it was before, and the traces of its section tips."""
    draw_base(axes, 1.8 * max(arm.radii))
    draw_tube(axes, shapes[-1], [0.6 * radius for radius in arm.radii], alpha=0.8)
    for shape in shapes[:-1]:
        draw_line(axes, shape, width=2.0, alpha=0.4)
    draw_traces(axes, tips)


def _draw_plane(
    axes: Axes, arm: Arm, shapes: list[list[np.ndarray]], tips: np.ndarray, box: np.ndarray
) -> None:
    """The same, seen along the horizontal axis in which the tips move least."""
    across = int(np.argmax(np.ptp(tips[..., :2], axis=0).max(axis=0)))
    draw_cuts(axes, arm.obstacles, across, box)
    for k, shape in enumerate(shapes):
        for s, line in enumerate(shape):
            last = k == len(shapes) - 1
            look: dict[str, Any] = {"linewidth": 4.0} if last else {"linewidth": 1.5, "alpha": 0.4}
            axes.plot(
                line[:, across], line[:, 2], color=colour(s), **look,
                label=f"section {s + 1}" if last else None,
            )  # fmt: skip
    for s in range(tips.shape[1]):
        end = s == tips.shape[1] - 1
        axes.plot(
            tips[:, s, across], tips[:, s, 2], **(TRACE if end else _faint(s)), zorder=3,
            label="way of the tip" if end else f"way of tip {s + 1}",
        )  # fmt: skip
    axes.plot(tips[0, -1, across], tips[0, -1, 2], "o", color=INK, markersize=4, label="start")
    axes.axhline(0.0, color=GREY, linewidth=1.0)
    axes.set_aspect("equal", adjustable="box")
    axes.set_xlim(*box[:, across])
    axes.set_ylim(*(box[::-1, 2] if arm.hangs else box[:, 2]))
    even_ticks(axes.xaxis, box[:, across], box)
    even_ticks(axes.yaxis, box[:, 2], box)
    name = "xy"[across]
    label(axes, f"{name} (m)", "z (m)", f"{name}z plane")


def _draw_curvatures(axes: Axes, model: Model, motion: Any) -> None:
    """Curvatures of each section's first segment that move at all; all of them if none does."""
    scene = model.scene
    kinds = [kind for kind in scene.strains if kind in CURVATURES]
    curves = {
        (s, kind): motion[f"{kind}_{s + 1}_1"]
        for s in range(len(scene.manipulator.sections))
        for kind in kinds
    }
    sizes = {key: np.abs(curve).max() for key, curve in curves.items()}
    shown = [key for key, size in sizes.items() if size >= 1e-3 * max(sizes.values())]
    kinds = [kind for kind in kinds if kind in {of for _, of in shown}]
    part = ".1" if scene.segments > 1 else ""
    for s, kind in shown:
        look = {"color": colour(s), "linestyle": dash(kinds.index(kind)), "linewidth": width(s)}
        axes.plot(
            motion.time, curves[s, kind], **look, label=f"{CURVATURES[kind]}, section {s + 1}{part}"
        )
    title = "curvatures" + (" of each section's first segment" if part else "")
    label(axes, TIME, "curvature (1/m)", title)
    _legend(axes)


def _draw_speeds(axes: Axes, motion: Any) -> None:
    for s, speeds in enumerate(motion.tip_speeds.T):
        look = {"color": colour(s), "linestyle": dash(s), "linewidth": width(s)}
        axes.plot(motion.time, speeds, **look, label=f"tip {s + 1}")
    axes.set_ylim(bottom=0.0)
    label(axes, TIME, "speed (m/s)", "speeds of the section tips")
    _legend(axes)


def _legend(axes: Axes) -> None:
    axes.margins(x=0.01)
    if 0 < len(axes.get_legend_handles_labels()[1]) <= MOST_NAMES:
        legend_right(axes)
