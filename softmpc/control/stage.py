"""The symbols of one interval of an optimal-control problem, which costs and limits speak of."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import casadi as ca

from softmpc.model.model import Model

__all__ = ["Stage"]


@dataclass(frozen=True)
class Stage:
    """State x at the end of an interval, its input, the input before, the place to be; SI."""

    model: Model
    x: ca.SX
    u: ca.SX
    u_before: ca.SX
    target: ca.SX  # tip reference at the end of the interval (3, m)

    @classmethod
    def of(cls, model: Model) -> Stage:
        layout = model.layout
        inputs = len(layout.u)
        return cls(
            model,
            ca.SX.sym("x", len(layout.x)),
            ca.SX.sym("u", inputs),
            ca.SX.sym("u_before", inputs),
            ca.SX.sym("target", 3),
        )

    @property
    def q(self) -> ca.SX:
        return self.x[: self.model.strains]

    @property
    def dq(self) -> ca.SX:
        return self.x[self.model.strains : 2 * self.model.strains]

    @property
    def z(self) -> ca.SX:
        return self.x[2 * self.model.strains :]

    @cached_property
    def tip(self) -> ca.SX:
        """Place of the arm's tip (3, m)."""
        return self.model.tip(self.q)

    @cached_property
    def pressures(self) -> ca.SX:
        """Unit pressures at the end of the interval (Pa)."""
        return self.model.pressures(self.z, self.u)
