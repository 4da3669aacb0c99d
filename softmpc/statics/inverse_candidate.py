"""An optimum of inverse statics as the arm itself sees it, to be compared with others."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softmpc.statics.equilibrium import Equilibrium, find_equilibrium, refine_equilibrium
from softmpc.statics.inverse_program import InverseProgram
from softmpc.statics.program import RestProgram, RestSolution
from softmpc.statics.targets import Target

__all__ = ["HIT", "Candidate", "Judge"]

HIT = 1e-6  # m, nearer counts as there
SAME = 1e-5  # m, nearer is the same posture


@dataclass(frozen=True)
class Candidate:
    """An optimum, as the arm itself sees it."""

    solution: RestSolution | None  # None for a posture that nothing led to
    posture: Equilibrium
    on_rest_branch: bool
    distance: float
    angle: float
    miss: float  # m, of both
    cost: float

    @property
    def good(self) -> bool:
        """Whether the arm comes here, and stays."""
        return self.on_rest_branch and self.posture.stable

    @property
    def rank(self) -> tuple[int, float]:
        """The lower the better: first what hits and can be reached at rest."""
        if self.miss <= HIT:
            trouble = 0 if self.good else 1 if self.posture.stable else 2
            return trouble, self.cost
        return 3 if self.good else 4, self.miss


@dataclass(frozen=True)
class Judge:
    """Looks at postures for some targets."""

    program: RestProgram
    inverse: InverseProgram
    targets: tuple[Target, ...]
    angle_length: float

    def off(self, tips: np.ndarray, rotations: np.ndarray) -> np.ndarray:
        """What N postures miss, as it is priced (N×k, m); section tips (N×S×3, N×S×3×3)."""
        parts = [
            (target.seen(tips, rotations) - target.values)
            * (self.angle_length if target.turns else 1.0)
            for target in self.targets
        ]
        return np.hstack(parts)

    def optimum(self, found: RestSolution) -> Candidate:
        """Whether the arm comes to that posture, by continuation from rest, and how near it is."""
        model, limits = self.program.model, self.program.limits
        pressures = np.clip(found.pressures, limits.low, limits.high)  # to the last bit
        posture = find_equilibrium(model, pressures)
        tips = np.asarray(model.frames(found.q)[0]).T
        same = posture.converged and float(np.abs(posture.tips - tips).max()) <= SAME
        if not same:
            posture = refine_equilibrium(model, pressures, found.q)
        return self.posture(posture, same, found)

    def posture(
        self, posture: Equilibrium, same: bool, found: RestSolution | None = None
    ) -> Candidate:
        """A posture, `same` where it is the one that continuation from rest leads to."""
        tips, rotations = posture.tips, posture.rotations
        errors = [(target.turns, target.error(tips, rotations)) for target in self.targets]
        distance, angle = (
            max((error for turns, error in errors if turns is kind), default=0.0)
            for kind in (False, True)
        )
        miss = float(np.linalg.norm(self.off(tips[None], rotations[None])))
        cost = float("nan")
        if found is not None:
            cost = float(self.inverse.cost(found.point[0], found.parameters))
        return Candidate(found, posture, same, distance, angle, miss, cost)
