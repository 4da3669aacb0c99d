"""Each way a controller can fail, provoked: what it does then, and that it recovers.

Whatever happens the input is finite, within the limits of torque and of torque rate, and the step
says what happened.
"""

from __future__ import annotations

import threading
import time
from dataclasses import replace

import numpy as np
import pytest

from softmpc.control.closed_loop import start_at
from softmpc.control.costs import StrainRate, TipPosition, Torque, TorqueRate
from softmpc.control.ipopt import Ipopt
from softmpc.control.limits import PressureLimit, TorqueLimit, TorqueRateLimit
from softmpc.control.mpc import RESTART_AFTER, Mpc
from softmpc.control.ocp import Ocp
from softmpc.control.real_time import RealTime
from softmpc.control.step import Step
from softmpc.control.transcription import Transcription
from softmpc.errors import InputError
from softmpc.model.model import Model, build
from softmpc.model.presets import chen2022
from softmpc.model.scene import Scene
from softmpc.simulation.runge_kutta import RadauIIA
from softmpc.statics.equilibrium import find_equilibrium, pressures_from_torques

TORQUE, HIGHEST, RATE = np.full(6, 0.8), 2.5, 0.4
INTERVALS, STEP = 8, 0.025
COSTS = (TipPosition(), Torque(), TorqueRate(), StrainRate())
LIMITS = (
    TorqueLimit(0.0, HIGHEST), TorqueRateLimit(-RATE, RATE), PressureLimit(0.0, 1e6, soft=1e-4),
)  # fmt: skip


class Arm:
    """A plant with a controller: steps, and checks every input."""

    def __init__(self, model: Model, solver, **options) -> None:
        self.model, self.plant = model, RadauIIA(model, tolerance=1e-5)
        self.mpc = Mpc(solver.transcription, solver, **options)
        posture = find_equilibrium(model, pressures_from_torques(model, TORQUE))
        start = start_at(model, posture)
        self.x, self.u, self.home = start.x, start.u, posture.tips[-1]
        self.steps: list[Step] = []

    def step(self, target=(0.0, 0.0, 0.0), x=None) -> Step:
        """Towards a place beside the one at rest (3, m), or a path of them (N×3)."""
        given = np.broadcast_to(self.home + np.asarray(target), (INTERVALS, 3))
        step = self.mpc.step(self.x if x is None else x, self.u, given)
        assert np.all(np.isfinite(step.u))
        assert np.all(step.u >= 0.0) and np.all(step.u <= HIGHEST)
        assert np.abs(step.u - self.u).max() <= RATE + 1e-9
        assert step.seconds >= step.feedback_seconds > 0
        self.x, self.u = self.plant.advance(self.x, step.u, STEP)[-1], step.u
        self.steps.append(step)
        return step

    @property
    def off(self) -> float:
        """Distance of the tip from home."""
        return float(np.linalg.norm(np.asarray(self.model.tip(self.x[:8])).ravel() - self.home))

    def recovers(self, within: int = 30) -> None:
        """Home again, every step solved."""
        for _ in range(within):
            self.step()
        assert all(step.solved for step in self.steps[-10:])
        assert self.off < 1e-4


@pytest.fixture(scope="module")
def model() -> Model:
    return build(Scene(chen2022()))


@pytest.fixture(scope="module")
def transcription(model: Model) -> Transcription:
    return Transcription(Ocp(model, INTERVALS, STEP, COSTS, LIMITS))


@pytest.fixture
def arm(model: Model, transcription: Transcription) -> Arm:
    return Arm(model, RealTime(transcription, mode="never"))


class Broken(RealTime):
    """Real-time iteration that fails as it is told."""

    fault = ""

    def feedback(self, x, time_limit=None):
        found = super().feedback(x, time_limit)
        if self.fault == "raises":
            raise RuntimeError("the evaluation failed\nat some place")
        if self.fault == "NaN":
            return replace(found, w=np.full_like(found.w, np.nan))
        if self.fault == "late":
            time.sleep(0.06)
        return found


@pytest.fixture
def broken(model: Model, transcription: Transcription) -> Arm:
    return Arm(model, Broken(transcription, mode="never"), budget=None)


def test_prepare_and_feedback_are_a_step(model: Model, transcription: Transcription) -> None:
    whole, parts = (Arm(model, RealTime(transcription, mode="never")) for _ in range(2))
    given = np.tile(whole.home + [0.01, 0, 0], (INTERVALS, 1))
    for _ in range(4):
        first = whole.mpc.step(whole.x, whole.u, given)
        parts.mpc.prepare(given, None if parts.steps else parts.u)
        second = parts.mpc.feedback(whole.x)
        parts.steps.append(second)
        assert np.array_equal(first.u, second.u)
        whole.x, whole.u = whole.plant.advance(whole.x, first.u, STEP)[-1], first.u
    assert second.prepare_seconds > 1e-4  # between samples
    with pytest.raises(InputError, match="call `prepare` before"):
        parts.mpc.feedback(whole.x)


