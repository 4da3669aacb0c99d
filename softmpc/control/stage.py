"""The symbols of one interval of an optimal-control problem, which costs and limits speak of."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import casadi as ca

from softmpc.model.disturbance import Disturbance
from softmpc.model.model import Model, sparse_times

__all__ = ["DISTURBANCE", "Stage"]

DISTURBANCE = "disturbance"  # the reference by which a solve is told of it


@dataclass(frozen=True)
class Stage:
    """State x at the end of an interval, its input, the input before; SI.

    What changes from one solve to the next is `given` by name: the place where the tip should be
    at the end of the interval is `given("tip", 3)`.
    """

    model: Model
    x: ca.SX
    u: ca.SX
    u_before: ca.SX
    disturbance: Disturbance | None = None
    references: dict[str, ca.SX] = field(default_factory=dict)

    @classmethod
    def of(cls, model: Model, disturbance: Disturbance | None = None) -> Stage:
        layout = model.layout
        inputs = len(layout.u)
        return cls(
            model,
            ca.SX.sym("x", len(layout.x)),
            ca.SX.sym("u", inputs),
            ca.SX.sym("u_before", inputs),
            disturbance,
        )

    def given(self, name: str, size: int) -> ca.SX:
        """A reference of that name (SI); the same symbol whoever asks for it."""
        if name not in self.references:
            self.references[name] = ca.SX.sym(name, size)
        return self.references[name]

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
    def axis(self) -> ca.SX:
        """Direction in which the tip points (3), a unit vector in the base frame."""
        return self.model.frames(self.q)[1][:, -1]

    @cached_property
    def pressures(self) -> ca.SX:
        """Unit pressures at the end of the interval (Pa)."""
        return self.model.pressures(self.z, self.given_to_drive)

    @property
    def given_to_drive(self) -> ca.SX:
        """The input with its unknown offset."""
        if self.disturbance is None or not self.disturbance.G.any():
            return self.u
        d = self.given(DISTURBANCE, len(self.disturbance))
        return self.u + sparse_times(self.disturbance.G, d)
