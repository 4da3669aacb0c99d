"""From motor torque to unit pressure: the linear hydraulics of one actuator.

State z = (ẋ, P_a, P_c): piston speed, pressure in the unit, pressure in the cylinder. The piston's
place is no state: x = (C_1 P_a + C_2 P_c)/A_c. The arm does not act back on (34), its compliance
is constant. Laminar tube flow, no inertance of the tube water: docs/hydraulics.md says where
that ends.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from typing import TYPE_CHECKING, Any

import numpy as np

from softmpc.errors import BuildError

if TYPE_CHECKING:
    from softmpc.model.parameters import Hydraulics, Section

__all__ = [
    "DriveMatrices",
    "cylinder_compliance",
    "piston_mobility",
    "screw_ratio",
    "slow_mode",
    "state_space",
    "tube_conductance",
    "unit_compliance",
    "unit_matrices",
]

Array = Any


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


def screw_ratio(hydraulics: Hydraulics) -> float:
    """Force on the piston over motor torque (1/m).

    Implements Eq. (33): η T ω = F_b ẋ with ẋ = ω s. Read with ω in rad/s the screw advances by
    s = lead/2π (default); `screw="lead"` takes s as printed. Source: paper section 2.3.
    """
    s = hydraulics.screw_lead / (2 * pi if hydraulics.screw == "lead/2pi" else 1.0)
    return hydraulics.efficiency / s


def piston_mobility(hydraulics: Hydraulics) -> Array:
    """Acceleration of the piston (m/s²) a unit of (F_b, ẋ, P_c, friction force).

    Implements Eq. (32): F_b = m_b ẍ + f + P_c A_c + d_v ẋ. Source: paper section 2.3.
    """
    m = hydraulics.piston_mass
    return np.array([1 / m, -hydraulics.piston_damping / m, -hydraulics.piston_area / m, -1 / m])


def tube_conductance(hydraulics: Hydraulics) -> float:
    """Laminar flow through the tube over pressure difference, k = π d_p⁴/(128 μ l_p), m³/(s·Pa)."""
    d = hydraulics.tube_diameter
    return pi * d**4 / (128 * hydraulics.water_viscosity * hydraulics.tube_length)


def unit_compliance(section: Section, hydraulics: Hydraulics) -> float:
    """Volume a unit takes up over its pressure, C_1 in m³/Pa.

    Implements Eq. (34): k (P_c - P_a) = C_1 dP_a/dt, C_1 = A_d² l_0/(E A_s) + V_1/K.
    Source: paper section 2.3.
    """
    wall = section.unit_area**2 * section.length / (section.young_modulus * section.wall_area)
    return wall + hydraulics.chamber_volume / hydraulics.bulk_modulus


def cylinder_compliance(hydraulics: Hydraulics) -> float:
    """Volume the cylinder's water gives over its pressure, C_2 in m³/Pa.

    Implements Eq. (35): A_c ẋ + k (P_a - P_c) = C_2 dP_c/dt, C_2 = V_2/K.
    Source: paper section 2.3.
    """
    return hydraulics.cylinder_volume / hydraulics.bulk_modulus


def unit_matrices(section: Section, hydraulics: Hydraulics) -> DriveMatrices:
    """State-space matrices of one actuator, for z = (ẋ, P_a, P_c) and torque T in N·m.

    Implements Eq. (36), with f/m_b for the misprinted f m_b. Source: paper section 2.3.
    """
    by_force, by_speed, by_pressure, _ = piston_mobility(hydraulics)
    k, area = tube_conductance(hydraulics), hydraulics.piston_area
    c1, c2 = unit_compliance(section, hydraulics), cylinder_compliance(hydraulics)
    return DriveMatrices(
        A=np.array(
            [[by_speed, 0.0, by_pressure], [0.0, -k / c1, k / c1], [area / c2, k / c2, -k / c2]]
        ),
        B=np.array([[by_force * screw_ratio(hydraulics)], [0.0], [0.0]]),
        C=np.array([[0.0, 1.0, 0.0]]),
        D=np.zeros((1, 1)),
        X=np.array([[0.0, c1 / area, c2 / area]]),
    )


def state_space(section: Section, hydraulics: Hydraulics) -> Any:
    """One actuator as a `control.StateSpace`, from torque (N·m) to unit pressure (Pa)."""
    import control

    m = unit_matrices(section, hydraulics)
    return control.ss(m.A, m.B, m.C, m.D, inputs=["T"], outputs=["P_a"], states=list(UNIT_STATES))


def slow_mode(section: Section, hydraulics: Hydraulics) -> DriveMatrices:
    """One actuator reduced to its slowest mode, by python-control's `model_reduction`.

    The fast modes follow at once, with their static gain ("matchdc"): the pole and the gain at rest
    are those of the full drive. The state is a pressure in Pa. Raises `BuildError` where the
    slowest mode oscillates, for then one state cannot hold it.
    """
    import control

    full = state_space(section, hydraulics)
    poles, modes = np.linalg.eig(full.A)
    order = np.argsort(np.abs(poles))
    if abs(poles[order[0]].imag) > 1e-9 * abs(poles[order[0]]):
        raise BuildError(
            f"the slowest mode of the drive oscillates (pole {poles[order[0]]:.4g} 1/s): "
            "actuation 'slow-mode' has one real state; use 'hydraulic'"
        )
    slowest, second, third = modes[:, order].T
    pair = np.any(np.iscomplex(second))  # of conjugate modes: real and imaginary part are a basis
    fast = [second.real, second.imag if pair else third.real]
    # The first state is scaled so that it is its own share of the pressure.
    basis = np.column_stack([slowest.real / (full.C @ slowest.real)[0], *fast])
    apart = control.similarity_transform(full, np.linalg.inv(basis))
    slow = control.model_reduction(apart, elim_states=[1, 2], method="matchdc")
    return DriveMatrices(slow.A, slow.B, slow.C, slow.D, np.zeros((0, 0)))


UNIT_STATES = ("piston_speed", "P_a", "P_c")
