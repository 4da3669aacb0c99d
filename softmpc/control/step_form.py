"""How strains and rates at the stages of an implicit step follow from its unknowns.

    q_s = q + of_rate_s dq + Σ_j to_strain_sj a_j,    dq_s = kept dq + Σ_j to_rate_sj a_j

With inertia the unknowns a are the accelerations at the stages. Without it they are the rates, and
the rates before the step do not matter.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softmpc.model.model import Model
from softmpc.simulation.tableau import Tableau

__all__ = ["StepForm"]


@dataclass(frozen=True)
class StepForm:
    """The form of a step of some length by a tableau with s stages; the last stage is its end."""

    of_rate: np.ndarray  # (s)
    to_strain: np.ndarray  # (s×s)
    kept: float
    to_rate: np.ndarray  # (s×s)
    accelerates: bool  # whether the unknowns are accelerations

    @classmethod
    def of(cls, model: Model, tableau: Tableau, length: float) -> StepForm:
        A, c, h = tableau.A, tableau.c, length
        if model.order == 2:
            return cls(c * h, h**2 * (A @ A), 1.0, h * A, True)
        return cls(0 * c, h * A, 0.0, np.eye(len(c)), False)

    @classmethod
    def by_length(cls, model: Model, tableau: Tableau, length: float) -> StepForm:
        """Its derivative in the length of the step."""
        A, c, h = tableau.A, tableau.c, length
        if model.order == 2:
            return cls(c, 2 * h * (A @ A), 0.0, A, True)
        return cls(0 * c, A, 0.0, 0 * A, False)

    @staticmethod
    def scale(model: Model, stages: int) -> np.ndarray:
        """Sizes of the unknowns of all stages."""
        layout = model.layout
        return np.tile(layout.ddq.scale if model.order == 2 else layout.dq.scale, stages)
