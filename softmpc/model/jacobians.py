"""The virtual-power residual of a chain, its Jacobians, and M and C, whatever effects it has.

Forces with constant coefficients are differentiated by the recursion of `derivatives`, the others
(`Chain.beyond`) by CasADi, which costs more the more segments there are. Where these need the
accelerations, CasADi differentiates everything: their graph then has most of the chain's in it, and
the recursion beside it would only add (`python -m tests.benchmarks.instructions`).

The recursion is written out for short chains, and called segment by segment for long ones
(`looped`): then the symbols are MX.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from softmpc.model import virtual_power
from softmpc.model.chain import Chain, State
from softmpc.model.derivatives import can_differentiate, differentiate
from softmpc.model.force_laws import Body, DampingLaw
from softmpc.model.looped import differentiate_in_loops

__all__ = ["MOST_WRITTEN_OUT", "Jacobians", "residual_of", "split_pressures"]

SX = Any  # CasADi's SX, or MX where the chain is long
# Segments in all: from some five on the Jacobian written out is too large to compile, and takes
# longer to build than small functions (`python -m tests.benchmarks.looping`).
MOST_WRITTEN_OUT = 4


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
    return State(state.q, type(state.q).zeros(state.q.shape[0]), state.ddq)


class Jacobians:
    """Derivatives of `residual_of` for one chain, by `symbols`: those given, or MX if `looped`.

    Looped by default are chains with more segments than `MOST_WRITTEN_OUT`.
    """

    def __init__(
        self, chain: Chain, state: State, p: SX, most_written_out: int | None = None
    ) -> None:
        self.chain, self.linear = chain, chain.linear()
        self.beyond: Any = chain.beyond()
        self.none: list[SX] = [None] * len(chain.scene.manipulator.sections)
        self._accelerated = self._needs_accelerations()
        most = MOST_WRITTEN_OUT if most_written_out is None else most_written_out
        self.looped = len(chain.segments) > most and not self._accelerated
        self.state, self.p = state, p
        if self.looped:
            symbols: list[SX] = [ca.MX.sym(x, chain.size) for x in ("q", "dq", "ddq")]
            self.state = State(*symbols)
            self.p = ca.MX.sym("p", *p.shape)

    @property
    def symbols(self) -> dict[str, SX]:
        return vars(self.state) | {"p": self.p}

    def _needs_accelerations(self) -> bool:
        """Whether forces beyond the constant coefficients depend on accelerations."""
        if self.beyond is None:
            return False
        q, ddq = (ca.SX.sym(name, self.chain.size) for name in ("q", "ddq"))
        return bool(ca.depends_on(self._other_forces(_start(State(q, None, ddq))), ddq))

    @cached_property
    def _damping(self) -> Chain:
        return self.linear.damping()

    def _blocks(self, chain: Chain, state: State, wanted: tuple[str, ...], held: bool) -> list[SX]:
        """Jacobians by recursion; without `held`, of inertia and damping alone."""
        pressures = split_pressures(chain, self.p) if held else self.none
        if self.looped:
            return differentiate_in_loops(chain, state, pressures, wanted, elastic=held)
        blocks = differentiate(chain, state, pressures, by_q="by_q" in wanted, elastic=held)
        return [getattr(blocks, name) for name in wanted]

    def _other_forces(self, state: State) -> SX:
        """The part of the residual that has no constant coefficients."""
        return residual_of(self.beyond, state, self.none, elastic=False)

    def _on_symbols(self, expressions: Callable[[State], list[SX]], state: State) -> list[SX]:
        """Expressions of a state; a function of their own where the state is MX."""
        if not self.looped:
            return expressions(state)
        symbols = State(*(ca.SX.sym("x", x.shape[0]) for x in state.columns))
        function = ca.Function("beyond", symbols.columns, expressions(symbols), {"cse": True})
        return list(function.call(state.columns))

    def by_motion(self) -> list[SX]:
        """∂r/∂q, ∂r/∂dq and ∂r/∂ddq (n×n each)."""
        s = self.state
        if self._accelerated:
            r = residual_of(self.chain, s, split_pressures(self.chain, self.p))
            return [_jacobian(r, x) for x in (s.q, s.dq, s.ddq)]
        if can_differentiate(self.linear):
            blocks = self._blocks(self.linear, s, ("by_q", "by_dq", "by_ddq"), held=True)
        else:
            by_q, by_ddq = self._blocks(self.linear, _start(s), ("by_q", "by_ddq"), held=True)
            rates = State(s.q, s.dq)
            drag = self._blocks(self._damping, rates, ("by_q", "by_dq"), held=False)
            blocks = [by_q + drag[0], drag[1], by_ddq]
        if self.beyond is None:
            return blocks
        others = self._on_symbols(lambda s: _jacobians(self._other_forces(s), s), s)
        return [b + other for b, other in zip(blocks, others, strict=True)]

    def stiffness(self) -> SX:
        """∂r/∂q at rest (n×n)."""
        rest = State(self.state.q)
        (K,) = self._blocks(self.linear, rest, ("by_q",), held=True)
        if self.beyond is None:
            return K
        return K + self._on_symbols(lambda s: _jacobians(self._other_forces(s), s), rest)[0]

    def inertia(self, rest: State) -> SX:
        """M (n×n); with `rest` of the order of derivatives to share them with."""
        if not self._accelerated:
            return self._blocks(self.linear, rest, ("by_ddq",), held=False)[0]
        stored = self.chain.conservative()
        r = residual_of(stored, _start(self.state), self.none, elastic=False)
        return _jacobian(r, self.state.ddq)

    def rates(self) -> SX:
        """C (n×n): C dq are the forces of the rates, and Ṁ - 2C is skew but for damping.

        Inertial forces are quadratic in dq, so half their Jacobian is the matrix of Christoffel
        symbols; damping laws contribute Σ Pᵀ D P with P = ∂v/∂dq.
        """
        s = State(self.state.q, self.state.dq)
        recursive = can_differentiate(self.linear) and not self._accelerated
        chain = self.linear if recursive else self._damping
        (C,) = self._blocks(chain, s, ("coriolis",), held=False)
        if self.beyond is None:
            return C
        if self._accelerated and self.linear.coriolis:
            steady = State(s.q, s.dq, ca.SX.zeros(s.q.shape[0]))
            stored = residual_of(self.chain.conservative(), steady, self.none, elastic=False)
            C = C + _jacobian(stored, s.dq) / 2
        return C + self._on_symbols(lambda s: [_damping_matrix(self.beyond, s)], s)[0]

    def by_pressures(self) -> SX:
        """∂r/∂p (n×m): pressures act on their own section alone, whatever the motion."""
        q, p = (ca.SX.sym(name, x.shape[0]) for name, x in (("q", self.state.q), ("p", self.p)))
        slope = ca.jacobian(_driving(self.chain, State(q), split_pressures(self.chain, p)), p)
        return ca.Function("by_p", [q, p], [slope], {"cse": True})(self.state.q, self.p)


def split_pressures(chain: Chain, p: SX) -> list[SX]:
    """The unit pressures of each section."""
    counts = [section.units for section in chain.scene.manipulator.sections]
    return list(ca.vertsplit(p, [0, *np.cumsum(counts).tolist()]))


def _driving(chain: Chain, state: State, pressures: list[SX]) -> SX:
    """What the drive does on the strains (n): the part of the residual that has pressures."""
    rows, base = [], chain.base()
    for segment in chain.segments:
        link = chain.link(segment, state, base)
        own = pressures[segment.section_index]
        tension, moment = virtual_power.resultants(chain, link, own, elastic=False)
        rows.append(virtual_power.to_strains(link, tension, moment))
    return ca.vertcat(*rows)


def _jacobians(r: SX, state: State) -> list[SX]:
    return [_jacobian(r, x) for x in state.columns]


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
