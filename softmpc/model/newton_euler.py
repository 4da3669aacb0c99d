"""The paper's own formulation: force and moment balance of each segment, as printed.

Four rows a segment: axial force and three moments about o_{i-1}, in frame i-1. The page's slips
are read as docs/equations.md says. As printed, the next segment hands back its axial force and its
moment only, so that model does not converge with more segments: it is here to be compared with.
`FullNewtonEuler` hands back the whole wrench and converges, at first order.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

from softmpc.model.bodies import BodyLaw
from softmpc.model.chain import Chain, Link, State
from softmpc.model.drive import driving_force, driving_moment
from softmpc.model.formulations import FullNewtonEuler

__all__ = ["Balance", "equations"]

SX = Any
ROWS = slice(2, 6)  # of a wrench: axial force and the three moments


@dataclass(frozen=True)
class Balance:
    """The four terms of (26), all segments stacked."""

    M: SX
    C: SX
    N: SX
    tau: SX


@dataclass(frozen=True)
class Kinematics:
    """One segment, seen from its base frame: place, Jacobians and their rates."""

    place: SX  # ^{i-1}X_i
    rotation: SX  # ^{i-1}R_i
    travel: SX  # ^{i-1}v_i = travel dq
    travel_rate: SX
    turn: SX  # ^{i-1}ω_i = turn dq, the printed one
    turn_rate: SX


def equations(chain: Chain, state: State, pressures: list[SX | None]) -> Balance:
    """M, C, N and τ as printed.

    Implements Eq. (26): M(q) q̈ + C(q, q̇) q̇ + N(q) = τ(p). Source: paper section 2.2.6.
    """
    links = chain.forward(state)
    motions = _kinematics(chain, links, state)
    if isinstance(chain.scene.formulation, FullNewtonEuler):
        return _transmitted(chain, links, motions, state, pressures)
    M, C, N, tau = [], [], [], []
    for i, (link, motion) in enumerate(zip(links, motions, strict=True)):
        law = link.segment.bodies[0][1]
        following = links[i + 1] if i + 1 < len(links) else None
        M.append(_mass(motion, law)[ROWS, :])
        C.append(_with_viscosity(link, _rates(chain, motion, law, state)[ROWS, :]))
        N.append(_position(chain, link, motion, law, following))
        tau.append(_inputs(link, motion, following, pressures))
    return Balance(*(ca.sparsify(ca.vertcat(*rows)) for rows in (M, C, N, tau)))


def _kinematics(chain: Chain, links: list[Link], state: State) -> list[Kinematics]:
    """Motion of each mass point relative to the base, in the segment's frame.

    Implements Eqs. (7), (8), (9), (10), (11), (12): X_i = g H_i γ is the tip of segment i; its
    velocity is J q̇ with J = ∂X/∂q and its acceleration J q̈ + J̇ q̇, relative to the base and turned
    into frame i-1 (read literally, H_i depends on q_i alone). Source: paper section 2.1.
    """
    place, rotation = ca.SX(3, 1), ca.SX.eye(3)
    turn: SX = ca.SX(3, chain.size)
    motions = []
    for link in links:
        local, turned = link.tip.p.terms[0], link.tip.rotation
        turn = turn + rotation @ _printed_turn(link, state.q)
        place = place + rotation @ local
        travel = ca.jacobian(place, state.q)
        rates = (_along(travel, state), _along(turn, state))
        back = rotation.T
        motions.append(
            Kinematics(local, turned, back @ travel, back @ rates[0], back @ turn, back @ rates[1])
        )
        rotation = rotation @ turned
    return motions


def _along(matrix: SX, state: State) -> SX:
    """Time derivative of a matrix that depends on q."""
    return ca.reshape(ca.jtimes(ca.vec(matrix), state.q, state.dq), matrix.shape)


def _printed_turn(link: Link, q: SX) -> SX:
    """∂θ_ζ/∂q, the columns a segment adds to the angular velocity.

    Implements Eqs. (5), (6), (29): θ_ζ is the rotation vector w = l k, the printed angular
    velocity its rate, and U = Σ_ζ R_{ζ-1} ∂θ_ζ/∂q. Exact only while the axis of rotation stands
    still, so it is used here and nowhere else. Source: paper sections 2.1 and 2.2.6.
    """
    return ca.jacobian(link.tip.w.terms[0], q)


def _disc_tensor(motion: Kinematics, law: BodyLaw) -> SX | None:
    if law.disc is None:
        return None
    return motion.rotation @ ca.diag(law.disc * ca.DM([1, 1, 2])) @ motion.rotation.T


def _wrench(force: SX, moment: SX, place: SX) -> SX:
    """Force and moment about o_{i-1} (6 rows) of a force at the tip of a segment and a moment.

    Implements Eq. (13): the moment has X × force; `ROWS` takes the axial force and the moments,
    since shear is ignored. Source: paper section 2.2.
    """
    return ca.vertcat(force, ca.skew(place) @ force + moment)


def _mass(motion: Kinematics, law: BodyLaw) -> SX:
    """Implements Eq. (27): wrenches of unit accelerations. Source: paper section 2.2.6."""
    mass = law.mass or 0.0
    inertia = _disc_tensor(motion, law)
    moment = ca.SX(*motion.turn.shape) if inertia is None else inertia @ motion.turn
    return _wrench(mass * motion.travel, moment, motion.place)


def _rates(chain: Chain, motion: Kinematics, law: BodyLaw, state: State) -> SX:
    """Wrenches of C(q, q̇): inertia that is quadratic in the rates, and damping.

    Implements Eqs. (14), (28): m dv/dt, I dω/dt + ω × I ω with ω = U q̇, d_v v and d_ω ω.
    Source: paper sections 2.2.1 and 2.2.6.
    """
    force: SX = ca.SX(*motion.travel.shape)
    moment: SX = ca.SX(*motion.travel.shape)
    inertia = _disc_tensor(motion, law)
    if chain.coriolis and law.mass is not None:
        force = force + law.mass * motion.travel_rate
    if chain.coriolis and inertia is not None:
        spin = ca.skew(motion.turn @ state.dq)
        moment = moment + inertia @ motion.turn_rate + spin @ inertia @ motion.turn
    if law.drag is not None:
        force = force + law.drag * motion.travel
    if law.spin_drag is not None:
        moment = moment + law.spin_drag * motion.turn
    return _wrench(force, moment, motion.place)


def _with_viscosity(link: Link, rows: SX) -> SX:
    """Rows of C with the viscous tension and moments of the segment itself."""
    if link.segment.viscosity is not None:
        for kind, i in link.segment.states.items():
            rows[kind, i] += link.segment.viscosity[kind] / link.segment.rest
    return rows


def _elastic(chain: Chain, link: Link) -> tuple[SX, SX]:
    strains = link.tip.strains.terms[0]
    law, section = chain.scene.formulation.elasticity, link.segment.section
    tension = law.tension(section, link.segment.rest, strains[0], strains[1:4])
    return ca.vertcat(0, 0, tension), law.moment(section, strains[1:4])


def _driving(link: Link, pressures: list[SX | None]) -> tuple[SX, SX]:
    section, own = link.segment.section, pressures[link.segment.section_index]
    return ca.vertcat(0, 0, driving_force(section, own)), driving_moment(section, own)


def _rows(resultants: tuple[SX, SX]) -> SX:
    """The four rows of a segment's own tension and moment."""
    force, moment = resultants
    return ca.vertcat(force[2], moment)


