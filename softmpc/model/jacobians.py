"""The virtual-power residual of a chain, its Jacobians, and M and C, whatever effects it has.

Forces with constant coefficients are differentiated by the recursion of `derivatives`, the others
(`Chain.beyond`) by CasADi, which costs more the more segments there are. Where these need the
accelerations, CasADi differentiates everything: their graph then has most of the chain's in it, and
the recursion beside it would only add (`python -m tests.benchmarks.instructions`).
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import casadi as ca

from softmpc.model import virtual_power
from softmpc.model.chain import Chain, State
from softmpc.model.derivatives import can_differentiate, differentiate
from softmpc.model.force_laws import Body, DampingLaw

__all__ = ["Jacobians", "residual_of"]

SX = Any


def residual_of(chain: Chain, state: State, pressures: list[SX], elastic: bool = True) -> SX:
    """r(q, dq, ddq, P) of a chain, with the accelerations that its scene has."""
    if state.ddq is None or can_differentiate(chain):
        links = chain.forward(state)
        return virtual_power.residual(chain, links, state, pressures, elastic)
    # Without Coriolis terms: accelerations as in a start from rest, drag at the rates.
    links = chain.forward(_start(state), highest=7)
    drags = chain.damping().forward(State(state.q, state.dq), highest=7)
    return virtual_power.residual(chain, links, state, pressures, elastic, drags=drags)


def _start(state: State) -> State:
    """The state with accelerations but no rates."""
    return State(state.q, ca.SX.zeros(state.q.shape[0]), state.ddq)


class Jacobians:
    """Derivatives of `residual_of` for one chain, state and pressures."""

    def __init__(self, chain: Chain, state: State, pressures: list[SX]) -> None:
        self.chain, self.state, self.pressures = chain, state, pressures
        self.none = [None] * len(pressures)
        self.linear, self.beyond = chain.linear(), chain.beyond()

    @cached_property
    def _damping(self) -> Chain:
        return self.linear.damping()

    @cached_property
    def _accelerated(self) -> bool:
        """Whether forces beyond the constant coefficients depend on accelerations."""
        if self.beyond is None:
            return False
        r = residual_of(self.beyond, _start(self.state), self.none, elastic=False)
        return bool(ca.depends_on(r, self.state.ddq))

    def by_motion(self) -> list[SX]:
        """∂r/∂q, ∂r/∂dq and ∂r/∂ddq (n×n each)."""
        s = self.state
        if self._accelerated:
            r = residual_of(self.chain, s, self.pressures)
            return [_jacobian(r, x) for x in (s.q, s.dq, s.ddq)]
        if can_differentiate(self.linear):
            b = differentiate(self.linear, s, self.pressures)
            blocks = [b.by_q, b.by_dq, b.by_ddq]
        else:
            b = differentiate(self.linear, _start(s), self.pressures)
            d = differentiate(self._damping, State(s.q, s.dq), self.none, elastic=False)
            blocks = [b.by_q + d.by_q, d.by_dq, b.by_ddq]
        if self.beyond is None:
            return blocks
        r = residual_of(self.beyond, s, self.none, elastic=False)
        return [b + _jacobian(r, x) for b, x in zip(blocks, (s.q, s.dq, s.ddq), strict=True)]

    def stiffness(self) -> SX:
        """∂r/∂q at rest (n×n)."""
        rest = State(self.state.q)
        K = differentiate(self.linear, rest, self.pressures).by_q
        if self.beyond is None:
            return K
        return K + _jacobian(residual_of(self.beyond, rest, self.none, elastic=False), rest.q)

    def inertia(self, rest: State) -> SX:
        """M (n×n); with `rest` of the order of derivatives to share them with."""
        if not self._accelerated:
            return differentiate(self.linear, rest, self.pressures, by_q=False).by_ddq
        stored = self.chain.conservative()
        r = residual_of(stored, _start(self.state), self.none, elastic=False)
        return _jacobian(r, self.state.ddq)

    def rates(self) -> SX:
        """C (n×n): C dq are the forces of the rates, and Ṁ - 2C is skew but for damping.

        Inertial forces are quadratic in dq, so half their Jacobian is the matrix of Christoffel
        symbols; damping laws contribute Σ Pᵀ D P with P = ∂v/∂dq.
        """
        s = self.state
        recursive = can_differentiate(self.linear) and not self._accelerated
        chain = self.linear if recursive else self._damping
        C = differentiate(chain, State(s.q, s.dq), self.pressures, by_q=False).coriolis
        if self.beyond is None:
            return C
        if self._accelerated and self.linear.coriolis:
            steady = State(s.q, s.dq, ca.SX.zeros(s.q.shape[0]))
            stored = residual_of(self.chain.conservative(), steady, self.none, elastic=False)
            C = C + _jacobian(stored, s.dq) / 2
        return C + _damping_matrix(self.beyond, State(s.q, s.dq))


def _jacobian(r: SX, x: SX) -> SX:
    return ca.sparsify(ca.jacobian(r, x))


def _damping_matrix(chain: Chain, state: State) -> SX:
    total = ca.SX(chain.size, chain.size)
    for link in chain.forward(state):
        for point, (_, on_body) in zip(link.points, link.segment.bodies, strict=True):
            body = Body(link, point)
            laws = [law for law in on_body.laws if isinstance(law, DampingLaw)]
            if laws:
                P = _jacobian(body.velocity, state.dq)
                total = total + P.T @ sum((law.matrix(body) for law in laws), ca.SX(3, 3)) @ P
    return total