def test_infeasible_start(model: Model, transcription: Transcription) -> None:
    """Pressure above a hard limit that no torque can mend in a step; it falls by itself."""
    limits = (*LIMITS[:2], PressureLimit(0.0, 0.36e6))
    arm = Arm(
        model, RealTime(Transcription(replace(transcription.ocp, limits=limits)), mode="never")
    )
    above = arm.plant.advance(arm.x, np.full(6, 1.6), 0.1)[-1]
    arm.x, arm.u = above, np.full(6, 1.6)
    step = arm.step()
    assert step.status == "failed: QP infeasible" and step.source == "held input"
    assert step.worst.count("P_") == 3 and step.worst.count(" Pa") == 3
    assert "in interval 8 by 2.8e+05 Pa" in step.worst
    assert step.qp == "infeasible"
    arm.u = TORQUE.copy()
    arm.x = arm.plant.advance(arm.x, TORQUE, 0.5)[-1]  # somebody else lets the pressure go
    arm.recovers()


@pytest.mark.parametrize("solver", [Ipopt, RealTime])
def test_iteration_cap(model: Model, transcription: Transcription, solver) -> None:
    few = {"max_iterations": 2} if solver is Ipopt else {"iterations": 2, "mode": "never"}
    arm = Arm(model, solver(transcription, **few))
    step = arm.step((0.05, 0.02, 0.0))
    assert step.status == "iteration cap" and not step.solved and step.iterations == 2
    used = step.violation <= 1e-4
    assert step.source == ("solution" if used else "held input")
    assert step.worst or used
    for _ in range(RESTART_AFTER + 1):
        arm.step((0.05, 0.02, 0.0))
    if solver is RealTime:
        arm.mpc.solver.iterations = 30
        arm.recovers()


def test_late_result_is_the_plan_of_the_next_step(broken: Arm) -> None:
    """The input of the plan before now; the late result in the next step."""
    mpc = broken.mpc
    broken.step((0.003, 0, 0))
    broken.step((0.003, 0, 0))
    before = mpc._plan.input
    mpc.budget, mpc.solver.fault = 0.05, "late"
    step = broken.step((0.003, 0, 0))
    assert step.status == "budget overrun" and step.source == "shifted plan"
    assert step.seconds > 0.05
    assert step.u == pytest.approx(before, abs=1e-12)
    planned = mpc._plan.input  # of the late result
    again = broken.step((0.003, 0, 0))
    assert again.u == pytest.approx(planned, abs=1e-12)
    assert mpc._failures == 0
    mpc.budget, mpc.solver.fault = None, ""
    broken.recovers()


def test_late_first_result_leaves_the_input_where_it_is(broken: Arm) -> None:
    broken.mpc.budget, broken.mpc.solver.fault = 0.05, "late"
    step = broken.step((0.003, 0, 0))
    assert step.status == "budget overrun" and step.source == "held input"
    assert step.u == pytest.approx(TORQUE, abs=1e-12) and not step.clipped


def test_quadratic_program_has_what_is_left_of_the_budget(
    model: Model, transcription: Transcription
) -> None:
    given: list[float | None] = []

    class Asked(RealTime):
        def feedback(self, x, time_limit=None):
            given.append(time_limit)
            return super().feedback(x, time_limit)

    arm = Arm(model, Asked(transcription, mode="never"), budget=10.0)
    first, second = arm.step(), arm.step()
    assert given[0] < 10.0 - first.prepare_seconds and given[1] < 10.0 - second.prepare_seconds
    assert given[1] > 10.0 - second.seconds
    arm.mpc.budget = 1e-6  # nothing is left: as much once more, for the next step
    assert arm.step().status == "budget overrun"
    assert given[2] == 1e-6
    arm.mpc.budget = None
    arm.recovers()
    assert given[-1] is None


@pytest.mark.parametrize(
    "fault, status",
    [
        ("raises", "failed: RuntimeError: the evaluation failed"),
        ("NaN", "failed: result not finite"),
    ],
)
def test_broken_solver(broken: Arm, fault: str, status: str) -> None:
    """The plan is followed to its end, then the input is held; then everything works again."""
    for _ in range(3):
        broken.step((0.01, 0, 0))
    plan = broken.mpc._plan
    broken.mpc.solver.fault = fault
    for k in range(INTERVALS + 3):
        step = broken.step((0.01, 0, 0))
        assert step.status == status
        if k < INTERVALS - 1:
            assert step.source == "shifted plan"
            assert step.u == pytest.approx(plan.input, abs=1e-9)
            plan = plan.older()
        else:
            assert step.source == "held input"
            assert np.array_equal(step.u, broken.steps[-2].u)
    assert all(np.isfinite(broken.mpc._plan.solution.w))
    broken.mpc.solver.fault = ""
    broken.recovers()


def test_prepare_that_raises_is_a_failed_step(arm: Arm, monkeypatch: pytest.MonkeyPatch) -> None:
    arm.step()

    def singular(*_) -> None:
        raise np.linalg.LinAlgError("Singular matrix")

    with monkeypatch.context() as patch:
        patch.setattr(arm.mpc.solver, "prepare", singular)
        assert arm.step().status == "failed: LinAlgError: Singular matrix"
    arm.recovers()


