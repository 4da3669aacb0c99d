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
from functools import reduce
from operator import add
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

__all__ = [
    "BLOCKS",
    "Blocks",
    "can_differentiate",
    "differentiate",
    "force_stacks",
    "hand_back",
    "held_forces",
    "motion_stacks",
    "own_blocks",
    "stumpff_functions",
    "tip_load",
]

SX = Any  # CasADi's SX or DM; the arithmetic is the same
BLOCKS = ("by_q", "by_dq", "by_ddq", "coriolis")


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

    @classmethod
    def zero(cls, size: int) -> Blocks:
        return cls(*(ca.SX(size, size) for _ in BLOCKS))


def held_forces(
    chain: Chain, link: Link, tip: tuple[SX, SX], pressures: SX | None, elastic: bool
) -> SX:
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
        values += [ca.vertcat(*moving.values[:-2]), ca.densify(force)]
        values += [ca.SX.zeros(3) if moment is None else ca.densify(moment)]
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
    links = chain.forward(state, highest=stumpff_functions(state, by_q))
    blocks = Blocks.zero(chain.size)
    last, frames = links[-1], _frames(links)
    load_force, load_moment = (frames[-1].rotation @ x for x in (last.load_force, last.load_moment))
    beyond = tip_load(load_force, load_moment, frames[-1].points(last, last.tip)[0])
    outer: list[tuple[list[int], Columns]] = []
    force, moment = -last.load_force, -last.load_moment
    for link, frame in zip(reversed(links), reversed(frames), strict=True):
        if link is not last:
            force, moment = link.tip.rotation @ force, link.tip.rotation @ moment
        own = pressures[link.segment.section_index]
        held = held_forces(chain, link, (force, moment), own, elastic) if by_q else 0.0
        screw, columns = own_blocks(blocks, held, link, frame, beyond, links[0].gravity)
        here = [link.segment.states[k] for k in link.segment.kinds]
        for there, distal in outer:
            _couple(blocks, here, screw, there, distal)
        outer.append((here, columns))
        force, moment = hand_back(link, force, moment)
        gather(beyond, link, frame)
    return Blocks(*(ca.sparsify(getattr(blocks, n)) for n in BLOCKS))


def stumpff_functions(state: State, by_q: bool) -> int:
    """The highest Stumpff function that `differentiate` needs."""
    return max(3 + 2 * len(state.columns), 7 if by_q else 5)


def _frames(links: list[Link]) -> list[Frame]:
    frames = [Frame(ca.SX.eye(3), ca.SX(3, 1))]
    for link in links[:-1]:
        origin = frames[-1].origin + frames[-1].rotation @ link.tip.p.terms[0]
        frames.append(Frame(frames[-1].rotation @ link.tip.rotation, origin))
    return frames


def tip_load(force: SX, moment: SX, at: SX) -> Composite:
    """The sums beyond the last segment: a dead force and moment at the tip, world."""
    return Composite(
        force=-force, spread=-at @ force.T, dead_force=force, dead_moment=moment, dead_at=at
    )


def hand_back(link: Link, force: SX, moment: SX) -> tuple[SX, SX]:
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


def own_blocks(
    blocks: Blocks, held: SX, link: Link, frame: Frame, beyond: Composite, gravity: SX
) -> tuple[Screw, Columns]:
    """The segment's own blocks; returns its screw and columns for its couplings."""
    segment = link.segment
    here = [segment.states[k] for k in segment.kinds]
    screw = screw_of(link, frame, segment.kinds)
    columns = columns_beyond(screw, beyond, gravity)
    W = screw.W[0]
    lever = beyond.spread - frame.points(link, link.tip)[0] @ beyond.force.T
    by_q = held + _reach(screw, columns.by_q) - W.T @ turning_moment(lever) @ W
    by_dq = _reach(screw, columns.by_dq)
    inertial = by_dq - _reach(screw, columns.drag) - W.T @ columns.spin
    by_ddq = _reach(screw, columns.mass)
    bodies = []
    for point, (_, law) in zip(link.points, segment.bodies, strict=True):
        own = own_columns(link, point, law, segment.kinds)
        bodies.append(own.columns)
        by_q, by_dq = by_q + own.by_q, by_dq + own.by_dq
        inertial, by_ddq = inertial + own.inertial, by_ddq + own.by_ddq
    columns = columns + to_world(reduce(add, bodies), frame)
    if segment.viscosity is not None:
        by_dq = by_dq + ca.diag(ca.DM([segment.viscosity[k] for k in segment.kinds]))
    blocks.by_q[here, here] = by_q
    blocks.by_dq[here, here] = by_dq + inertial
    blocks.by_ddq[here, here] = by_ddq
    blocks.coriolis[here, here] = by_dq
    return screw, columns


# Blocks between a segment and one beyond it. Each is a product of a stack of the near one's motion
# and a stack of the far one's forces: `above` is the block [near, far], the transpose of `below`
# is [far, near]. `mass` is symmetric.
Stacks = tuple[SX, ...]


def motion_stacks(screw: Screw) -> dict[str, Stacks]:
    """What each product takes of the near segment (3×k each)."""
    (W, W1, W2), (U, U1, U2) = screw.W, screw.U
    rate = (W, U, W1, U1)
    near: dict[str, Stacks] = {
        "above by_q": (W, U),
        "above by_dq": (W, U),
        "above coriolis": (W, U),
    }
    near |= {"mass": (W, U), "below by_dq": rate, "below coriolis": rate}
    return near | {"below by_q": (W, W1, U1, W2, U2)}


def force_stacks(far: Columns) -> dict[str, Stacks]:
    """What each product takes of the far segment (3×k each)."""
    mass, half, drag = far.mass, far.by_dq, far.drag
    dragging = drag.moment + far.spin
    turned, rate = far.by_q.moment + far.turned, 2 * far.mass_rate + dragging
    stacks: dict[str, Stacks] = {"above by_q": (turned, far.by_q.force)}
    stacks["above by_dq"] = (2 * half.moment - dragging, 2 * half.force - drag.force)
    stacks["above coriolis"] = (half.moment, half.force)
    stacks["mass"] = (mass.moment, mass.force)
    stacks["below by_dq"] = (rate, drag.force, 2 * mass.moment, 2 * mass.force)
    stacks["below coriolis"] = (far.mass_rate + dragging, drag.force, mass.moment, mass.force)
    stacks["below by_q"] = (far.static, rate, drag.force, mass.moment, mass.force)
    return stacks


def _stacked(parts: Stacks) -> SX:
    return ca.vertcat(*parts)


def _couple(blocks: Blocks, here: list[int], screw: Screw, there: list[int], far: Columns) -> None:
    """Blocks between a segment (`here`) and one beyond it (`there`)."""
    near, forces = motion_stacks(screw), force_stacks(far)
    product = {n: _stacked(near[n]).T @ _stacked(forces[n]) for n in near}
    for name in ("by_q", "by_dq", "coriolis"):
        getattr(blocks, name)[here, there] = product[f"above {name}"]
        getattr(blocks, name)[there, here] = product[f"below {name}"].T
    blocks.by_ddq[here, there] = product["mass"]
    blocks.by_ddq[there, here] = product["mass"].T
