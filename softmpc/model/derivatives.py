"""Derivatives of the virtual-power residual by recursion, not by differentiating its graph.

For every material point X and strain q_j the total time derivative and ∂/∂q_j commute:

    ∂Ẋ/∂q̇_j = ∂X/∂q_j,   ∂Ẍ/∂q̇_j = 2 d/dt(∂X/∂q_j),   ∂Ẍ/∂q_j = d²/dt²(∂X/∂q_j),

and beyond its own segment q_j moves the arm like a rigid body: ∂X/∂q_j = W_j × X + U_j. So the
columns (W, U) with two time derivatives, and sums over the bodies beyond each segment (mass, first
and second moments), give ∂r/∂q, ∂r/∂q̇ and ∂r/∂q̈ = M: each 4×4 block costs a few scalar products,
everything else is linear in the number of segments. Plain differentiation of the chain grows with
its square and a far larger factor (`python -m tests.benchmarks.instructions`).

Frames: "local" at a segment's base, "world" at the arm's base; world moments are about its origin.
A disc (rotary inertia) is treated as two director vectors d with second moment disc·(1 - t tᵀ).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import casadi as ca

from softmpc.model.chain import Chain, Link, Point, State, padded
from softmpc.model.effects import BodyLaw
from softmpc.model.jets import Jet
from softmpc.model.stumpff import slopes
from softmpc.model.virtual_power import body_wrench, resultants, strain_forces, to_strains

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


@dataclass
class Wrenches:
    """Force and moment columns (3×m each) for a set of bodies, and how to add them up."""

    force: SX
    moment: SX

    def __add__(self, other: Wrenches) -> Wrenches:
        return Wrenches(self.force + other.force, self.moment + other.moment)

    def to_world(self, rotation: SX, origin: SX) -> Wrenches:
        force = rotation @ self.force
        return Wrenches(force, rotation @ self.moment + ca.skew(origin) @ force)


@dataclass
class Columns:
    """What a segment's strains do, summed over all bodies they move; see `_own` and `_beyond`."""

    mass: Wrenches  # Σ m (P, X × P): the inertia forces of unit accelerations
    mass_rate: SX  # Σ m Ẋ × P
    drag: Wrenches  # Σ d (P, X × P), and spin drag
    by_dq: Wrenches  # forces of unit rates, inertial part halved (the C matrix)
    by_q: Wrenches  # forces of unit strains
    turned: SX  # Σ P × F: how the total force turns a column
    static: SX  # Σ P × (static forces) + Σ V × (dead moment)
    spin: SX  # Σ spin drag · V

    def __add__(self, other: Columns) -> Columns:
        names = self.__dataclass_fields__
        return Columns(*(getattr(self, n) + getattr(other, n) for n in names))


def _inertia(second_moment: SX) -> SX:
    """tr(K) 1 - K: the matrix of w -> Σ X × (w × Y) for K = Σ Y Xᵀ."""
    return ca.trace(second_moment) * ca.SX.eye(3) - second_moment


@dataclass
class Composite:
    """Sums over the bodies beyond a segment, in the world frame (m: mass, d: drag, g: weight)."""

    m: SX = 0.0
    h: list[SX] = field(default_factory=lambda: [ca.SX(3, 1)] * 3)  # Σ m (X, Ẋ, Ẍ)
    k: list[SX] = field(default_factory=lambda: [ca.SX(3, 3)] * 3)  # Σ m (X, Ẋ, Ẍ) Xᵀ, discs too
    d: SX = 0.0
    g: list[SX] = field(default_factory=lambda: [ca.SX(3, 1)] * 2)
    l: list[SX] = field(default_factory=lambda: [ca.SX(3, 3)] * 2)
    heavy: SX = 0.0
    heavy_at: SX = field(default_factory=lambda: ca.SX(3, 1))
    spin: SX = 0.0
    spin_of: SX = field(default_factory=lambda: ca.SX(3, 1))  # Σ spin drag · angular velocity
    force: SX = field(default_factory=lambda: ca.SX(3, 1))
    spread: SX = field(default_factory=lambda: ca.SX(3, 3))  # Σ X Fᵀ
    dead_force: SX = field(default_factory=lambda: ca.SX(3, 1))  # the tip load
    dead_moment: SX = field(default_factory=lambda: ca.SX(3, 1))
    dead_at: SX = field(default_factory=lambda: ca.SX(3, 1))


