"""What the printed angular velocity costs where it is passed on: for study only.

(5), (6) take the rate of the rotation vector for the angular velocity, ω = ẇ. That is exact only
while the axis of rotation stands still. The paper differentiates positions for its velocities, so
there ω = ẇ is in nothing but rotary inertia and angular damping. Here segments turn those after
them with it: virtual power then lets forces do work on motions that the arm cannot make, and rests
out of plane are wrong at first order. No scene file offers this, because nobody should use it; the
study has it to show why.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import casadi as ca

from softmpc.model.chain import Chain
from softmpc.model.kinematics import ConstantStrainArc
from softmpc.model.model import Model
from softmpc.model.scene import Scene

__all__ = ["PrintedRates", "with_printed_rates"]


@dataclass(frozen=True)
class PrintedRates(ConstantStrainArc):
    """The constant-strain arc with the angular velocity of Eqs. (5), (6), ω = dw/dt.

    `turn` and its transpose are the identity. Everything else is exact.
    """

    name: ClassVar[str] = "printed rates"

    def turn(self, w: Any, dw: Any, c: list[Any]) -> Any:
        return dw

    def pull_rotation(self, w: Any, c: list[Any], moment: Any) -> Any:
        return moment


def with_printed_rates(scene: Scene) -> Model:
    """The model of a scene with `PrintedRates` for its arc; for rests, small motions and costs."""
    own = scene.with_(kinematics=PrintedRates())
    drive = own.actuation.matrices(own.manipulator, own.effects)
    return _Differentiated(own, Chain(own), drive)


class _Differentiated(Model):
    """Derivatives by CasADi: those of the recursion rest on an exact ω."""

    @cached_property
    def residual_jacobian(self) -> ca.Function:
        """(q, dq, ddq, p) -> ∂r/∂q, ∂r/∂dq, ∂r/∂ddq (n×n) and ∂r/∂p (n×m)."""
        symbols, r = self._symbols, self._residual_at(self._state)
        blocks = {f"by_{name}": ca.jacobian(r, x) for name, x in symbols.items()}
        return self._function("residual_jacobian", symbols, blocks)

    @cached_property
    def stiffness(self) -> ca.Function:
        """(q, p) -> ∂(N - τ)/∂q (n×n), and ∂(N - τ)/∂p (n×m)."""
        symbols, r = {"q": self._state.q, "p": self._p}, self._residual_at(self._rest)
        blocks = dict(
            zip(("K", "by_p"), (ca.jacobian(r, x) for x in symbols.values()), strict=True)
        )
        return self._function("stiffness", symbols, blocks)

    @cached_property
    def M(self) -> ca.Function:
        """∂r/∂ddq at rest (n×n), not symmetric out of plane."""
        r = self._residual_at(self._state)
        M = ca.substitute(ca.jacobian(r, self._state.ddq), self._state.dq, 0 * self._state.dq)
        return self._function("M", {"q": self._state.q}, {"M": M})
