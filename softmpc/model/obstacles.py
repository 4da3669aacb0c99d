"""Obstacles: shapes that say how deep a sphere is in them, and in which direction out is."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass
from math import inf, isfinite, radians, sqrt
from typing import Any, ClassVar, Literal

import casadi as ca
import numpy as np

from softmpc.errors import SceneError
from softmpc.model.kinematics import ConstantStrainArc
from softmpc.model.quantities import check_quantities, choice, quantity, vector
from softmpc.model.stumpff import stumpff

__all__ = ["OBSTACLES", "Box", "Cylinder", "Obstacle", "Plane", "Sphere", "obstacle_names"]

Vector = tuple[float, float, float]
ROUNDED = 1e-6  # of the radius, around a centre or an axis, where no direction leads out
EDGE = 1e-12  # m, so near to an edge the distance is that to the farther of its walls


class Obstacle(ABC):
    """A body that does not move, in the base frame."""

    name: ClassVar[str]

    @abstractmethod
    def depth(self, place: Any, radius: float) -> tuple[Any, Any]:
        """Penetration (m, negative when apart) of a sphere of that radius, and the way out (3)."""


def _unit(owner: str, value: Vector) -> Vector:
    """The vector over its length."""
    length = sqrt(sum(x * x for x in value))
    if length == 0.0:
        raise SceneError(f"{owner} = {value!r}: must not be zero, it gives a direction")
    # Twice the same for a vector that has unit length already, so that scene files keep it.
    return value if abs(length - 1.0) < 1e-15 else tuple(x / length for x in value)  # type: ignore[return-value]


@dataclass(frozen=True)
class Plane(Obstacle):
    """A wall: the arm is kept on the side to which the normal points."""

    # fmt: off
    name: ClassVar[str] = "plane"
    point: tuple[float, float, float] = vector(
        (0.0, 0.0, 1.0), unit="m", source="assumed: none", doc="a point of the plane",
    )
    normal: tuple[float, float, float] = vector(
        (0.0, 0.0, -1.0), unit="", source="assumed: none", doc="normal of any length",
    )
    # fmt: on

    def __post_init__(self) -> None:
        check_quantities(self)
        object.__setattr__(self, "normal", _unit("Plane.normal", self.normal))

    def depth(self, place: Any, radius: float) -> tuple[Any, Any]:
        normal = ca.DM(self.normal)
        return radius - ca.dot(normal, place - ca.DM(self.point)), normal


@dataclass(frozen=True)
class Sphere(Obstacle):
    """A ball: the arm is kept outside of it, or inside like in a hollow."""

    # fmt: off
    name: ClassVar[str] = "sphere"
    center: tuple[float, float, float] = vector(
        (0.0, 0.0, 1.0), unit="m", source="assumed: none", doc="its centre",
    )
    radius: float = quantity(
        0.05, unit="m", source="assumed: none", low=0.0, low_open=True, high=100.0, doc="radius",
    )
    side: Literal["outside", "inside"] = choice(
        "outside", allowed=("outside", "inside"), source="assumed: a ball",
        doc="where the arm is kept",
    )
    # fmt: on

    def __post_init__(self) -> None:
        check_quantities(self)

    def depth(self, place: Any, radius: float) -> tuple[Any, Any]:
        offset = place - ca.DM(self.center)
        distance = _rounded_length(offset, self.radius)
        return _kept(self.side, distance, offset / distance, self.radius, radius)


@dataclass(frozen=True)
class Cylinder(Obstacle):
    """A cylinder, endless or with flat ends: the arm is kept outside, or inside like in a tube."""

    # fmt: off
    name: ClassVar[str] = "cylinder"
    point: tuple[float, float, float] = vector(
        (0.0, 0.0, 0.0), unit="m", source="assumed: none",
        doc="a point of the axis; the middle of the cylinder where it has a length",
    )
    axis: tuple[float, float, float] = vector(
        (0.0, 0.0, 1.0), unit="", source="assumed: none", doc="direction of the axis, any length",
    )
    radius: float = quantity(
        0.1, unit="m", source="assumed: none", low=0.0, low_open=True, high=100.0, doc="radius",
    )
    side: Literal["outside", "inside"] = choice(
        "outside", allowed=("outside", "inside"), source="assumed: a post",
        doc="where the arm is kept",
    )
    length: float = quantity(
        inf, unit="m", source="assumed: endless", low=0.0, low_open=True, high=100.0, or_inf=True,
        doc="length between its flat ends, which are closed",
    )
    # fmt: on

    def __post_init__(self) -> None:
        check_quantities(self)
        object.__setattr__(self, "axis", _unit("Cylinder.axis", self.axis))

    def depth(self, place: Any, radius: float) -> tuple[Any, Any]:
        axis = ca.DM(self.axis)
        offset = place - ca.DM(self.point)
        height = ca.dot(axis, offset)
        across = offset - axis * height
        distance = _rounded_length(across, self.radius)
        out = across / distance
        if not isfinite(self.length):
            return _kept(self.side, distance, out, self.radius, radius)
        end = _sign(height)
        beyond, (off_side, off_end) = _from_walls(
            [distance - self.radius, end * height - self.length / 2]
        )
        return _kept(self.side, beyond, out * off_side + axis * (end * off_end), 0.0, radius)


@dataclass(frozen=True)
class Box(Obstacle):
    """A box with sharp edges, turned as one likes: the arm is kept outside of it."""

    # fmt: off
    name: ClassVar[str] = "box"
    center: tuple[float, float, float] = vector(
        (0.0, 0.0, 1.0), unit="m", source="assumed: none", doc="its centre",
    )
    size: tuple[float, float, float] = quantity(
        (0.1, 0.1, 0.1), unit="m", source="assumed: none", low=0.0, low_open=True, high=100.0,
        count=3, doc="lengths of its edges",
    )
    rotation: tuple[float, float, float] = vector(
        (0.0, 0.0, 0.0), unit="deg", source="assumed: edges along x, y, z",
        doc="rotation vector: it is turned about this vector by the vector's length",
    )
    # fmt: on

    def __post_init__(self) -> None:
        check_quantities(self)

    @property
    def edges(self) -> np.ndarray:
        """Directions of its edges, unit vectors in columns (3×3)."""
        w = ca.SX(ca.DM([radians(angle) for angle in self.rotation]))
        return np.asarray(ca.evalf(ConstantStrainArc().rotation(w, stumpff(ca.sumsqr(w), 2))))

    def depth(self, place: Any, radius: float) -> tuple[Any, Any]:
        edges = ca.DM(self.edges) if any(self.rotation) else None
        local = place - ca.DM(self.center)
        local = local if edges is None else edges.T @ local
        signs = [_sign(local[i]) for i in range(3)]
        beyond, slopes = _from_walls(
            [signs[i] * local[i] - side / 2 for i, side in enumerate(self.size)]
        )
        out = ca.vertcat(*(sign * slope for sign, slope in zip(signs, slopes, strict=True)))
        return radius - beyond, out if edges is None else edges @ out


OBSTACLES: dict[str, type[Obstacle]] = {kind.name: kind for kind in (Plane, Cylinder, Sphere, Box)}


def obstacle_names(obstacles: Iterable[Obstacle]) -> tuple[str, ...]:
    """What people call each of several obstacles: "sphere 1", "box 1", "sphere 2", …"""
    kinds = [obstacle.name for obstacle in obstacles]
    return tuple(f"{kind} {kinds[: i + 1].count(kind)}" for i, kind in enumerate(kinds))


def _kept(side: str, distance: Any, out: Any, size: float, radius: float) -> tuple[Any, Any]:
    """Depth of a sphere and its way out, from a distance, its slope, and what it is at the wall."""
    if side == "outside":
        return size + radius - distance, out
    return distance - size + radius, -out


def _rounded_length(vector: Any, size: float) -> Any:
    """The length of a vector, with a slope also where it is zero."""
    return ca.sqrt(ca.sumsqr(vector) + (ROUNDED * size) ** 2)


def _sign(value: Any) -> Any:
    """1 or -1, never 0: a way out also from the middle."""
    return 2 * (value >= 0) - 1


def _from_walls(beyond: list[Any]) -> tuple[Any, list[Any]]:
    """Signed distance from a corner of walls at right angles, and its slope along each normal.

    `beyond` is how far a point is in front of each wall. In front of several it is the distance
    from their edge or corner; behind all of them it is that from the nearest, below zero.
    """
    over = [ca.fmax(x, 0) for x in beyond]
    square = sum((x**2 for x in over[1:]), over[0] ** 2)
    outside = square > EDGE**2
    nearest, first = beyond[0], [1]
    for x in beyond[1:]:
        nearer = x > nearest
        nearest, first = (
            ca.if_else(nearer, x, nearest),
            [*(k * (1 - nearer) for k in first), nearer],
        )
    # The root sees an argument it can stand, so the branch not taken never yields NaN.
    distance = ca.sqrt(ca.if_else(outside, square, 1.0))
    slopes = [ca.if_else(outside, x / distance, k) for x, k in zip(over, first, strict=True)]
    return ca.if_else(outside, distance, nearest), slopes
