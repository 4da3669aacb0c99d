"""The optimal-control problem: what is to be minimised within which limits, and nothing more.

How it is discretised is the transcription's business, how it is solved the solver's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from softmpc.control.costs import Cost, StrainRate, TipPosition, Torque, TorqueRate
from softmpc.control.limits import Limit, PressureLimit, TorqueLimit
from softmpc.errors import InputError
from softmpc.model.disturbance import Disturbance
from softmpc.model.model import Model

__all__ = ["PRESSURE_EXCESS", "Ocp", "tracking_problem"]

LONGEST = 10.0  # s, of an interval
PRESSURE_EXCESS = 1e-4  # of full pressure, whose square costs ½ (a millimetre at the tip does)


@dataclass(frozen=True)
class Ocp:
    """`intervals` with constant input, costs at their ends, limits throughout.

    The first interval lasts `step` seconds, as long as the controller holds an input; `grid` says
    how many steps each interval lasts, one each without it. A cost of what lasts counts by the
    length of its interval. With a `disturbance` the model carries one, given anew in each solve as
    the reference "disturbance" (scaled).
    """

    model: Model
    intervals: int
    step: float
    costs: tuple[Cost, ...]
    limits: tuple[Limit, ...]
    grid: tuple[float, ...] = field(default=(), kw_only=True)
    disturbance: Disturbance | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        if self.intervals < 1:
            raise InputError(f"Ocp.intervals = {self.intervals}: must be 1 or more")
        if not 0 < self.step < LONGEST:
            raise InputError(f"Ocp.step = {self.step} s: must be above 0 and below {LONGEST:g} s")
        if not self.costs:
            raise InputError("Ocp.costs is empty: give at least one cost, such as TipPosition()")
        object.__setattr__(self, "grid", tuple(float(n) for n in self.grid))
        if self.grid:
            self._check_grid()
        if self.model.order == 2:
            self.model.require_mass("an optimal-control problem")

    def _check_grid(self) -> None:
        if len(self.grid) != self.intervals:
            raise InputError(
                f"Ocp.grid has {len(self.grid)} lengths for {self.intervals} intervals: must be "
                "one for each"
            )
        if self.grid[0] != 1.0:
            raise InputError(f"Ocp.grid = {self.grid}: must begin with 1, the controller's step")
        longest = LONGEST / self.step
        if not all(1.0 <= n <= longest for n in self.grid):
            raise InputError(
                f"Ocp.grid = {self.grid}: each must be between 1 and {longest:g} steps"
            )

    @property
    def ratios(self) -> np.ndarray:
        """Length of each interval in steps (N)."""
        return np.array(self.grid) if self.grid else np.ones(self.intervals)

    @property
    def nodes(self) -> np.ndarray:
        """Times of the ends of the intervals from now (N), s."""
        return self.step * np.cumsum(self.ratios)


def tracking_problem(
    model: Model,
    intervals: int = 20,
    step: float = 0.025,
    costs: tuple[Cost, ...] | None = None,
    limits: tuple[Limit, ...] | None = None,
    grid: Sequence[float] = (),
) -> Ocp:
    """Follow a tip path within the arm's torque and pressure limits, the latter soft."""
    arm = model.scene.manipulator.limits
    if costs is None:
        costs = (TipPosition(), Torque(), TorqueRate(), StrainRate())
    if limits is None:
        pressure = (arm.pressure_min, arm.pressure_max)
        torque = (arm.torque_min, arm.torque_max)
        driven = model.scene.actuation.input == "torque"
        limits = (TorqueLimit(*(torque if driven else pressure)),)
        limits += (PressureLimit(*pressure, soft=PRESSURE_EXCESS),) if driven else ()
    return Ocp(model, intervals, step, costs, limits, grid=tuple(grid))
