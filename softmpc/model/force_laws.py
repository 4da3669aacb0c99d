"""Forces on a body that no constant coefficient describes: fluids, growing masses, contact.

Each law is one small class. The equations of motion, the energy audit and the derivatives ask it
for its force, its energy and its power, and know of no particular one. A law either stores energy
or takes it out (`dissipates`); an effect with both sides brings two laws.

Signs are those of the residual: what the body needs less what it gets, so drag is D v and a push
of an obstacle along n is -F n. Vectors are in the local frame of the body's segment.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar

import casadi as ca

if TYPE_CHECKING:
    from softmpc.model.chain import Link, Point

__all__ = ["Body", "DampingLaw", "ForceLaw"]


@dataclass(frozen=True)
class Body:
    """A point of a segment in motion; what no law asks for costs nothing."""

    link: Link
    point: Point

    @cached_property
    def _motion(self) -> tuple[ca.SX, ca.SX]:
        return self.link.motion.at(self.point.p)

    @property
    def velocity(self) -> ca.SX:
        """Absolute velocity, m/s."""
        return self._motion[0]

    @property
    def acceleration(self) -> ca.SX:
        """Absolute acceleration, m/s²."""
        return self._motion[1]

    @cached_property
    def spin(self) -> ca.SX:
        """Absolute angular velocity, rad/s."""
        return self.link.motion.turned(self.point.turn)[0]

    @property
    def tangent(self) -> ca.SX:
        """Unit vector along the arm."""
        return self.point.tangent

    @property
    def place(self) -> ca.SX:
        """Place in the base frame, m."""
        return self.link.place + self.link.rotation @ self.point.p.terms[0]

    def to_local(self, vector: Any) -> Any:
        """A vector of the base frame in the local frame."""
        return self.link.rotation.T @ vector

    @property
    def gravity(self) -> ca.SX:
        """Acceleration of free fall, m/s²."""
        return self.link.gravity

    @property
    def head(self) -> Any:
        """g·x, m²/s²: gravity times the place."""
        return self.link.head + ca.dot(self.link.gravity, self.point.p.terms[0])

    @property
    def stretch(self) -> Any:
        """ε of the segment."""
        return self.point.strains.terms[0][0]

    @property
    def stretch_rate(self) -> Any:
        """dε/dt of the segment, zero at rest."""
        terms = self.point.strains.terms
        return terms[1][0] if len(terms) > 1 else 0.0


class ForceLaw(ABC):
    """A force on a body, with its energy; frozen, so that a scene's laws can be compared."""

    dissipates: ClassVar[bool] = False

    @abstractmethod
    def wrench(self, body: Body) -> tuple[Any, Any | None]:
        """Force (3, N) and moment (3, N·m, or None)."""

    def on_stretch(self, body: Body) -> Any | None:
        """Generalised force on ε of the body's segment (J) beside that of the wrench."""
        return None

    def energies(self, body: Body) -> dict[str, Any]:
        """Energies stored, J, by name."""
        return {}

    def powers(self, body: Body) -> dict[str, Any]:
        """Power put in, W, by name: never positive where the law dissipates."""
        return {}


class DampingLaw(ForceLaw):
    """A force D v with a matrix D that is symmetric and nowhere negative."""

    dissipates: ClassVar[bool] = True
    name: ClassVar[str]  # of its power

    @abstractmethod
    def matrix(self, body: Body) -> Any:
        """D (3×3, N·s/m); it may depend on place and velocity."""

    def powers(self, body: Body) -> dict[str, Any]:
        return {self.name: -ca.dot(self.wrench(body)[0], body.velocity)}
