"""A bound on the true error from a measured one, calibrated on scenes with a known truth.

Split conformal prediction. Errors are measured against a reference that has an error of its own;
its `doubt` is how far it moves when it is one step coarser. Over seeded scenes, whose truth is a
far finer model by another integrator, the scores (true error − measured)/doubt are sorted. The
factor is the one that 90 % of new scenes stay below, whatever the distribution of the scores, as
long as the scenes are like these:

    bound = measured + factor · doubt.

`python -m tests.benchmarks.choosing --calibrate` measures the scores and prints the factors.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import ceil, inf, isfinite
from typing import Any

__all__ = ["CALIBRATED", "SHARE", "Calibration", "bound_m", "conformal_factor", "score"]

SHARE = 0.9  # of scenes in which the true error is to be below the bound
LEAST_DOUBT = 1e-6  # m; a doubt below is rounding and integration, not the reference's


@dataclass(frozen=True)
class Calibration:
    """The factor of a family, and the number of scenes that it comes from."""

    factor: float
    scenes: int

    @property
    def enough(self) -> bool:
        """Whether there are enough scenes for the bound to hold in 90 % of new ones."""
        return isfinite(conformal_factor([0.0] * self.scenes))


# Conformal factors, rounded up. A rod has no segments: its scores are below 2e-6, and the factor 1
# is more than it needs. Theory expects 1/9 of the doubt to be left of motions, extrapolated from
# 3, 4 and 6 segments; of loops on 4 segments a section, 1.3 of the difference to 3.
CALIBRATED = {
    "rest": Calibration(1.0, 11),
    "motion": Calibration(0.1, 22),  # 0.0951
    "loop": Calibration(1.64, 9),  # 1.633
}


def bound_m(family: str, error: Mapping[str, Any]) -> float:
    """The bound (m) for a measured error with its `error_m` and `doubt_m`."""
    return float(error["error_m"]) + CALIBRATED[family].factor * _doubt_m(error)


def score(error: Mapping[str, Any], true_m: float) -> float:
    """By how many doubts the true error (m) exceeds the measured one; negative where it is less."""
    return (true_m - float(error["error_m"])) / _doubt_m(error)


def conformal_factor(scores: Sequence[float], share: float = SHARE) -> float:
    """The factor that a new score is below with at least that probability.

    Of n scores it is the ⌈(n + 1)·share⌉-th smallest, infinite where there are too few; never below
    0, for a bound below the measured error would look like a gift of the calibration.
    """
    rank = ceil((len(scores) + 1) * share - 1e-9)
    return max(0.0, sorted(scores)[rank - 1]) if rank <= len(scores) else inf


def _doubt_m(error: Mapping[str, Any]) -> float:
    return max(float(error["doubt_m"]), LEAST_DOUBT)
