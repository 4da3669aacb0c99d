"""Postures at rest all over the workspace, always the same ones: where searches start from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softmpc.model.model import Model
from softmpc.statics.equilibrium import Equilibrium, find_equilibrium
from softmpc.statics.rest_limits import RestLimits

__all__ = ["POSTURES", "Spread"]

POSTURES = 200
POOL = 100  # nearest of them, among which starts are chosen
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
        found = [find_equilibrium(model, limits.low + share * limits.range) for share in shares]
        found = [rest for rest in found if rest.converged] or found[:1]
        return cls(
            found,
            np.array([rest.tips for rest in found]),
            np.array([rest.rotations for rest in found]),
            np.array([rest.q for rest in found]) / model.layout.q.scale,
        )

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
