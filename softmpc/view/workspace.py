"""Pictures of a workspace in space: the shell cut open, and postures at its limits."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from softmpc.view.arm import FRONT, Arm, box_of, draw_base, draw_line, draw_tube, space, zoom_within
from softmpc.view.style import COLOURS, GREY, INK, figure, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from softmpc.model.model import Model
    from softmpc.statics.workspace_result import Workspace

__all__ = ["INNER", "OUTER", "VIEW", "draw_shell", "limit_postures_figure", "workspace_figure"]

OUTER, INNER = COLOURS[0], COLOURS[1]
VIEW = (18, -62)  # degrees: elevation, and azimuth of the eye
CUT = 85.0  # degrees to either side of the eye that the outer surface leaves open
FINE = 3  # facets between two half-planes


@styled
def workspace_figure(
    model: Model, workspace: Workspace, title: str = "Workspace of the tip"
) -> Figure:
    """Both surfaces of the shell; the side towards the eye is cut open, as in Fig. 5a.

    A set without a shell (a curve, a surface, a point) is drawn by its sampled places.
    """
    arm = Arm(model)
    box = box_of(workspace.points, np.zeros((1, 3)), margin=1.2 * max(arm.radii))
    made = figure(7.2, 6.0, title)
    zoom = min(1.12, zoom_within(box, VIEW[0], 0.85))
    axes = space(made, 111, box, arm.hangs, view=VIEW, zoom=zoom)
    draw_base(axes, 2 * max(arm.radii))
    if workspace.shell is None or workspace.dimension < 3:
        axes.plot(*workspace.points.T, ".", color=OUTER, markersize=2.5, label="places in reach")
    else:
        draw_shell(axes, workspace, arm.hangs)
    handles, _ = axes.get_legend_handles_labels()
    made.legend(handles=handles or _key(), loc="outside lower center", ncols=4)
    return made


def draw_shell(axes: Any, workspace: Workspace, hangs: bool) -> None:
    """The far half of the outer surface, the whole inner one before it, and their common rim."""
    assert workspace.shell is not None
    azimuths = _fine(workspace.azimuths)
    rims, outer, inner = workspace.shell.between(azimuths)
    eye = np.radians(-VIEW[1] if hangs else VIEW[1])  # axes of a hanging arm are turned about x
    from_eye = np.abs(np.angle(np.exp(1j * (azimuths - eye))))
    closed = from_eye >= np.radians(CUT)
    order = np.argsort(np.mod(azimuths - eye, 2 * np.pi))
    back = order[closed[order]]
    around = np.append(order, order[0])
    places = {
        side: workspace.shell.places(azimuths, rims, radii)
        for side, radii in (("outer", outer), ("inner", inner))
    }
    style: dict[str, Any] = {"rstride": 1, "cstride": 1, "antialiased": True, "shade": True}
    axes.plot_surface(
        *np.moveaxis(places["outer"][back], -1, 0), color=OUTER, alpha=0.55,
        linewidth=0.2, edgecolor="#00335540", **style,
    )  # fmt: skip
    axes.plot_surface(
        *np.moveaxis(places["inner"][around], -1, 0), color=INNER, alpha=0.95,
        linewidth=0.2, edgecolor="#55330060", **style,
    )  # fmt: skip
    for i in (back[0], back[-1]):
        cut = np.concatenate([places["outer"][i], places["inner"][i][::-1]])
        axes.plot(*cut.T, color=INK, linewidth=1.0)
    rim = places["outer"][around, -1]
    axes.plot(*rim.T, color=GREY, linewidth=1.0)


def _key() -> list[Any]:
    """What the colours mean."""
    from matplotlib.patches import Patch

    return [
        Patch(color=OUTER, alpha=0.5, label="outer surface, cut open"),
        Patch(color=INNER, label="inner surface"),
    ]


def _fine(azimuths: np.ndarray) -> np.ndarray:
    """Some azimuths between those of the half-planes."""
    ends = np.append(azimuths, azimuths[0] + 2 * np.pi)
    steps = [np.linspace(a, b, FINE, endpoint=False) for a, b in pairwise(ends)]
    return np.concatenate(steps)


@styled
def limit_postures_figure(
    model: Model, postures: Mapping[str, Any], title: str = "Limit postures"
) -> Figure:
    """Postures (strains by name) side by side in space, as in Fig. 5c."""
    arm = Arm(model)
    shapes = {name: arm.sections(q) for name, q in postures.items()}
    box = box_of(*(line for lines in shapes.values() for line in lines), margin=2 * max(arm.radii))
    made = figure(4.6 * len(shapes) + 0.4, 4.2, title)
    grid, zoom = made.add_gridspec(1, len(shapes)), zoom_within(box, FRONT[0], 0.7)
    for k, (name, lines) in enumerate(shapes.items()):
        axes = space(made, grid[k], box, arm.hangs, FRONT, min(1.08, zoom))
        draw_base(axes, 2 * max(arm.radii))
        draw_tube(axes, lines, arm.radii, alpha=0.45)
        draw_line(axes, lines)
        axes.set_title(name, loc="left")
    return made
