"""How the equations of motion are put together: the formulation slot of a scene."""

from __future__ import annotations

from abc import ABC
from dataclasses import dataclass, field
from typing import ClassVar

from softmpc.model.elasticity import Elasticity, EnergyElasticity, StrainElasticity
from softmpc.model.mass import GaussMass, LumpedMass, MassDistribution

__all__ = ["Formulation", "FullNewtonEuler", "NewtonEuler", "VirtualPower"]


class Formulation(ABC):
    """Base of the formulations; each has a mass distribution and an elastic law."""

    name: ClassVar[str]
    mass: MassDistribution
    elasticity: Elasticity


@dataclass(frozen=True)
class VirtualPower(Formulation):
    """Virtual power on exact velocities: symmetric, conserves energy, converges (default)."""

    name: ClassVar[str] = "virtual-power"
    mass: MassDistribution = field(default_factory=GaussMass)
    elasticity: Elasticity = field(default_factory=EnergyElasticity)


@dataclass(frozen=True)
class NewtonEuler(Formulation):
    """The paper's force and moment balance as printed: lumped mass, transmission (22)."""

    name: ClassVar[str] = "newton-euler"
    elasticity: Elasticity = field(default_factory=StrainElasticity)

    @property
    def mass(self) -> MassDistribution:  # type: ignore[override]
        return LumpedMass()


@dataclass(frozen=True)
class FullNewtonEuler(NewtonEuler):
    """The balance with the full wrench transmitted: lumped mass, converges at first order."""

    name: ClassVar[str] = "newton-euler-full"
