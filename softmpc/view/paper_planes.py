"""The arm in the plane xz, in which all of the paper's motions and postures are."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from softmpc.view.arm import Arm, even_ticks, smooth
from softmpc.view.style import GREY, INK, colour, label

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["COARSE", "base_plate", "draw_band", "draw_shape", "frame_plane", "key"]

COARSE: dict[str, Any] = {"linestyle": (0, (5, 1.5)), "linewidth": 1.2}  # the paper's formulation


def frame_plane(axes: Axes, arm: Arm, box: np.ndarray, title: str = "", down: bool = False) -> None:
    """Equal scales around `box` (2×3), z down for a hanging arm or if asked, and the base."""
    axes.plot(*base_plate(arm)[:, [0, 2]].T, color=GREY, linewidth=3, zorder=2.4)
    axes.set_aspect("equal", adjustable="box")
    axes.set_xlim(*box[:, 0])
    axes.set_ylim(*(box[::-1, 2] if down or arm.hangs else box[:, 2]))
    even_ticks(axes.xaxis, box[:, 0], box)
    even_ticks(axes.yaxis, box[:, 2], box)
    label(axes, "x (m)", "z (m)", title)


def draw_shape(axes: Axes, lines: list[np.ndarray], **look: Any) -> None:
    """The centre line, a colour a section."""
    for s, line in enumerate(map(smooth, lines)):
        axes.plot(line[:, 0], line[:, 2], **{"color": colour(s), "linewidth": 1.5, **look})


def draw_band(axes: Axes, lines: list[np.ndarray], radii: list[float], alpha: float = 1.0) -> None:
    """The arm as wide as it is, a colour a section, with its end discs."""
    for s, (line, radius) in enumerate(zip(map(smooth, lines), radii, strict=True)):
        middle = line[:, [0, 2]]
        along = np.gradient(middle, axis=0)
        across = along[:, ::-1] * [1, -1] / np.linalg.norm(along, axis=1)[:, None]
        left, right = middle + radius * across, middle - radius * across
        outline = np.vstack([left, right[::-1]])
        axes.fill(*outline.T, color=colour(s), alpha=alpha, linewidth=0, zorder=2.2)
        for end in (0, -1):
            disc = np.stack([left[end], right[end]])
            axes.plot(*disc.T, color=INK, linewidth=0.8, zorder=2.3)


def base_plate(arm: Arm) -> np.ndarray:
    """Ends of the base (2×3, m), for `box_of`."""
    half = 1.6 * max(arm.radii)
    return np.array([[-half, 0, 0], [half, 0, 0]])


def key(*entries: tuple[str, dict[str, Any]]) -> tuple[list[Any], list[str]]:
    """Handles and names of a legend."""
    from matplotlib.lines import Line2D

    return [Line2D([], [], **look) for _, look in entries], [name for name, _ in entries]
