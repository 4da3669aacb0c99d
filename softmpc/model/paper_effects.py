"""The effects of the paper, and the linear viscosity of the rubber beside them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from softmpc.model.effect import Effect
from softmpc.model.quantities import vector

if TYPE_CHECKING:
    from softmpc.model.parameters import Section

__all__ = [
    "Coriolis",
    "EnvironmentDamping",
    "Gravity",
    "Inertia",
    "MaterialDamping",
    "RotaryInertia",
    "TipLoad",
]


@dataclass(frozen=True)
class Gravity(Effect):
    """Weight of the arm, a force m g on each body; `vector` in m/s² in the base frame.

    Its moment about the segment's base, X × m g, is Eq. (25) of the paper.
    """

    name: ClassVar[str] = "gravity"
    surroundings: ClassVar[bool] = True
    bare: ClassVar[str] = "vector"
    vector: tuple[float, float, float] = vector(
        (0.0, 0.0, 9.81),
        unit="m/s²",
        source="assumed: the arm hangs",
        doc="acceleration of free fall, in the base frame",
    )

    def on_body(self, section: Section, share: float) -> dict[str, float]:
        return {"heavy": share * section.mass}


@dataclass(frozen=True)
class Inertia(Effect):
    """Inertia of the bodies; left out, the arm is quasi-static."""

    name: ClassVar[str] = "inertia"
    by_default: ClassVar[bool] = True

    def on_body(self, section: Section, share: float) -> dict[str, float]:
        return {"mass": share * section.mass}


@dataclass(frozen=True)
class Coriolis(Effect):
    """The part of the accelerations that is quadratic in the rates."""

    name: ClassVar[str] = "coriolis"
    by_default: ClassVar[bool] = True
    needs: ClassVar[tuple[str, ...]] = ("inertia",)


@dataclass(frozen=True)
class RotaryInertia(Effect):
    """Inertia of the cross-sections against turning; without it twist has no mass."""

    name: ClassVar[str] = "rotary_inertia"
    by_default: ClassVar[bool] = True
    needs: ClassVar[tuple[str, ...]] = ("inertia",)

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
    by_default: ClassVar[bool] = True

    def on_body(self, section: Section, share: float) -> dict[str, float]:
        return {
            "drag": share * section.linear_damping,
            "spin_drag": share * section.angular_damping,
        }


@dataclass(frozen=True)
class MaterialDamping(Effect):
    """Kelvin-Voigt viscosity of the rubber: stress η dε/dt beside E ε, G replaced by η/3."""

    name: ClassVar[str] = "material_damping"
    by_default: ClassVar[bool] = True

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
    surroundings: ClassVar[bool] = True
    force: tuple[float, float, float] = vector(
        (0.0, 0.0, 0.0), unit="N", source="assumed: none", doc="dead force, in the base frame"
    )
    moment: tuple[float, float, float] = vector(
        (0.0, 0.0, 0.0), unit="N·m", source="assumed: none", doc="dead moment, in the base frame"
    )