def test_measurements_that_are_not_finite(arm: Arm) -> None:
    for _ in range(3):
        arm.step((0.01, 0, 0))
    for _ in range(RESTART_AFTER + 1):
        step = arm.step((0.01, 0, 0), x=np.full_like(arm.x, np.nan))
        assert step.status == "input not finite" and step.source == "shifted plan"
    assert arm.step((np.nan, 0, 0)).status == "input not finite"
    arm.recovers()


def test_target_out_of_reach(arm: Arm) -> None:
    """Two metres away: torque saturates for seconds, and comes back at once."""
    for _ in range(60):
        arm.step((1.5, 0.5, 1.2))
    inputs = np.array([step.u for step in arm.steps[20:]])
    saturated = (inputs < 1e-6) | (inputs > HIGHEST - 1e-6)
    assert np.all(saturated.any(axis=1))
    assert np.abs(np.diff(inputs, axis=0)).sum(axis=0).max() < 2 * HIGHEST  # no chattering
    assert all(step.solved for step in arm.steps)
    arm.recovers(40)


def test_path_faster_than_the_arm(arm: Arm) -> None:
    """Ten laps a second of 20 cm: bounded, and home again afterwards."""
    for k in range(40):
        t = STEP * (k + 1 + np.arange(INTERVALS))
        circle = np.stack([np.cos(20 * np.pi * t), np.sin(20 * np.pi * t), 0 * t], axis=1)
        arm.step(0.1 * circle)
    assert arm.off < 0.3
    arm.recovers(40)


def test_input_outside_its_limits_comes_back(arm: Arm) -> None:
    """An input before that is too high: the limit of torque goes before that of its rate."""
    guard = arm.mpc.guard
    assert np.array_equal(guard.after(np.full(6, 4.0), TORQUE), np.full(6, HIGHEST))
    assert np.array_equal(guard.after(TORQUE, np.full(6, 2.0)), TORQUE + RATE)
    assert np.array_equal(guard.after(TORQUE, np.zeros(6)), TORQUE - RATE)
    step = arm.mpc.step(arm.x, np.full(6, 4.0), np.tile(arm.home, (INTERVALS, 1)))
    assert step.status == "failed: QP infeasible" and step.worst.startswith("dT_1 in interval 1 by")
    assert np.all(step.u == HIGHEST) and step.clipped
    arm.recovers()


def test_wrong_sizes_and_options_are_said(arm: Arm) -> None:
    given = np.tile(arm.home, (INTERVALS, 1))
    with pytest.raises(InputError, match="x has 3 numbers; this arm needs 34"):
        arm.mpc.step(np.zeros(3), arm.u, given)
    with pytest.raises(InputError, match="u_before has 1 numbers"):
        arm.mpc.step(arm.x, np.zeros(1), given)
    with pytest.raises(InputError, match="first step needs `u_before`"):
        Mpc(arm.mpc.transcription, arm.mpc.solver).prepare(given)
    for budget in (0.0, -1.0, float("inf"), float("nan")):
        with pytest.raises(InputError, match="budget"):
            Mpc(arm.mpc.transcription, arm.mpc.solver, budget=budget)
    with pytest.raises(InputError, match="restart_after"):
        Mpc(arm.mpc.transcription, arm.mpc.solver, restart_after=0)


def test_two_threads_and_two_runs_give_the_same(model: Model, transcription: Transcription) -> None:
    """Two controllers of one transcription, alone and side by side, bit for bit."""
    targets = {"left": (0.02, 0.0, 0.0), "right": (-0.01, 0.02, 0.01)}

    def run(name: str, found: dict[str, np.ndarray]) -> None:
        arm = Arm(model, RealTime(transcription, mode="never"))
        found[name] = np.array([arm.step(targets[name]).u for _ in range(12)])

    alone: dict[str, np.ndarray] = {}
    together: dict[str, np.ndarray] = {}
    for name in targets:
        run(name, alone)
    threads = [threading.Thread(target=run, args=(name, together)) for name in targets]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for name in targets:
        assert np.array_equal(alone[name], together[name])


def test_many_failures_in_a_row_do_not_flood_the_log(
    model: Model, caplog: pytest.LogCaptureFixture
) -> None:
    """The first, second, fourth … are warnings; -v has all of them."""
    limits = (TorqueLimit(0.0, HIGHEST), TorqueRateLimit(-RATE, RATE), PressureLimit(0.0, 1e4))
    transcription = Transcription(Ocp(model, INTERVALS, STEP, COSTS, limits))
    arm = Arm(model, RealTime(transcription))
    caplog.set_level("INFO", "softmpc.control.mpc")
    for _ in range(5):
        assert not arm.step().solved
    said = [one.levelname for one in caplog.records if "in a row" in one.getMessage()]
    assert said == ["WARNING", "WARNING", "INFO", "WARNING", "INFO"]
