"""Energies and powers of a model, term by term: what an energy audit adds up."""

from __future__ import annotations

from typing import Any

import casadi as ca

from softmpc.model.bodies import BodyLaw
from softmpc.model.chain import Chain, Link, State
from softmpc.model.drive import chamber_volumes
from softmpc.model.force_laws import Body
from softmpc.model.places import Poses

__all__ = ["energies", "powers"]


def energies(chain: Chain, poses: Poses) -> dict[str, Any]:
    """Energies in J; terms the scene does not have are left out."""
    terms: dict[str, Any] = {}
    for place, rotation, link in poses[:-1]:
        for point, (_, law) in zip(link.points, link.segment.bodies, strict=True):
            where = place + rotation @ point.p.terms[0]
            _add(terms, "kinetic", _kinetic(link, point, law))
            if law.heavy is not None and chain.gravity is not None:
                _add(terms, "gravity", -law.heavy * ca.dot(ca.DM(chain.gravity.vector), where))
            for other in law.laws:
                for name, energy in other.energies(Body(link, point)).items():
                    _add(terms, name, energy)
        _add(terms, "elastic", _elastic(chain, link))
    if chain.load is not None and not any(chain.load.moment):
        # A dead moment has no potential: the work it does depends on the way.
        terms["load"] = -ca.dot(ca.DM(chain.load.force), poses[-1][0])
    return terms


def _add(terms: dict[str, Any], name: str, value: Any | None) -> None:
    if value is not None:
        terms[name] = terms[name] + value if name in terms else value


def _kinetic(link: Link, point: Any, law: BodyLaw) -> Any | None:
    if law.mass is None:
        return None
    velocity, _ = link.motion.at(point.p)
    energy = 0.5 * law.mass * ca.sumsqr(velocity)
    if law.disc is not None:
        spin, _ = link.motion.turned(point.turn)
        energy += 0.5 * law.disc * (ca.sumsqr(spin) + ca.dot(point.tangent, spin) ** 2)
    return energy


def _elastic(chain: Chain, link: Link) -> Any | None:
    strains = link.tip.strains.terms[0]
    law = chain.scene.formulation.elasticity
    return law.energy(link.segment.section, link.segment.rest, strains[0], strains[1:4])


def powers(chain: Chain, poses: Poses, state: State, pressures: list[Any]) -> dict[str, Any]:
    """Power put into the arm in W: drive positive where it does work, damping never positive."""
    terms: dict[str, Any] = {}
    for _, _, link in poses[:-1]:
        segment = link.segment
        strains, rates = (segment.strains(x) for x in (state.q, state.dq))
        volumes = ca.vertcat(
            *chamber_volumes(segment.section, segment.rest, strains[0], strains[1:4])
        )
        flows = ca.jtimes(volumes, state.q, state.dq)
        _add(terms, "drive", ca.dot(pressures[segment.section_index], flows))
        if segment.viscosity is not None:
            lost = sum(c * rates[k] ** 2 for k, c in enumerate(segment.viscosity))
            _add(terms, "material_damping", -lost)
        for point, (_, law) in zip(link.points, segment.bodies, strict=True):
            _add(terms, "environment_damping", _drag(link, point, law))
            for other in law.laws:
                for name, power in other.powers(Body(link, point)).items():
                    _add(terms, name, power)
    if chain.load is not None and any(chain.load.moment):
        link = poses[-2][2]
        spin, _ = link.motion.turned(link.tip.turn)
        velocity, _ = link.motion.at(link.tip.p)
        terms["load"] = ca.dot(link.load_force, velocity) + ca.dot(link.load_moment, spin)
    return terms


def _drag(link: Link, point: Any, law: BodyLaw) -> Any | None:
    if law.drag is None and law.spin_drag is None:
        return None
    velocity, _ = link.motion.at(point.p)
    spin, _ = link.motion.turned(point.turn)
    return -(law.drag or 0.0) * ca.sumsqr(velocity) - (law.spin_drag or 0.0) * ca.sumsqr(spin)
