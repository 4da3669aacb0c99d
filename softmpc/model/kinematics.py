"""The arc of a segment: where its tip is, how it turns, and how both move.

A segment of rest length λ with strains (ε, k) has the length l = λ(1 + ε) and the rotation vector
w = l k. Any point along it is the tip of a shorter segment with the same strains, so each arc is
described by its tip alone. All functions take CasADi expressions or jets, and the Stumpff
functions `c` of `argument(w)` (`c[k]` up to k = 3, for `pull_position` up to k = 5).

    p = l · shape(w),   ω = turn(w, dw/dt)   (exact, in the frame at the segment's base)
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar

import casadi as ca

from softmpc.model.jets import cross, dot, stack

__all__ = ["Arc", "ConstantStrainArc", "PaperArc"]


class Arc(ABC):
    """One segment's geometry: a slot of the scene."""

    name: ClassVar[str]

    @abstractmethod
    def argument(self, w: Any) -> Any:
        """The argument s of the Stumpff functions."""

    @abstractmethod
    def shape(self, w: Any, c: list[Any]) -> Any:
        """Tip position over length, p/l (3)."""

    @abstractmethod
    def shape_columns(self, w: Any, c: list[Any], slopes: list[Any]) -> list[Any]:
        """∂(p/l)/∂w_j, j = x, y, z; `slopes` are dc_k/ds."""

    @abstractmethod
    def pull_position(self, w: Any, c: list[Any], slopes: list[Any], f: Any) -> Any:
        """(∂(p/l)/∂w)ᵀ f: what a force `f` at the tip does on w, without forming columns."""

    @abstractmethod
    def turn(self, w: Any, dw: Any, c: list[Any]) -> Any:
        """Angular velocity of the tip frame for the rate `dw` of w."""

    @abstractmethod
    def pull_rotation(self, w: Any, c: list[Any], moment: Any) -> Any:
        """The transpose of `turn`: what a moment at the tip does on w."""

    @abstractmethod
    def rotation(self, w: ca.SX, c: list[ca.SX]) -> ca.SX:
        """Tip frame seen from the base frame of the segment (3×3)."""

    @abstractmethod
    def tangent(self, w: Any, c: list[Any]) -> Any:
        """Third column of `rotation`."""


@dataclass(frozen=True)
class ConstantStrainArc(Arc):
    """Bending and twist at once: a helix, R = exp(skew(w)), with s = |w|².

    V = c_1 + c_2 skew(w) + c_3 w wᵀ is the left Jacobian of SO(3): p = l V e_z and ω = V dw/dt.
    """

    name: ClassVar[str] = "constant-strain"

    def argument(self, w: Any) -> Any:
        return dot(w, w)

    def shape(self, w: Any, c: list[Any]) -> Any:
        wx, wy, wz = w[0], w[1], w[2]
        twist = c[3] * wz
        return stack(c[2] * wy + twist * wx, twist * wy - c[2] * wx, c[1] + twist * wz)

    def shape_columns(self, w: Any, c: list[Any], slopes: list[Any]) -> list[Any]:
        radial = self.shape(w, slopes) * 2
        wx, wy, wz = w[0], w[1], w[2]
        twist = c[3] * wz
        return [
            radial * wx + stack(twist, -c[2], 0.0),
            radial * wy + stack(c[2], twist, 0.0),
            radial * wz + stack(c[3] * wx, c[3] * wy, c[3] * wz * 2),
        ]

    def pull_position(self, w: Any, c: list[Any], slopes: list[Any], f: Any) -> Any:
        wx, wy, wz = w[0], w[1], w[2]
        wf = dot(w, f)
        radial = slopes[1] * f[2] + slopes[2] * (wy * f[0] - wx * f[1]) + slopes[3] * (wz * wf)
        twist = c[3] * wz
        return w * (radial * 2) + stack(
            twist * f[0] - c[2] * f[1], twist * f[1] + c[2] * f[0], twist * f[2] + c[3] * wf
        )

    def turn(self, w: Any, dw: Any, c: list[Any]) -> Any:
        return c[1] * dw + c[2] * cross(w, dw) + w * (c[3] * dot(w, dw))

    def pull_rotation(self, w: Any, c: list[Any], moment: Any) -> Any:
        return moment * c[1] - cross(w, moment) * c[2] + w * (c[3] * dot(w, moment))

    def rotation(self, w: ca.SX, c: list[ca.SX]) -> ca.SX:
        return c[0] * ca.SX.eye(3) + ca.skew(c[1] * w) + (c[2] * w) @ w.T

    def tangent(self, w: Any, c: list[Any]) -> Any:
        wx, wy, wz = w[0], w[1], w[2]
        lean = c[2] * wz
        return stack(c[1] * wy + lean * wx, lean * wy - c[1] * wx, c[0] + lean * wz)


