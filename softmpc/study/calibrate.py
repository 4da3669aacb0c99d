"""Calibration: parameters of a scene fitted to what was measured or printed, by IPOPT."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from softmpc.errors import InputError, SoftmpcError
from softmpc.model.scene import Scene
from softmpc.study.calibration_report import report
from softmpc.study.calibration_result import Calibration
from softmpc.study.free_parameters import FreeParameter, ParameterSpace, Tie
from softmpc.study.least_squares import Fit, minimise
from softmpc.study.observations import Observation
from softmpc.study.residuals import Data, Predictions
from softmpc.study.uncertainty import RESOLVED, uncertainty
from softmpc.sweeps import sweep

if TYPE_CHECKING:
    from concurrent.futures import Executor

__all__ = ["CalibrationProblem", "calibrate"]

Progress = Callable[[float, float], None]
SAME = 1e-3  # of the cost, for searches that ended alike
NEW_SIGMA = 0.01  # change of the estimated sigma below which it is done


@dataclass(frozen=True, eq=False)
class CalibrationProblem:
    """What to fit to what. `ties` keep numbers at a multiple of others.

    With `estimate_sigma` the sigmas count only relative to each other, and their common factor is
    estimated from the residuals. Raises `InputError` where the parts do not fit together.
    """

    scene: Scene
    parameters: tuple[FreeParameter, ...]
    observations: tuple[Observation, ...]
    ties: tuple[Tie, ...] = ()
    estimate_sigma: bool = False
    title: str = ""

    def __post_init__(self) -> None:
        for name in ("parameters", "observations", "ties"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
        if not any(o.counts for o in self.observations):
            raise InputError("there is nothing to fit to: give poses, motions or summary values")
        for observation in self.observations:
            observation.check(self.scene)
        _ = self.space

    @cached_property
    def space(self) -> ParameterSpace:
        """The free parameters as a vector."""
        return ParameterSpace(self.scene, self.parameters, self.ties)

    @cached_property
    def predictions(self) -> Predictions:
        """What the arm shows, kept from one fit to the next."""
        return Predictions(self.space, self.observations)

    @cached_property
    def data(self) -> Data:
        """The observations as vectors."""
        return Data(self.observations)

    def fit(self, data: Data, start: np.ndarray, factor: float = 1.0) -> Fit:
        """The best x for these data, sigmas being `factor` times what they say."""
        mean, deviation = self.space.prior
        known = np.isfinite(deviation)
        pull = np.eye(len(mean))[known] / deviation[known, None]
        counts = data.counts

        def residuals(x: np.ndarray) -> np.ndarray:
            r = data.residuals(self.predictions.at(x))[counts] / factor
            return np.concatenate([r, ((x - mean) / deviation)[known]])

        def jacobian(x: np.ndarray) -> np.ndarray:
            return np.vstack([self.jacobian(data, x)[counts] / factor, pull])

        return minimise(residuals, jacobian, start, self.space.bounds)

    def jacobian(self, data: Data, x: np.ndarray) -> np.ndarray:
        """Residuals by x (N×P); zero where a limit is kept, and what is not fitted."""
        active = data.active(self.predictions.at(x))
        slopes = self.predictions.slopes(x, data.weighing(active))
        return np.where(active[:, None], slopes / data.sigmas[:, None], 0.0)

    def settled(self, data: Data, start: np.ndarray) -> tuple[Fit, float]:
        """The fit and the factor of the sigmas: fitted again while priors make that matter."""
        fit, factor = self.fit(data, start), 1.0
        if not self.estimate_sigma:
            return fit, factor
        for _ in range(6):
            new = self.factor(data, fit, factor)
            if fit.status == "interrupted" or abs(new / factor - 1) < NEW_SIGMA:
                return fit, new
            factor = new
            if np.isfinite(self.space.prior[1]).any():
                fit = self.fit(data, fit.x, factor)
        return fit, factor

    def factor(self, data: Data, fit: Fit, before: float) -> float:
        """How many times the stated sigmas the residuals are; `before` where nothing is left."""
        shown = self.predictions.at(fit.x)
        active = data.active(shown)
        J = self.jacobian(data, fit.x)[active]
        free = np.ones(len(fit.x), bool)
        used = uncertainty(J, self.space.prior[1], free, before).used
        freedom = active.sum() - used
        chi2 = float(np.sum(data.residuals(shown)[active] ** 2))
        return float(np.sqrt(chi2 / freedom)) if freedom >= 0.5 and chi2 > 0 else before


@dataclass(frozen=True, eq=False)
class _Searches:
    """One search from a given start, for `sweep`."""

    problem: CalibrationProblem

    def __call__(self, start: list[float]) -> dict[str, Any]:
        try:
            fit, factor = self.problem.settled(self.problem.data, np.array(start))
        except SoftmpcError as error:
            return {"status": str(error), "x": start, "cost": float("inf"), "factor": 1.0}
        if fit.status == "interrupted":
            raise KeyboardInterrupt
        about = {"status": fit.status, "cost": fit.cost, "iterations": fit.iterations}
        return about | {"x": fit.x.tolist(), "factor": factor}


def calibrate(
    problem: CalibrationProblem,
    *,
    starts: int = 1,
    seed: int = 0,
    executor: Executor | int | None = 1,
    progress: Progress | None = None,
) -> Calibration:
    """Fit the parameters; the first of `starts` searches begins at their starts, others anywhere.

    Other starts are drawn with `seed` within the bounds and searched on the `executor` of
    `softmpc.sweeps.sweep`. `progress(done, of about how many)` is called now and then. Raises
    `SoftmpcError` where the scene cannot be computed at the start; a search that does not converge
    or is interrupted is told by the status, with the best that was found.
    """
    if starts < 1:
        raise InputError(f"starts = {starts!r}: must be at least 1")
    began = time.perf_counter()
    problem = replace(problem)  # with predictions of its own
    if progress:
        _tell(problem, progress)
    try:
        fit, factor = problem.settled(problem.data, problem.space.start)
    except SoftmpcError as error:
        raise type(error)(f"at the start values: {error}") from None
    agreeing = 1
    if starts > 1 and fit.status != "interrupted":
        fit, factor, agreeing = _best(problem, fit, factor, starts, seed, executor, progress)
    if fit.converged:
        fit = _unseen_at_start(problem, fit)
    found = report(problem, fit, factor)
    wall = time.perf_counter() - began
    return replace(found, starts=starts, agreeing=agreeing, wall_s=wall)


def _unseen_at_start(problem: CalibrationProblem, fit: Fit) -> Fit:
    """What no value and no prior sees is put back: a search may leave it anywhere."""
    data, (_, deviation) = problem.data, problem.space.prior

    def cost(x: np.ndarray) -> float:
        return float(np.sum(data.residuals(problem.predictions.at(x))[data.counts] ** 2))

    slopes = np.linalg.norm(problem.jacobian(data, fit.x)[data.counts], axis=0)
    unseen = ~np.isfinite(deviation) & (slopes <= RESOLVED * slopes.max())
    best, x = cost(fit.x), fit.x.copy()
    for k in np.flatnonzero(unseen & (x != problem.space.start)):
        moved = np.where(np.arange(len(x)) == k, problem.space.start, x)
        if cost(moved) <= best * (1 + SAME):  # a limit may be kept here and not there
            x = moved
    return replace(fit, x=x)


def _tell(problem: CalibrationProblem, progress: Progress) -> None:
    """Progress by arms: each iteration takes one and two a parameter, some six iterations."""
    predictions, expected = problem.predictions, 6 * (1 + 2 * len(problem.space))

    def tell() -> None:
        progress(predictions.arms, max(expected, predictions.arms + 1))

    predictions.tell = tell


def _best(
    problem: CalibrationProblem,
    fit: Fit,
    factor: float,
    starts: int,
    seed: int,
    executor: Executor | int | None,
    progress: Progress | None,
) -> tuple[Fit, float, int]:
    """The best of all searches, and how many ended there."""
    generator = np.random.default_rng(seed)
    others = [problem.space.random_start(generator).tolist() for _ in range(starts - 1)]
    work = _Searches(replace(problem))
    first = fit.cost if fit.converged else float("inf")
    try:
        found = sweep(work, others, executor=executor, chunk=1, progress=progress)
    except KeyboardInterrupt:
        return replace(fit, status="interrupted"), factor, 1
    for other in found:
        better = other["status"] == "converged" and not other["cost"] >= fit.cost
        if better or (other["status"] == "converged" and not fit.converged):
            x = np.array(other["x"])
            fit = Fit("converged", x, other["cost"], other["iterations"])
            factor = other["factor"]
    costs = [first] + [other["cost"] for other in found if other["status"] == "converged"]
    alike = sum(abs(cost - fit.cost) <= SAME * (1 + fit.cost) for cost in costs)
    return fit, factor, max(1, alike)
