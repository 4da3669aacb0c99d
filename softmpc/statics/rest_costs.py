"""What decides between postures that hold the same target: costs of the inverse statics.

A cost of your own is a class below `RestCost` whose `terms` returns an objective of size one, in
the symbols of the program: strains `program.q`, pressures `program.p`, in SI.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import Any, ClassVar

import casadi as ca
import numpy as np

from softmpc.errors import InputError
from softmpc.model.model import Model
from softmpc.statics.program import Extra, RestProgram, Rows
from softmpc.statics.rest_limits import limit_rows

__all__ = [
    "REST_COSTS", "ClosestPosture", "GreatestMargin", "LeastPressure", "LeastStrainEnergy",
    "RestCost", "Terms",
]  # fmt: skip


@dataclass(frozen=True)
class Terms:
    """What a cost puts into the program: an objective, and what else it needs."""

    objective: ca.SX
    extra: Extra = field(default_factory=Extra)
    rows: Rows = field(default_factory=Rows)
    parameters: ca.SX = field(default_factory=lambda: ca.SX(0, 1))


class RestCost(ABC):
    """A cost of a posture at rest, of size one."""

    name: ClassVar[str]

    @abstractmethod
    def terms(self, program: RestProgram) -> Terms:
        """Its part of the program."""

    def values(self, model: Model, present: np.ndarray | None) -> np.ndarray:
        """Values of its parameters, where it has some; `present` is the posture now (n), if any."""
        return np.zeros(0)


@dataclass(frozen=True)
class LeastPressure(RestCost):
    """Half the mean square of the unit pressures over the highest one."""

    name: ClassVar[str] = "least-pressure"

    def terms(self, program: RestProgram) -> Terms:
        scale = program.model.layout.p.scale
        return Terms(0.5 * ca.sumsqr(program.p / scale) / len(scale))


@dataclass(frozen=True)
class LeastStrainEnergy(RestCost):
    """Elastic energy over that of an arm under full pressure."""

    name: ClassVar[str] = "least-strain-energy"

    def terms(self, program: RestProgram) -> Terms:
        model = program.model
        energies = model.energies(q=program.q, dq=0)
        if "elastic" not in energies:
            law = model.scene.formulation.elasticity.name
            raise InputError(
                f"cost {self.name!r}: the elasticity {law!r} of this scene has no energy; "
                "use elasticity 'energy', or another cost"
            )
        full = 0.5 * float(model.layout.q.scale @ model.layout.r.scale)
        return Terms(energies["elastic"] / full)


@dataclass(frozen=True)
class ClosestPosture(RestCost):
    """Half the mean square of the strains' distance from a posture `q` (n), scaled.

    Without `q` that is where the solution starts from: along a path the posture before, else the
    straight arm.
    """

    q: tuple[float, ...] | None = None

    name: ClassVar[str] = "closest-posture"

    def __post_init__(self) -> None:
        if self.q is not None:
            object.__setattr__(self, "q", tuple(np.asarray(self.q, float).ravel().tolist()))

    def terms(self, program: RestProgram) -> Terms:
        scale = program.model.layout.q.scale
        wanted = ca.SX.sym("wanted", len(scale))
        return Terms(0.5 * ca.sumsqr(program.q / scale - wanted) / len(scale), parameters=wanted)

    def values(self, model: Model, present: np.ndarray | None) -> np.ndarray:
        given = present if self.q is None else self.q
        q = np.zeros(model.strains) if given is None else np.asarray(given, float)
        if q.shape != (model.strains,) or not np.all(np.isfinite(q)):
            raise InputError(
                f"ClosestPosture.q has {q.size} values: must be the {model.strains} strains of "
                "this model, finite numbers"
            )
        return np.asarray(q / model.layout.q.scale)


@dataclass(frozen=True)
class GreatestMargin(RestCost):
    """Less the smallest distance of any unit from its limits, relative to the width between them.

    Limits are those of pressure, torque and stroke, and of curvature where the scene has one. At
    best it is 1/2, in the middle of all of them. Held units do not count.
    """

    name: ClassVar[str] = "greatest-margin"

    def terms(self, program: RestProgram) -> Terms:
        limits, scale = program.limits, program.model.layout.p.scale
        free = [j for j, width in enumerate(limits.range / scale) if width > 0]
        rows, low, high = limit_rows(program.model, program.q, program.p)
        values = ca.vertcat(program.p[free], rows)
        low = np.concatenate([limits.low[free], low])
        high = np.concatenate([limits.high[free], high])
        smallest = ca.SX.sym("smallest_margin")
        width = high - low
        margins = ca.vertcat((values - low) / width, (high - values) / width)
        count = margins.numel()
        return Terms(
            -smallest,
            Extra(smallest, np.full(1, -np.inf), np.full(1, 0.5)),
            Rows(margins - smallest, np.zeros(count), np.full(count, np.inf)),
        )


REST_COSTS: dict[str, Any] = {
    kind.name: kind for kind in (LeastPressure, LeastStrainEnergy, ClosestPosture, GreatestMargin)
}
