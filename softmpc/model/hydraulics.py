"""From motor torque to unit pressure: the linear hydraulics of one actuator.

State z = (ẋ, P_a, P_c): piston speed, pressure in the unit, pressure in the cylinder; with
inertance of the tube water also its flow Q. The piston's place is no state, it is
x = (C_1 P_a + C_2 P_c)/A_c. The arm does not act back on (34), its compliance is constant.
docs/hydraulics.md says where that ends; `drive_laws` goes on from there.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from math import pi
from typing import TYPE_CHECKING, Any

import numpy as np

from softmpc.errors import BuildError
from softmpc.model.drive_effects import RotorInertia, TubeInertance, find

if TYPE_CHECKING:
    from softmpc.model.effect import Effect
    from softmpc.model.parameters import Hydraulics, Section

__all__ = [
    "DriveMatrices",
    "cylinder_compliance",
    "piston_mobility",
    "reflected_mass",
    "screw_advance",
    "screw_ratio",
    "slow_mode",
    "state_space",
    "tube_conductance",
    "tube_inertance",
    "unit_compliance",
    "unit_matrices",
    "unit_states",
    "water_compliance",
]

Array = Any
UNIT_STATES = ("piston_speed", "P_a", "P_c")


@dataclass(frozen=True)
class DriveMatrices:
    """ż = A z + B T, P = C z + D T of some actuators, and their pistons' place x = X z."""

    A: Array
    B: Array
    C: Array
    D: Array
    X: Array

    def at_rest(self, u: Array) -> Array:
        """States z in balance with a held input u."""
        return -np.linalg.solve(self.A, self.B @ u)

    @property
    def static_gain(self) -> Array:
        """Pressures at rest over inputs."""
        return self.D + self.C @ self.at_rest(np.eye(self.D.shape[1]))


def screw_advance(hydraulics: Hydraulics) -> float:
    """Travel of the piston over angle of the motor, s in m/rad."""
    return hydraulics.screw_lead / (2 * pi if hydraulics.screw == "lead/2pi" else 1.0)


def screw_ratio(hydraulics: Hydraulics) -> float:
    """Force on the piston over motor torque (1/m).

    Implements Eq. (33): η T ω = F_b ẋ with ẋ = ω s. Read with ω in rad/s the screw advances by
    s = lead/2π (default); `screw="lead"` takes s as printed. Source: paper section 2.3.
    """
    return hydraulics.efficiency / screw_advance(hydraulics)


def piston_mobility(
    hydraulics: Hydraulics, more_mass: float = 0.0, more_damping: float = 0.0
) -> Array:
    """Acceleration of the piston (m/s²) a unit of (F_b, ẋ, P_c, friction force).

    Implements Eq. (32): F_b = m_b ẍ + f + P_c A_c + d_v ẋ. Source: paper section 2.3. Effects may
    bring more mass (kg) and damping (N·s/m).
    """
    m, d = hydraulics.piston_mass + more_mass, hydraulics.piston_damping + more_damping
    return np.array([1 / m, -d / m, -hydraulics.piston_area / m, -1 / m])


def reflected_mass(hydraulics: Hydraulics, rotor: RotorInertia | None) -> float:
    """What the piston feels of the motor's inertia, η J/s² (kg).

    (33) with the torque that reaches the screw, T − J dω/dt, and dω/dt = ẍ/s:
    F_b = η T/s − η J ẍ/s². So the efficiency that weakens the torque weakens the inertia alike.
    """
    return screw_ratio(hydraulics) * rotor.inertia / screw_advance(hydraulics) if rotor else 0.0


def tube_conductance(hydraulics: Hydraulics) -> float:
    """Laminar flow through the tube over pressure difference, k = π d_p⁴/(128 μ l_p), m³/(s·Pa)."""
    d = hydraulics.tube_diameter
    return pi * d**4 / (128 * hydraulics.water_viscosity * hydraulics.tube_length)


def tube_inertance(hydraulics: Hydraulics) -> float:
    """Pressure difference over acceleration of the flow, I = ρ l_p/(π d_p²/4), kg/m⁴."""
    bore = pi * hydraulics.tube_diameter**2 / 4
    return hydraulics.water_density * hydraulics.tube_length / bore


def water_compliance(hydraulics: Hydraulics) -> float:
    """Volume the water of a unit gives over its pressure, V_1/K in m³/Pa."""
    return hydraulics.chamber_volume / hydraulics.bulk_modulus


def unit_compliance(section: Section, hydraulics: Hydraulics) -> float:
    """Volume a unit takes up over its pressure, C_1 in m³/Pa.

    Implements Eq. (34): k (P_c - P_a) = C_1 dP_a/dt, C_1 = A_d² l_0/(E A_s) + V_1/K.
    Source: paper section 2.3.
    """
    wall = section.unit_area**2 * section.length / (section.young_modulus * section.wall_area)
    return wall + water_compliance(hydraulics)


