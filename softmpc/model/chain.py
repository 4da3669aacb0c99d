"""The chain of segments and its motion, passed from the base to the tip.

Everything is expressed in the frame at the base of the segment it belongs to ("local"), relative
to the base of the arm, so the first segment costs least and nothing is rotated twice. Quantities
nobody asks for never enter a CasADi function, so they cost nothing.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, TypeVar

import casadi as ca

from softmpc.model.bodies import Bodies, BodyLaw, bodies_of
from softmpc.model.effect import Effect, Site
from softmpc.model.effects import Coriolis, Gravity, Inertia, TipLoad
from softmpc.model.jets import Jet, dot
from softmpc.model.kinematics import Arc
from softmpc.model.stumpff import slopes, stumpff, stumpff_jets

if TYPE_CHECKING:
    from softmpc.model.parameters import Section
    from softmpc.model.scene import Scene

__all__ = ["STRAINS", "Base", "Chain", "Link", "Point", "Segment", "State"]

STRAINS = ("epsilon", "kappa_x", "kappa_y", "kappa_z")
E = TypeVar("E", bound=Effect)


@dataclass(frozen=True)
class State:
    """Symbols of a motion: strains, rates and accelerations, one SX column each.

    Implements Eq. (1): q stacks (ε, kx, ky, kz) of segment 1, 2, … (those that are states).
    Source: paper section 2.1.
    """

    q: ca.SX
    dq: Any = None  # SX; None at rest
    ddq: Any = None  # SX; None where accelerations do not matter

    @property
    def columns(self) -> list[ca.SX]:
        """Those that are given."""
        return [x for x in (self.q, self.dq, self.ddq) if x is not None]


@dataclass(frozen=True)
class Segment:
    """What is constant about a segment: its section, rest length and place in the state."""

    index: int
    section_index: int
    section: Section
    rest: float  # rest length, m
    states: dict[int, int]  # strain 0…3 -> index in q
    bodies: Bodies
    viscosity: tuple[float, ...] | None

    def strains(self, column: ca.SX) -> ca.SX:
        """The four strains (or rates) of this segment; those that are no states are zero."""
        if len(self.states) == 4:
            return column[self.states[0] : self.states[3] + 1]  # one index is quicker than four
        return ca.vertcat(*(column[self.states[k]] if k in self.states else 0.0 for k in range(4)))

    @property
    def kinds(self) -> list[int]:
        """Which of the four strains are states, in order."""
        return sorted(self.states)


class Point:
    """A point of a segment: the tip of the arc that leads to it, as jets in the local frame.

    `strains` sets how many time derivatives there are. `highest` is the highest Stumpff function
    needed: 3 for places and 2 more for each time derivative, 5 for `pull`, 2 more than for places
    for `columns`. Whoever knows the functions already gives their `values`.
    """

    def __init__(
        self, arc: Arc, length: float, strains: Jet, highest: int, values: Any = None
    ) -> None:
        self.arc, self.length, self.strains = arc, length, strains
        self.l = (strains[0] + 1.0) * length
        self.w = strains[1:4] * self.l
        self.s = arc.argument(self.w)
        self.values = stumpff(self.s.terms[0], highest) if values is None else values
        self.c = stumpff_jets(self.values, self.s)
        self.p = arc.shape(self.w, self.c) * self.l

    @cached_property
    def columns(self) -> tuple[Jet, Jet]:
        """Derivatives of position and orientation with respect to the four strains (3×4 each)."""
        c, w, l, kappa = self.c, self.w, self.l, self.strains[1:4]
        shape = self.arc.shape(w, c)
        on_w = self.arc.shape_columns(w, c, slopes(c))
        turns = [self.arc.turn(w, ca.DM.eye(3)[:, j], c) for j in range(3)]
        stretch = shape + sum((on_w[j] * w[j] for j in (1, 2)), on_w[0] * w[0])
        twist = sum((turns[j] * kappa[j] for j in (1, 2)), turns[0] * kappa[0])
        area = l * l
        place = [stretch * self.length, *(column * area for column in on_w)]
        angle = [twist * self.length, *(column * l for column in turns)]
        return _side_by_side(place), _side_by_side(angle)

    @cached_property
    def turn(self) -> Jet:
        """Angular velocity and acceleration relative to the local frame (one order less)."""
        if len(self.w.terms) == 1:
            return Jet()
        return self.arc.turn(self.w, Jet(*self.w.terms[1:]), self.c)

    @cached_property
    def tangent(self) -> ca.SX:
        return self.arc.tangent(self.w.terms[0], [c.terms[0] for c in self.c])

    @cached_property
    def rotation(self) -> ca.SX:
        return self.arc.rotation(self.w.terms[0], [c.terms[0] for c in self.c])

    def pull(self, force: Any, moment: Any | None) -> tuple[Any, Any]:
        """Generalised forces on (l, w): the tip's Jacobian transposed, times a wrench."""
        w, l = self.w.terms[0], self.l.terms[0]
        c, d = self.values, slopes(self.values)
        on_l = dot(self.arc.shape(w, c), force)
        on_w = self.arc.pull_position(w, c, d, force) * l
        if moment is not None:
            on_w = on_w + self.arc.pull_rotation(w, c, moment)
        return on_l, on_w


