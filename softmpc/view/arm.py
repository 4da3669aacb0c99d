"""The arm in space: its shape at given strains, and how to draw it in three dimensions."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from softmpc.model.effects import Contact, Gravity
from softmpc.model.obstacles import Obstacle
from softmpc.view.style import GREY, INK, colour

if TYPE_CHECKING:
    from mpl_toolkits.mplot3d import Axes3D

    from softmpc.model.model import Model

__all__ = [
    "FRONT",
    "Arm",
    "box_of",
    "draw_base",
    "draw_frames",
    "draw_line",
    "draw_tube",
    "even_ticks",
    "smooth",
    "space",
    "zoom_within",
]

AROUND = np.linspace(0, 2 * np.pi, 25)
RINGS = 25  # of a section, at most
FINE_POINTS = 61  # of a smooth line
FRONT = (14, -62)  # degrees: elevation, and azimuth of the eye


@dataclass(frozen=True)
class Arm:
    """What pictures need of a model: centre lines, sizes, and which way is down."""

    model: Model

    @property
    def radii(self) -> list[float]:
        """Outer radius of each section (m)."""
        return [section.disc_radius for section in self.model.scene.manipulator.sections]

    @property
    def hangs(self) -> bool:
        """Whether gravity points along +z, so that z should point down in pictures."""
        gravity = self.model.scene.effect(Gravity)
        return gravity is not None and gravity.vector[2] > 0

    @property
    def obstacles(self) -> tuple[Obstacle, ...]:
        """What the arm may touch."""
        contact = self.model.scene.effect(Contact)
        return contact.obstacles if contact else ()

    def sections(self, q: Any) -> list[np.ndarray]:
        """Centre line of each section (points × 3, m), base first, ends shared."""
        points = np.asarray(self.model.centerline(q)).T
        steps = (len(points) - 1) // len(self.radii)
        return [points[i * steps : (i + 1) * steps + 1] for i in range(len(self.radii))]

    def rotations(self, q: Any) -> np.ndarray:
        """Orientation of each section tip (S×3×3), axes in columns."""
        blocks = np.asarray(self.model.frames(q)[1])
        return np.stack(np.split(blocks, len(self.radii), axis=1))


def smooth(line: np.ndarray) -> np.ndarray:
    """More points on a centre line (points × 3), so that its chords do not show."""
    from scipy.interpolate import CubicSpline

    given = np.linspace(0, 1, len(line))
    return np.asarray(CubicSpline(given, line)(np.linspace(0, 1, FINE_POINTS)))


def box_of(*places: Any, margin: float = 0.0) -> np.ndarray:
    """Lowest and highest corner (2×3) around finite points (…×3) with a margin, never flat."""
    points = np.concatenate([np.asarray(p, float).reshape(-1, 3) for p in places])
    points = points[np.isfinite(points).all(axis=1)]
    low, high = points.min(axis=0) - margin, points.max(axis=0) + margin
    half = np.maximum(high - low, 0.4 * (high - low).max()) / 2
    middle = (low + high) / 2
    return np.array([middle - half, middle + half])


def space(
    made: Any,
    place: Any,
    box: np.ndarray,
    hangs: bool,
    view: tuple[float, float] = FRONT,
    zoom: float = 1.0,
) -> Axes3D:
    """Three-dimensional axes around `box` with equal scales; z points down for a hanging arm.

    What is drawn later covers what was drawn before.
    """
    axes: Any = made.add_subplot(place, projection="3d", computed_zorder=False)
    low, high = box
    axes.set_xlim(low[0], high[0])
    # Two axes are turned, not one: the picture stays a picture and is no mirror image.
    axes.set_ylim((high[1], low[1]) if hangs else (low[1], high[1]))
    axes.set_zlim((high[2], low[2]) if hangs else (low[2], high[2]))
    axes.set_box_aspect(high - low, zoom=zoom)
    axes.view_init(*view)
    axes.set(xlabel="x (m)", ylabel="y (m)", zlabel="z (m)")
    _tidy(axes, box)
    return axes


def zoom_within(box: np.ndarray, elevation: float, height: float) -> float:
    """The zoom at which `box` takes this share of the axes' height, seen from there (degrees)."""
    wide, deep, tall = box[1] - box[0]
    up = np.radians(elevation)
    seen = tall * np.cos(up) + 0.7 * (wide + deep) * np.sin(up)
    return float(height * np.linalg.norm(box[1] - box[0]) / seen)


def _tidy(axes: Any, box: np.ndarray) -> None:
    """White panes, thin grid, the same ticks on each axis, and room for their numbers."""
    digits = max(0, -math.floor(math.log10(_step(box)) + 1e-9))
    for axis, ends in zip((axes.xaxis, axes.yaxis, axes.zaxis), box.T, strict=True):
        axis.set_pane_color((1, 1, 1, 0))
        axis._axinfo["grid"].update(color="#DDDDDD", linewidth=0.5)
        axis.labelpad = 1
        even_ticks(axis, ends, box)
    axes.tick_params(pad=0)
    axes.zaxis.labelpad += 4 * max(0, digits - 1)  # the name stands beside the numbers
    axes.zaxis.set_tick_params(pad=2 * max(0, digits - 1))


