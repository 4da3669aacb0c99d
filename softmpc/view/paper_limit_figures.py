"""Fig. 5 of the paper from our model: where one section reaches, and limit postures."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from softmpc.statics.equilibrium import find_equilibrium
from softmpc.study.paper_motions import UNITS
from softmpc.study.paper_readings import OURS
from softmpc.study.reproduce_statics import FULL, LIMIT_POSTURES
from softmpc.view.arm import FRONT, Arm, box_of, draw_base, draw_tube, space
from softmpc.view.paper_planes import base_plate, draw_band, draw_shape, frame_plane, key
from softmpc.view.style import ALARM, GREY, INK, colour, figure, styled
from softmpc.view.workspace import INNER, OUTER, VIEW, draw_shell

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from softmpc.statics.workspace_result import Workspace
    from softmpc.study.paper_readings import PaperRuns

__all__ = ["limits_figure"]

LIMITS = {"−x limit": (FULL, 0.0, 0.0), "+x limit": (0.0, FULL, FULL)}
CURVES, POINTS = 6, 41  # of the mesh in the plane xz, and of each of its curves
Lines = list[np.ndarray]


@styled
def limits_figure(runs: PaperRuns, title: str) -> Figure:
    """The shell of one section, its cut with the limits of −x and +x, both sections at limits."""
    made = figure(12.5, 4.9, title)
    grid = made.add_gridspec(1, 5, width_ratios=(1.15, 0.12, 1.25, 0.05, 1.25))
    arm = Arm(runs.weightless(OURS, 1))
    limits = {name: _lines(arm, p) for name, p in LIMITS.items()}
    _draw_shell(made, grid[0], arm, runs.workspace(OURS), limits)
    _draw_cut(made.add_subplot(grid[2]), arm, limits)
    _draw_limit_postures(made, grid[4], Arm(runs.weightless(OURS, 2)))
    handles, names = key(
        ("(a) outer surface, cut open", {"color": OUTER, "linewidth": 4.0, "alpha": 0.55}),
        ("(a) inner surface", {"color": INNER, "linewidth": 4.0}),
        ("(a) −x and +x limit", {"color": INK, "linewidth": 2.0}),
        ("(b) tip, one pressure held", {"color": GREY, "linewidth": 0.7}),
        ("(b) tip, a pressure at its limit", {"color": ALARM, "linewidth": 1.3}),
        ("(b), (c) section 1", {"color": colour(0), "linewidth": 4.0}),
        ("(c) section 2", {"color": colour(1), "linewidth": 4.0}),
    )
    made.legend(handles, names, loc="outside lower center", ncols=4)
    return made


def _lines(arm: Arm, pressures: Any) -> Lines:
    return arm.sections(find_equilibrium(arm.model, pressures).q)


def _draw_shell(
    made: Figure, place: Any, arm: Arm, workspace: Workspace, limits: dict[str, Lines]
) -> None:
    """(a) Outer and inner surface, and the limits in the plane xz."""
    box = box_of(workspace.points, base_plate(arm), margin=0.01)
    axes = space(made, place, box, True, VIEW, 1.0)
    draw_base(axes, 1.6 * max(arm.radii))
    if workspace.shell is not None:
        draw_shell(axes, workspace, True)
    for lines in limits.values():
        for line in lines:
            axes.plot(*line.T, color=INK, linewidth=2.0)
            axes.plot(*line[-1:].T, "o", color=INK, markersize=4)
    axes.set_title("(a) where the tip of one section can be", loc="left")


def _draw_cut(axes: Axes, arm: Arm, limits: dict[str, Lines]) -> None:
    """(b) Tips in the plane xz, where P_2 = P_3, and the section at both limits."""
    shares = np.linspace(0, 1, CURVES)
    mesh = []
    for share in shares:
        edge = share in (0.0, 1.0)
        for both in (False, True):
            tips = _swept(arm, share, both)
            mesh.append(tips)
            look: dict[str, Any] = (
                {"color": ALARM, "linewidth": 1.3} if edge else {"color": GREY, "linewidth": 0.7}
            )
            axes.plot(tips[:, 0], tips[:, 2], **look, zorder=2.5)
    for name, lines in limits.items():
        draw_band(axes, lines, arm.radii, alpha=0.3)
        draw_shape(axes, lines, linewidth=2.2)
        end, before = lines[-1][[-1, -2]][:, [0, 2]]
        beyond = end + 0.06 * (end - before) / np.linalg.norm(end - before)
        axes.plot(*end, "o", color=INK, markersize=4, zorder=4)
        axes.text(beyond[0], beyond[1], name, fontsize=8, ha="center", va="center")
        mesh.append(np.array([[beyond[0], 0.0, beyond[1]]]))
    bands = [line for lines in limits.values() for line in lines]
    box = box_of(base_plate(arm), *bands, *mesh, margin=2 * max(arm.radii))
    frame_plane(axes, arm, box, "(b) one section in the plane xz", down=True)


def _swept(arm: Arm, share: float, both: bool) -> np.ndarray:
    """Tips (K×3) with P_2 = P_3 (`both`) or P_1 held at a share of 1 MPa, the other swept."""
    tips = []
    for s in np.linspace(0, 1, POINTS):
        first, others = (s, share) if both else (share, s)
        rest = find_equilibrium(arm.model, FULL * np.array([first, others, others]))
        tips.append(rest.tips[-1])
    return np.array(tips)


def _draw_limit_postures(made: Figure, place: Any, arm: Arm) -> None:
    """(c) Both sections with the largest pressure in some units."""
    shapes = {}
    for name, units in LIMIT_POSTURES.items():
        pressures = [FULL if unit in units else 0.0 for unit in range(1, UNITS + 1)]
        shapes[name] = _lines(arm, pressures)
    box = box_of(*[line for lines in shapes.values() for line in lines], margin=max(arm.radii))
    axes = space(made, place, box, True, FRONT, 0.92)
    draw_base(axes, 1.6 * max(arm.radii))
    for name, lines in shapes.items():
        draw_tube(axes, lines, [0.6 * radius for radius in arm.radii], alpha=0.8)
        end = lines[-1][-1]
        axes.text(end[0], end[1], end[2] + 0.05, name, fontsize=8, ha="center", va="top")
    axes.set_title("(c) both sections, units at 1 MPa", loc="left")
