"""Where a segment's mass sits: at its tip, as in the paper, or at Gauss points along it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from softmpc.errors import SceneError

__all__ = ["GaussMass", "LumpedMass", "MassDistribution"]


class MassDistribution(ABC):
    """Quadrature of everything that is spread along a segment (mass, weight, drag)."""

    @property
    @abstractmethod
    def name(self) -> str:
        """Name in scene files."""

    @abstractmethod
    def quadrature(self) -> list[tuple[float, float]]:
        """(place along the segment in 0…1, share of its mass); the shares add up to one."""


@dataclass(frozen=True)
class LumpedMass(MassDistribution):
    """All mass at the tip of the segment (paper, section 2.1): first order in segment length."""

    name: ClassVar[str] = "lumped"

    def quadrature(self) -> list[tuple[float, float]]:
        return [(1.0, 1.0)]


@dataclass(frozen=True)
class GaussMass(MassDistribution):
    """Mass at 1, 2 or 3 Gauss-Legendre points: second order in segment length."""

    points: int = 2

    def __post_init__(self) -> None:
        if self.points not in (1, 2, 3):
            raise SceneError(
                f"GaussMass(points={self.points!r}): must be 1, 2 or 3; 2 are enough for the "
                "constant strain of a segment, so use more segments instead"
            )

    @property
    def name(self) -> str:
        return f"gauss-{self.points}"

    def quadrature(self) -> list[tuple[float, float]]:
        nodes, weights = np.polynomial.legendre.leggauss(self.points)
        return [(float(0.5 + 0.5 * x), float(0.5 * w)) for x, w in zip(nodes, weights, strict=True)]
