"""Effects: what a scene adds to elasticity and drive. Absent means absent.

An effect is a small frozen object. It does no mechanics itself: it says which coefficients of the
laws below it brings, and the formulations and their derivatives read them. A coefficient nobody
brings is None, and then no instruction is generated for it.

    on a body (a point of mass):  F = mass a + drag v - heavy g,
                                  M = disc (dω/dt + (ω×t)(t·ω) + t (t·dω/dt)) + spin_drag ω
    on the strains of a segment:  Q = viscosity · dq/dt
    on the tip of the arm:        a dead force and moment, given in the base frame
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from softmpc.model.drive_effects import DRIVE_EFFECTS
from softmpc.model.effect import Effect
from softmpc.model.paper_effects import (
    Coriolis,
    EnvironmentDamping,
    Gravity,
    Inertia,
    MaterialDamping,
    RotaryInertia,
    TipLoad,
)

if TYPE_CHECKING:
    from softmpc.model.parameters import Section

__all__ = [
    "EFFECTS",
    "BodyLaw",
    "Coriolis",
    "Effect",
    "EnvironmentDamping",
    "Gravity",
    "Inertia",
    "MaterialDamping",
    "RotaryInertia",
    "TipLoad",
    "body_law",
]

# All effects that scene files know, in the order in which scenes keep them: the paper's first.
EFFECTS: tuple[type[Effect], ...] = (
    Gravity,
    Inertia,
    Coriolis,
    RotaryInertia,
    EnvironmentDamping,
    MaterialDamping,
    TipLoad,
    *DRIVE_EFFECTS,
)


@dataclass(frozen=True)
class BodyLaw:
    """Coefficients of the forces on one body; None where no effect brings one."""

    mass: float | None = None  # kg, inertia
    heavy: float | None = None  # kg, weight
    drag: float | None = None  # N·s/m
    disc: float | None = None  # kg·m², moment of inertia about a diameter of the thin disc
    spin_drag: float | None = None  # N·m·s/rad

    @property
    def turns(self) -> bool:
        """Whether the body's rotation matters."""
        return self.disc is not None or self.spin_drag is not None


def body_law(effects: tuple[Effect, ...], section: Section, share: float) -> BodyLaw:
    """The coefficients that the scene's effects bring to a body, added up."""
    brought: dict[str, float] = {}
    for effect in effects:
        for name, value in effect.on_body(section, share).items():
            brought[name] = brought.get(name, 0.0) + value
    return BodyLaw(**{k: v for k, v in brought.items() if v != 0.0})
