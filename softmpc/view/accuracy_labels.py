"""Names beside points without overlap: each takes the best free place around its point."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from softmpc.view.style import GREY, INK

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["place_labels"]

DISTANCES = (9, 13, 18, 26, 36, 48, 62, 78, 96, 116, 140, 170)  # points, from the point to the text
ANGLES = np.radians(np.arange(0, 360, 15) + 22.5)
GAP, DOT = 3.0, 5.5  # points around a text, and half of a mark
# What a place costs: each is worth this many points of distance.
COVERS_POINT, COVERS_LINE, CROSSES, OVERLAPS = 30.0, 6.0, 120.0, 1e4
Box = np.ndarray  # x and y of the lower left and the upper right corner, 2×2 pixels


def place_labels(
    axes: Axes, points: Sequence[tuple[float, float, str]], lines: Sequence[np.ndarray] = (),
    fontsize: float = 7.5,
) -> None:  # fmt: skip
    """Write the text of each (x, y, text) near its place, with a line to it where it is far.

    `lines` are other data (n×2 each), which texts keep off where they can. Greedy, from the most
    crowded point on; the layout of the figure is fixed by this.
    """
    made = axes.get_figure(root=True)
    assert made is not None
    made.draw_without_rendering()
    made.set_layout_engine("none")
    scale = made.dpi / 72
    anchors = axes.transData.transform([(x, y) for x, y, _ in points]).reshape(-1, 2)
    dots, strokes = _pixels(axes, lines)
    dots = np.vstack([dots, anchors])
    boxes: list[Box] = []
    leaders: list[Box] = []
    for i in _crowded_first(anchors):
        size = _size(axes, points[i][2], fontsize)
        offset, box = _best(anchors[i], size, scale, _bounds(axes), (dots, strokes, boxes, leaders))
        _write(axes, points[i], (offset - anchors[i]) / scale, fontsize)
        boxes.append(box)
        leaders.append(np.array([anchors[i], offset]))


def _best(
    anchor: np.ndarray, size: np.ndarray, scale: float, bounds: Box, taken: Any
) -> tuple[np.ndarray, Box]:
    """Centre and box of the cheapest place."""
    best: tuple[float, Any] = (np.inf, None)
    for distance, centre in _places(anchor, size, scale):
        box = np.array([centre - size / 2, centre + size / 2])
        if distance >= best[0]:
            break
        if (box[0] < bounds[0]).any() or (box[1] > bounds[1]).any():
            continue
        cost = distance + _cost(anchor, centre, box, scale, taken)
        if cost < best[0]:
            best = cost, (centre, box)
    if best[1] is None:  # no room at all: what does not fit is cut by nobody, and may cover others
        return anchor, np.array([anchor - size / 2, anchor + size / 2])
    return best[1]


def _cost(anchor: np.ndarray, centre: np.ndarray, box: Box, scale: float, taken: Any) -> float:
    dots, strokes, boxes, leaders = taken
    wide = box + GAP * scale * np.array([[-1], [1]])
    cost = COVERS_POINT * _inside(dots, box + DOT * scale * np.array([[-1], [1]]))
    cost += COVERS_LINE * _inside(strokes, wide)
    leader = np.array([anchor, centre])
    along = anchor + np.linspace(0, 1, 25)[:, None] * (centre - anchor)
    for other in boxes:
        overlap = (wide[0] < other[1]).all() and (other[0] < wide[1]).all()
        cost += OVERLAPS * overlap + CROSSES * (_inside(along, other) > 0)
    for other in leaders:
        ends = other[0] + np.linspace(0, 1, 25)[:, None] * (other[1] - other[0])
        cost += CROSSES * (_inside(ends, wide) > 0) + CROSSES * _cross(leader, other)
    return float(cost)


def _places(
    anchor: np.ndarray, size: np.ndarray, scale: float
) -> Iterator[tuple[float, np.ndarray]]:
    """Distances in points, and centres in pixels, near ones first."""
    for distance in DISTANCES:
        for angle in ANGLES:
            way = np.array([np.cos(angle), np.sin(angle)])
            yield float(distance), anchor + way * (distance * scale + size / 2)


def _inside(dots: np.ndarray, box: Box) -> int:
    return int(((dots > box[0]) & (dots < box[1])).all(axis=1).sum())


def _cross(one: Box, other: Box) -> bool:
    """Whether two lines cross."""

    def side(line: Box, dot: np.ndarray) -> float:
        (a, b), (c, d) = line[1] - line[0], dot - line[0]
        return float(a * d - b * c)

    return (
        side(one, other[0]) * side(one, other[1]) < 0
        and side(other, one[0]) * side(other, one[1]) < 0
    )


def _crowded_first(anchors: np.ndarray) -> list[int]:
    if len(anchors) < 2:
        return list(range(len(anchors)))
    apart = np.linalg.norm(anchors[:, None] - anchors[None], axis=2)
    np.fill_diagonal(apart, np.inf)
    return [int(i) for i in np.argsort(apart.min(axis=1), kind="stable")]


def _pixels(axes: Axes, lines: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """The data of lines, and dense dots along them, in pixels."""
    dots, strokes = [np.empty((0, 2))], [np.empty((0, 2))]
    for line in lines:
        pixels = axes.transData.transform(np.asarray(line, float).reshape(-1, 2))
        dots.append(pixels)
        for begin, end in pairwise(pixels):
            count = max(2, int(np.hypot(*(end - begin)) / 6))
            strokes.append(begin + np.linspace(0, 1, count)[:, None] * (end - begin))
    return np.vstack(dots), np.vstack(strokes)


def _bounds(axes: Axes) -> Box:
    return np.array(axes.get_window_extent().get_points())


def _size(axes: Axes, text: str, fontsize: float) -> np.ndarray:
    shown = axes.text(0.5, 0.5, text, fontsize=fontsize, transform=axes.transAxes)
    box = shown.get_window_extent()
    shown.remove()
    return np.array([box.width, box.height])


def _write(
    axes: Axes, point: tuple[float, float, str], offset: np.ndarray, fontsize: float
) -> None:
    x, y, text = point
    axes.annotate(
        text, (x, y), xytext=tuple(offset), textcoords="offset points", ha="center", va="center",
        fontsize=fontsize, color=INK, zorder=6,
        bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.8, "alpha": 0.85},
        arrowprops={"arrowstyle": "-", "linewidth": 0.7, "color": GREY, "shrinkA": 0,
                    "shrinkB": 3, "zorder": 5},
    )  # fmt: skip
