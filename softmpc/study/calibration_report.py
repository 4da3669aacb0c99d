"""From where a fit ended to what can be said about it."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from softmpc.errors import SoftmpcError
from softmpc.model.scene import Scene
from softmpc.study.calibration_result import Calibration, Estimate, Residual
from softmpc.study.least_squares import Fit
from softmpc.study.uncertainty import (
    Direction,
    Uncertainty,
    goodness,
    quantile,
    uncertainty,
    undetermined,
)

if TYPE_CHECKING:
    from softmpc.study.calibrate import CalibrationProblem
    from softmpc.study.residuals import Data

__all__ = ["estimates", "report"]

AT_BOUND = 1e-12  # of x: the search puts there what is at a bound
SHOWN = 0.1  # the largest relative change in the words for a direction
UNKNOWN = float("nan")
CALIBRATED = ", calibrated"


def report(
    problem: CalibrationProblem, fit: Fit, factor: float, data: Data | None = None
) -> Calibration:
    """The result of a fit to the problem's data, or others.

    Where derivatives cannot be computed there are no standard errors.
    """
    data, space = data or problem.data, problem.space
    shown = problem.predictions.at(fit.x)
    r, active = data.residuals(shown), data.active(shown)
    try:
        J = problem.jacobian(data, fit.x)
    except SoftmpcError:
        J = np.full((len(r), len(space)), np.nan)
    rows = J[active] if np.all(np.isfinite(J)) else np.zeros((0, len(space)))
    sure = uncertainty(rows, space.prior[1], _free(problem, fit.x), factor)
    chi2, freedom = float(np.sum(r[active] ** 2)), float(active.sum() - sure.used)
    directions, determined = undetermined(rows, _sizes(problem, fit.x))
    scale = float(np.sqrt(chi2 / freedom)) if freedom >= 0.5 else UNKNOWN
    deviations = sure.deviations
    return Calibration(
        status=fit.status,
        title=problem.title,
        estimates=estimates(problem, fit.x, sure, determined, freedom),
        residuals=_residuals(data, shown, r),
        chi2=chi2,
        freedom=freedom,
        probability=goodness(chi2, freedom),
        sigma_factor=scale,
        sigma_estimated=problem.estimate_sigma,
        correlation=sure.correlation,
        undetermined=tuple(_words(problem, fit.x, direction) for direction in directions),
        directions=np.array([d.x for d in directions]).reshape(-1, len(space)),
        jacobian=J,
        covariance=sure.correlation * np.outer(deviations, deviations),
        starts=1,
        agreeing=1,
        arms=problem.predictions.arms,
        wall_s=UNKNOWN,
        scene=_named(space.scene_at(fit.x)),
    )


def _sizes(problem: CalibrationProblem, x: np.ndarray) -> np.ndarray:
    """A change of each x that matters: the prior's deviation, or all of the number."""
    prior = problem.space.prior[1]
    whole = np.where(problem.space.logarithmic, 1.0, np.maximum(np.abs(x), 1.0))
    return np.where(np.isfinite(prior), prior, whole)


def _named(scene: Scene) -> Scene:
    """The scene with an arm that says it is not the preset's any more."""
    arm = scene.manipulator
    name = arm.name if arm.name.endswith(CALIBRATED) else arm.name + CALIBRATED
    return scene.with_(manipulator=replace(arm, name=name))


def _free(problem: CalibrationProblem, x: np.ndarray) -> np.ndarray:
    """Which parameters (P) are not at a bound."""
    low, high = problem.space.bounds
    return np.asarray((x - low > AT_BOUND) & (high - x > AT_BOUND))


def estimates(
    problem: CalibrationProblem,
    x: np.ndarray,
    sure: Uncertainty,
    determined: np.ndarray,
    freedom: float,
) -> tuple[Estimate, ...]:
    """The parameters with their 95 % intervals, cut off at the bounds."""
    space = problem.space
    low, high = space.bounds
    reach = quantile(freedom if problem.estimate_sigma else None) * sure.deviations
    free = _free(problem, x)
    bottom = np.where(free, np.maximum(low, x - reach), UNKNOWN)
    top = np.where(free, np.minimum(high, x + reach), UNKNOWN)
    found = []
    values, errors = space.values(x), sure.deviations * np.abs(space.slopes(x))
    edges = [np.where(np.isnan(end), UNKNOWN, space.values(end)) for end in (bottom, top)]
    for k, path in enumerate(space.names):
        side = "low" if x[k] - low[k] <= AT_BOUND else "high"
        found.append(
            Estimate(
                path=path,
                unit=space.units[k],
                start=space.starts[k],
                estimate=float(values[k]),
                std_error=float(errors[k]),
                low95=float(edges[0][k]),
                high95=float(edges[1][k]),
                bound="" if free[k] else side,
                determined=bool(determined[k]),
                prior=space.priors[k],
                low=space.limits[k][0],
                high=space.limits[k][1],
                log=space.logarithmic[k],
            )
        )
    return tuple(found)


def _residuals(data: Data, shown: np.ndarray, r: np.ndarray) -> tuple[Residual, ...]:
    rows = zip(
        data.names, data.values, shown, data.sigmas, r, data.senses, data.counts, strict=True
    )
    return tuple(
        Residual(name, float(m), float(s), float(d), float(e), sense, bool(fitted))
        for name, m, s, d, e, sense, fitted in rows
    )


def _words(problem: CalibrationProblem, x: np.ndarray, direction: Direction) -> str:
    """A direction as changes of the numbers themselves, the largest of them by a tenth."""
    space = problem.space
    step = direction.x * SHOWN / np.abs(direction.x).max()
    values, change = space.values(x), step * space.slopes(x)
    order = [k for k in np.argsort(-np.abs(step)) if step[k]]
    said = []
    for k in order:
        if values[k] and abs(change[k] / values[k]) < 10:
            said.append(f"{space.names[k]} {100 * change[k] / values[k]:+.2g} %")
        else:
            said.append(f"{space.names[k]} {change[k]:+.2g} {space.units[k]}".rstrip())
    effect = direction.effect * SHOWN / np.abs(direction.x).max()
    seen = f"residuals change by {effect:.1g} sigma in all" if effect > 0.01 else "nothing changes"
    return f"{' with '.join(said)}: {seen}"
