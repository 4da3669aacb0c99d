"""Obstacles: shapes that say how deep a sphere is in them, and in which direction out is."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from math import sqrt
from typing import Any, ClassVar, Literal

import casadi as ca

from softmpc.errors import SceneError
from softmpc.model.quantities import check_quantities, choice, quantity, vector

__all__ = ["OBSTACLES", "Cylinder", "Obstacle", "Plane"]

Vector = tuple[float, float, float]


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
class Cylinder(Obstacle):
    """An endless cylinder: the arm is kept outside of it, or inside like in a tube."""

    # fmt: off
    name: ClassVar[str] = "cylinder"
    point: tuple[float, float, float] = vector(
        (0.0, 0.0, 0.0), unit="m", source="assumed: none", doc="a point of the axis",
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
    # fmt: on

    def __post_init__(self) -> None:
        check_quantities(self)
        object.__setattr__(self, "axis", _unit("Cylinder.axis", self.axis))

    def depth(self, place: Any, radius: float) -> tuple[Any, Any]:
        axis = ca.DM(self.axis)
        offset = place - ca.DM(self.point)
        across = offset - axis * ca.dot(axis, offset)
        # Rounded within a millionth of the radius of the axis, where no direction leads out.
        distance = ca.sqrt(ca.sumsqr(across) + (1e-6 * self.radius) ** 2)
        if self.side == "outside":
            return self.radius + radius - distance, across / distance
        return distance - self.radius + radius, -across / distance


OBSTACLES: dict[str, type[Obstacle]] = {kind.name: kind for kind in (Plane, Cylinder)}
