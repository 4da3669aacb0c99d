"""The equations of motion by virtual power: one pass out for motion, one pass back for forces.

Each body's force and moment do virtual power on the exact velocities of the arc, so M and ∂N/∂q
come out symmetric and energy is kept. A segment's rows are the generalised forces on its strains.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from softmpc.model.bodies import BodyLaw
from softmpc.model.chain import Chain, Link, Point, State
from softmpc.model.drive import driving_force, driving_moment
from softmpc.model.force_laws import Body

__all__ = [
    "body_wrench",
    "inertia_forces",
    "residual",
    "resultants",
    "strain_forces",
    "to_strains",
]

Wrench = tuple[Any, Any | None]


def body_wrench(link: Link, point: Point, law: BodyLaw) -> Wrench:
    """Force and moment that a body needs (inertia, drag) less what it gets (weight), local."""
    wrench = _constant_wrench(link, point, law)
    for other in law.laws:
        wrench = _sum(wrench, other.wrench(Body(link, point)))
    return wrench


def _constant_wrench(link: Link, point: Point, law: BodyLaw) -> Wrench:
    """The part of it that has constant coefficients."""
    velocity, acceleration = link.motion.at(point.p)
    force: Any = ca.SX.zeros(3)
    if law.mass is not None and law.mass == law.heavy:
        force = law.mass * (acceleration - link.gravity)
    else:
        if law.mass is not None:
            force = law.mass * acceleration
        if law.heavy is not None:
            force = force - law.heavy * link.gravity
    if law.drag is not None:
        force = force + law.drag * velocity
    return force, _body_moment(link, point, law) if law.turns else None


def _body_moment(link: Link, point: Point, law: BodyLaw) -> Any:
    spin, spin_rate = link.motion.turned(point.turn)
    moment: Any = ca.SX.zeros(3)
    if law.disc is not None:
        t = point.tangent
        # A thin disc: I = disc (1 + t tᵀ), and t only turns, so d(Iω)/dt has three terms.
        gyroscopic = ca.cross(spin, t) * ca.dot(t, spin)
        moment = law.disc * (spin_rate + gyroscopic + t * ca.dot(t, spin_rate))
    if law.spin_drag is not None:
        moment = moment + law.spin_drag * spin
    return moment


def inertia_forces(links: list[Link], drags: list[Link] | None = None) -> list[tuple[Any, Any]]:
    """Generalised forces of bodies and tip load on (l, w) of each segment, by recursion.

    `drags` are the same segments with other effects in another motion, to be added.
    """
    force, moment = -links[-1].load_force, -links[-1].load_moment  # in the last local frame
    results = []
    for i, link in reversed(list(enumerate(links))):
        tip = link.tip
        if link is not links[-1]:
            force, moment = tip.rotation @ force, tip.rotation @ moment
        on_l, on_w = tip.pull(force, moment)
        moment = moment + ca.cross(tip.p.terms[0], force)
        for k, point in enumerate(link.points):
            f, m = _wrench(link, k)
            if drags is not None:
                f, m = _sum((f, m), _wrench(drags[i], k))
            share_l, share_w = point.pull(f, m)
            place = point.length / link.segment.rest
            on_l, on_w = on_l + place * share_l, on_w + place * share_w
            force = force + f
            moment = moment + ca.cross(point.p.terms[0], f)
            moment = moment if m is None else moment + m
        results.append((on_l, on_w))
    return results[::-1]


def _wrench(link: Link, body: int) -> Wrench:
    return body_wrench(link, link.points[body], link.segment.bodies[body][1])


def _sum(a: Wrench, b: Wrench) -> Wrench:
    moments = [m for m in (a[1], b[1]) if m is not None]
    return a[0] + b[0], sum(moments[1:], moments[0]) if moments else None


def resultants(
    chain: Chain, link: Link, pressures: ca.SX | None, elastic: bool = True
) -> tuple[Any, Any]:
    """Tension and moment in a segment, elastic less driven: they do work on l and w = l k."""
    segment, section = link.segment, link.segment.section
    strains = link.tip.strains.terms[0]
    law = chain.scene.formulation.elasticity
    tension, moment = 0.0, ca.SX(3, 1)
    if elastic:
        tension = law.tension(section, segment.rest, strains[0], strains[1:4])
        moment = law.moment(section, strains[1:4])
    if pressures is not None:
        tension = tension - driving_force(section, pressures)
        moment = moment - driving_moment(section, pressures)
    return tension, moment


def to_strains(link: Link, on_l: Any, on_w: Any) -> ca.SX:
    """Generalised forces on (ε, k) from those on (l, w = l k)."""
    strains = link.tip.strains.terms[0]
    rest = link.segment.rest
    rows = ca.vertcat(rest * (on_l + ca.dot(strains[1:4], on_w)), rest * (1 + strains[0]) * on_w)
    return rows[link.segment.kinds]


def strain_forces(chain: Chain, link: Link, state: State) -> ca.SX | None:
    """Viscous forces on the strains that are states."""
    viscosity = link.segment.viscosity
    if viscosity is None or state.dq is None:
        return None
    rates = link.segment.strains(state.dq)
    return ca.vertcat(*(viscosity[k] * rates[k] for k in link.segment.kinds))


def _stretch_force(link: Link) -> Any | None:
    """What laws of the bodies do on ε beside their wrenches, where it is a state."""
    if 0 not in link.segment.states:
        return None
    found = [
        law.on_stretch(Body(link, point))
        for point, (_, on_body) in zip(link.points, link.segment.bodies, strict=True)
        for law in on_body.laws
    ]
    present = [force for force in found if force is not None]
    return sum(present[1:], present[0]) if present else None


def residual(
    chain: Chain,
    links: list[Link],
    state: State,
    pressures: list[ca.SX | None],
    elastic: bool = True,
    drags: list[Link] | None = None,
) -> ca.SX:
    """r(q, dq, ddq, P) = M ddq + C dq + N - τ, over all segments; zero along a motion."""
    rows = []
    for link, (on_l, on_w) in zip(links, inertia_forces(links, drags), strict=True):
        own = pressures[link.segment.section_index]
        tension, moment = resultants(chain, link, own, elastic)
        row = to_strains(link, on_l + tension, on_w + moment)
        viscous, stretching = strain_forces(chain, link, state), _stretch_force(link)
        if stretching is not None:
            row[0] += stretching  # ε comes first
        rows.append(row if viscous is None else row + viscous)
    return ca.vertcat(*rows)