def _side_by_side(columns: list[Any]) -> Jet:
    order = min(len(c.terms) for c in columns if isinstance(c, Jet))
    jets = [padded(c) if isinstance(c, Jet) else padded(Jet(c)) for c in columns]
    return Jet(*(ca.horzcat(*(jet[n] for jet in jets)) for n in range(order)))


def padded(jet: Jet, shape: tuple[int, int] = (3, 1), length: int = 3) -> tuple[Any, ...]:
    """The terms of a jet, with zeros for the derivatives it does not carry."""
    return (*jet.terms, *[ca.SX.zeros(*shape)] * length)[:length]


@dataclass(frozen=True)
class Motion:
    """Absolute motion of a frame, in local components (order 0 to 2 as needed)."""

    spin: ca.SX
    spin_rate: ca.SX
    velocity: ca.SX
    acceleration: ca.SX

    def at(self, p: Jet) -> tuple[ca.SX, ca.SX]:
        """Absolute velocity and acceleration of a point that moves by `p` in this frame."""
        x, dx, ddx = padded(p)
        swing = ca.cross(self.spin, x)
        velocity = self.velocity + swing + dx
        centrifugal = ca.cross(self.spin, swing + 2 * dx)
        return velocity, self.acceleration + ca.cross(self.spin_rate, x) + centrifugal + ddx

    def turned(self, turn: Jet) -> tuple[ca.SX, ca.SX]:
        """Absolute angular velocity and acceleration of a frame that turns by `turn` in this."""
        rate, acceleration = padded(turn, length=2)
        spin = self.spin + rate
        return spin, self.spin_rate + acceleration + ca.cross(self.spin, rate)


@dataclass(frozen=True)
class Base:
    """What passes from segment to segment, in the components of the one that gets it."""

    motion: Motion
    gravity: ca.SX
    load_force: ca.SX
    load_moment: ca.SX
    place: ca.SX  # of the local frame, in the base frame
    rotation: ca.SX  # takes local components to those of the base frame
    head: Any  # gravity times that place, m²/s²


@dataclass(frozen=True)
class Link(Base):
    """One segment in motion: its base, its bodies and its tip."""

    segment: Segment
    points: tuple[Point, ...]  # one a body
    tip: Point

    def onward(self) -> Base:
        """The base of the next segment: this one's tip."""
        tip = self.tip
        local, back = tip.p.terms[0], tip.rotation.T
        place, head = self.place + self.rotation @ local, self.head + ca.dot(self.gravity, local)
        velocity, acceleration = self.motion.at(tip.p)
        spin, spin_rate = self.motion.turned(tip.turn)
        motion = Motion(*(back @ x for x in (spin, spin_rate, velocity, acceleration)))
        gravity, rotation = back @ self.gravity, self.rotation @ tip.rotation
        force, moment = back @ self.load_force, back @ self.load_moment
        return Base(motion, gravity, force, moment, place, rotation, head)


