"""What a choice came to: candidates with their evidence, the one chosen, or why there is none."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from softmpc.accuracy.bound import CALIBRATED, SHARE, bound_m
from softmpc.accuracy.configuration import Configuration
from softmpc.accuracy.points import Point
from softmpc.accuracy.work import MEASURED

__all__ = ["Choice", "Evidence", "Goal"]

Numbers = Mapping[str, Any]


@dataclass(frozen=True)
class Goal:
    """What is asked for. `family` is "rest", "motion" or "loop"."""

    family: str
    tolerance_m: float
    rate_hz: float | None = None

    @property
    def deadline_s(self) -> float | None:
        return None if self.rate_hz is None else 1.0 / self.rate_hz


@dataclass(frozen=True, eq=False)
class Evidence:
    """A candidate and what was measured of it; `step_s` is what has to fit into the deadline."""

    goal: Goal
    point: Point
    step_s: float | None = None

    @property
    def configuration(self) -> Configuration:
        return self.point.configuration

    @property
    def bound_m(self) -> float | None:
        """What the true error is below in 90 % of scenes; None where no error could be had."""
        if self.point.error_m is None or self.point.doubt_m is None:
            return None
        return bound_m(self.goal.family, self.point.error)

    @property
    def within(self) -> bool:
        """Whether the bound is within the tolerance."""
        return self.bound_m is not None and self.bound_m <= self.goal.tolerance_m

    @property
    def fast(self) -> bool:
        """Whether it was timed, and keeps the rate."""
        if self.point.time_s is None:
            return False
        if self.goal.deadline_s is None:
            return True
        return self.step_s is not None and self.step_s <= self.goal.deadline_s

    @property
    def order(self) -> float:
        """By which costs are compared: the ratio to the scene as given where there is one."""
        found = self.point.cost.get("ratio")
        return float(found) if found is not None else float(self.point.time_s or 0.0)

    def summary(self) -> dict[str, Any]:
        """Plain data for JSON."""
        own = self.point.summary()
        kept = {key: own[key] for key in ("name", "changes", "error", "cost")}
        more = {"bound_m": self.bound_m, "within": self.within, "step_s": self.step_s}
        return kept | more | {"fast": self.fast if self.point.cost else None}


@dataclass(frozen=True, eq=False)
class Choice:
    """The cheapest candidate within the tolerance and the rate; `chosen` is None without one.

    `status` is "chosen", "refused" or "interrupted". `document` is the scene file with the changes.
    """

    title: str
    status: str
    goal: Goal
    evidence: tuple[Evidence, ...]  # of all candidates, in the order they were tried
    references: Mapping[str, str]
    machine: Numbers
    chosen: Evidence | None = None
    reasons: tuple[str, ...] = ()
    document: Mapping[str, Any] = field(default_factory=dict)

    @property
    def timed(self) -> Sequence[Evidence]:
        """Those of which the time was measured too, the fastest first."""
        found = [one for one in self.evidence if one.point.cost.get("status") == MEASURED]
        return sorted(found, key=lambda one: one.order)

    def summary(self) -> dict[str, Any]:
        """Plain data for JSON; no date in it."""
        calibrated = CALIBRATED[self.goal.family]
        return {
            "title": self.title,
            "status": self.status,
            "for": self.goal.family,
            "tolerance_m": self.goal.tolerance_m,
            "rate_hz": self.goal.rate_hz,
            "bound": {
                "share": SHARE, "factor": calibrated.factor, "scenes": calibrated.scenes,
                "enough_scenes": calibrated.enough,
                "form": "error_m + factor * doubt_m",
            },
            "references": dict(self.references),
            "chosen": None if self.chosen is None else self.chosen.summary(),
            "reasons": list(self.reasons),
            "candidates": [one.summary() for one in self.evidence],
            "machine": dict(self.machine),
        }  # fmt: skip