def even_ticks(axis: Any, ends: np.ndarray, box: np.ndarray) -> None:
    """Ticks at the same round step for every side of `box`, none in the corners."""
    axis.set_ticks(_ticks(_step(box), ends, box))


def _step(box: np.ndarray) -> float:
    """At most 8 steps along the longest side, 5 where long numbers would stand side by side.

    A finer one where a side had but one tick, if that makes no more than 10.
    """
    size, wide = (box[1] - box[0]).max(), (box[1] - box[0])[:2].max()
    decade = 10.0 ** np.floor(np.log10(size))
    steps = decade * np.array([0.1, 0.2, 0.5, 1, 2])
    short = steps > 0.09  # numbers
    k = next(
        k for k in range(1, len(steps)) if size < 8 * steps[k] and (short[k] or wide < 5 * steps[k])
    )
    fewest = min(len(_ticks(steps[k], ends, box)) for ends in box.T)
    finer = fewest < 2 and short[k - 1] and size < 10 * steps[k - 1]
    return float(steps[k - 1] if finer else steps[k])


def _ticks(step: float, ends: np.ndarray, box: np.ndarray) -> np.ndarray:
    low, high = ends + 0.04 * (box[1] - box[0]).max() * np.array([1, -1])
    return np.asarray(step * np.arange(np.ceil(low / step), np.floor(high / step) + 1))


def draw_line(
    axes: Any, lines: list[np.ndarray], width: float = 3.0, alpha: float = 1.0
) -> list[Any]:
    """The centre line as one thick line a section; returns the lines."""
    return [
        axes.plot(*line.T, color=colour(i), linewidth=width, alpha=alpha)[0]
        for i, line in enumerate(lines)
    ]


def draw_tube(
    axes: Any,
    lines: list[np.ndarray],
    radii: list[float],
    alpha: float = 1.0,
    of_all: Any = None,
) -> list[Any]:
    """The arm as a shaded tube of these radii; returns what was drawn.

    A section a colour, or the colour `of_all`.
    """
    from matplotlib.colors import LightSource

    light = LightSource(azdeg=315, altdeg=40)
    drawn = []
    for i, (line, radius) in enumerate(zip(lines, radii, strict=True)):
        few = np.linspace(0, len(line) - 1, min(len(line), RINGS)).round().astype(int)
        surface = _tube(line[few], radius)
        drawn.append(axes.plot_surface(
            *surface, color=colour(i) if of_all is None else of_all, alpha=alpha, linewidth=0,
            antialiased=False, rstride=1, cstride=1, shade=True, lightsource=light,
        ))  # fmt: skip
        for end in (0, -1):
            ring = surface[:, end]
            drawn += axes.plot(*ring, color=INK, linewidth=0.7, alpha=min(1, 2 * alpha))
    return drawn


def _tube(line: np.ndarray, radius: float) -> np.ndarray:
    """Surface of a tube around a line (3 × points × angles), its frame carried without twist."""
    tangent = np.gradient(line, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1)[:, None]
    side = np.cross(tangent[0], np.eye(3)[np.argmin(np.abs(tangent[0]))])
    rings = []
    for point, along in zip(line, tangent, strict=True):
        side = side - along * (side @ along)
        side /= np.linalg.norm(side)
        over = np.cross(along, side)
        rings.append(
            point + radius * (np.outer(np.cos(AROUND), side) + np.outer(np.sin(AROUND), over))
        )
    return np.moveaxis(np.array(rings), 2, 0)


def draw_base(axes: Any, radius: float) -> None:
    """The plate that the arm is fixed to, at the origin; whole where it sticks out of the axes."""
    ring = np.array([np.cos(AROUND), np.sin(AROUND), 0 * AROUND]) * radius
    surface = np.stack([0 * ring, ring], axis=1)
    drawn = [
        axes.plot_surface(*surface, color=GREY, alpha=0.5, linewidth=0, shade=False, clip_on=False),
        *axes.plot(*ring, color=INK, linewidth=0.8, clip_on=False),
    ]
    for one in drawn:  # the layout takes three dimensions for two
        one.set_in_layout(False)


def draw_frames(axes: Any, places: Any, rotations: Any, size: float) -> None:
    """Axes x, y, z of each frame as short lines: solid, dashed, dotted, named at their ends."""
    for place, rotation in zip(np.asarray(places), np.asarray(rotations), strict=True):
        for name, arrow, dashes in zip(
            "xyz", rotation.T, ("-", (0, (4, 1)), (0, (1, 1))), strict=True
        ):
            end = place + size * arrow
            axes.plot(*zip(place, end, strict=True), color=INK, linewidth=1.2, linestyle=dashes)
            axes.text(*(place + 1.25 * size * arrow), name, fontsize=8, ha="center", va="center")