def cylinder_compliance(hydraulics: Hydraulics) -> float:
    """Volume the cylinder's water gives over its pressure, C_2 in m³/Pa.

    Implements Eq. (35): A_c ẋ + k (P_a - P_c) = C_2 dP_c/dt, C_2 = V_2/K.
    Source: paper section 2.3.
    """
    return hydraulics.cylinder_volume / hydraulics.bulk_modulus


def unit_states(effects: Iterable[Effect] = ()) -> tuple[str, ...]:
    """Names of the states of one actuator."""
    return (*UNIT_STATES, "Q") if find(effects, TubeInertance) else UNIT_STATES


def unit_matrices(
    section: Section,
    hydraulics: Hydraulics,
    effects: Iterable[Effect] = (),
    more_damping: float = 0.0,
) -> DriveMatrices:
    """State-space matrices of one actuator, for z = (ẋ, P_a, P_c) and torque T in N·m.

    Implements Eq. (36), with f/m_b for the misprinted f m_b. Source: paper section 2.3. Rotor and
    tube inertia stay linear; other effects do not change what holds close to rest.
    """
    rotor, inertance = find(effects, RotorInertia), find(effects, TubeInertance)
    more_mass = reflected_mass(hydraulics, rotor)
    by_force, by_speed, by_pressure, _ = piston_mobility(hydraulics, more_mass, more_damping)
    k, area = tube_conductance(hydraulics), hydraulics.piston_area
    c1, c2 = unit_compliance(section, hydraulics), cylinder_compliance(hydraulics)
    if inertance:
        i = tube_inertance(hydraulics)
        rows = [
            [by_speed, 0.0, by_pressure, 0.0],
            [0.0, 0.0, 0.0, 1 / c1],
            [area / c2, 0.0, 0.0, -1 / c2],
            [0.0, -1 / i, 1 / i, -1 / (k * i)],
        ]
    else:
        rows = [[by_speed, 0.0, by_pressure], [0.0, -k / c1, k / c1], [area / c2, k / c2, -k / c2]]
    B, C, X = np.zeros((len(rows), 1)), np.zeros((1, len(rows))), np.zeros((1, len(rows)))
    B[0], C[0, 1], X[0, 1:3] = by_force * screw_ratio(hydraulics), 1.0, (c1 / area, c2 / area)
    return DriveMatrices(np.array(rows), B, C, np.zeros((1, 1)), X)


def state_space(section: Section, hydraulics: Hydraulics, effects: Iterable[Effect] = ()) -> Any:
    """One actuator as a `control.StateSpace`, from torque (N·m) to unit pressure (Pa)."""
    import control

    effects = tuple(effects)
    m = unit_matrices(section, hydraulics, effects)
    states = list(unit_states(effects))
    return control.ss(m.A, m.B, m.C, m.D, inputs=["T"], outputs=["P_a"], states=states)


def slow_mode(
    section: Section, hydraulics: Hydraulics, effects: Iterable[Effect] = ()
) -> DriveMatrices:
    """One actuator reduced to its slowest mode, by python-control's `model_reduction`.

    The fast modes follow at once, with their static gain ("matchdc"): the pole and the gain at rest
    are those of the full drive. The state is a pressure in Pa. Raises `BuildError` where the
    slowest mode oscillates, for then one state cannot hold it.
    """
    import control

    full = state_space(section, hydraulics, effects)
    poles, modes = np.linalg.eig(full.A)
    order = np.argsort(np.abs(poles))
    if abs(poles[order[0]].imag) > 1e-9 * abs(poles[order[0]]):
        raise BuildError(
            f"the slowest mode of the drive oscillates (pole {poles[order[0]]:.4g} 1/s): "
            "actuation 'slow-mode' has one real state; use 'hydraulic'"
        )
    slowest, fast = modes[:, order[0]], []
    for j in order[1:]:  # of conjugate modes, real and imaginary part are a basis
        if poles[j].imag >= 0:
            fast += [modes[:, j].real, modes[:, j].imag] if poles[j].imag else [modes[:, j].real]
    # The first state is scaled so that it is its own share of the pressure.
    basis = np.column_stack([slowest.real / (full.C @ slowest.real)[0], *fast])
    apart = control.similarity_transform(full, np.linalg.inv(basis))
    slow = control.model_reduction(apart, elim_states=list(range(1, len(poles))), method="matchdc")
    return DriveMatrices(slow.A, slow.B, slow.C, slow.D, np.zeros((0, 0)))