class Chain:
    """The scene's segments, and the recursions over them."""

    def __init__(self, scene: Scene, effects: tuple[Effect, ...] | None = None) -> None:
        self.scene = scene
        self.effects = scene.effects if effects is None else effects
        self.segments = _segments(scene, self.effects)
        self.size = len(self.segments) * len(scene.strains)
        self.gravity = self._find(Gravity)
        self.load = self._find(TipLoad)
        self.dynamic = self._find(Inertia) is not None
        self.coriolis = self._find(Coriolis) is not None

    def _find(self, kind: type[E]) -> E | None:
        return next((e for e in self.effects if isinstance(e, kind)), None)

    def damping(self) -> Chain:
        """The same segments with drag and viscosity alone: no mass, no weight, no load."""
        others = (Gravity, Inertia, Coriolis, TipLoad)
        effects = tuple(e for e in self.effects if not isinstance(e, others))
        return self._with(effects, _drags)

    def linear(self) -> Chain:
        """The same segments without the forces that have no constant coefficient."""
        return self._with(self.effects, lambda law: replace(law, laws=()))

    def beyond(self) -> Chain | None:
        """The same segments with nothing but what `linear` leaves out; None where that is none."""
        if not any(law.laws for segment in self.segments for _, law in segment.bodies):
            return None
        effects = tuple(e for e in self.effects if not isinstance(e, TipLoad))
        chain = self._with(effects, lambda law: BodyLaw(laws=law.laws))
        chain.segments = [replace(segment, viscosity=None) for segment in chain.segments]
        return chain

    def conservative(self) -> Chain:
        """The same segments without the forces that take energy out."""
        chain = self._with(self.effects, _stores)
        chain.segments = [replace(segment, viscosity=None) for segment in chain.segments]
        return chain

    def _with(self, effects: tuple[Effect, ...], change: Callable[[BodyLaw], BodyLaw]) -> Chain:
        chain = Chain(self.scene, effects)
        chain.segments = [
            replace(segment, bodies=tuple((at, change(law)) for at, law in segment.bodies))
            for segment in self.segments
        ]
        return chain

    def forward(self, state: State, highest: int | None = None) -> list[Link]:
        """Motion of every segment; `highest` is for those who need more Stumpff functions."""
        base, links = self.base(), []
        for segment in self.segments:
            links.append(self.link(segment, state, base, highest))
            base = links[-1].onward()
        return links

    def base(self) -> Base:
        """What the first segment gets from the base of the arm."""
        zero = ca.SX.zeros(3)
        gravity = ca.SX(ca.DM(self.gravity.vector)) if self.gravity else zero
        force = ca.SX(ca.DM(self.load.force)) if self.load else zero
        moment = ca.SX(ca.DM(self.load.moment)) if self.load else zero
        motion = Motion(zero, zero, zero, zero)
        return Base(motion, gravity, force, moment, zero, ca.SX.eye(3), ca.SX(0))

    def link(self, segment: Segment, state: State, base: Base, highest: int | None = None) -> Link:
        """One segment in motion, on the base that the segments before it give it."""
        tip, points = self._points(segment, state, highest)
        return Link(**vars(base), segment=segment, points=points, tip=tip)

    def _points(
        self, segment: Segment, state: State, highest: int | None
    ) -> tuple[Point, tuple[Point, ...]]:
        """The tip of a segment, and the points where its bodies are."""
        tip = self.point(segment, state, 1.0, highest)
        return tip, tuple(
            tip if place == 1.0 else self.point(segment, state, place, highest)
            for place, _ in segment.bodies
        )

    def point(
        self, segment: Segment, state: State, place: float, highest: int | None = None
    ) -> Point:
        """The point at `place` (0 base, 1 tip) of a segment."""
        strains = Jet(*(segment.strains(x) for x in state.columns))
        highest = max(5, 1 + 2 * len(state.columns)) if highest is None else highest
        return Point(self.scene.kinematics, segment.rest * place, strains, highest)


def _drags(law: BodyLaw) -> BodyLaw:
    kept = tuple(force for force in law.laws if force.dissipates)
    return BodyLaw(drag=law.drag, spin_drag=law.spin_drag, laws=kept)


def _stores(law: BodyLaw) -> BodyLaw:
    kept = tuple(force for force in law.laws if not force.dissipates)
    return replace(law, drag=None, spin_drag=None, laws=kept)


def _segments(scene: Scene, effects: tuple[Effect, ...]) -> list[Segment]:
    kinds = [STRAINS.index(name) for name in scene.strains]
    quadrature = [
        (place, share / scene.segments) for place, share in scene.formulation.mass.quadrature()
    ]
    names = frozenset(effect.name for effect in effects)
    sections = scene.manipulator.sections
    count = len(sections) * scene.segments
    segments: list[Segment] = []
    for i in range(count):
        section = sections[i // scene.segments]
        site = Site(section, section.length / scene.segments, i == count - 1, names)
        states = {kind: i * len(kinds) + j for j, kind in enumerate(kinds)}
        bodies = bodies_of(effects, site, quadrature)
        viscosity = _viscosity(effects, section, site.rest)
        s = i // scene.segments
        segments.append(Segment(i, s, section, site.rest, states, bodies, viscosity))
    return segments


def _viscosity(
    effects: tuple[Effect, ...], section: Section, rest: float
) -> tuple[float, ...] | None:
    terms = [e.on_strains(section, rest) for e in effects]
    present = [t for t in terms if t is not None]
    return tuple(map(sum, zip(*present, strict=True))) if present else None
