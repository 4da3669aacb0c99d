"""What the arm is made of: numbers in SI, each with unit, source, validity range and meaning.

The defaults are those of the paper's arm; `softmpc.model.presets` freezes them under a name.
A value that is not given keeps its default: nothing is recomputed behind the user's back, so a new
``young_modulus`` usually wants a new ``shear_modulus`` (E/3 for rubber) beside it.
"""

from dataclasses import dataclass
from math import cos, pi, radians, sin
from typing import Literal

from softmpc.errors import ParameterError
from softmpc.model.quantities import check_quantities, choice, quantity

__all__ = ["Hydraulics", "Limits", "Manipulator", "Section"]


@dataclass(frozen=True, kw_only=True)
class Section:
    """One section: parallel fluid-filled units between two end discs; angles in rad."""

    # fmt: off
    length: float = quantity(
        0.25, unit="m", source="table 1: l_0", low=1e-3, high=100.0,
        doc="rest length", toml="section_length",
    )
    young_modulus: float = quantity(
        1.2e6, unit="Pa", source="table 1: E", low=1e3, high=1e12,
        doc="Young's modulus E of the wall",
    )
    shear_modulus: float = quantity(
        0.4e6, unit="Pa", source="deduced: E/3, incompressible rubber", low=1e2, high=1e12,
        doc="shear modulus G of the wall",
    )
    bending_radius: float = quantity(
        0.0298, unit="m", source="deduced: radii of curvature at 1 MPa in 3.1, without gravity",
        low=1e-4, high=100.0, doc="radius in the bending and twist stiffness K_i (19)",
    )
    disc_radius: float = quantity(
        0.0323, unit="m", source="deduced: envelope, unit offset + 15 mm", low=1e-4, high=100.0,
        doc="radius of the disc in the rotary inertia (16)",
    )
    unit_offset: float = quantity(
        0.0173, unit="m", source="deduced: three tangent units of 15 mm radius",
        low=0.0, high=100.0, doc="distance of the unit axes from the centre line",
    )
    unit_area: float = quantity(
        3.14e-4, unit="m²", source="table 1: A_d", low=1e-10, high=100.0,
        doc="bore area of a unit, on which the pressure acts",
    )
    wall_area: float = quantity(
        3.93e-4, unit="m²", source="table 1: A_s", low=1e-10, high=100.0,
        doc="area of the wall of a unit",
    )
    mass: float = quantity(
        0.56, unit="kg", source="deduced: rubber and water of three units, frames unknown",
        low=1e-6, high=1e5, doc="mass, water included", toml="section_mass",
    )
    unit_angles: tuple[float, ...] = quantity(
        (0.0, radians(120.0), radians(240.0)), unit="rad",
        source="deduced: bending directions in 3.1 and 3.2", low=-2 * pi, high=2 * pi,
        doc="angle of each unit about the centre line, from x towards y; one value a unit",
        toml="section_angles_deg",
    )
    linear_damping: float = quantity(
        4.5, unit="N·s/m", source="fitted: settling times of Figs 6 and 7", low=0.0, high=1e6,
        doc="environment damping d_v (24), force by velocity",
    )
    angular_damping: float = quantity(
        0.002, unit="N·m·s/rad", source="fitted: settling times of Figs 6 and 7",
        low=0.0, high=1e6,
        doc="environment damping d_ω (24), moment by angular velocity",
    )
    viscosity: float = quantity(
        1.0e4, unit="Pa·s", source="fitted: settling times of Figs 6 and 7", low=0.0, high=1e10,
        doc="Kelvin-Voigt modulus of the wall (material damping)",
    )
    # fmt: on

    def __post_init__(self) -> None:
        check_quantities(self)

    @property
    def units(self) -> int:
        """Number of units."""
        return len(self.unit_angles)

    @property
    def unit_positions(self) -> tuple[tuple[float, float], ...]:
        """(rho_x, rho_y) of each unit axis in the cross-section, m."""
        offset = self.unit_offset
        return tuple((offset * cos(angle), offset * sin(angle)) for angle in self.unit_angles)

    @property
    def bending_stiffness(self) -> float:
        """E π r⁴/4 with the bending radius r, N·m²."""
        return self.young_modulus * pi * self.bending_radius**4 / 4

    @property
    def torsional_stiffness(self) -> float:
        """G π r⁴/2 with the bending radius r, N·m²."""
        return self.shear_modulus * pi * self.bending_radius**4 / 2

    @property
    def axial_stiffness(self) -> float:
        """E A_s of all units together, N."""
        return self.units * self.young_modulus * self.wall_area