@dataclass
class Own:
    """Columns of one body of the segment itself (local), and its blocks in the segment's rows."""

    columns: Columns
    by_q: SX
    by_dq: SX  # inertial part halved
    inertial: SX  # that half alone
    by_ddq: SX


def _own(link: Link, point: Point, law: BodyLaw, kinds: list[int]) -> Own:
    spin, turning = link.motion.spin, _turning(link.motion.spin, link.motion.spin_rate)
    P, V = (_absolute(jet, spin, turning, kinds) for jet in point.columns)
    velocity, acceleration = link.motion.at(point.p)
    m, d, heavy = law.mass or 0.0, law.drag or 0.0, law.heavy or 0.0
    none = ca.SX(3, len(kinds))
    moments = [none, none, none, none]  # mass, mass_rate, by_dq, by_q
    spread = ca.SX(3, 3)
    if law.disc is not None:
        moments, spread = _disc(link, point, law.disc, V)
    spin_at, spin_drag = link.motion.turned(point.turn)[0], law.spin_drag or 0.0
    by_dq = moments[2] + spin_drag * V[0]
    by_q = moments[3] + spin_drag * (V[1] - ca.skew(spin_at) @ V[0])
    force, _ = body_wrench(link, point, law)
    at = ca.skew(point.p.terms[0])
    forces = (m * P[0], m * P[1] + d * P[0], m * P[2] + d * P[1])
    columns = Columns(
        mass=Wrenches(forces[0], at @ forces[0] + moments[0]),
        mass_rate=m * ca.skew(velocity) @ P[0] + moments[1],
        drag=Wrenches(d * P[0], at @ (d * P[0])),
        by_dq=Wrenches(forces[1], at @ forces[1] + by_dq),
        by_q=Wrenches(forces[2], at @ forces[2] + by_q),
        turned=-ca.skew(force) @ P[0] - _inertia(spread) @ V[0],
        static=heavy * ca.skew(link.gravity) @ P[0],
        spin=spin_drag * V[0],
    )
    return Own(
        columns,
        by_q=P[0].T @ forces[2] + V[0].T @ (by_q - _inertia(spread) @ V[0]),
        by_dq=P[0].T @ forces[1] + V[0].T @ by_dq,
        inertial=P[0].T @ (m * P[1]) + V[0].T @ moments[2],
        by_ddq=P[0].T @ forces[0] + V[0].T @ moments[0],
    )


def _turning(spin: SX, spin_rate: SX) -> SX:
    return ca.skew(spin_rate) + ca.skew(spin) @ ca.skew(spin)


def _absolute(terms: Jet, spin: SX, turning: SX, kinds: list[int]) -> list[SX]:
    """Columns that live in a turning frame, and their absolute time derivatives."""
    x, dx, ddx = (term[:, kinds] for term in padded(terms, (3, 4)))
    omega = ca.skew(spin)
    return [x, dx + omega @ x, ddx + 2 * omega @ dx + turning @ x]


def _disc_moments(link: Link, point: Point, disc: float) -> list[SX]:
    """Σ (d, ḋ, d̈) dᵀ over a disc's directors, local."""
    t = point.tangent
    across = disc * (ca.SX.eye(3) - t @ t.T)
    spin, spin_rate = link.motion.turned(point.turn)
    return [across, ca.skew(spin) @ across, _turning(spin, spin_rate) @ across]