@dataclass(frozen=True)
class PaperArc(Arc):
    """The paper's arc: bends in a plane first, twists its tip after.

    Implements Eqs. (3), (4): R = Rz(φ) Ry(θ) Rz(τ - φ) and p = (l/θ) [cφ(1-cθ), sφ(1-cθ), sθ].
    Here without φ and θ, which are singular on the straight arm: with b = [w_x, w_y, 0] and
    s = |b|² = θ² it is R = exp(skew(b)) Rz(w_z) and p = l (c_1 e_z + c_2 b × e_z).
    Source: paper section 2.1, where (4) abbreviates the sines and cosines.
    """

    name: ClassVar[str] = "paper-arc"

    def argument(self, w: Any) -> Any:
        return w[0] * w[0] + w[1] * w[1]

    def shape(self, w: Any, c: list[Any]) -> Any:
        return stack(c[2] * w[1], -(c[2] * w[0]), c[1])

    def shape_columns(self, w: Any, c: list[Any], slopes: list[Any]) -> list[Any]:
        radial = self.shape(w, slopes) * 2
        return [
            radial * w[0] + stack(0.0, -c[2], 0.0),
            radial * w[1] + stack(c[2], 0.0, 0.0),
            stack(0.0, 0.0, 0.0),
        ]

    def pull_position(self, w: Any, c: list[Any], slopes: list[Any], f: Any) -> Any:
        radial = (slopes[1] * f[2] + slopes[2] * (w[1] * f[0] - w[0] * f[1])) * 2
        return stack(radial * w[0] - c[2] * f[1], radial * w[1] + c[2] * f[0], 0.0)

    def turn(self, w: Any, dw: Any, c: list[Any]) -> Any:
        b, db = stack(w[0], w[1], 0.0), stack(dw[0], dw[1], 0.0)
        bend = c[1] * db + c[2] * cross(b, db) + b * (c[3] * dot(b, db))
        return bend + self.tangent(w, c) * dw[2]

    def pull_rotation(self, w: Any, c: list[Any], moment: Any) -> Any:
        b = stack(w[0], w[1], 0.0)
        bend = moment * c[1] - cross(b, moment) * c[2] + b * (c[3] * dot(b, moment))
        return stack(bend[0], bend[1], dot(self.tangent(w, c), moment))

    def rotation(self, w: ca.SX, c: list[ca.SX]) -> ca.SX:
        b = ca.vertcat(w[0], w[1], 0.0)
        bend = c[0] * ca.SX.eye(3) + ca.skew(c[1] * b) + (c[2] * b) @ b.T
        cos, sin = ca.cos(w[2]), ca.sin(w[2])
        twist = ca.vertcat(ca.horzcat(cos, -sin, 0), ca.horzcat(sin, cos, 0), ca.DM([[0, 0, 1]]))
        return bend @ twist

    def tangent(self, w: Any, c: list[Any]) -> Any:
        return stack(c[1] * w[1], -(c[1] * w[0]), c[0])
