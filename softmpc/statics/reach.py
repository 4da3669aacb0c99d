"""Reach of the tip by IPOPT: the posture that holds it at a place, and how far it is from the edge.

One program serves both: strains and pressures in equilibrium, the tip on a ray from `origin`,
either at its start with the least pressure, or as far along it as the pressures allow. At its
start the tip may miss the place at a price, so a place out of reach gives the nearest posture.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Any

import casadi as ca
import numpy as np

from softmpc.errors import InputError
from softmpc.model.model import Model
from softmpc.statics.equilibrium import Equilibrium, find_equilibrium, refine_equilibrium

__all__ = ["Clearance", "Reach", "pressure_range"]

FAR = 10.0  # arm lengths, a bound on the ray
PRICE = 1e8  # of missing the place by an arm length, against full pressure
HIT = 1e-6  # m, nearer counts as there
STARTS = 60  # postures to start from, made once
TRIES = 8  # of them, the nearest, before a place counts as out of reach


def pressure_range(model: Model) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest pressure of each unit at rest (Pa), torque limits included."""
    limits, m = model.scene.manipulator.limits, model.scene.manipulator.units
    low, high = np.full(m, limits.pressure_min), np.full(m, limits.pressure_max)
    if model.scene.actuation.input == "torque":
        gain = np.diag(model.drive.static_gain)
        ends = np.sort(np.outer([limits.torque_min, limits.torque_max], gain), axis=0)
        low, high = np.maximum(low, ends[0]), np.minimum(high, ends[1])
    return low, high


@dataclass(frozen=True)
class Clearance:
    """Smallest distance from places to the edge of the workspace along some directions."""

    distance: float  # m
    place: np.ndarray  # where (3)
    direction: np.ndarray  # towards the edge (3)
    directions: int  # how many were searched from each place


class Reach:
    """Postures and limits of the tip of one model."""

    def __init__(self, model: Model) -> None:
        self.model = model
        self.low, self.high = pressure_range(model)
        self._solver = self._make()
        self._last: np.ndarray | None = None

    def _make(self) -> ca.Function:
        model = self.model
        n, m, layout = model.strains, len(self.low), model.layout
        length = model.scene.manipulator.length
        w = ca.MX.sym("w", n + m + 4)  # strains, pressures, way along the ray, miss
        q, p = w[:n] * layout.q.scale, w[n : n + m] * layout.p.scale
        along, miss = w[n + m], w[n + m + 1 :]
        parameters = ca.MX.sym("parameters", 7)  # origin, direction, 1: along the ray
        place = parameters[:3] + along * length * parameters[3:6]
        balance = model.balance(q, p) / layout.r.scale
        off = (model.tip(q) - place) / length - miss
        effort = 0.5 * ca.sumsqr(w[n : n + m]) / m + 0.5 * PRICE * ca.sumsqr(miss)
        objective = (1 - parameters[6]) * effort - parameters[6] * along
        problem: Any = {"x": w, "p": parameters, "f": objective, "g": ca.vertcat(balance, off)}
        quiet: dict[str, Any] = {"print_level": 0, "sb": "yes", "tol": 1e-9, "max_iter": 200}
        return ca.nlpsol(
            "reach", "ipopt", problem, {"print_time": False, "error_on_fail": False, "ipopt": quiet}
        )

    def posture(self, place: np.ndarray) -> Equilibrium | None:
        """The posture of least pressure with the tip at `place` (3, m); None if out of reach."""
        found, distance = self.nearest(place)
        return found if distance <= HIT else None

    def nearest(self, place: np.ndarray) -> tuple[Equilibrium | None, float]:
        """The posture whose tip comes nearest to `place`, and its distance (m).

        IPOPT starts from the last posture, the arm at half pressure, and a few fixed postures all
        over the workspace, nearest first, until one start hits: the program is not convex.
        """
        place = np.asarray(place, float).ravel()
        best, least = None, float("inf")
        for guess in self._guesses(place):
            w = self._solve(place, np.array([0.0, 0.0, 1.0]), guess, along=False)
            if w is None:
                continue
            distance = float(np.linalg.norm(w[-3:])) * self.model.scene.manipulator.length
            if distance < least:
                best, least = w, distance
            if distance <= HIT:
                break
        if best is None:
            return None, least
        self._last = best if least <= HIT else self._last
        q, p = self._split(best)
        return refine_equilibrium(self.model, np.clip(p, self.low, self.high), q), least

    def to_edge(self, place: np.ndarray, direction: np.ndarray) -> float | None:
        """Distance (m) from a place in reach to the edge along a unit vector."""
        start = self._last if self._last is not None else self._spread[0][1]
        w = self._solve(place, direction, start, along=True)
        return None if w is None else float(w[-4]) * self.model.scene.manipulator.length

    def clearance(
        self, places: np.ndarray, progress: Callable[[int, int], None] | None = None
    ) -> Clearance | None:
        """How close `places` (K×3) come to the edge; None if one of them is out of reach."""
        directions = [np.array(d, float) for d in product((-1, 0, 1), repeat=3) if any(d)]
        directions = [d / np.linalg.norm(d) for d in directions]
        best: Clearance | None = None
        for k, place in enumerate(np.asarray(places, float)):
            if self.posture(place) is None:
                return None
            for direction in directions:
                distance = self.to_edge(place, direction)
                if distance is not None and (best is None or distance < best.distance):
                    best = Clearance(distance, place, direction, len(directions))
            if progress is not None:
                progress(k + 1, len(places))
        return best

    def _split(self, w: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        n, layout = self.model.strains, self.model.layout
        return w[:n] * layout.q.scale, w[n:-4] * layout.p.scale

    @cached_property
    def _spread(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Tips and variables of some postures: half pressure, then random pressures."""
        draws = np.random.default_rng(0).uniform(size=(STARTS, len(self.low)))
        shares = np.vstack([np.full(len(self.low), 0.5), np.where(draws < 0.4, 0.0, draws)])
        layout, found = self.model.layout, []
        for share in shares:
            rest = find_equilibrium(self.model, self.low + share * (self.high - self.low))
            if rest.converged:
                w = [rest.q / layout.q.scale, rest.pressures / layout.p.scale, np.zeros(4)]
                found.append((rest.tips[-1], np.concatenate(w)))
        return found

    def _guesses(self, place: np.ndarray) -> list[np.ndarray]:
        near = sorted(self._spread[1:], key=lambda s: float(np.linalg.norm(s[0] - place)))
        last = [] if self._last is None else [self._last]
        return [*last, self._spread[0][1], *(w for _, w in near[:TRIES])]

    def _solve(
        self, place: np.ndarray, direction: np.ndarray, guess: np.ndarray, along: bool
    ) -> np.ndarray | None:
        if place.shape != (3,) or not np.all(np.isfinite(place)):
            raise InputError(f"place = {place.tolist()}: must be three finite numbers in m")
        n, scale = self.model.strains, self.model.layout.p.scale
        free, ray = np.full(n, np.inf), FAR if along else 0.0
        miss = np.zeros(3) if along else np.full(3, FAR)
        found = self._solver(
            x0=guess,
            p=np.concatenate([place, direction, [float(along)]]),
            lbx=np.concatenate([-free, self.low / scale, [0.0], -miss]),
            ubx=np.concatenate([free, self.high / scale, [ray], miss]),
            lbg=0.0,
            ubg=0.0,
        )
        return np.asarray(found["x"]).ravel() if self._solver.stats()["success"] else None