def _disc(link: Link, point: Point, disc: float, V: list[SX]) -> tuple[list[SX], SX]:
    k = _disc_moments(link, point, disc)
    i0, b, c = (_inertia(x) for x in k)
    by_dq = i0 @ V[1] + b @ V[0]
    by_q = i0 @ V[2] + 2 * b @ V[1] + c @ V[0]
    return [i0 @ V[0], _inertia(k[1].T) @ V[0], by_dq, by_q], k[2].T


@dataclass
class Screw:
    """Motion of the arm beyond a segment for unit strains, with two time derivatives; world."""

    W: list[SX]
    U: list[SX]


def _screw(link: Link, frame: Frame, kinds: list[int]) -> Screw:
    motion, tip = link.motion, link.tip
    turning = _turning(motion.spin, motion.spin_rate)
    P, W = (_absolute(jet, motion.spin, turning, kinds) for jet in tip.columns)
    P, W = [frame.rotation @ x for x in P], [frame.rotation @ x for x in W]
    o, do, ddo = (ca.skew(x) for x in frame.points(link, tip))
    U = [P[0] + o @ W[0]]
    U.append(P[1] + o @ W[1] + do @ W[0])
    U.append(P[2] + o @ W[2] + 2 * do @ W[1] + ddo @ W[0])
    return Screw(W, U)


@dataclass
class Frame:
    """A segment's local frame in the world."""

    rotation: SX
    origin: SX

    def points(self, link: Link, point: Point) -> tuple[SX, SX, SX]:
        velocity, acceleration = link.motion.at(point.p)
        place = self.origin + self.rotation @ point.p.terms[0]
        return place, self.rotation @ velocity, self.rotation @ acceleration


def _beyond(s: Screw, beyond: Composite, gravity: SX) -> Columns:
    """Columns of all bodies beyond the segment, from the sums over them (world)."""
    (W, W1, W2), (U, U1, U2) = s.W, s.U
    h, h1, h2 = (ca.skew(x) for x in beyond.h)
    g, g1 = (ca.skew(x) for x in beyond.g)
    i0, b, c = (_inertia(k) for k in beyond.k)
    j0, j1 = (_inertia(k) for k in beyond.l)
    m, d = beyond.m, beyond.d
    mass = Wrenches(m * U - h @ W, i0 @ W + h @ U)
    drag = Wrenches(d * U - g @ W, j0 @ W + g @ U)
    rate = Wrenches(m * U1 - h @ W1 - h1 @ W, i0 @ W1 + b @ W + h @ U1)
    by_dq = rate + drag
    by_dq.moment += beyond.spin * W
    by_q = Wrenches(
        m * U2 - h @ W2 - 2 * h1 @ W1 - h2 @ W + d * U1 - g @ W1 - g1 @ W,
        i0 @ W2 + 2 * b @ W1 + c @ W + h @ U2 + j0 @ W1 + j1 @ W + g @ U1,
    )
    by_q.moment += beyond.spin * W1 - ca.skew(beyond.spin_of) @ W
    heavy = beyond.heavy * U - ca.skew(beyond.heavy_at) @ W
    tip = U - ca.skew(beyond.dead_at) @ W
    static = ca.skew(gravity) @ heavy + ca.skew(beyond.dead_force) @ tip
    return Columns(
        mass=mass,
        mass_rate=_inertia(beyond.k[1].T) @ W + h1 @ U,
        drag=drag,
        by_dq=by_dq,
        by_q=by_q,
        turned=-_inertia(beyond.spread) @ W - ca.skew(beyond.force) @ U,
        static=static + ca.skew(beyond.dead_moment) @ W,
        spin=beyond.spin * W,
    )


