"""Derivatives of the virtual-power residual by recursion, not by differentiating its graph.

For every material point X and strain q_j the total time derivative and ∂/∂q_j commute:

    ∂Ẋ/∂q̇_j = ∂X/∂q_j,   ∂Ẍ/∂q̇_j = 2 d/dt(∂X/∂q_j),   ∂Ẍ/∂q_j = d²/dt²(∂X/∂q_j),

and beyond its own segment q_j moves the arm like a rigid body: ∂X/∂q_j = W_j × X + U_j. So the
columns (W, U) with two time derivatives, and sums over the bodies beyond each segment (mass, first
and second moments), give ∂r/∂q, ∂r/∂q̇ and ∂r/∂q̈ = M: each 4×4 block costs a few scalar products,
everything else is linear in the number of segments. Plain differentiation of the chain grows with
its square and a far larger factor (`python -m tests.benchmarks.instructions`).

The columns and sums themselves are in `softmpc.model.columns`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import casadi as ca

from softmpc.model.chain import Chain, Link, Point, State
from softmpc.model.columns import (
    Columns,
    Composite,
    Frame,
    Screw,
    Wrenches,
    columns_beyond,
    gather,
    own_columns,
    screw_of,
    to_world,
    turning_moment,
)
from softmpc.model.jets import Jet
from softmpc.model.stumpff import slopes
from softmpc.model.virtual_power import body_wrench, resultants, to_strains

__all__ = ["Blocks", "can_differentiate", "differentiate"]

SX = Any  # CasADi's SX or DM; the arithmetic is the same


def can_differentiate(chain: Chain) -> bool:
    """Whether the identities above hold for this scene: accelerations need all their terms."""
    return chain.coriolis or not chain.dynamic


@dataclass(frozen=True)
class Blocks:
    """Jacobians of the residual, and the Coriolis and damping matrix C."""

    by_q: ca.SX
    by_dq: ca.SX
    by_ddq: ca.SX
    coriolis: ca.SX


def _held(chain: Chain, link: Link, tip: tuple[SX, SX], pressures: SX | None, elastic: bool) -> SX:
    """∂/∂q of a segment's row with all forces held: geometry, elasticity and drive."""
    wrenches = [(link.tip, 1.0, tip)]
    for point, (place, law) in zip(link.points, link.segment.bodies, strict=True):
        wrenches.append((point, place, body_wrench(link, point, law)))
    q = ca.SX.sym("q", 4)
    symbols, values, on_l, on_w = [q], [link.tip.strains.terms[0]], 0.0, 0.0
    points: list[Point] = []
    for moving, place, (force, moment) in wrenches:
        c = ca.SX.sym("c", len(moving.values) - 2)  # Stumpff functions: their slopes are known
        points.append(Point(moving.arc, moving.length, Jet(q), 0, ca.vertsplit(c)))
        f, n = ca.SX.sym("f", 3), ca.SX.sym("n", 3)
        symbols += [c, f, n]
        values += [ca.vertcat(*moving.values[:-2]), force]
        values += [ca.SX.zeros(3) if moment is None else moment]
        share_l, share_w = points[-1].pull(f, None if moment is None else n)
        on_l, on_w = on_l + place * share_l, on_w + place * share_w
    still = replace(link, tip=points[0])
    tension, bend = resultants(chain, still, pressures, elastic)
    row = to_strains(still, on_l + tension, on_w + bend)
    block = ca.jacobian(row, q)
    for point, (moving, _, _) in zip(points, wrenches, strict=True):
        slope = ca.vertcat(*slopes(moving.values))
        along = ca.jtimes(row, ca.vertcat(*point.values), slope)
        block = block + along @ ca.jacobian(point.s.terms[0], q)
    return ca.substitute([block[:, link.segment.kinds]], symbols, values)[0]


def differentiate(
    chain: Chain,
    state: State,
    pressures: list[SX | None],
    by_q: bool = True,
    elastic: bool = True,
) -> Blocks:
    """Jacobians of `virtual_power.residual` for a scene that `can_differentiate`.

    Without `by_q` its block is meaningless, and the others are cheaper.
    """
    order = len(state.columns) - 1
    links = chain.forward(state, highest=max(5 + 2 * order, 7 if by_q else 5))
    blocks = Blocks(*(ca.SX(chain.size, chain.size) for _ in range(4)))
    frames = _frames(links)
    beyond = _tip_load(links[-1], frames[-1])
    outer: list[tuple[list[int], Screw, Columns]] = []
    force, moment = -links[-1].load_force, -links[-1].load_moment
    for link, frame in zip(reversed(links), reversed(frames), strict=True):
        if link is not links[-1]:
            force, moment = link.tip.rotation @ force, link.tip.rotation @ moment
        own = pressures[link.segment.section_index]
        held = _held(chain, link, (force, moment), own, elastic) if by_q else 0.0
        screw, columns = _segment(blocks, held, link, frame, beyond, links[0].gravity)
        here = [link.segment.states[k] for k in link.segment.kinds]
        for there, _, distal in outer:
            _couple(blocks, here, screw, columns, there, distal)
        outer.append((here, screw, columns))
        force, moment = _hand_back(link, force, moment)
        gather(beyond, link, frame)
    _add_viscosity(blocks, chain)
    return Blocks(*(ca.sparsify(getattr(blocks, n)) for n in Blocks.__dataclass_fields__))


