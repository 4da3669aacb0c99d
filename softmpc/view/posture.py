"""Pictures of the arm at rest."""

from __future__ import annotations

from math import ceil
from typing import TYPE_CHECKING, Any

import numpy as np

from softmpc.view.arm import (
    Arm,
    box_of,
    draw_base,
    draw_frames,
    draw_line,
    draw_tube,
    even_ticks,
    smooth,
    space,
)
from softmpc.view.obstacles import NEAR, draw_cuts, draw_obstacles, obstacle_key, widened
from softmpc.view.style import GREY, INK, colour, figure, label, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from softmpc.model.model import Model

__all__ = ["draw_posture", "legend_below", "posture_figure"]

MOST_COLUMNS = 8  # of the legend


@styled
def posture_figure(model: Model, q: Any, title: str = "Posture at rest") -> Figure:
    """The arm at strains `q`: in space, and seen along y and along x."""
    made = draw_posture(model, q, title)
    legend_below(made)
    return made


def draw_posture(model: Model, q: Any, title: str, around: Any = ()) -> Figure:
    """As `posture_figure`, with room for the places `around` (…×3), and for a legend."""
    arm = Arm(model)
    lines, rotations = arm.sections(q), arm.rotations(q)
    radius = max(arm.radii)
    box = box_of(*lines, np.reshape(around, (-1, 3)), margin=2.2 * radius)
    box = widened(box, arm.obstacles, NEAR * model.scene.manipulator.length)
    made = figure(11.5, 5.2, title)
    wide, deep, _ = box[1] - box[0]  # both projections get the same scale
    grid = made.add_gridspec(1, 3, width_ratios=(0.9 * (wide + deep), wide, deep), wspace=0.08)
    axes = space(made, grid[0], box, arm.hangs)
    obstructed = draw_obstacles(axes, arm.obstacles, box)
    draw_base(axes, 2 * radius)
    draw_tube(axes, lines, arm.radii, alpha=0.35)
    draw_line(axes, lines)
    origins = np.array([line[0] for line in lines] + [lines[-1][-1]])
    draw_frames(axes, origins, [np.eye(3), *rotations], 1.8 * radius)
    flat = [made.add_subplot(grid[column]) for column in (1, 2)]
    for view, across in zip(flat, (0, 1), strict=True):
        _projection(view, lines, arm, across, box)
    if obstructed:
        flat[0].add_patch(obstacle_key())
    return made


def legend_below(made: Figure) -> None:
    """What the projections show."""
    handles, names = made.axes[1].get_legend_handles_labels()
    columns = ceil(len(names) / ceil(len(names) / MOST_COLUMNS))
    made.legend(handles, names, loc="outside lower center", ncols=columns)


def _projection(
    axes: Axes, lines: list[np.ndarray], arm: Arm, across: int, box: np.ndarray
) -> None:
    """The arm against x (`across` = 0) or y (1), z on the other axis, equal scales."""
    radius = max(arm.radii)
    draw_cuts(axes, arm.obstacles, across, box)
    axes.plot([-2 * radius, 2 * radius], [0, 0], color=GREY, linewidth=4, label="base")
    for i, line in enumerate(map(smooth, lines)):
        axes.plot(
            line[:, across], line[:, 2], color=colour(i), linewidth=4, label=f"section {i + 1}"
        )
        axes.plot(*line[-1, [across, 2]], "o", color=INK, markersize=4, zorder=3)
    axes.plot([], [], "o", color=INK, markersize=4, label="section tip")
    axes.set_aspect("equal", adjustable="box")
    axes.set_xlim(*box[:, across])
    axes.set_ylim(*(box[::-1, 2] if arm.hangs else box[:, 2]))
    even_ticks(axes.xaxis, box[:, across], box)
    even_ticks(axes.yaxis, box[:, 2], box)
    name = "xy"[across]
    label(axes, f"{name} (m)", "z (m)", f"{name}z plane")