def _handed_back(motion: Kinematics, force: SX, moment: SX) -> SX:
    """What the next segment's axial force and moment do on this one.

    Implements Eq. (22), elastic or driving part: only its axial force and its moment are
    transmitted, shear is dropped. Source: paper section 2.2.4.
    """
    return _wrench(motion.rotation @ force, motion.rotation @ moment, motion.place)[ROWS]


def _position(
    chain: Chain, link: Link, motion: Kinematics, law: BodyLaw, following: Link | None
) -> SX:
    """Rows of N(q): elastic forces less weight and less what the next segment hands back.

    Implements Eqs. (25), (30); the weight's moment is X × G. Source: paper section 2.2.6.
    """
    rows = _rows(_elastic(chain, link)) - _weight(link, motion, law)[ROWS]
    if following is not None:
        rows = rows - _handed_back(motion, *_elastic(chain, following))
    return rows


def _weight(link: Link, motion: Kinematics, law: BodyLaw) -> SX:
    if law.heavy is None:
        return ca.SX(6, 1)
    return _wrench(law.heavy * link.gravity, ca.SX(3, 1), motion.place)


def _inputs(
    link: Link, motion: Kinematics, following: Link | None, pressures: list[SX | None]
) -> SX:
    """Rows of τ: drive, less the drive the next segment hands back, and the load at the tip.

    Implements Eq. (31); the load acts once, on the last segment. Source: paper section 2.2.6.
    """
    rows = _rows(_driving(link, pressures))
    if following is not None:
        return rows - _handed_back(motion, *_driving(following, pressures))
    return rows + _wrench(link.load_force, link.load_moment, motion.place)[ROWS]


def _transmitted(
    chain: Chain,
    links: list[Link],
    motions: list[Kinematics],
    state: State,
    pressures: list[SX | None],
) -> Balance:
    """M, C, N and τ with the whole wrench handed from segment to segment (not in the paper).

    A cut through the base of a segment carries inertia, damping, weight and load of all that is
    beyond it; the segment's own elasticity, less its own drive, balances the part it can.
    """
    M, C, N, tau = [], [], [], []
    beyond: list[SX] = []
    for link, motion in zip(reversed(links), reversed(motions), strict=True):
        law = link.segment.bodies[0][1]
        carried = [_mass(motion, law), _rates(chain, motion, law, state)]
        carried += [-_weight(link, motion, law)]
        if beyond:
            back = _transfer(motion)
            load = back @ beyond.pop()
            carried = [own + back @ far for own, far in zip(carried, beyond, strict=True)]
        else:
            load = _wrench(link.load_force, link.load_moment, motion.place)
        beyond = [*carried, load]
        M.append(carried[0][ROWS, :])
        C.append(_with_viscosity(link, carried[1][ROWS, :]))
        N.append(_rows(_elastic(chain, link)) + carried[2][ROWS])
        tau.append(_rows(_driving(link, pressures)) + load[ROWS])
    return Balance(*(ca.sparsify(ca.vertcat(*rows[::-1])) for rows in (M, C, N, tau)))


def _transfer(motion: Kinematics) -> SX:
    """Takes a wrench about o_i in frame i to o_{i-1} in frame i-1 (6×6)."""
    r = motion.rotation
    upper = ca.horzcat(r, ca.SX(3, 3))
    return ca.vertcat(upper, ca.horzcat(ca.skew(motion.place) @ r, r))
