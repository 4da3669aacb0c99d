"""A workspace cut along the xz plane, with postures at its limits."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from softmpc.view.arm import Arm, box_of, even_ticks, smooth
from softmpc.view.style import ALARM, GREY, colour, dash, figure, label, styled
from softmpc.view.workspace import INNER, OUTER

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from softmpc.model.model import Model
    from softmpc.statics.workspace_result import Workspace

__all__ = ["limit_postures", "workspace_cut_figure"]

SLICE = 0.02  # of the arm's length: samples as near to the plane are drawn


def limit_postures(workspace: Workspace) -> dict[str, np.ndarray]:
    """Strains by name where the tip is farthest to either side along x, and lowest and highest."""
    names = {
        ("x", "smallest"): "smallest x",
        ("x", "largest"): "largest x",
        ("z", "smallest"): "smallest z",
        ("z", "largest"): "largest z",
    }
    found = {names[e.quantity, e.sense]: e for e in workspace.extremes if e.quantity in "xz"}
    return {name: e.place.q for name, e in found.items() if e.place is not None}


@styled
def workspace_cut_figure(
    model: Model,
    workspace: Workspace,
    postures: Mapping[str, Any] | None = None,
    title: str = "Workspace in the xz plane",
) -> Figure:
    """The edge in the xz plane, sampled places near it, and postures, as in Fig. 5b.

    `postures` are strains by name, `limit_postures` where none are given. Postures that leave the
    plane are seen along y.
    """
    arm = Arm(model)
    shapes = {
        name: arm.sections(q)
        for name, q in (limit_postures(workspace) if postures is None else postures).items()
    }
    tips = workspace.samples.tips
    near = tips[np.abs(tips[:, 1]) < SLICE * model.scene.manipulator.length]
    curves = _curves(workspace)
    everything = [*(line for lines in shapes.values() for line in lines), near, *curves.values()]
    radius = max(arm.radii)
    base = np.array([[-radius, 0, 0], [radius, 0, 0]])  # the margin shows the rest of its plate
    box = box_of(*everything, base, margin=1.2 * radius)
    made = figure(7.0, 6.4, title)
    axes = made.add_subplot()
    axes.plot(near[:, 0], near[:, 2], ".", color=GREY, markersize=2.5, label="sampled, near y = 0")
    for name, curve in curves.items():
        shade = OUTER if name.startswith("outer") else INNER
        axes.plot(curve[:, 0], curve[:, 2], color=shade, linewidth=2.0, label=name)
    _draw_postures(axes, shapes)
    axes.plot([-2 * radius, 2 * radius], [0, 0], color=GREY, linewidth=4)
    axes.set_aspect("equal", adjustable="box")
    axes.set_xlim(*box[:, 0])
    axes.set_ylim(*(box[::-1, 2] if arm.hangs else box[:, 2]))
    even_ticks(axes.xaxis, box[:, 0], box)
    even_ticks(axes.yaxis, box[:, 2], box)
    label(axes, "x (m)", "z (m)")
    made.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return made


def _draw_postures(axes: Axes, shapes: dict[str, list[np.ndarray]]) -> None:
    """Each posture in a line style of its own, its sections in their colours."""
    for k, (name, lines) in enumerate(shapes.items()):
        for i, line in enumerate(map(smooth, lines)):
            axes.plot(line[:, 0], line[:, 2], color=colour(i + 2), linewidth=2.2, linestyle=dash(k))
        axes.plot(
            [], [], color=colour(2), linewidth=2.2, linestyle=dash(k), label=f"posture: {name}"
        )
        axes.plot(*lines[-1][-1, [0, 2]], "o", color=ALARM, markersize=4, zorder=4)


def _curves(workspace: Workspace) -> dict[str, np.ndarray]:
    """The outer and the inner curve in the plane y = 0, from one side to the other."""
    shell = workspace.shell
    if shell is None or abs(workspace.frame[1, 2]) > 1e-9:
        return {}
    azimuths = _azimuths_in_plane(workspace)
    if shell.flat and np.abs(shell.directions()[..., 1]).max() > 1e-9:
        return {}
    rims, outer, inner = shell.between(azimuths)
    sides = {
        "outer surface": shell.places(azimuths, rims, outer),
        "inner surface": shell.places(azimuths, rims, inner),
    }
    sides = {name: _smooth(shell.nodes, places) for name, places in sides.items()}
    gap = [np.full((1, 3), np.nan)] if np.any(rims[:, 0] > 1e-9) else []
    return {
        name: np.concatenate([places[1][::-1], *gap, places[0]]) for name, places in sides.items()
    }


def _smooth(nodes: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Curves (2×points×3) through the nodes (2×M×3), for the eye."""
    from scipy.interpolate import PchipInterpolator

    fine = np.concatenate([np.linspace(a, b, 8) for a, b in pairwise(nodes)])
    return np.asarray(PchipInterpolator(nodes, places, axis=1)(fine))


def _azimuths_in_plane(workspace: Workspace) -> np.ndarray:
    """Azimuths of +x and -x, seen along the axis of the frame."""
    first = workspace.frame.T @ np.array([1.0, 0.0, 0.0])
    start = float(np.arctan2(first[1], first[0]))
    return np.array([start, start + np.pi])
