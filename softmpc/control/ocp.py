"""The optimal-control problem: what is to be minimised within which limits, and nothing more.

How it is discretised is the transcription's business, how it is solved the solver's.
"""

from __future__ import annotations

from dataclasses import dataclass

from softmpc.control.costs import Cost, StrainRate, TipPosition, Torque, TorqueRate
from softmpc.control.limits import Limit, PressureLimit, TorqueLimit
from softmpc.errors import InputError
from softmpc.model.model import Model

__all__ = ["Ocp", "tracking_problem"]


@dataclass(frozen=True)
class Ocp:
    """`intervals` of `step` seconds with constant input, costs at their ends, limits throughout."""

    model: Model
    intervals: int
    step: float
    costs: tuple[Cost, ...]
    limits: tuple[Limit, ...]

    def __post_init__(self) -> None:
        if self.intervals < 1:
            raise InputError(f"Ocp.intervals = {self.intervals}: must be 1 or more")
        if not 0 < self.step < 10:
            raise InputError(f"Ocp.step = {self.step} s: must be above 0 and below 10 s")
        if not self.costs:
            raise InputError("Ocp.costs is empty: give at least one cost, such as TipPosition()")
        self.model.require_mass("an optimal-control problem")


def tracking_problem(
    model: Model,
    intervals: int = 20,
    step: float = 0.025,
    costs: tuple[Cost, ...] | None = None,
    limits: tuple[Limit, ...] | None = None,
) -> Ocp:
    """Follow a tip path within the arm's torque and pressure limits."""
    arm = model.scene.manipulator.limits
    if costs is None:
        costs = (TipPosition(), Torque(), TorqueRate(), StrainRate())
    if limits is None:
        pressure = (arm.pressure_min, arm.pressure_max)
        torque = (arm.torque_min, arm.torque_max)
        driven = model.scene.actuation.input == "torque"
        limits = (TorqueLimit(*(torque if driven else pressure)),)
        limits += (PressureLimit(*pressure),) if driven else ()
    return Ocp(model, intervals, step, costs, limits)
