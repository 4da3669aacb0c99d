"""Model predictive control: one solve a sampling step, and what to do when a solve fails.

The controller always returns a finite torque within the limits. A failed solve is never used as a
warm start; the plan of the last good one is followed instead, and after a few failures the solver
starts afresh from the arm at rest.
"""

from __future__ import annotations

import logging
import time
from dataclasses import dataclass

import numpy as np

from softmpc.control.ipopt import Ipopt
from softmpc.control.limits import TorqueLimit
from softmpc.control.ocp import Ocp
from softmpc.control.solver import Solution
from softmpc.control.transcription import Transcription

__all__ = ["Mpc", "Step"]

FAILURES_BEFORE_RESTART = 3
LOG = logging.getLogger(__name__)


@dataclass(frozen=True)
class Step:
    """What the controller did in one sampling step."""

    u: np.ndarray  # input to apply (k)
    status: str  # "solved", or why not and what was done instead
    seconds: float
    iterations: int
    cost: float
    worst: str  # name of the most violated row of a failed solve

    @property
    def solved(self) -> bool:
        return self.status == "solved"


class Mpc:
    """A controller for one arm; it keeps its last good plan and nothing else."""

    def __init__(self, transcription: Transcription, solver: Ipopt | None = None) -> None:
        self.transcription = transcription
        self.ocp = transcription.ocp
        self.solver = solver or Ipopt(transcription)
        self.low, self.high = _input_limits(self.ocp)
        self.reset()

    def reset(self) -> None:
        """Forget the last plan."""
        self._good: Solution | None = None
        self._age = 0  # steps since the last good solve

    def step(self, x: np.ndarray, u_before: np.ndarray, targets: np.ndarray) -> Step:
        """The input for the state x (q, dq, z) and references at the coming nodes (N×3, m)."""
        started = time.perf_counter()
        given = (np.asarray(v, float).ravel() for v in (x, u_before, targets))
        x, u_before, flat = given
        if not all(np.all(np.isfinite(v)) for v in (x, u_before, flat)):
            return self._fall_back(u_before, "input not finite", started, None)
        parameters = self.transcription.parameters(x, u_before, flat)
        guess, multipliers = self._guess(x, u_before)
        solution = self.solver.solve(parameters, guess, multipliers)
        if not solution.solved:
            return self._fall_back(u_before, solution.status, started, solution)
        self._good, self._age = solution, 0
        u = self.transcription.split(solution.w)[0][0]
        return Step(
            np.clip(u, self.low, self.high),
            "solved",
            time.perf_counter() - started,
            solution.iterations,
            solution.cost,
            "",
        )

    def _guess(self, x: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, Solution | None]:
        """Where to start: the last good plan, shifted; the arm at rest without one."""
        t, good = self.transcription, self._good
        if good is None or self._age >= FAILURES_BEFORE_RESTART:
            return t.resting(x, np.clip(u, self.low, self.high)), None
        w, lam_w, lam_g = good.w, good.lam_w, good.lam_g
        rows = len(lam_g) // t.N
        for _ in range(self._age + 1):
            w, lam_w = t.shifted(w, t.nw), t.shifted(lam_w, t.nw)
            lam_g = t.shifted(lam_g, rows)
        shifted = Solution(True, "shifted", w, lam_w, lam_g, good.cost, 0.0, "", 0, 0.0)
        return w, shifted

    def _fall_back(
        self, u_before: np.ndarray, why: str, started: float, solution: Solution | None
    ) -> Step:
        """Follow the last good plan; hold the last input once it has run out."""
        self._age += 1
        held = np.where(np.isfinite(u_before), u_before, self.low)
        if self._good is not None and self._age < self.transcription.N:
            held = self.transcription.split(self._good.w)[0][self._age]
        worst = f"{solution.worst} ({solution.violation:.2g})" if solution else ""
        LOG.warning("solve failed, %d in a row: %s %s", self._age, why, worst)
        return Step(
            np.clip(held, self.low, self.high),
            f"failed: {why}",
            time.perf_counter() - started,
            solution.iterations if solution else 0,
            float("nan"),
            worst,
        )


def _input_limits(ocp: Ocp) -> tuple[np.ndarray, np.ndarray]:
    """Bounds of the input: the tightest of the problem's torque limits, else the arm's own."""
    arm, k = ocp.model.scene.manipulator.limits, len(ocp.model.layout.u)
    torque = ocp.model.scene.actuation.input == "torque"
    low = arm.torque_min if torque else arm.pressure_min
    high = arm.torque_max if torque else arm.pressure_max
    given = [limit for limit in ocp.limits if isinstance(limit, TorqueLimit)]
    low = max([low, *(limit.low for limit in given)])
    high = min([high, *(limit.high for limit in given)])
    return np.full(k, low), np.full(k, high)
