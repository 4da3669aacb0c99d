"""Forces of water on a body: quadratic drag, added mass, and a mass that grows with the stretch."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import casadi as ca

from softmpc.model.force_laws import Body, DampingLaw, ForceLaw

__all__ = ["AddedMassLaw", "DragLaw", "GrowingMass"]


@dataclass(frozen=True)
class DragLaw(DampingLaw):
    """F = b_n |v_n| v_n + b_t |v_t| v_t, with |x| rounded to √(x² + v_0²) so that it is smooth."""

    name: ClassVar[str] = "fluid_drag"
    normal: float  # b_n, N·s²/m²
    tangential: float  # b_t, N·s²/m²
    velocity: float  # v_0, m/s

    def wrench(self, body: Body) -> tuple[Any, Any | None]:
        along = body.tangent * ca.dot(body.tangent, body.velocity)
        normal, tangential = self._factors(body)
        return normal * (body.velocity - along) + tangential * along, None

    def matrix(self, body: Body) -> Any:
        along = body.tangent @ body.tangent.T
        normal, tangential = self._factors(body)
        return normal * (ca.SX.eye(3) - along) + tangential * along

    def _factors(self, body: Body) -> tuple[Any, Any]:
        """Drag over speed, across and along, N·s/m."""
        along = ca.dot(body.tangent, body.velocity)
        across = body.velocity - body.tangent * along
        floor = self.velocity**2
        return (
            self.normal * ca.sqrt(ca.sumsqr(across) + floor),
            self.tangential * ca.sqrt(along**2 + floor),
        )


@dataclass(frozen=True)
class AddedMassLaw(ForceLaw):
    """Momentum p = m (v - t (t·v)) of the fluid around: force dp/dt and moment v × p.

    The moment is that of a body whose momentum is not along its velocity (Munk's): with it the
    energy p·v/2 changes by what the wrench does, and M is symmetric.
    """

    mass: float  # m, kg

    def wrench(self, body: Body) -> tuple[Any, Any | None]:
        t, v, a = body.tangent, body.velocity, body.acceleration
        turning = ca.cross(body.spin, t)
        along = ca.dot(t, v)
        rate = a - turning * along - t * (ca.dot(turning, v) + ca.dot(t, a))
        return self.mass * rate, -self.mass * along * ca.cross(v, t)

    def energies(self, body: Body) -> dict[str, Any]:
        along = ca.dot(body.tangent, body.velocity)
        return {"added_mass": self.mass / 2 * (ca.sumsqr(body.velocity) - along**2)}


@dataclass(frozen=True)
class GrowingMass(ForceLaw):
    """Mass μ ε of water that moves with the body and enters at the base, from rest.

    From L = μ ε (v²/2 + g·x): the force is μ ε (a - g) + μ ε' v, and ε has -μ (v²/2 + g·x) beside
    it. Energy balances if the pressure is that at the height of the base: the head of the water
    column is in the term with g·x.
    """

    mass: float  # μ, kg at ε = 1
    inertia: bool
    gravity: bool

    def wrench(self, body: Body) -> tuple[Any, Any | None]:
        force = ca.SX.zeros(3)
        if self.inertia:
            force = body.stretch * body.acceleration + body.stretch_rate * body.velocity
        if self.gravity:
            force = force - body.stretch * body.gravity
        return self.mass * force, None

    def on_stretch(self, body: Body) -> Any | None:
        power = ca.SX(0)
        if self.inertia:
            power = power + ca.sumsqr(body.velocity) / 2
        if self.gravity:
            power = power + body.head
        return -self.mass * power

    def energies(self, body: Body) -> dict[str, Any]:
        mass = self.mass * body.stretch
        found = {}
        if self.inertia:
            found["kinetic"] = mass * ca.sumsqr(body.velocity) / 2
        if self.gravity:
            found["gravity"] = -mass * body.head
        return found
