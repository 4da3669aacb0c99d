"""Postures at rest all over the workspace, always the same ones: where searches start from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softmpc.model.model import Model
from softmpc.statics.equilibrium import Equilibrium, find_equilibrium
from softmpc.statics.rest_limits import RestLimits

__all__ = ["POSTURES", "Spread"]

POSTURES = 200
IDLE = 0.4  # chance of a unit to be at its lowest pressure: the edge is where many are


@dataclass(frozen=True)
class Spread:
    """Postures (N) of one arm, with the places and orientations of their section tips."""

    postures: list[Equilibrium]
    tips: np.ndarray  # (N×S×3) m
    rotations: np.ndarray  # (N×S×3×3)

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
        )
