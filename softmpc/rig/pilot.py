"""The controller of a rig: estimator, supervision and MPC, from readings to an input.

Once a step it takes what has arrived, estimates state and disturbance for the time at which its
input will act, and asks the MPC, or falls back. The input is finite and within the limits of torque
and torque rate whatever happens.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from softmpc.control.guide import Guide
from softmpc.control.mpc import Mpc
from softmpc.control.one_thread import one_thread
from softmpc.control.stage import DISTURBANCE
from softmpc.control.step import Step
from softmpc.estimation.estimator import Estimate, Estimator
from softmpc.estimation.sensing import Sample
from softmpc.estimation.sensors import TICK, SectionTips
from softmpc.rig.supervision import Condition, State, Supervisor

__all__ = ["Act", "Pilot"]

LOG = logging.getLogger(__name__)
Array = np.ndarray
DOUBTFUL = 0.2  # s after readings contradicted the estimate in which it is not quite trusted


@dataclass(frozen=True)
class Act:
    """What the pilot did in a step."""

    u: Array
    state: State
    step: Step  # of the MPC; where it was not asked its status is the state
    estimate: Estimate  # of now
    estimate_seconds: float
    seconds: float


class Pilot:
    """Controls one arm from readings of its sensors; `delay` (ticks) is until an input acts."""

    def __init__(
        self,
        mpc: Mpc,
        estimator: Estimator,
        supervisor: Supervisor,
        guide: Guide,
        delay: int = 0,
    ) -> None:
        self.mpc, self.estimator, self.supervisor = mpc, estimator, supervisor
        self.guide, self.delay = guide, delay
        self._tips = [
            i for i, sensor in enumerate(estimator.sensors) if isinstance(sensor, SectionTips)
        ]
        self._scale = mpc.ocp.model.layout.u.scale
        self._rest_input = mpc.guard.inside(0.0 * self._scale)

    def reset(self, x: Array, u: Array, tick: int = 0) -> None:
        """Begin at a state of the controller's model and an input."""
        self.mpc.reset()
        self.supervisor.reset(tick)
        self.estimator.reset(x, u, tick)
        self.u = np.asarray(u, float).copy()
        self._pending: list[tuple[int, Array]] = []
        self._failed_steps = 0
        self._problem = ""  # of the last step
        self._broken = ""  # the estimator
        self._held_at: float | None = None  # time of the reference, in fall-back
        self._last: tuple[Estimate, Estimate] | None = None

    @one_thread
    def listen(self, tick: int, samples: Sequence[Sample]) -> None:
        """Take what has arrived, without an input: the last one is held."""
        self._estimates(tick, samples)

    @one_thread
    def step(self, tick: int, samples: Sequence[Sample]) -> Act:
        """The input from what has arrived until `tick`."""
        began = time.perf_counter()
        now, expected = self._estimates(tick, samples)
        estimated = time.perf_counter() - began
        before = self.supervisor.state
        state = self.supervisor.update(tick, self._conditions(tick, expected))
        if state >= State.FALL_BACK:
            u = self._without_mpc(tick, state)
            step = Step(u, str(state), "supervision", 0.0, 0.0)
        else:
            if before >= State.FALL_BACK:
                self.mpc.reset()
            self._held_at = None
            step = self._asked(tick, expected)
        self.u = self.mpc.guard.after(self.u, step.u)
        self._pending.append((tick + self.delay, self.u))
        took = time.perf_counter() - began
        step = replace(step, u=self.u.copy())
        return Act(self.u.copy(), state, step, now, estimated, took)

    # --- the estimate ----------------------------------------------------------------------------

    def _estimates(self, tick: int, samples: Sequence[Sample]) -> tuple[Estimate, Estimate]:
        """State and disturbance now, and when the input will act."""
        estimator, acts = self.estimator, tick + self.delay
        for since, u in [one for one in self._pending if one[0] <= tick]:
            estimator.applied(u, since)
        self._pending = [one for one in self._pending if one[0] > tick]
        try:
            estimator.receive(samples)
            now = estimator.estimate(tick)
            expected = estimator.ahead(acts, self._pending) if self.delay else now
            if not np.all(np.isfinite(expected.x)):
                raise ArithmeticError("the estimate is not finite")
            self._broken, self._last = "", (now, expected)
        except (ArithmeticError, np.linalg.LinAlgError) as error:
            LOG.warning("the estimator begins anew: %s", error)
            self._broken = f"the estimator failed: {error}"
            self._begin_anew(tick)
        assert self._last is not None
        return self._last

    def _begin_anew(self, tick: int) -> None:
        """At rest where the reference is: the best there is without an estimate."""
        given = self.guide.given(np.array([tick * TICK]))
        u = self.u
        self.estimator.reset(given["rest"][0], u, tick)
        fresh = self.estimator.estimate(tick)
        self._last = fresh, fresh

    # --- supervision -----------------------------------------------------------------------------

    def _conditions(self, tick: int, expected: Estimate) -> list[Condition]:
        """All that is not as it should be."""
        settings, found = self.supervisor.settings, []
        if self._broken:
            found.append(Condition(State.FALL_BACK, self._broken))
        for i, sensor in enumerate(self.estimator.sensors):
            age = (tick - self.estimator.health[i].good) * TICK
            usual = sensor.period * TICK + sensor.latency
            if i in self._tips and age - usual > settings.blind_after:
                found.append(Condition(State.FALL_BACK, f"no {sensor.name} for {age:.2f} s"))
            elif age - usual > settings.silent_after:
                found.append(Condition(State.DEGRADED, f"no {sensor.name} for {age:.2f} s"))
        spread = self._tip_spread(expected)
        if spread > settings.tip_spread:
            far = f"the tip is known to {1e3 * spread:.0f} mm only"
            found.append(Condition(State.FALL_BACK, far))
        doubts = self.estimator.contradicted
        if doubts and (tick - doubts[-1]) * TICK < DOUBTFUL:
            found.append(Condition(State.DEGRADED, "readings contradicted the estimate"))
        if self._failed_steps >= settings.failed_steps:
            many = f"{self._failed_steps} steps in a row: {self._problem}"
            found.append(Condition(State.FALL_BACK, many))
        elif self._problem:
            found.append(Condition(State.DEGRADED, self._problem))
        return found

    def _tip_spread(self, estimate: Estimate) -> float:
        """Standard deviation of the tip's place, m."""
        model, process = self.estimator.model, self.estimator.process
        J = (
            np.asarray(model.tip_jacobian(estimate.x[: process.n]))[-3:]
            * process.scale[: process.n]
        )
        P = estimate.P[: process.n, : process.n]
        return float(np.sqrt(max(np.trace(J @ P @ J.T), 0.0)))

    # --- the input -------------------------------------------------------------------------------

    def _asked(self, tick: int, expected: Estimate) -> Step:
        """The MPC's answer for the time at which the input acts."""
        given = self.guide.given((tick + self.delay) * TICK + self.mpc.ocp.nodes)
        if self.mpc.ocp.disturbance is not None:
            given[DISTURBANCE] = np.tile(expected.d, (self.mpc.ocp.intervals, 1))
        step = self.mpc.step(expected.x, self.u, given)
        self._problem = "" if step.solved else step.status
        self._failed_steps = 0 if step.solved else self._failed_steps + 1
        return step

    def _without_mpc(self, tick: int, state: State) -> Array:
        """What holds the reference where it was, or on the way to the arm at rest."""
        if state is State.SAFE_STOP:
            most = self._scale * self.mpc.ocp.step / self.supervisor.settings.ramp
            return np.clip(self._rest_input, self.u - most, self.u + most)
        if self._held_at is None:
            self._held_at = tick * TICK
        self._failed_steps, self._problem = 0, ""  # it will be asked again
        return np.asarray(self.guide.holding(self._held_at))
