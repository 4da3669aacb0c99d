"""The controller: good plans are kept, failed ones are not, torques stay finite and in limits."""

from dataclasses import replace

import numpy as np
import pytest

from softmpc.control.ipopt import Ipopt
from softmpc.control.mpc import RESTART_AFTER, Mpc
from softmpc.control.ocp import tracking_problem
from softmpc.control.solver import Solution
from softmpc.control.transcription import Transcription
from softmpc.model.model import build
from softmpc.model.presets import chen2022
from softmpc.model.scene import Scene
from softmpc.statics.equilibrium import find_equilibrium, pressures_from_torques

TORQUE = np.full(6, 0.8)
INTERVALS = 6


class Recorder(Ipopt):
    """IPOPT that records its guesses and fails when told to."""

    fail = False

    def solve(self, parameters, guess, multipliers=None) -> Solution:
        self.calls = [*getattr(self, "calls", []), (np.array(guess), multipliers)]
        solution = super().solve(parameters, guess, multipliers)
        if not self.fail:
            return solution
        bad = np.full_like(solution.w, np.nan)
        return replace(solution, solved=False, status="Forced", w=bad, lam_w=bad)


@pytest.fixture(scope="module")
def parts():
    model = build(Scene(chen2022()))
    t = Transcription(tracking_problem(model, INTERVALS, 0.025))
    posture = find_equilibrium(model, pressures_from_torques(model, TORQUE))
    z = model.drive.at_rest(TORQUE)
    x = np.concatenate([posture.q, np.zeros(8), z])
    return t, Recorder(t), x, posture.tips[-1]


@pytest.fixture
def loop(parts):
    t, solver, x, tip = parts
    solver.fail, solver.calls = False, []
    return Mpc(t, solver), x, np.tile(tip + [0.002, 0.001, 0], (INTERVALS, 1))


def inside(u: np.ndarray) -> bool:
    return bool(np.all(np.isfinite(u)) and np.all(u >= 0) and np.all(u <= 2.5))


def test_second_step_starts_from_the_shifted_plan(loop) -> None:
    mpc, x, target = loop
    assert mpc.step(x, TORQUE, target).solved
    good = mpc._plan.solution
    mpc.step(x, TORQUE, target)
    guess, multipliers = mpc.solver.calls[-1]
    width = mpc.transcription.nw
    assert guess[:-width] == pytest.approx(good.w[width:])
    assert multipliers is not None


@pytest.mark.parametrize("where", ["x", "u", "target"])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_input_that_is_not_finite_never_reaches_the_solver(loop, where: str, value: float) -> None:
    mpc, x, target = loop
    mpc.step(x, TORQUE, target)
    given = {"x": x.copy(), "u": TORQUE.copy(), "target": target.copy()}
    given[where].flat[1] = value
    step = mpc.step(given["x"], given["u"], given["target"])
    assert step.status == "input not finite"
    assert inside(step.u)
    assert len(mpc.solver.calls) == 1


def test_first_input_may_be_bad_too(loop) -> None:
    mpc, x, target = loop
    assert inside(mpc.step(x * np.nan, TORQUE * np.nan, target).u)


def test_failed_solve_follows_the_last_plan_and_is_never_a_warm_start(loop) -> None:
    mpc, x, target = loop
    mpc.step(x, TORQUE, target)
    plan = mpc.transcription.split(mpc._plan.solution.w)[0]
    mpc.solver.fail = True
    for k in range(1, INTERVALS + 4):
        step = mpc.step(x, TORQUE, target)
        assert step.status == "failed: Forced"
        assert inside(step.u)
        expected = plan[k] if k < INTERVALS else TORQUE
        assert step.u == pytest.approx(np.clip(expected, 0, 2.5))
    for guess, multipliers in mpc.solver.calls:
        assert np.all(np.isfinite(guess))
        assert multipliers is None or np.all(np.isfinite(multipliers.lam_w))


def test_restarts_from_rest_after_some_failures(loop) -> None:
    mpc, x, target = loop
    mpc.step(x, TORQUE, target)
    mpc.solver.fail = True
    for _ in range(RESTART_AFTER + 1):
        mpc.step(x, TORQUE, target)
    assert mpc.solver.calls[-1][1] is None
    mpc.solver.fail = False
    assert mpc.step(x, TORQUE, target).solved


@pytest.mark.parametrize("far", [(0.5, 0, 0), (0, 0, -1.0), (3.0, 3.0, 3.0)])
def test_unreachable_targets_keep_torque_in_limits(loop, far: tuple[float, ...]) -> None:
    mpc, x, target = loop
    u = TORQUE
    for _ in range(3):
        step = mpc.step(x, u, target + np.array(far))
        assert inside(step.u)
        assert step.solved or step.worst
        u = step.u


def test_same_input_same_torque(loop, parts) -> None:
    mpc, x, target = loop
    first = [mpc.step(x, TORQUE, target).u for _ in range(2)]
    other = Mpc(parts[0], parts[1])
    assert np.array_equal(first, [other.step(x, TORQUE, target).u for _ in range(2)])
