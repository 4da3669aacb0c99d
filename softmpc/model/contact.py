"""Contact of the arm with obstacles: a smooth push that starts where the arm's envelope touches.

The arm touches with spheres of its envelope's radius, at places along each segment. A sphere that
is δ deep in an obstacle is pushed out by F(δ) s(d δ'):

    F = k w (x³ - x⁴/2), x = δ/w in 0…1;   F = k (δ - w/2) from δ = w on;   0 when apart
    s(y) = y + √(1 + y²)

F has two continuous derivatives and the energy U = k w² (x⁴/4 - x⁵/10), then its integral. s is 1
at rest, grows while the arm goes in and stays above 0 while it leaves: damping never pulls.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import casadi as ca

from softmpc.errors import SceneError
from softmpc.model.bodies import Bodies, BodyLaw
from softmpc.model.effect import Effect, Site
from softmpc.model.force_laws import Body, DampingLaw, ForceLaw
from softmpc.model.obstacles import OBSTACLES, Obstacle
from softmpc.model.quantities import parts, quantity

__all__ = ["Contact", "ContactDamping", "ContactPush"]


@dataclass(frozen=True)
class Contact(Effect):
    """Obstacles that the arm cannot enter; they push, smoothly and without friction."""

    # fmt: off
    name: ClassVar[str] = "contact"
    surroundings: ClassVar[bool] = True
    virtual_power_only: ClassVar[bool] = True
    obstacles: tuple[Obstacle, ...] = parts(OBSTACLES, doc="what the arm may touch")
    stiffness: float = quantity(
        1e4, unit="N/m", source="assumed: 10 N go 1.5 mm deep", low=1.0, high=1e9,
        doc="stiffness k of one place of contact",
    )
    softness: float = quantity(
        1e-3, unit="m", source="assumed: small against the arm's radius", low=1e-7, high=1.0,
        doc="depth w over which the stiffness builds up",
    )
    damping: float = quantity(
        1.0, unit="s/m", source="assumed: rubber on a wall", low=0.0, high=1e6,
        doc="d: at the speed 1/d inwards the push is 2.4 times that at rest",
    )
    places: int = quantity(
        2, unit="", source="assumed: half a segment is about the arm's width", low=1, high=64,
        doc="places of contact a segment, evenly spaced, the last at its end; a whole number",
    )
    # fmt: on

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.obstacles:
            raise SceneError("Contact.obstacles is empty: must have at least one obstacle")
        if self.places != int(self.places):
            raise SceneError(f"Contact.places = {self.places!r}: must be a whole number")
        object.__setattr__(self, "places", int(self.places))

    def own_bodies(self, site: Site) -> Bodies:
        laws: list[ForceLaw] = []
        for obstacle in self.obstacles:
            push = ContactPush(obstacle, site.section.disc_radius, self.stiffness, self.softness)
            laws += [push, ContactDamping(push, self.damping)] if self.damping else [push]
        law = BodyLaw(laws=tuple(laws))
        return tuple(((k + 1) / self.places, law) for k in range(self.places))


@dataclass(frozen=True)
class ContactPush(ForceLaw):
    """F(δ) along the way out of an obstacle."""

    obstacle: Obstacle
    radius: float  # of the sphere, m
    stiffness: float  # k, N/m
    softness: float  # w, m

    def at(self, body: Body) -> tuple[Any, Any]:
        """Depth δ and the way out in the local frame."""
        depth, out = self.obstacle.depth(body.place, self.radius)
        return depth, body.to_local(out)

    def force(self, depth: Any) -> Any:
        """F, N."""
        x, beyond = self._split(depth)
        return self.stiffness * (self.softness * x**3 * (1 - x / 2) + beyond)

    def wrench(self, body: Body) -> tuple[Any, Any | None]:
        depth, out = self.at(body)
        return -self.force(depth) * out, None

    def energies(self, body: Body) -> dict[str, Any]:
        x, beyond = self._split(self.at(body)[0])
        w = self.softness
        stored = w**2 * x**4 * (0.25 - x / 10) + beyond * (w + beyond) / 2
        return {"contact": self.stiffness * stored}

    def _split(self, depth: Any) -> tuple[Any, Any]:
        """δ/w within 0…1, and what is beyond w."""
        x = ca.fmin(ca.fmax(depth / self.softness, 0), 1)
        return x, ca.fmax(depth - self.softness, 0)


@dataclass(frozen=True)
class ContactDamping(DampingLaw):
    """F (s - 1): what the speed adds to a push or takes from it."""

    name: ClassVar[str] = "contact_damping"
    push: ContactPush
    damping: float  # d, s/m

    def wrench(self, body: Body) -> tuple[Any, Any | None]:
        depth, out = self.push.at(body)
        y = -self.damping * ca.dot(out, body.velocity)
        return -self.push.force(depth) * (y + ca.sqrt(1 + y**2) - 1) * out, None

    def matrix(self, body: Body) -> Any:
        depth, out = self.push.at(body)
        y = -self.damping * ca.dot(out, body.velocity)
        secant = 1 + y / (1 + ca.sqrt(1 + y**2))  # (s - 1)/y, above 0
        return self.push.force(depth) * self.damping * secant * (out @ out.T)
