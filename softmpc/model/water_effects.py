"""Effects of water: around the arm (buoyancy, drag, added mass) and inside its chambers."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from typing import TYPE_CHECKING, ClassVar

from softmpc.model.effect import Effect, Site
from softmpc.model.force_laws import ForceLaw
from softmpc.model.quantities import quantity
from softmpc.model.water_laws import AddedMassLaw, DragLaw, GrowingMass

if TYPE_CHECKING:
    from softmpc.model.parameters import Section

__all__ = ["AddedMass", "Buoyancy", "FluidDrag", "WaterMass"]


def _density(doc: str) -> float:
    density: float = quantity(
        1000.0, unit="kg/m³", source="assumed: water", low=0.0, low_open=True, high=2e4, doc=doc
    )
    return density


@dataclass(frozen=True)
class Buoyancy(Effect):
    """Lift of the fluid that the arm displaces, by walls and chambers, spread like the mass."""

    name: ClassVar[str] = "buoyancy"
    surroundings: ClassVar[bool] = True
    needs: ClassVar[tuple[str, ...]] = ("gravity",)
    density: float = _density("density of the fluid around the arm")

    def on_body(self, section: Section, share: float) -> dict[str, float]:
        volume = section.units * (section.wall_area + section.unit_area) * section.length
        return {"heavy": -share * self.density * volume}


@dataclass(frozen=True)
class FluidDrag(Effect):
    """Drag quadratic in speed: across the arm on its diameter, along it on its skin."""

    # fmt: off
    name: ClassVar[str] = "fluid_drag"
    surroundings: ClassVar[bool] = True
    virtual_power_only: ClassVar[bool] = True
    density: float = _density("density of the fluid around the arm")
    normal: float = quantity(
        1.1, unit="", source="assumed: cylinder across a stream, Re 1e3 to 1e5", low=0.0, high=10.0,
        doc="drag coefficient across the arm, on its diameter 2 disc_radius",
    )
    tangential: float = quantity(
        0.01, unit="", source="assumed: skin friction of a rough cylinder", low=0.0, high=1.0,
        doc="drag coefficient along the arm, on its circumference",
    )
    velocity: float = quantity(
        1e-3, unit="m/s", source="assumed: small against speeds of 0.1 m/s", low=1e-9, high=10.0,
        doc="speed below which drag becomes linear",
    )
    # fmt: on

    def laws(self, site: Site, share: float) -> tuple[ForceLaw, ...]:
        area = 2 * site.section.disc_radius * share * site.section.length
        normal = self.density / 2 * self.normal * area
        tangential = self.density / 2 * self.tangential * pi * area
        if normal == tangential == 0.0:
            return ()
        return (DragLaw(normal, tangential, self.velocity),)


@dataclass(frozen=True)
class AddedMass(Effect):
    """Fluid that moves along when the arm moves across itself: ρ C π R² a length."""

    # fmt: off
    name: ClassVar[str] = "added_mass"
    surroundings: ClassVar[bool] = True
    needs: ClassVar[tuple[str, ...]] = ("inertia",)
    virtual_power_only: ClassVar[bool] = True
    density: float = _density("density of the fluid around the arm")
    coefficient: float = quantity(
        1.0, unit="", source="assumed: potential flow across a cylinder", low=0.0, low_open=True,
        high=10.0, doc="added mass over displaced mass, C",
    )
    # fmt: on

    def laws(self, site: Site, share: float) -> tuple[ForceLaw, ...]:
        section = site.section
        volume = pi * section.disc_radius**2 * share * section.length
        return (AddedMassLaw(self.density * self.coefficient * volume),)


@dataclass(frozen=True)
class WaterMass(Effect):
    """Water that enters the chambers as they grow: mass and weight ρ A_d l_0 ε of all units."""

    name: ClassVar[str] = "water_mass"
    virtual_power_only: ClassVar[bool] = True
    density: float = _density("density of the fluid in the chambers")

    def laws(self, site: Site, share: float) -> tuple[ForceLaw, ...]:
        section = site.section
        volume = section.units * section.unit_area * section.length
        inertia, gravity = "inertia" in site.names, "gravity" in site.names
        if not (inertia or gravity):
            return ()
        return (GrowingMass(share * self.density * volume, inertia, gravity),)
