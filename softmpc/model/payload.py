"""A payload at the tip of the arm."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from softmpc.model.bodies import Bodies, BodyLaw
from softmpc.model.effect import Effect, Site
from softmpc.model.paper_effects import disc_inertia
from softmpc.model.quantities import quantity

__all__ = ["Payload"]


@dataclass(frozen=True)
class Payload(Effect):
    """A body at the tip of the arm, with inertia and weight where the scene has them.

    It is a thin disc across the arm, as the arm's own bodies are; its moments of inertia count
    where the scene has rotary inertia.
    """

    # fmt: off
    name: ClassVar[str] = "payload"
    surroundings: ClassVar[bool] = True
    mass: float = quantity(
        0.1, unit="kg", source="assumed: a light gripper", low=0.0, low_open=True, high=1e4,
        doc="mass at the tip",
    )
    radius: float = quantity(
        0.03, unit="m", source="assumed: as wide as the arm", low=0.0, high=10.0,
        doc="radius of the disc, m r²/4 about a diameter; 0 is a point of mass",
    )
    # fmt: on

    def own_bodies(self, site: Site) -> Bodies:
        if not site.last:
            return ()
        law = BodyLaw(
            mass=self.mass if "inertia" in site.names else None,
            heavy=self.mass if "gravity" in site.names else None,
            disc=disc_inertia(self.mass, self.radius) if "rotary_inertia" in site.names else None,
        )
        return ((1.0, law),)
