"""Running a scene for a study: its motion at a tight tolerance, its cost at the scene's own."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from statistics import median
from typing import Any

import numpy as np

from softmpc.errors import BuildError, InputError
from softmpc.model.counting import executed
from softmpc.model.model import Model
from softmpc.simulation.compare import compare
from softmpc.simulation.integrator import IntegrationError
from softmpc.simulation.result import Simulation
from softmpc.simulation.run import simulate
from softmpc.simulation.settings import SimulationSettings

__all__ = ["TIGHT", "Cost", "Errors", "Runner", "motion_of", "reason"]

TIGHT = 1e-8  # m at the tip, a step, in motions that are compared
PATIENCE = 60.0  # s that one run may take


@dataclass(frozen=True, eq=False)
class Errors:
    """How far section tips are from those of another motion, m; the last section's is the tip."""

    largest: tuple[float, ...]  # over the motion, by section
    rms: tuple[float, ...]

    @classmethod
    def between(cls, one: Simulation, other: Simulation) -> Errors:
        gaps = compare(one, other).errors
        rms = np.sqrt(np.mean(gaps**2, axis=0))
        return cls(tuple(gaps.max(axis=0).tolist()), tuple(rms.tolist()))

    @property
    def worst(self) -> float:
        """Largest of any section."""
        return max(self.largest)


@dataclass(frozen=True)
class Cost:
    """What a model costs: sizes of its functions and states, and time to run the motion, s."""

    residual: int  # instructions executed in one call
    residual_jacobian: int
    drive: int  # instructions of the drive's rate and its derivatives, where it has states
    states: int
    wall_s: float

    @classmethod
    def of(cls, model: Model, wall_s: float) -> Cost:
        moving = model.strains * (2 if model.order == 2 else 1)
        drive = 0
        if len(model.layout.z):
            drive = executed(model.drive_rate) + executed(model.drive_jacobian)
        return cls(
            residual=executed(model.residual),
            residual_jacobian=executed(model.residual_jacobian),
            drive=drive,
            states=moving + len(model.layout.z),
            wall_s=wall_s,
        )

    @property
    def instructions(self) -> int:
        """All of them together."""
        return self.residual + self.residual_jacobian + self.drive


@dataclass(frozen=True, eq=False)
class Runner:
    """Runs models through the motion that a scene's [simulate] asks for."""

    settings: SimulationSettings
    repeats: int = 3

    def tight(self, model: Model, tip_tolerance: float = TIGHT) -> Simulation:
        """The motion to be compared, by Radau IIA at a tight tolerance; raises as `motion_of`."""
        numbers: dict[str, Any] = {"tolerance": None, "step": None, "tip_tolerance": tip_tolerance}
        return motion_of(model, replace(self.settings, method="radau", **numbers))

    def own(self, model: Model) -> Simulation:
        """The motion by the scene's own method and tolerance; raises as `motion_of`."""
        return motion_of(model, self.settings)

    def wall_s(self, model: Model, beside: Model) -> tuple[float, float]:
        """Median times (s) of a model and of another one, run by turns at the scene's tolerance.

        By turns, because a busy machine then slows both.
        """
        times = [[self.own(each).wall_s for each in (model, beside)] for _ in range(self.repeats)]
        own, other = zip(*times, strict=True)
        return median(own), median(other)


def motion_of(model: Model, settings: SimulationSettings, **changes: Any) -> Simulation:
    """The whole motion of some settings, with changes of the arguments of `simulate`.

    Raises `KeyboardInterrupt` when it is interrupted, `IntegrationError` where its end is not
    reached, or not within `PATIENCE`, or it has values that are not finite.
    """
    began = time.perf_counter()

    def patience(reached: float, duration: float) -> None:
        if time.perf_counter() - began > PATIENCE:
            raise IntegrationError(f"took longer than {PATIENCE:g} s")

    done = simulate(model, **(vars(settings) | {"progress": patience} | changes))
    if done.status == "interrupted":
        raise KeyboardInterrupt
    if not done.finished:
        raise IntegrationError(done.status)
    if not np.all(np.isfinite(done.tips)):
        raise IntegrationError("the motion has values that are not finite")
    return done


def reason(error: Exception) -> str:
    """Why something could not be run, in one line; CasADi's long messages end with what matters."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    if isinstance(error, InputError | BuildError) or len(lines) < 2:
        return " ".join(lines) or type(error).__name__
    return lines[-1]
