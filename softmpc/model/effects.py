"""Effects: what a scene adds to elasticity and drive. Absent means absent.

An effect is a small frozen object. It does no mechanics itself: it says which coefficients of the
laws below it brings, and the formulations and their derivatives read them. A coefficient nobody
brings is None, and then no instruction is generated for it. Forces with other laws are `ForceLaw`
objects (softmpc/model/force_laws.py).

    on a body (a point of mass):  F = mass a + drag v - heavy g,
                                  M = disc (dω/dt + (ω×t)(t·ω) + t (t·dω/dt)) + spin_drag ω
    on the strains of a segment:  Q = viscosity · dq/dt
    on the tip of the arm:        a dead force and moment, given in the base frame
"""

from __future__ import annotations

from softmpc.model.contact import Contact
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
from softmpc.model.payload import Payload
from softmpc.model.water_effects import AddedMass, Buoyancy, FluidDrag, WaterMass

__all__ = [
    "EFFECTS",
    "AddedMass",
    "Buoyancy",
    "Contact",
    "Coriolis",
    "Effect",
    "EnvironmentDamping",
    "FluidDrag",
    "Gravity",
    "Inertia",
    "MaterialDamping",
    "Payload",
    "RotaryInertia",
    "TipLoad",
    "WaterMass",
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
    Buoyancy,
    FluidDrag,
    AddedMass,
    WaterMass,
    Payload,
    Contact,
    *DRIVE_EFFECTS,
)
