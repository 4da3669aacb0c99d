"""A transcribed problem around a trajectory: its steps, costs and limits, and their slopes."""

from __future__ import annotations

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from softmpc.control.dynamics import Dynamics, Steps
from softmpc.control.terms import Terms
from softmpc.control.trajectory import Moment, Trajectory
from softmpc.control.transcription import Transcription

__all__ = ["Linearisation", "Linearised", "Measured"]

Array = np.ndarray


@dataclass(frozen=True)
class Measured:
    """How good a trajectory is, scaled."""

    cost: float
    defects: Array  # N × (s·n + nx)
    rows: Array  # of the limits, N×rows

    @property
    def finite(self) -> bool:
        return bool(np.isfinite(self.cost + self.defects.sum() + self.rows.sum()))


@dataclass(frozen=True)
class Linearised:
    """The problem around a trajectory, scaled; one row an interval.

    Beside its steps, cost ½|e + E (u_before, u, x⁺)|² and limits c + L (u_before, u, x⁺); the same
    at the end of the horizon.
    """

    steps: Steps
    e: Array  # N×residuals
    E: Array
    e_end: Array  # 1×residuals, of the last interval
    E_end: Array
    c: Array  # N×rows
    L: Array
    measured: Measured  # the trajectory itself


class Linearisation:
    """The functions of one transcription that a solver by linearisation calls."""

    def __init__(self, t: Transcription, mode: str = "auto") -> None:
        self.t = t
        self.dynamics = Dynamics(t, mode)
        objective, ratios = t.objective, t.ocp.ratios
        rows = ca.vertcat(*(row.value for row in objective.rows))
        self.residuals = objective.residuals.numel()  # the rows of limits follow
        every = ca.vertcat(objective.residuals, rows)
        given = objective.symbols
        self.terms = Terms("terms", every, given, ratios, 2 * t.n, mode)
        end = objective.end_residuals
        self.end_terms = Terms("end_terms", end, given, ratios[-1:], 2 * t.n, mode)

    def make(self) -> None:
        """Make all functions now, so that the first solve need not."""
        self.dynamics.make()
        self.terms.make()
        self.end_terms.make()

    def measure(self, moment: Moment, at: Trajectory) -> Measured:
        """Cost, defects and limit rows of a trajectory."""
        defects = self.dynamics.defects(moment, at)
        given = (moment.before(at)[1], at.u, at.x, moment.given)
        every = self.terms.values(*given)
        end = self.end_terms.values(*(value[-1:] for value in given))
        return self._measured(at, defects, every, end)

    def from_another_state(self, measured: Measured, moment: Moment, at: Trajectory) -> Measured:
        """What was measured, for a moment with another state: that enters one interval alone."""
        defects = measured.defects.copy()
        defects[0] = self.dynamics.first_defects(moment, at)
        return replace(measured, defects=defects)

    def _measured(self, at: Trajectory, defects: Array, every: Array, end: Array) -> Measured:
        e = every[:, : self.residuals]
        price = float(np.sum(at.u @ self.t.objective.price))
        cost = 0.5 * (float(np.vdot(e, e)) + float(np.vdot(end, end))) + price
        return Measured(cost, defects, every[:, self.residuals :])

    def __call__(self, moment: Moment, at: Trajectory) -> Linearised:
        """The problem around a trajectory. Raises `numpy.linalg.LinAlgError` where it has none."""
        split = self.residuals
        steps = self.dynamics(moment, at)
        given = (moment.before(at)[1], at.u, at.x, moment.given)
        every, slopes = self.terms(*given)
        e_end, E_end = self.end_terms(*(value[-1:] for value in given))
        return Linearised(
            steps=steps, e=every[:, :split], E=slopes[:, :split], e_end=e_end, E_end=E_end,
            c=every[:, split:], L=slopes[:, split:],
            measured=self._measured(at, steps.defects, every, e_end),
        )  # fmt: skip
