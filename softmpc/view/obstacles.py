"""Obstacles in pictures: translucent in space, and as the part that a vertical plane cuts."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from softmpc.model.obstacles import Box, Cylinder, Obstacle, Plane, Sphere
from softmpc.view.style import GREY

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.patches import Patch

__all__ = ["NEAR", "draw_cuts", "draw_obstacles", "draw_outlines", "obstacle_key", "widened"]

FILL: dict[str, Any] = {"facecolor": GREY, "alpha": 0.22}
FEWEST, MOST = 48, 4000  # faces around a cylinder; a sphere has the fewest
NEAR = 0.12  # lengths of the arm: obstacles so near belong into its picture
COVERED = 0.99  # of a view
GRID = 201  # places along each side of the plane view


def draw_obstacles(axes: Any, obstacles: tuple[Obstacle, ...], box: np.ndarray) -> bool:
    """The surfaces of obstacles as far as they are in `box`; returns whether there is any."""
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    middle, reach = box.mean(axis=0), float(np.linalg.norm(box[1] - box[0]))
    seen = False
    for obstacle in obstacles:
        faces = [_clipped(face, box) for face in _faces(obstacle, middle, reach)]
        faces = [face for face in faces if len(face) > 2]
        if faces:
            alike = _with_as_many_corners(faces)
            axes.add_collection3d(Poly3DCollection(alike, **FILL, edgecolor="none", zorder=0))
            seen = True
    return seen


def _with_as_many_corners(faces: list[np.ndarray]) -> list[np.ndarray]:
    """Last corners repeated: Matplotlib fills shorter polygons with whatever memory holds.

    It takes that for places when it finds the limits of the axes.
    """
    most = max(map(len, faces))
    return [np.concatenate([face, *[face[-1:]] * (most - len(face))]) for face in faces]


def draw_cuts(axes: Axes, obstacles: tuple[Obstacle, ...], across: int, box: np.ndarray) -> None:
    """Obstacles where the vertical plane through the base cuts them; x is the axis `across`."""
    x, z = np.linspace(box[0, [across, 2]], box[1, [across, 2]], GRID).T
    places = np.zeros((3, GRID * GRID))
    places[across], places[2] = (side.ravel() for side in np.meshgrid(x, z))
    for obstacle in obstacles:
        depths = _depths(obstacle, places).reshape(GRID, GRID)
        if depths.min() < 0 < depths.max():
            axes.contourf(x, z, depths, [0, depths.max()], colors=[GREY], alpha=FILL["alpha"])
            axes.contour(x, z, depths, [0], colors=[GREY], linewidths=1.0)


def widened(box: np.ndarray, obstacles: tuple[Obstacle, ...], reach: float) -> np.ndarray:
    """The box (2×3), wide enough for what of the obstacles is within `reach` (m) of it."""
    near = box + reach * np.array([[-1.0], [1.0]])
    middle, far = box.mean(axis=0), float(np.linalg.norm(near[1] - near[0]))
    corners = np.array([[box[i, 0], box[j, 1], box[k, 2]] for i, j, k in np.ndindex(2, 2, 2)])
    seen = [box]
    for obstacle in obstacles:
        if isinstance(obstacle, Plane):
            normal = np.array(obstacle.normal)
            feet = corners - np.outer((corners - np.array(obstacle.point)) @ normal, normal)
            seen.append(feet[((near[0] <= feet) & (feet <= near[1])).all(axis=1)])
        else:
            seen += [_clipped(face, near) for face in _faces(obstacle, middle, far)]
    places = np.concatenate(seen)
    return np.array([places.min(axis=0), places.max(axis=0)])


def draw_outlines(axes: Axes, obstacles: tuple[Obstacle, ...], box: np.ndarray) -> None:
    """What obstacles cover of the view along z, as far as they are in `box`; holes are not seen.

    What covers all of it is left out, like a table below.
    """
    from scipy.spatial import ConvexHull

    middle, reach = box.mean(axis=0), float(np.linalg.norm(box[1] - box[0]))
    for obstacle in obstacles:
        faces = [_clipped(face, box) for face in _faces(obstacle, middle, reach)]
        places = np.concatenate([*faces, np.zeros((0, 3))])[:, :2]
        if len(places) and np.linalg.matrix_rank(places - places[0], tol=1e-9) == 2:
            hull = ConvexHull(places)
            if hull.volume > COVERED * np.prod(box[1, :2] - box[0, :2]):
                continue
            outline = places[hull.vertices]
            axes.fill(*outline.T, facecolor=FILL["facecolor"], alpha=FILL["alpha"], zorder=0)
            axes.plot(*np.vstack([outline, outline[:1]]).T, color=GREY, linewidth=1.0)


def obstacle_key() -> Patch:
    """What stands for obstacles in a legend; of no size where it is drawn itself."""
    from matplotlib.patches import Rectangle

    return Rectangle((0, 0), 0, 0, **FILL, edgecolor=GREY, label="obstacle")


def _depths(obstacle: Obstacle, places: np.ndarray) -> np.ndarray:
    """How deep points (3×N) are in an obstacle (N, m)."""
    place = ca.SX.sym("place", 3)
    depth = ca.Function("depth", [place], [obstacle.depth(place, 0.0)[0]])
    return np.asarray(depth.map(places.shape[1])(places)).ravel()


def _faces(obstacle: Obstacle, middle: np.ndarray, reach: float) -> list[np.ndarray]:
    """Flat polygons (corners × 3) that cover an obstacle's surface within `reach` of `middle`."""
    if isinstance(obstacle, Plane):
        point, normal = np.array(obstacle.point), np.array(obstacle.normal)
        foot = middle - normal * (normal @ (middle - point))
        one, two = _across(normal)
        return [foot + reach * np.array([one + two, one - two, -one - two, two - one])]
    if isinstance(obstacle, Cylinder):
        return _cylinder_faces(obstacle, middle, reach)
    if isinstance(obstacle, Sphere):
        return _sphere_faces(obstacle, middle, reach)
    if isinstance(obstacle, Box):
        return _box_faces(obstacle)
    return []


