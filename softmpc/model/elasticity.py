"""Elastic force and moment of a segment: a slot with three laws.

Each law gives the tension (N) along the segment and the moment (3, N·m) for given strains, both
positive where they resist. The moment does work on δ(l k), so a law has an energy only if its
tension knows of the moment: that is what `EnergyElasticity` corrects (docs/equations.md).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import casadi as ca

if TYPE_CHECKING:
    from softmpc.model.parameters import Section

__all__ = ["Elasticity", "EnergyElasticity", "PrintedElasticity", "StrainElasticity"]


def bending_moment(section: Section, kappa: Any) -> Any:
    """Elastic moment M_e = K [kx, ky, kz] in N·m.

    Implements Eqs. (18), (19): K = diag(E I, E I, G J), I = π r⁴/4, J = π r⁴/2, where r is the
    section's `bending_radius`. Source: paper section 2.2.2.
    """
    stiffness = (section.bending_stiffness, section.bending_stiffness, section.torsional_stiffness)
    return ca.vertcat(*(k * kappa[j] for j, k in enumerate(stiffness)))


class Elasticity(ABC):
    """The constitutive law of a segment."""

    name: ClassVar[str]

    @abstractmethod
    def tension(self, section: Section, rest: float, epsilon: Any, kappa: Any) -> Any:
        """Axial force (N) at stretch 1 + `epsilon` and curvature `kappa` (3, 1/m)."""

    def moment(self, section: Section, kappa: Any) -> Any:
        """Moment (3, N·m) at curvature `kappa`."""
        return bending_moment(section, kappa)

    def energy(self, section: Section, rest: float, epsilon: Any, kappa: Any) -> Any | None:
        """Strain energy (J) of a segment of rest length `rest`, or None where there is none."""
        return None


@dataclass(frozen=True)
class StrainElasticity(Elasticity):
    """Tension E A_s Σ ε_j over the units, literally as Eq. (17) is read; has no energy."""

    name: ClassVar[str] = "strain"

    def tension(self, section: Section, rest: float, epsilon: Any, kappa: Any) -> Any:
        return printed_tension(section, rest, epsilon, kappa) / rest


@dataclass(frozen=True)
class PrintedElasticity(Elasticity):
    """Tension as printed in (17), not divided by the initial length; one segment a section."""

    name: ClassVar[str] = "printed"

    def tension(self, section: Section, rest: float, epsilon: Any, kappa: Any) -> Any:
        return printed_tension(section, rest, epsilon, kappa)


def printed_tension(section: Section, rest: float, epsilon: Any, kappa: Any) -> Any:
    """E A_s Σ_j (l_ij - l_i0), in N·m as printed: the caller divides by l_i0 for a force.

    Implements Eq. (17). l_ij is the arc length of unit j, l_i0 the initial length `rest` of the
    segment (the page has its current length, for which the sum vanishes). Source: section 2.2.2.
    """
    lengths = [rest * (1 + epsilon) * unit_stretch(kappa, at) for at in section.unit_positions]
    total: Any = sum(length - rest for length in lengths)
    return section.young_modulus * section.wall_area * total


def unit_stretch(kappa: Any, position: tuple[float, float]) -> Any:
    """Length of the unit at `position` (x, y in m) over that of the central axis."""
    x, y = position
    return 1 + kappa[0] * y - kappa[1] * x


@dataclass(frozen=True)
class EnergyElasticity(Elasticity):
    """Tension N E A_s ε - ½ k·K k: the least change of the paper's law that has an energy.

    U = λ [ ½ N E A_s ε² + ½ (1 + ε) k·K k ] for a segment of rest length λ and N units.
    """

    name: ClassVar[str] = "energy"

    def tension(self, section: Section, rest: float, epsilon: Any, kappa: Any) -> Any:
        return section.axial_stiffness * epsilon - 0.5 * ca.dot(kappa, self.moment(section, kappa))

    def energy(self, section: Section, rest: float, epsilon: Any, kappa: Any) -> Any:
        bending = 0.5 * (1 + epsilon) * ca.dot(kappa, self.moment(section, kappa))
        return rest * (0.5 * section.axial_stiffness * epsilon**2 + bending)
