"""Postures at rest all over the workspace, always the same ones: where searches start from."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from softmpc.model.model import Model
from softmpc.statics.equilibrium import Equilibrium, find_equilibrium
from softmpc.statics.rest_limits import RestLimits

__all__ = ["POSTURES", "Spread"]

POSTURES = 200
POOL = 100  # nearest of them, among which starts are chosen
AT_LIMITS = 256  # all there are of six units
IDLE = 0.4  # chance of a unit to be at its lowest pressure: the edge is where many are


@dataclass(frozen=True)
class Spread:
    """Postures (N) of one arm, with the places and orientations of their section tips."""

    postures: list[Equilibrium]
    tips: np.ndarray  # (N×S×3) m
    rotations: np.ndarray  # (N×S×3×3)
    shapes: np.ndarray  # strains, scaled (N×n)

    @classmethod
    def of(cls, model: Model, limits: RestLimits, count: int = POSTURES) -> Spread:
        """Half of the range in each unit, then random pressures; those that settle at rest."""
        draws = np.random.default_rng(0).uniform(size=(2, count, len(limits.low)))
        shares = np.where(draws[0] < IDLE, 0.0, draws[1])
        shares[0] = 0.5
        return cls._at(model, limits, shares)

    @classmethod
    def at_limits(cls, model: Model, limits: RestLimits, count: int = AT_LIMITS) -> Spread:
        """All units at a limit, or one of them half way: the edge is made of such postures.

        Of more units than six a draw; a unit that is held has one share only.
        """
        free = limits.range > 0
        units = int(np.count_nonzero(free))
        if (units + 2) * 2 ** max(units - 1, 0) <= count:
            corners = [np.array(corner) for corner in product((0.0, 1.0), repeat=units)]
            kinds = [
                *corners,
                *(c + 0.5 * one for one in np.eye(units) for c in corners if c @ one == 0),
            ]
            some = np.array(kinds).reshape(len(kinds), units)
        else:
            rng = np.random.default_rng(1)
            some = rng.choice([0.0, 1.0], size=(count, units))
            half = np.flatnonzero(rng.uniform(size=count) < 0.75)
            some[half, rng.integers(units, size=len(half))] = 0.5
        shares = np.zeros((len(some), len(free)))
        shares[:, free] = some
        return cls._at(model, limits, shares)

    @classmethod
    def _at(cls, model: Model, limits: RestLimits, shares: np.ndarray) -> Spread:
        found = [find_equilibrium(model, limits.low + share * limits.range) for share in shares]
        found = [rest for rest in found if rest.converged] or found[:1]
        return cls(
            found,
            np.array([rest.tips for rest in found]),
            np.array([rest.rotations for rest in found]),
            np.array([rest.q for rest in found]) / model.layout.q.scale,
        )

    def nearest(self, misses: np.ndarray, count: int) -> list[Equilibrium]:
        """Those that miss least (N)."""
        return [self.postures[k] for k in np.argsort(misses)[:count]]

    def starts(self, misses: np.ndarray, count: int) -> list[Equilibrium]:
        """Of the postures that miss least (N), the first one, then those most unlike the others.

        Neighbours mostly lead to the same solution, or to none.
        """
        near = np.argsort(misses)[:POOL]
        shapes, chosen = self.shapes[near], [0]
        apart = np.linalg.norm(shapes - shapes[0], axis=1)
        for _ in range(min(count, len(near)) - 1):
            chosen.append(int(np.argmax(apart)))
            apart = np.minimum(apart, np.linalg.norm(shapes - shapes[chosen[-1]], axis=1))
        return [self.postures[k] for k in near[chosen]]
