"""Pictures of inverse statics: a posture with its targets, and the tips of many."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from softmpc.statics.targets import Direction, Orientation, Position
from softmpc.view.arm import FRONT, Arm, box_of, draw_base, draw_line, space, zoom_within
from softmpc.view.obstacles import draw_obstacles
from softmpc.view.posture import draw_posture, legend_below
from softmpc.view.style import ALARM, COLOURS, GREY, INK, figure, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from softmpc.model.model import Model
    from softmpc.statics.inverse_result import InverseResult

__all__ = ["batch_figure", "inverse_figure"]

CROSS: dict[str, Any] = {"color": ALARM, "marker": "x", "markersize": 9, "markeredgewidth": 1.8}
MISSED: dict[str, Any] = {"color": ALARM, "linewidth": 1.2, "linestyle": (0, (2, 1.5))}
# Marker and colour of the tips by how the target ended.
ENDS = {
    "solved": ("o", COLOURS[0]), "unreachable": ("^", COLOURS[1]), "no convergence": ("s", GREY)
}  # fmt: skip


@styled
def inverse_figure(model: Model, found: InverseResult, title: str = "Inverse statics") -> Figure:
    """The posture, in space and from two sides, with the places and directions asked for."""
    places = list(_places(found))
    arrows = list(_arrows(found, 4 * max(Arm(model).radii)))
    around = [place for _, place in places] + [end for _, end in arrows]
    made = draw_posture(model, found.q, f"{title}: {_state(found)}", np.array(around))
    for axes, coordinates in zip(made.axes, ([0, 1, 2], [0, 2], [1, 2]), strict=True):
        for k, (tip, place) in enumerate(places):
            line = np.array([tip, place])[:, coordinates].T
            axes.plot(*line, zorder=4, **MISSED)
            axes.plot(*line[:, 1:], **CROSS, linestyle="", zorder=5, label="target" * (not k))
        for k, (tip, end) in enumerate(arrows):
            line = np.array([tip, end])[:, coordinates].T
            axes.plot(*line, color=ALARM, linewidth=1.6, label="direction asked for" * (not k))
    legend_below(made)
    return made


def _state(found: InverseResult) -> str:
    off = f", {found.distance * 1e3:.3g} mm off" if found.distance > 1e-5 else ""
    return found.status + off + ("" if found.stable else ", not stable")


def _places(found: InverseResult) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """(tip, place asked for) of each; a coordinate that is free is the tip's."""
    for target in found.targets:
        if isinstance(target, Position):
            tip = found.tips[target.index(len(found.tips))]
            asked = [
                x if wanted is None else wanted for x, wanted in zip(tip, target.place, strict=True)
            ]
            yield tip, np.array(asked)


def _arrows(found: InverseResult, size: float) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """(tip, end) of the direction asked for."""
    for target in found.targets:
        if isinstance(target, Direction | Orientation):
            tip = found.tips[target.index(len(found.tips))]
            axis = target.axis if isinstance(target, Direction) else np.array(target.rotation)[:, 2]
            yield tip, tip + size * np.array(axis)


@styled
def batch_figure(
    model: Model, found: Sequence[InverseResult], title: str = "Inverse statics"
) -> Figure:
    """The tips of all targets in space, by status, what the others miss, and one posture."""
    arm = Arm(model)
    pairs = [pair for result in found for pair in _places(result)]
    tips = np.array([result.tips[-1] for result in found])
    lines = arm.sections(found[0].q)
    box = box_of(tips, *lines, np.reshape([place for _, place in pairs], (-1, 3)), margin=0.02)
    made = figure(7.0, 6.2, title)
    zoom = min(1.0, zoom_within(box, FRONT[0], 0.85))
    axes = space(made, made.add_gridspec(1, 1)[0], box, arm.hangs, zoom=zoom)
    draw_obstacles(axes, arm.obstacles, box)
    draw_base(axes, 2 * max(arm.radii))
    draw_line(axes, lines, width=2.0, alpha=0.5)
    for tip, place in pairs:
        if np.linalg.norm(place - tip) > 1e-5:
            axes.plot(*np.array([tip, place]).T, **{**MISSED, "linewidth": 0.8})
    for status, (marker, tint) in ENDS.items():
        some = tips[[result.status == status for result in found]]
        if len(some):
            axes.plot(*some.T, marker, color=tint, markersize=3, label=f"{status}: {len(some)}")
    loose = tips[[not result.stable for result in found]]
    if len(loose):
        axes.plot(*loose.T, "o", color=INK, markersize=7, fillstyle="none",
                  label=f"not stable: {len(loose)}")  # fmt: skip
    made.legend(loc="outside lower center", ncols=4)
    return made
