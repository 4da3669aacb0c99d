"""What a controller did in one sampling step, and the words for how it went."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

__all__ = [
    "BUDGET_OVERRUN", "FAILED", "INPUT_NOT_FINITE", "ITERATION_CAP", "SOLVED", "Step",
]  # fmt: skip

SOLVED = "solved"
ITERATION_CAP = "iteration cap"
BUDGET_OVERRUN = "budget overrun"
INPUT_NOT_FINITE = "input not finite"
FAILED = "failed"  # and then why: "failed: QP infeasible"


@dataclass(frozen=True)
class Step:
    """What the controller did in one sampling step."""

    u: np.ndarray  # input to apply (k), SI
    status: str  # one of the words above; a failure says why
    source: str  # of the input: "solution", "shifted plan" or "held input"
    prepare_seconds: float
    feedback_seconds: float
    iterations: int = 0
    cost: float = float("nan")
    kkt: float = float("nan")  # see `Solution`, like the next three
    qp: str = ""
    share: float = 0.0
    violation: float = float("nan")
    worst: str = ""  # worst violations of a step that is not solved: what, where, how much
    clipped: bool = False  # the input was changed by the last guard

    @property
    def solved(self) -> bool:
        return self.status == SOLVED

    @property
    def seconds(self) -> float:
        """All the time it took."""
        return self.prepare_seconds + self.feedback_seconds
