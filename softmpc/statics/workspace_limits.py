"""The largest and smallest of what an arm at rest has: extents of its tip, bends, lengths."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from softmpc.model.model import Model
from softmpc.statics.equilibrium import find_equilibrium
from softmpc.statics.program import Extra, RestSolver
from softmpc.statics.workspace_rays import Place, RaySearch, Search
from softmpc.statics.workspace_samples import Samples, Start

__all__ = ["EXTENTS", "QUANTITIES", "Extreme", "ExtremeSearch", "section_shape"]

EPSILON, KAPPA_X, KAPPA_Y = range(3)  # of STRAINS
EXTENTS = ("x", "y", "z")
QUANTITIES = ("bending_angle", "arc_length", "radius")
STRAIGHT = 1e-9  # of a bend of one over the length: the slope at a straight arm is that of zero
ROUNDED = 1e-3  # the same for IPOPT, which ends at no kink
SAME = 1e-6  # of a value: a sample must be better by more than that
LEAST_BEND = 1e-6  # rad; an arm that bends less is straight, its radius infinite


@dataclass(frozen=True, eq=False)
class Extreme:
    """The smallest or largest value of one quantity, SI and rad.

    `place.best` is false where a search went further, to what is not stable or not where forward
    statics ends: this is the best place that was confirmed then.
    """

    quantity: str  # x, y, z of the tip; bending_angle, arc_length, radius of a section
    section: int
    sense: str  # "smallest" or "largest"
    value: float
    place: Place | None


def section_shape(
    model: Model, q: Any, section: int, straight: float = STRAIGHT
) -> tuple[Any, Any]:
    """Arc length (m) and bending angle (rad) of a section at strains `q`, numbers or symbols.

    The angle adds up over the segments: θ of Eq. (2) where there is one. Its kink at a straight
    segment is rounded, `straight` over the length wide.
    """
    length, angle = ca.DM(0), ca.DM(0)
    for segment in (s for s in model.chain.segments if s.section_index == section - 1):
        own = {kind: q[place] for kind, place in segment.states.items()}
        way = segment.rest * (1 + own.get(EPSILON, 0))
        bend = sum(own[kind] ** 2 for kind in (KAPPA_X, KAPPA_Y) if kind in own)
        length = length + way
        angle = angle + way * ca.sqrt(bend + (straight / segment.rest) ** 2)
    return length, angle


class ExtremeSearch:
    """Searches for extremes of one model; `rays` gives the program and how to confirm."""

    def __init__(self, rays: RaySearch) -> None:
        self.rays = rays
        self._solvers: dict[tuple[str, int], RestSolver] = {}
        self._shapes: dict[tuple[int, float], ca.Function] = {}

    def find(
        self, quantity: str, section: int, sign: int, samples: Samples
    ) -> tuple[Place | None, float]:
        """The place of largest value (`sign` -1: smallest), and that value."""
        key = (quantity, section)
        if key not in self._solvers:
            self._solvers[key] = self._solver(*key)
        order = np.argsort(-sign * np.minimum(self.values(*key, samples.q, samples.tips), 1e9))
        search = Search(
            self._solvers[key],
            lambda found: -found.objective,
            lambda start: sign * self._scaled(*key, start),
        )
        starts = samples.starts([*order[:3], *order[3:30:9]])
        place = self.rays.best(search, np.array([float(sign)]), starts)
        sampled = starts[0]
        value, known = (self._value(*key, at) if at else np.nan for at in (place, sampled))
        if place is None or sign * (known - value) > SAME * max(abs(value), 1e-9):
            return self._sampled(sampled), known
        return place, value

    def _sampled(self, start: Start) -> Place:
        """A sample as a place: better than what could be confirmed of all searches."""
        rest = find_equilibrium(self.rays.model, start.pressures)
        return Place(
            rest.pressures, rest.q, np.asarray(start.tip), rest.smallest_stiffness, best=False
        )

    def values(self, quantity: str, section: int, q: np.ndarray, tips: np.ndarray) -> np.ndarray:
        """The quantity at postures, strains (K×n) and places (K×3)."""
        if quantity in EXTENTS:
            return np.asarray(tips[:, EXTENTS.index(quantity)])
        length, angle = self._shape(section, q)
        if quantity == "arc_length":
            return np.asarray(length)
        bent = angle > LEAST_BEND
        if quantity == "bending_angle":
            return np.where(bent, angle, 0.0)
        return np.where(bent, length / np.maximum(angle, LEAST_BEND), np.inf)

    def _shape(self, section: int, q: np.ndarray, straight: float = STRAIGHT) -> list[np.ndarray]:
        """Arc lengths and bending angles (K each) of a section at strains (K×n)."""
        key = (section, straight)
        if key not in self._shapes:
            model, given = self.rays.model, ca.SX.sym("q", self.rays.model.strains)
            shape = [ca.densify(v) for v in section_shape(model, given, *key)]
            self._shapes[key] = ca.Function("shape", [given], shape)
        return [np.asarray(v).ravel() for v in self._shapes[key](q.T)]

    def _value(self, quantity: str, section: int, at: Place | Start) -> float:
        q, tip = np.asarray(at.q, float)[None], np.asarray(at.tip, float)[None]
        return float(self.values(quantity, section, q, tip)[0])

    def _scaled(self, quantity: str, section: int, start: Start) -> float:
        """The value as the program has it."""
        if quantity in EXTENTS:
            return self._value(quantity, section, start) / self.rays.length
        q, rest = np.asarray(start.q, float)[None], self._rest(section)
        length, angle = (float(v[0]) for v in self._shape(section, q, ROUNDED))
        return {
            "bending_angle": angle, "arc_length": length / rest, "radius": -angle * rest / length
        }[quantity]  # fmt: skip

    def _rest(self, section: int) -> float:
        return self.rays.model.scene.manipulator.sections[section - 1].length

    def _solver(self, quantity: str, section: int) -> RestSolver:
        """Parameters: the sign, then the most."""
        rays, sign = self.rays, ca.SX.sym("sign")
        length, angle = section_shape(rays.model, rays.program.q, section, ROUNDED)
        rest = self._rest(section)
        value = {
            "bending_angle": angle,
            "arc_length": length / rest,
            "radius": -angle * rest / length,  # the least of one over it is the largest radius
            **dict(zip(EXTENTS, ca.vertsplit(rays.place), strict=True)),
        }[quantity]
        return rays.solver(sign * value, Extra(), ca.SX(0, 1), sign)
