"""Implicit Runge-Kutta methods on the residual in second-order form.

`RadauIIA` chooses its steps by a tolerance in metres at the tip, or keeps a given step;
`GaussLegendre` keeps a given step, because it is for energy over long times. The steps themselves
are CasADi functions (`softmpc.simulation.trial`), compiled when that pays
(`softmpc.just_in_time`).
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from softmpc.errors import InputError
from softmpc.just_in_time import JustInTime
from softmpc.model.model import Model
from softmpc.simulation.hermite import Hermite
from softmpc.simulation.integrator import IntegrationError, Interval
from softmpc.simulation.system import System
from softmpc.simulation.tableau import Tableau, gauss_legendre, radau_iia
from softmpc.simulation.trial import MOST_FAILURES, Trials

__all__ = ["GaussLegendre", "RadauIIA", "RungeKutta"]

TRIALS = 24  # of one call
FIRST_STEP = 1e-3  # s, where nothing is known about the motion
EXACT = 1e-13  # m: tolerance that stands for a given step; its stages are solved to rounding
MOST_TRIALS = 200_000  # of one call of `advance`
LEAST, MOST = 1e-12, 0.1  # m, of the tolerance


class RungeKutta:
    """An implicit method for one model; see `Integrator` for `advance`.

    `step` (s) is kept if given; otherwise steps follow from `tolerance`, the error of a step in
    metres at the tip. Raises `BuildError` where strains have neither mass nor damping.
    """

    def __init__(
        self, model: Model, tableau: Tableau, tolerance: float | None, step: float | None
    ) -> None:
        self.model, self.tableau, self.step = model, tableau, step
        if step is not None and not (np.isfinite(step) and step > 0):
            raise InputError(f"step = {step!r} s: must be above 0")
        if step is None and not LEAST <= (tolerance or np.nan) <= MOST:
            raise InputError(
                f"tip tolerance = {tolerance!r} m: must be between {LEAST:g} and {MOST:g} m"
            )
        self.tolerance = EXACT if step is not None or tolerance is None else float(tolerance)
        self.system = System(model)
        self.trials = Trials(self.system, tableau, step is None)
        self.steps = self.refused = self.iterations = 0  # of all calls so far
        self._next_step = FIRST_STEP
        self._end: np.ndarray | None = None  # state and input that the last call ended with

    @cached_property
    def _many(self) -> JustInTime:
        return JustInTime(self.trials.many(TRIALS))

    def prepare(self) -> None:
        """Make the functions now, not with the first step."""
        _ = self._many

    def advance(
        self, x: Any, u: Any, duration: float, samples: int = 1, u_end: Any = None
    ) -> np.ndarray:
        """States (samples×nx) after x = (q, dq, z); see `Integrator.advance`.

        Without inertia the dq given is not used.
        """
        given = Interval(self.model, x, u, duration, samples, u_end)
        path = self._path(given)
        arm = self._between(path, given.times)
        drive = self.system.drive
        if drive is None:
            z = self._drive_between(path, given.times)
        else:
            z = drive.states(self.system.law(given), given.times)
        states = np.hstack([arm[0], arm[1], z])
        if not np.all(np.isfinite(states)):
            raise IntegrationError(f"{self.tableau.name}: the motion is no longer finite")
        u_end = given.u0 + given.duration * given.u_slope
        self._end = np.concatenate([states[-1, : self.system.n], u_end])
        return states

    # --- from start to end ---------------------------------------------------------------------

    def _path(self, given: Interval) -> dict[str, np.ndarray]:
        """What is known at the ends of the steps, by name (size×steps+1)."""
        carry, fixed = self._begin(given)
        columns, tried = [carry[:, None]], 0
        while columns[-1][0, -1] < given.duration:
            after = self._trials(columns[-1][:, -1], fixed)
            columns.append(after)
            tried += TRIALS
            self._check(after, given, tried)
        path = np.hstack(columns)
        parts = self.trials.carry.unpack(path)
        fresh = np.concatenate([[True], np.diff(parts["t"][0]) > 0])
        self._count(parts, int(fresh.sum()) - 1)
        return {name: part[:, fresh] for name, part in parts.items()}

    def _trials(self, carry: np.ndarray, fixed: np.ndarray) -> np.ndarray:
        """What some trials carry on (size×trials)."""
        try:
            return np.asarray(self._many(carry, fixed))
        except RuntimeError as error:  # CasADi, of matrices that are not finite, and of Ctrl-C
            if "KeyboardInterrupt" in str(error):
                raise KeyboardInterrupt from None
            raise IntegrationError(f"{self.tableau.name}: the motion is no longer finite") from None

    def _begin(self, given: Interval) -> tuple[np.ndarray, np.ndarray]:
        """The first carry, and what the interval shares."""
        system = self.system
        w, coefficients = system.input_law(given)
        z = given.z[: system.k]
        y = system.start(given.q, given.dq, z, w)
        dq = given.dq if system.order == 2 else y[: system.n]
        h = self._first_step(given)
        head = [0.0, h, h, 0.0, 0.0, 0.0]
        carry = np.concatenate([head, given.q, dq, z, y, np.tile(y, self.tableau.stages)])
        longest = h if self.step is not None else given.duration
        return carry, np.concatenate([[given.duration, self.tolerance, longest], coefficients])

    def _first_step(self, given: Interval) -> float:
        if self.step is not None:
            return given.duration / max(1, round(given.duration / self.step + 0.499999))
        here = np.concatenate([given.q, given.u0])
        went_on = self._end is not None and np.allclose(self._end, here, rtol=1e-9, atol=1e-12)
        return min(self._next_step if went_on else FIRST_STEP, given.duration)

    def _check(self, after: np.ndarray, given: Interval, tried: int) -> None:
        last = self.trials.carry.unpack(after[:, -1])
        t, h = float(last["t"][0]), float(last["h"][0])
        stuck = last["failures"][0] >= MOST_FAILURES or h < 1e-12 * given.duration
        if stuck and self.step is not None:
            raise IntegrationError(
                f"{self.tableau.name}: the stages of a step of {h:.3g} s could not be solved; "
                "take a shorter step"
            )
        if stuck:
            raise IntegrationError(f"{self.tableau.name}: no step can be found, not even {h:.1e} s")
        if tried >= MOST_TRIALS:
            raise IntegrationError(
                f"{self.tableau.name}: {tried} steps are not enough, reached {t:.3g} s"
            )

    def _count(self, parts: dict[str, np.ndarray], steps: int) -> None:
        self.steps += steps
        self.refused += int(parts["refused"][0, -1])
        self.iterations += int(parts["iterations"][0, -1])
        self._next_step = float(parts["h"][0, -1])

    # --- between the steps ---------------------------------------------------------------------

    def _between(self, path: dict[str, np.ndarray], times: np.ndarray) -> np.ndarray:
        """Strains and rates (2×K×n) at times, from the ends of the steps around each."""
        names = ("q", "dq", "y") if self.system.order == 2 else ("q", "y")
        return _interpolated(path["t"][0], [path[name][: self.system.n].T for name in names], times)

    def _drive_between(self, path: dict[str, np.ndarray], times: np.ndarray) -> np.ndarray:
        ends = [path["z"].T, path["y"][self.system.n :].T]
        return np.asarray(_interpolated(path["t"][0], ends, times)[0])


class RadauIIA(RungeKutta):
    """Radau IIA, L-stable, order 2s - 1; steps by a tolerance (m, at the tip), or given (s)."""

    def __init__(
        self,
        model: Model,
        tolerance: float | None = 1e-6,
        stages: int = 3,
        step: float | None = None,
    ) -> None:
        super().__init__(model, radau_iia(stages), tolerance, step)


class GaussLegendre(RungeKutta):
    """Gauss-Legendre, symmetric, order 2s, with a given step (s): energy stays over long times."""

    def __init__(self, model: Model, step: float, stages: int = 3) -> None:
        super().__init__(model, gauss_legendre(stages), None, step)


def _interpolated(ends: np.ndarray, known: list[np.ndarray], times: np.ndarray) -> np.ndarray:
    """Values and rates (2×K×n) at times; `known` are derivatives 0, 1, … (I×n) at `ends` (I)."""
    pieces = Hermite.of(np.diff(ends), [x[:-1] for x in known], [x[1:] for x in known])
    piece = np.clip(np.searchsorted(ends, times, side="left") - 1, 0, len(ends) - 2)
    values, rates = pieces(piece, (times - ends[piece])[:, None])
    return np.stack([values[:, 0], rates[:, 0]])