def _to_world(c: Columns, frame: Frame) -> Columns:
    r, o = frame.rotation, frame.origin
    return Columns(
        mass=c.mass.to_world(r, o),
        mass_rate=r @ c.mass_rate,
        drag=c.drag.to_world(r, o),
        by_dq=c.by_dq.to_world(r, o),
        by_q=c.by_q.to_world(r, o),
        turned=r @ c.turned,
        static=r @ c.static,
        spin=r @ c.spin,
    )


def _gather(beyond: Composite, link: Link, frame: Frame) -> None:
    """Add the segment's own bodies to the sums."""
    for point, (_, law) in zip(link.points, link.segment.bodies, strict=True):
        X = frame.points(link, point)
        force = frame.rotation @ body_wrench(link, point, law)[0]
        if law.mass is not None:
            beyond.m += law.mass
            beyond.h = [s + law.mass * x for s, x in zip(beyond.h, X, strict=True)]
            beyond.k = [s + law.mass * x @ X[0].T for s, x in zip(beyond.k, X, strict=True)]
        if law.drag is not None:
            beyond.d += law.drag
            beyond.g = [s + law.drag * x for s, x in zip(beyond.g, X[:2], strict=True)]
            beyond.l = [s + law.drag * x @ X[0].T for s, x in zip(beyond.l, X[:2], strict=True)]
        if law.heavy is not None:
            beyond.heavy += law.heavy
            beyond.heavy_at = beyond.heavy_at + law.heavy * X[0]
        beyond.force = beyond.force + force
        beyond.spread = beyond.spread + X[0] @ force.T
        if law.disc is not None:
            r = frame.rotation
            discs = [r @ k @ r.T for k in _disc_moments(link, point, law.disc)]
            beyond.k = [s + k for s, k in zip(beyond.k, discs, strict=True)]
            beyond.spread = beyond.spread + discs[2].T
        if law.spin_drag is not None:
            spin = frame.rotation @ link.motion.turned(point.turn)[0]
            beyond.spin += law.spin_drag
            beyond.spin_of = beyond.spin_of + law.spin_drag * spin


def _held(chain: Chain, link: Link, tip: tuple[SX, SX], pressures: SX | None) -> SX:
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
    tension, bend = resultants(chain, still, pressures)
    row = to_strains(still, on_l + tension, on_w + bend)
    block = ca.jacobian(row, q)
    for point, (moving, _, _) in zip(points, wrenches, strict=True):
        slope = ca.vertcat(*slopes(moving.values))
        along = ca.jtimes(row, ca.vertcat(*point.values), slope)
        block = block + along @ ca.jacobian(point.s.terms[0], q)
    return ca.substitute([block[:, link.segment.kinds]], symbols, values)[0]


def differentiate(
    chain: Chain, state: State, pressures: list[SX | None], by_q: bool = True
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
        held = _held(chain, link, (force, moment), own) if by_q else 0.0
        screw, columns = _segment(blocks, held, link, frame, beyond, links[0].gravity)
        here = [link.segment.states[k] for k in link.segment.kinds]
        for there, _, distal in outer:
            _couple(blocks, here, screw, columns, there, distal)
        outer.append((here, screw, columns))
        force, moment = _hand_back(link, force, moment)
        _gather(beyond, link, frame)
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
    screw = _screw(link, frame, kinds)
    columns = _beyond(screw, beyond, gravity)
    W = screw.W[0]
    lever = beyond.spread - frame.points(link, link.tip)[0] @ beyond.force.T
    by_q = held + _reach(screw, columns.by_q) - W.T @ _inertia(lever) @ W
    by_dq = _reach(screw, columns.by_dq)
    inertial = by_dq - _reach(screw, columns.drag) - W.T @ columns.spin
    by_ddq = _reach(screw, columns.mass)
    for point, (_, law) in zip(link.points, link.segment.bodies, strict=True):
        own = _own(link, point, law, kinds)
        columns = columns + _to_world(own.columns, frame)
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
    (W, W1, W2), (U, U1, U2) = screw.W, screw.U
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
