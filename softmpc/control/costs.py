"""Costs: weighted residuals whose squares an optimal-control problem adds up.

Each is ½ Σ (residual)², so every cost is a least-squares term and Gauss-Newton applies. Weights
are one over the deviation that costs ½: `TipPosition(deviation=1e-3)` charges ½ for a millimetre
that lasts one step of the controller.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import casadi as ca
import numpy as np

from softmpc.control.stage import Stage
from softmpc.errors import InputError

__all__ = [
    "Cost", "RestAtEnd", "StrainRate", "TipDirection", "TipPosition", "Torque", "TorqueRate",
    "about_plan",
]  # fmt: skip


@dataclass(frozen=True)
class Cost(ABC):
    """A least-squares term; `deviation` in the unit of its quantity."""

    name: ClassVar[str]
    at_end: ClassVar[bool] = False  # at the end of the horizon alone, else in every interval
    of_change: ClassVar[bool] = False  # of what changes within an interval, else of what lasts
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
    """Distance of the tip from the reference "tip" (3, m); deviation in m."""

    name: ClassVar[str] = "tip"
    deviation: float = 1e-3

    def residual(self, stage: Stage) -> ca.SX:
        return (stage.tip - stage.given("tip", 3)) / self.deviation


@dataclass(frozen=True)
class TipDirection(Cost):
    """Angle between the tip's axis and the reference "axis" (3, unit length); deviation in rad."""

    name: ClassVar[str] = "axis"
    deviation: float = 0.05

    def residual(self, stage: Stage) -> ca.SX:
        return (stage.axis - stage.given("axis", 3)) / self.deviation


@dataclass(frozen=True)
class Torque(Cost):
    """Effort: input over its scale (full torque); settles what the tip leaves open.

    `about` names a reference (k, SI) that is free of charge: only the difference from it counts.
    """

    name: ClassVar[str] = "torque"
    deviation: float = 3.0
    about: str = ""

    def residual(self, stage: Stage) -> ca.SX:
        return _off(stage, stage.u, self.about) / stage.model.layout.u.scale / self.deviation


@dataclass(frozen=True)
class TorqueRate(Cost):
    """Change of the input from one interval to the next, over its scale.

    `about` names a reference (k, SI) of a change that is free of charge.
    """

    name: ClassVar[str] = "torque rate"
    of_change: ClassVar[bool] = True
    deviation: float = 0.1
    about: str = ""

    def residual(self, stage: Stage) -> ca.SX:
        change = _off(stage, stage.u - stage.u_before, self.about)
        return change / stage.model.layout.u.scale / self.deviation


@dataclass(frozen=True)
class StrainRate(Cost):
    """Rates of the strains over their scales: damps what the tip does not show.

    `about` names a reference (n, SI) of rates that are free of charge.
    """

    name: ClassVar[str] = "strain rate"
    deviation: float = 0.3
    about: str = ""

    def residual(self, stage: Stage) -> ca.SX:
        return _off(stage, stage.dq, self.about) / stage.model.layout.dq.scale / self.deviation


PLANNED_INPUT = "planned input"
PLANNED: dict[type, str] = {  # names of what a plan makes free of charge
    Torque: PLANNED_INPUT,
    TorqueRate: "planned change of input",
    StrainRate: "planned strain rates",
}


def about_plan(costs: Sequence[Cost]) -> tuple[Cost, ...]:
    """The same costs with what is planned free of charge: feed-forward."""
    return tuple(
        replace(cost, about=PLANNED[type(cost)])
        if isinstance(cost, Torque | TorqueRate | StrainRate)
        else cost
        for cost in costs
    )


def _off(stage: Stage, value: ca.SX, about: str) -> ca.SX:
    """The difference from a reference of that name; all of the value where there is none."""
    return value - stage.given(about, value.numel()) if about else value


@dataclass(frozen=True, eq=False)
class RestAtEnd(Cost):
    """What is still to pay after the horizon: ½ |L (x - rest)|² at its end.

    `rest` is a reference, the state (SI) in which the arm rests at its target; `factor` is L for
    scaled states, see `softmpc.control.terminal`. An L with more columns also weighs the scaled
    difference of the last input from the reference "rest input", the input (SI) that holds it.
    """

    name: ClassVar[str] = "rest at the end"
    at_end: ClassVar[bool] = True
    factor: Any = None
    deviation: float = 1.0

    def residual(self, stage: Stage) -> ca.SX:
        L, layout = np.atleast_2d(np.asarray(self.factor, float)), stage.model.layout
        nx, k = len(layout.x), len(layout.u)
        if L.shape[1] not in (nx, nx + k) or not np.all(np.isfinite(L)):
            raise InputError(
                f"RestAtEnd(factor of shape {L.shape}): must be finite with {nx} columns, one for "
                f"each state, or {nx + k} with those of the inputs; see `terminal_cost`"
            )
        off = (stage.x - stage.given("rest", nx)) / layout.x.scale
        if L.shape[1] > nx:
            off = ca.vertcat(off, (stage.u - stage.given("rest input", k)) / layout.u.scale)
        return ca.mtimes(ca.DM(L), off) / self.deviation
