"""Costs: weighted residuals whose squares an optimal-control problem adds up.

Each is ½ Σ (residual)², so every cost is a least-squares term and Gauss-Newton applies. Weights
are one over the deviation that costs ½: `TipPosition(deviation=1e-3)` charges ½ for a millimetre.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import casadi as ca

from softmpc.control.stage import Stage
from softmpc.errors import InputError

__all__ = ["Cost", "StrainRate", "TipPosition", "Torque", "TorqueRate"]


@dataclass(frozen=True)
class Cost(ABC):
    """A least-squares term of every interval; `deviation` in the unit of its quantity."""

    name: ClassVar[str]
    deviation: float

    def __post_init__(self) -> None:
        if not (0 < self.deviation < float("inf")):
            raise InputError(
                f"{type(self).__name__}(deviation={self.deviation!r}): must be above 0 and finite; "
                "leave the cost out to have none"
            )

    @abstractmethod
    def residual(self, stage: Stage) -> ca.SX:
        """The weighted residual, a column."""


@dataclass(frozen=True)
class TipPosition(Cost):
    """Distance of the tip from its reference; deviation in m."""

    name: ClassVar[str] = "tip"
    deviation: float = 1e-3

    def residual(self, stage: Stage) -> ca.SX:
        return (stage.tip - stage.target) / self.deviation


@dataclass(frozen=True)
class Torque(Cost):
    """Effort: input over its scale (full torque); settles what the tip leaves open."""

    name: ClassVar[str] = "torque"
    deviation: float = 3.0

    def residual(self, stage: Stage) -> ca.SX:
        return stage.u / stage.model.layout.u.scale / self.deviation


@dataclass(frozen=True)
class TorqueRate(Cost):
    """Change of the input from one interval to the next, over its scale."""

    name: ClassVar[str] = "torque rate"
    deviation: float = 0.1

    def residual(self, stage: Stage) -> ca.SX:
        return (stage.u - stage.u_before) / stage.model.layout.u.scale / self.deviation


@dataclass(frozen=True)
class StrainRate(Cost):
    """Rates of the strains over their scales: damps what the tip does not show."""

    name: ClassVar[str] = "strain rate"
    deviation: float = 0.3

    def residual(self, stage: Stage) -> ca.SX:
        return stage.dq / stage.model.layout.dq.scale / self.deviation
