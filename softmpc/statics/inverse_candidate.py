"""An optimum of inverse statics as the arm itself sees it, to be compared with others."""

from __future__ import annotations

from dataclasses import dataclass

from softmpc.statics.equilibrium import Equilibrium
from softmpc.statics.program import RestSolution

__all__ = ["HIT", "Candidate"]

HIT = 1e-6  # m, nearer counts as there


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
