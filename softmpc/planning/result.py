"""A plan: what was found, how good it is, and how it was found."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from softmpc.planning.attempt import Found
from softmpc.planning.giving_way import GivesWay
from softmpc.planning.problem import PlanProblem
from softmpc.planning.replay import Replay

__all__ = ["FAILED", "INFEASIBLE", "INTERRUPTED", "NOT_LEAST", "NOT_VERIFIED", "SOLVED", "Level",
           "PlanResult", "StartReport", "cost_unit"]  # fmt: skip

SOLVED = "solved"
NOT_LEAST = "not least"  # all is met, but the iterations ended before the least was found
NOT_VERIFIED = "not verified"  # the finest mesh does not agree with its replay
INFEASIBLE = "infeasible"  # something gives way
FAILED = "no motion"  # no start led to any
INTERRUPTED = "interrupted"
SQUARES = {"torque": "N²m²", "pressure": "Pa²"}  # of the inputs

Array = np.ndarray


def cost_unit(problem: PlanProblem) -> str:
    """The SI unit of what is least."""
    squared = SQUARES[problem.model.scene.actuation.input]
    return {"time": "s", "effort": f"{squared}s", "jerk": f"{squared}/s"}[problem.least]


@dataclass(frozen=True)
class StartReport:
    """How one start ended on the first mesh."""

    name: str
    status: str
    cost: float
    wrong: float  # scaled, the largest of what is not met
    iterations: int
    seconds: float
    won: bool = False


@dataclass(frozen=True)
class Level:
    """One round of refinement: a mesh, and what its replay says."""

    intervals: int
    cost: float
    defect: float  # m
    clearance: float  # m, the least; inf without obstacles
    iterations: int
    seconds: float


@dataclass(frozen=True, eq=False)
class PlanResult:
    """A plan in SI; see `status`.

    `cost_error` is by how much the cost changed when the mesh was last made twice as fine, NaN
    where it never was. `gives_way` and `held_by` say what an infeasible problem lacks. `more` is
    clearance (m) by obstacle that was asked for beside the margin, for what is between nodes.
    """

    problem: PlanProblem
    status: str
    starts: tuple[StartReport, ...]
    found: Found | None = field(default=None, repr=False)
    replay: Replay | None = field(default=None, repr=False)
    levels: tuple[Level, ...] = ()
    cost_error: float = float("nan")
    gives_way: tuple[GivesWay, ...] = ()
    held_by: tuple[str, ...] = ()
    seconds: float = 0.0
    more: Mapping[str, float] = field(default_factory=dict)
    title: str = ""

    @property
    def solved(self) -> bool:
        """Whether all is met, and the replay agrees."""
        return self.status in (SOLVED, NOT_LEAST)

    @property
    def time(self) -> float:
        """Of the whole motion, s."""
        return float(self._plan.durations.sum())

    @property
    def t(self) -> Array:
        """Times of the nodes (K+1, s)."""
        return self._plan.t

    @property
    def u(self) -> Array:
        """Inputs (K×k): row i from node i to the next."""
        return self._plan.u

    @property
    def x(self) -> Array:
        """States at the nodes (K+1×nx)."""
        return self._plan.x

    @property
    def u_after(self) -> Array:
        """The input that is held after the end (k)."""
        return np.asarray(self._plan.u[-1])

    @property
    def _plan(self) -> Found:
        if self.found is None:
            raise AttributeError(f"a plan with the status {self.status!r} has no motion")
        return self.found

    def summary(self) -> dict[str, Any]:
        """Numbers for people and programs; keys name their units."""
        data: dict[str, Any] = {
            "title": self.title,
            "status": self.status,
            "least": self.problem.least,
            "seconds": self.seconds,
            "starts": [vars(start) for start in self.starts],
        }
        if self.found is not None and self.replay is not None:
            data |= self._numbers(self.found, self.replay)
        return data

    def _numbers(self, found: Found, replay: Replay) -> dict[str, Any]:
        return {
            "time_s": self.time,
            "durations_s": found.durations.tolist(),
            "cost": found.cost,
            "cost_unit": cost_unit(self.problem),
            "cost_error": self.cost_error,
            "intervals": len(found.u),
            "defect_mm": 1e3 * replay.defect,
            "misses_mm": [1e3 * miss for miss in replay.misses],
            "turns_deg": np.degrees(replay.turns).tolist(),
            "drift_mm": 1e3 * replay.drift,
            "clearance_mm": {name: 1e3 * room for name, room in replay.clearance.items()},
            "beyond": {name: vars(one) for name, one in replay.beyond.items()},
            "gives_way": [vars(one) for one in self.gives_way],
            "held_by": list(self.held_by),
            "levels": [vars(level) for level in self.levels],
        }