def _frames(links: list[Link]) -> list[Frame]:
    frames = [Frame(ca.SX.eye(3), ca.SX(3, 1))]
    for link in links[:-1]:
        origin = frames[-1].origin + frames[-1].rotation @ link.tip.p.terms[0]
        frames.append(Frame(frames[-1].rotation @ link.tip.rotation, origin))
    return frames


def _tip_load(last: Link, frame: Frame) -> Composite:
    force, moment = frame.rotation @ last.load_force, frame.rotation @ last.load_moment
    at = frame.points(last, last.tip)[0]
    return Composite(
        force=-force, spread=-at @ force.T, dead_force=force, dead_moment=moment, dead_at=at
    )


def _hand_back(link: Link, force: SX, moment: SX) -> tuple[SX, SX]:
    """Wrench at the segment's base from that at its tip, as in the residual's pass back."""
    moment = moment + ca.cross(link.tip.p.terms[0], force)
    for point, (_, law) in zip(link.points, link.segment.bodies, strict=True):
        f, m = body_wrench(link, point, law)
        force, moment = force + f, moment + ca.cross(point.p.terms[0], f)
        moment = moment if m is None else moment + m
    return force, moment


def _reach(screw: Screw, wrenches: Wrenches) -> SX:
    """Virtual power of force columns on the screw's strains."""
    return screw.W[0].T @ wrenches.moment + screw.U[0].T @ wrenches.force


def _segment(
    blocks: Blocks, held: SX, link: Link, frame: Frame, beyond: Composite, gravity: SX
) -> tuple[Screw, Columns]:
    """The segment's own blocks; returns its screw and columns for the segments before it."""
    kinds, here = link.segment.kinds, [link.segment.states[k] for k in link.segment.kinds]
    screw = screw_of(link, frame, kinds)
    columns = columns_beyond(screw, beyond, gravity)
    W = screw.W[0]
    lever = beyond.spread - frame.points(link, link.tip)[0] @ beyond.force.T
    by_q = held + _reach(screw, columns.by_q) - W.T @ turning_moment(lever) @ W
    by_dq = _reach(screw, columns.by_dq)
    inertial = by_dq - _reach(screw, columns.drag) - W.T @ columns.spin
    by_ddq = _reach(screw, columns.mass)
    for point, (_, law) in zip(link.points, link.segment.bodies, strict=True):
        own = own_columns(link, point, law, kinds)
        columns = columns + to_world(own.columns, frame)
        by_q, by_dq = by_q + own.by_q, by_dq + own.by_dq
        inertial, by_ddq = inertial + own.inertial, by_ddq + own.by_ddq
    blocks.by_q[here, here] = by_q
    blocks.by_dq[here, here] = by_dq + inertial
    blocks.by_ddq[here, here] = by_ddq
    blocks.coriolis[here, here] = by_dq
    return screw, columns


def _couple(
    blocks: Blocks, here: list[int], screw: Screw, near: Columns, there: list[int], far: Columns
) -> None:
    """Blocks between a segment (`here`) and one beyond it (`there`)."""
    (W, W1, W2), (_, U1, U2) = screw.W, screw.U
    turned = Wrenches(far.by_q.force, far.by_q.moment + far.turned)
    blocks.by_q[here, there] = _reach(screw, turned)
    half = _reach(screw, far.by_dq)
    drag = _reach(screw, far.drag) + W.T @ far.spin
    blocks.coriolis[here, there] = half
    blocks.by_dq[here, there] = 2 * half - drag
    mass = _reach(screw, far.mass)
    blocks.by_ddq[here, there] = mass
    blocks.by_ddq[there, here] = mass.T
    rate = far.mass.moment.T @ W1 + far.mass_rate.T @ W + far.mass.force.T @ U1
    blocks.coriolis[there, here] = rate + drag.T
    blocks.by_dq[there, here] = 2 * rate + drag.T
    inertial = far.mass.moment.T @ W2 + 2 * far.mass_rate.T @ W1 + far.mass.force.T @ U2
    dragged = (far.drag.moment + far.spin).T @ W1 + far.drag.force.T @ U1
    blocks.by_q[there, here] = inertial + dragged + far.static.T @ W


def _add_viscosity(blocks: Blocks, chain: Chain) -> None:
    for segment in chain.segments:
        for kind, i in segment.states.items():
            if segment.viscosity is not None:
                blocks.by_dq[i, i] += segment.viscosity[kind]
                blocks.coriolis[i, i] += segment.viscosity[kind]
