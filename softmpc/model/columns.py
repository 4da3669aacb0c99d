"""What a strain does to all bodies it moves: columns of velocities and forces, and sums of bodies.

The parts of `softmpc.model.derivatives`, whose docstring says why they suffice. Frames: "local" at
a segment's base, "world" at the arm's base; world moments are about its origin. A disc (rotary
inertia) is treated as two director vectors d with second moment disc·(1 - t tᵀ).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import casadi as ca

from softmpc.model.bodies import BodyLaw
from softmpc.model.chain import Link, Point, padded
from softmpc.model.jets import Jet
from softmpc.model.virtual_power import body_wrench

__all__ = [
    "Columns",
    "Composite",
    "Frame",
    "Own",
    "Screw",
    "Wrenches",
    "columns_beyond",
    "gather",
    "own_columns",
    "screw_of",
    "to_world",
    "turning_moment",
]

SX = Any  # CasADi's SX or DM; the arithmetic is the same


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
    """What a segment's strains do, summed over its own bodies or over all bodies beyond it."""

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


def turning_moment(second_moment: SX) -> SX:
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


def own_columns(link: Link, point: Point, law: BodyLaw, kinds: list[int]) -> Own:
    spin, turning = link.motion.spin, _turning(link.motion.spin, link.motion.spin_rate)
    P, V = (_absolute(jet, spin, turning, kinds) for jet in point.columns)
    velocity, _ = link.motion.at(point.p)
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
        turned=-ca.skew(force) @ P[0] - turning_moment(spread) @ V[0],
        static=heavy * ca.skew(link.gravity) @ P[0],
        spin=spin_drag * V[0],
    )
    return Own(
        columns,
        by_q=P[0].T @ forces[2] + V[0].T @ (by_q - turning_moment(spread) @ V[0]),
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


def disc_moments(link: Link, point: Point, disc: float) -> list[SX]:
    """Σ (d, ḋ, d̈) dᵀ over a disc's directors, local."""
    t = point.tangent
    across = disc * (ca.SX.eye(3) - t @ t.T)
    spin, spin_rate = link.motion.turned(point.turn)
    return [across, ca.skew(spin) @ across, _turning(spin, spin_rate) @ across]


def _disc(link: Link, point: Point, disc: float, V: list[SX]) -> tuple[list[SX], SX]:
    k = disc_moments(link, point, disc)
    i0, b, c = (turning_moment(x) for x in k)
    by_dq = i0 @ V[1] + b @ V[0]
    by_q = i0 @ V[2] + 2 * b @ V[1] + c @ V[0]
    return [i0 @ V[0], turning_moment(k[1].T) @ V[0], by_dq, by_q], k[2].T


@dataclass
class Screw:
    """Motion of the arm beyond a segment for unit strains, with two time derivatives; world."""

    W: list[SX]
    U: list[SX]


def screw_of(link: Link, frame: Frame, kinds: list[int]) -> Screw:
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


def columns_beyond(s: Screw, beyond: Composite, gravity: SX) -> Columns:
    """Columns of all bodies beyond the segment, from the sums over them (world)."""
    (W, W1, W2), (U, U1, U2) = s.W, s.U
    h, h1, h2 = (ca.skew(x) for x in beyond.h)
    g, g1 = (ca.skew(x) for x in beyond.g)
    i0, b, c = (turning_moment(k) for k in beyond.k)
    j0, j1 = (turning_moment(k) for k in beyond.l)
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
        mass_rate=turning_moment(beyond.k[1].T) @ W + h1 @ U,
        drag=drag,
        by_dq=by_dq,
        by_q=by_q,
        turned=-turning_moment(beyond.spread) @ W - ca.skew(beyond.force) @ U,
        static=static + ca.skew(beyond.dead_moment) @ W,
        spin=beyond.spin * W,
    )


def to_world(c: Columns, frame: Frame) -> Columns:
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


def gather(beyond: Composite, link: Link, frame: Frame) -> None:
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
            discs = [r @ k @ r.T for k in disc_moments(link, point, law.disc)]
            beyond.k = [s + k for s, k in zip(beyond.k, discs, strict=True)]
            beyond.spread = beyond.spread + discs[2].T
        if law.spin_drag is not None:
            spin = frame.rotation @ link.motion.turned(point.turn)[0]
            beyond.spin += law.spin_drag
            beyond.spin_of = beyond.spin_of + law.spin_drag * spin
