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

from abc import ABC
from dataclasses import dataclass
from math import isfinite
from typing import TYPE_CHECKING, ClassVar

from softmpc.errors import SceneError

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

Vector = tuple[float, float, float]


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


class Effect(ABC):
    """Something a scene may contain or leave out."""

    name: ClassVar[str]

    def on_body(self, section: Section, share: float) -> dict[str, float]:
        """Coefficients of `BodyLaw` for a body with that share of the section's mass."""
        return {}

    def on_strains(self, section: Section, rest: float) -> tuple[float, ...] | None:
        """Viscous coefficients of (ε, kx, ky, kz) of a segment of rest length `rest`."""
        return None


def _check_vector(owner: str, what: str, value: Vector) -> None:
    ok = len(value) == 3 and all(
        isinstance(x, (int, float)) and not isinstance(x, bool) and isfinite(x) for x in value
    )
    if not ok:
        raise SceneError(f"{owner}.{what} = {value!r}: must be three finite numbers")


@dataclass(frozen=True)
class Gravity(Effect):
    """Weight of the arm, a force m g on each body; `vector` in m/s² in the base frame.

    Its moment about the segment's base, X × m g, is Eq. (25) of the paper.
    """

    name: ClassVar[str] = "gravity"
    vector: Vector = (0.0, 0.0, 9.81)

    def __post_init__(self) -> None:
        _check_vector("Gravity", "vector", self.vector)

    def on_body(self, section: Section, share: float) -> dict[str, float]:
        return {"heavy": share * section.mass}


@dataclass(frozen=True)
class Inertia(Effect):
    """Inertia of the bodies; left out, the arm is quasi-static."""

    name: ClassVar[str] = "inertia"

    def on_body(self, section: Section, share: float) -> dict[str, float]:
        return {"mass": share * section.mass}


@dataclass(frozen=True)
class Coriolis(Effect):
    """The part of the accelerations that is quadratic in the rates."""

    name: ClassVar[str] = "coriolis"


@dataclass(frozen=True)
class RotaryInertia(Effect):
    """Inertia of the cross-sections against turning; without it twist has no mass."""

    name: ClassVar[str] = "rotary_inertia"

    def on_body(self, section: Section, share: float) -> dict[str, float]:
        return {"disc": disc_inertia(share * section.mass, section.disc_radius)}


def disc_inertia(mass: float, radius: float) -> float:
    """Moment of inertia (kg·m²) of a thin disc about a diameter; twice that about its axis.

    Implements Eqs. (15), (16): I = diag(¼, ¼, ½) m r². Source: paper section 2.2.1.
    """
    return mass * radius**2 / 4


@dataclass(frozen=True)
class EnvironmentDamping(Effect):
    """Drag of the surroundings, linear in velocity and in angular velocity.

    Implements Eq. (24), with the section's coefficients shared out like its mass. The paper
    prints no values. Source: paper section 2.2.5.
    """

    name: ClassVar[str] = "environment_damping"

    def on_body(self, section: Section, share: float) -> dict[str, float]:
        return {
            "drag": share * section.linear_damping,
            "spin_drag": share * section.angular_damping,
        }


@dataclass(frozen=True)
class MaterialDamping(Effect):
    """Kelvin-Voigt viscosity of the rubber: stress η dε/dt beside E ε, G replaced by η/3."""

    name: ClassVar[str] = "material_damping"

    def on_strains(self, section: Section, rest: float) -> tuple[float, ...]:
        slow = section.viscosity / section.young_modulus
        bending = rest * slow * section.bending_stiffness
        twist = rest * section.viscosity / 3 * section.torsional_stiffness / section.shear_modulus
        return (rest * slow * section.axial_stiffness, bending, bending, twist)


@dataclass(frozen=True)
class TipLoad(Effect):
    """A dead force (N) and moment (N·m) at the tip of the arm, given in the base frame.

    Implements Eq. (23): what the last segment has beyond it. Source: paper section 2.2.4.
    """

    name: ClassVar[str] = "tip_load"
    force: Vector = (0.0, 0.0, 0.0)
    moment: Vector = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        _check_vector("TipLoad", "force", self.force)
        _check_vector("TipLoad", "moment", self.moment)


EFFECTS: tuple[type[Effect], ...] = (
    Gravity,
    Inertia,
    Coriolis,
    RotaryInertia,
    EnvironmentDamping,
    MaterialDamping,
    TipLoad,
)


def body_law(effects: tuple[Effect, ...], section: Section, share: float) -> BodyLaw:
    """The coefficients that the scene's effects bring to a body, added up."""
    brought: dict[str, float] = {}
    for effect in effects:
        for name, value in effect.on_body(section, share).items():
            brought[name] = brought.get(name, 0.0) + value
    return BodyLaw(**{k: v for k, v in brought.items() if v != 0.0})