def _cylinder_faces(cylinder: Cylinder, middle: np.ndarray, reach: float) -> list[np.ndarray]:
    point, axis = np.array(cylinder.point), np.array(cylinder.axis)
    height = axis @ (middle - point)
    ends = np.clip([height - reach, height + reach], -cylinder.length / 2, cylinder.length / 2)
    # Narrow against the picture, also where only a piece of a wide cylinder is in it.
    count = int(np.clip(120 * cylinder.radius / reach, FEWEST, MOST))
    angles = np.linspace(0, 2 * np.pi, count + 1)[:, None]
    one, two = _across(axis)
    ring = point + cylinder.radius * (np.cos(angles) * one + np.sin(angles) * two)
    low, high = ring + ends[0] * axis, ring + ends[1] * axis
    sides = [np.array([low[k], low[k + 1], high[k + 1], high[k]]) for k in range(count)]
    return sides if np.isinf(cylinder.length) else [*sides, low[:-1], high[:-1]]


def _sphere_faces(sphere: Sphere, middle: np.ndarray, reach: float) -> list[np.ndarray]:
    """Rings around the way from the centre to the picture; only those of a wide sphere in it."""
    center = np.array(sphere.center)
    away = float(np.linalg.norm(middle - center))
    axis = (middle - center) / away if away else np.array([0.0, 0.0, 1.0])
    widest = np.pi if away <= reach else np.arcsin(reach / away)
    one, two = _across(axis)
    turns = np.linspace(0, 2 * np.pi, FEWEST + 1)[None, :, None]
    angles = np.linspace(0, widest, FEWEST // 2 + 1)[:, None, None]
    across = np.cos(turns) * one + np.sin(turns) * two
    rings = center + sphere.radius * (np.cos(angles) * axis + np.sin(angles) * across)
    return [
        np.array([near[k], near[k + 1], far[k + 1], far[k]])
        for near, far in pairwise(rings)
        for k in range(FEWEST)
    ]


def _box_faces(box: Box) -> list[np.ndarray]:
    half = box.edges * np.array(box.size) / 2
    faces = []
    for i in range(3):
        one, two = half[:, i - 2], half[:, i - 1]
        around = np.array([one + two, one - two, -one - two, two - one])
        faces += [np.array(box.center) + side * half[:, i] + around for side in (-1, 1)]
    return faces


def _across(axis: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two unit vectors at right angles to a unit vector and to each other."""
    one = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    one /= np.linalg.norm(one)
    return one, np.cross(axis, one)


def _clipped(corners: np.ndarray, box: np.ndarray) -> np.ndarray:
    """The part of a convex polygon (corners × 3) that is in a box (2×3); it may be empty."""
    for axis in range(3):
        corners = _above(corners, corners[:, axis] - box[0, axis])
        corners = _above(corners, box[1, axis] - corners[:, axis])
    return corners


def _above(corners: np.ndarray, heights: np.ndarray) -> np.ndarray:
    """The part of a polygon where heights, given at its corners, are not negative."""
    kept = []
    for k, height in enumerate(heights):
        before = heights[k - 1]
        if (before < 0) != (height < 0):
            share = before / (before - height)
            kept.append(corners[k - 1] + share * (corners[k] - corners[k - 1]))
        if height >= 0:
            kept.append(corners[k])
    return np.array(kept).reshape(-1, 3)