@dataclass(frozen=True, kw_only=True)
class Hydraulics:
    """The drive of one unit: motor torque, screw, piston, cylinder, tube, chamber; (32)-(36)."""

    # fmt: off
    bulk_modulus: float = quantity(
        2.18e9, unit="Pa", source="table 1: K", low=1e3, high=1e13, doc="bulk modulus of the fluid",
    )
    piston_area: float = quantity(
        0.0021, unit="m²", source="table 1: A_c", low=1e-10, high=100.0, doc="area of the piston",
    )
    piston_mass: float = quantity(
        1.2, unit="kg", source="table 1: m_b", low=1e-6, high=1e5, doc="moving mass of the piston",
    )
    tube_length: float = quantity(
        1.61, unit="m", source="table 1: l_p", low=1e-4, high=1e4, doc="length of the tube",
    )
    tube_diameter: float = quantity(
        0.004, unit="m", source="table 1: d_p", low=1e-5, high=10.0, doc="bore of the tube",
    )
    water_viscosity: float = quantity(
        1.01e-3, unit="Pa·s", source="table 1: μ", low=1e-6, high=1e4,
        doc="dynamic viscosity of the fluid",
    )
    water_density: float = quantity(
        1000.0, unit="kg/m³", source="assumed: water", low=1.0, high=2e4,
        doc="density of the fluid in the tube; for its inertance and its Reynolds number",
    )
    screw_lead: float = quantity(
        0.004, unit="m", source="table 1: s", low=1e-5, high=1.0, doc="lead of the screw",
    )
    efficiency: float = quantity(
        0.535, unit="", source="deduced: 2.5 N·m holds 1 MPa; table 1 prints 0.9",
        low=0.0, low_open=True, high=1.0, doc="efficiency of the screw (33)",
    )
    screw: Literal["lead/2pi", "lead"] = choice(
        "lead/2pi", allowed=("lead/2pi", "lead"),
        source="deduced: the screw turns in rad/s; (33) prints the lead",
        doc="what the torque is divided by in (33)",
    )
    piston_damping: float = quantity(
        200.0, unit="N·s/m", source="assumed: not printed", low=0.0, high=1e8,
        doc="viscous damping of the piston (32)",
    )
    friction: float = quantity(
        0.0, unit="N", source="assumed: not printed", low=0.0, high=1e7,
        doc="Coulomb friction f of the piston (32)",
    )
    friction_velocity: float = quantity(
        1e-3, unit="m/s", source="assumed: small against 0.05 m/s of the pistons", low=1e-9,
        high=1.0, doc="speed of the piston at which friction is 76 % of f: f tanh(speed/this)",
    )
    cylinder_volume: float = quantity(
        7.35e-4, unit="m³", source="table 1: V_2", low=1e-12, high=100.0,
        doc="fluid volume of the cylinder",
    )
    chamber_volume: float = quantity(
        7.85e-5, unit="m³", source="table 1: V_1", low=1e-12, high=100.0,
        doc="fluid volume of a unit, the same for all",
    )
    # fmt: on

    def __post_init__(self) -> None:
        check_quantities(self)


@dataclass(frozen=True, kw_only=True)
class Limits:
    """What the drive may do, and the arm at rest; gauge pressures in Pa, torques in N·m."""

    # fmt: off
    pressure_min: float = quantity(
        0.0, unit="Pa", source="deduced: safety range 0-1 MPa in 3.1", low=-1e5, high=1e10,
        doc="lowest pressure of a unit",
    )
    pressure_max: float = quantity(
        1e6, unit="Pa", source="deduced: safety range 0-1 MPa in 3.1", low=-1e5, high=1e10,
        doc="highest pressure of a unit",
    )
    torque_min: float = quantity(
        0.0, unit="N·m", source="deduced: range 0-2.5 N·m in 3.1", low=-1e6, high=1e6,
        doc="lowest motor torque",
    )
    torque_max: float = quantity(
        2.5, unit="N·m", source="deduced: range 0-2.5 N·m in 3.1", low=-1e6, high=1e6,
        doc="highest motor torque",
    )
    stroke_max: float = quantity(
        0.35, unit="m", source="deduced: V_2/A_c", low=1e-5, high=100.0,
        doc="largest travel of the piston",
    )
    stretch_min: float = quantity(
        -0.5, unit="", source="assumed: half the rest length", low=-0.95, high=0.0,
        doc="least stretch ε of a segment at rest",
    )
    stretch_max: float = quantity(
        2.0, unit="", source="assumed: three times the rest length, as rubber bears",
        low=0.0, high=100.0, doc="largest stretch ε of a segment at rest",
    )
    curvature_max: float = quantity(
        1e4, unit="1/m", source="assumed: no limit", low=0.0, low_open=True, high=1e4,
        doc="largest curvature √(kx² + ky²) of a segment at rest; 10000 is no limit",
    )
    # fmt: on

    def __post_init__(self) -> None:
        check_quantities(self)
        for name, unit in (("pressure", "Pa"), ("torque", "N·m")):
            low, high = getattr(self, f"{name}_min"), getattr(self, f"{name}_max")
            if not low <= high:
                raise ParameterError(
                    f"Limits.{name}_min = {low:.12g} {unit}: must be at most "
                    f"{name}_max = {high:.12g} {unit}"
                )


@dataclass(frozen=True, kw_only=True)
class Manipulator:
    """Sections in series, base first, each unit driven by its own `Hydraulics`."""

    name: str
    sections: tuple[Section, ...]
    hydraulics: Hydraulics = Hydraulics()
    limits: Limits = Limits()

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name:
            raise ParameterError(f"Manipulator.name = {self.name!r}: must be a non-empty text")
        if not isinstance(self.sections, tuple | list) or not self.sections:
            raise ParameterError("Manipulator.sections: must be one or more Section objects")
        object.__setattr__(self, "sections", tuple(self.sections))
        for i, section in enumerate(self.sections):
            _check_part(f"sections[{i}]", section, Section)
        _check_part("hydraulics", self.hydraulics, Hydraulics)
        _check_part("limits", self.limits, Limits)

    @property
    def units(self) -> int:
        """Number of units (actuators) of all sections."""
        return sum(section.units for section in self.sections)

    @property
    def length(self) -> float:
        """Rest length of the whole arm, m."""
        return sum(section.length for section in self.sections)


def _check_part(label: str, part: object, kind: type) -> None:
    if not isinstance(part, kind):
        raise ParameterError(f"Manipulator.{label} = {part!r}: must be a {kind.__name__} object")
