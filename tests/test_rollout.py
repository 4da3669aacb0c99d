"""Plans simulated anew: all intervals at once and one by one are two ways to one trajectory."""

import numpy as np
import pytest

import softmpc.control.rollout as module
from softmpc.control.linearisation import Linearisation
from softmpc.control.ocp import tracking_problem
from softmpc.control.rollout import Rollout
from softmpc.control.trajectory import Moment, Trajectory
from softmpc.control.transcription import Transcription
from softmpc.model.model import build
from softmpc.model.presets import chen2022
from softmpc.model.scene import Scene
from softmpc.statics.equilibrium import find_equilibrium, pressures_from_torques

TORQUE = np.full(6, 0.8)


@pytest.fixture(scope="module")
def linearisation() -> Linearisation:
    model = build(Scene(chen2022()))
    return Linearisation(Transcription(tracking_problem(model, 6, 0.025)), "never")


@pytest.fixture(scope="module")
def moment(linearisation: Linearisation) -> Moment:
    t = linearisation.t
    posture = find_equilibrium(t.model, pressures_from_torques(t.model, TORQUE))
    x = np.concatenate([posture.q, np.zeros(t.n), t.model.drive.at_rest(TORQUE)])
    return Moment(x / t.x_scale, t.decisions(TORQUE), np.zeros((t.N, t.nr)))


def broken(t: Transcription, moment: Moment, amount: float) -> np.ndarray:
    """Inputs far from those that hold the arm, with states and accelerations that do not fit."""
    rng = np.random.default_rng(4)
    u = np.tile(moment.u_before, (t.N, 1))
    u[:, :6] += 0.3 * rng.normal(size=(t.N, 6))
    a, x = amount * rng.normal(size=(t.N, t.na)), np.tile(moment.x, (t.N, 1))
    return Trajectory(u, a, x + amount * rng.normal(size=x.shape)).w


def defects(linearisation: Linearisation, moment: Moment, w: np.ndarray) -> float:
    at = Trajectory.of(linearisation.t, w)
    return float(np.abs(linearisation.measure(moment, at).defects).max())


def test_both_ways_end_in_one_trajectory(
    linearisation: Linearisation, moment: Moment, monkeypatch: pytest.MonkeyPatch
) -> None:
    t = linearisation.t
    w = broken(t, moment, 0.01)
    assert defects(linearisation, moment, w) > 0.1
    monkeypatch.setattr(module, "AT_ONCE", 1e-8)
    monkeypatch.setattr(Rollout, "one_by_one", lambda *_: None)
    at_once = Rollout(t, linearisation)(moment, w)
    monkeypatch.undo()
    one_by_one = Rollout(t)(moment, w)
    assert at_once is not None and one_by_one is not None
    assert at_once == pytest.approx(one_by_one, abs=1e-5)
    assert defects(linearisation, moment, one_by_one) < 1e-6
    u = Trajectory.of(t, w).u
    low, high = (bound[: t.nu] for bound in t.variable_bounds())
    assert np.array_equal(Trajectory.of(t, at_once).u, np.clip(u, low, high))


def test_at_once_goes_as_far_as_it_says(linearisation: Linearisation, moment: Moment) -> None:
    t = linearisation.t
    found = Rollout(t, linearisation)(moment, broken(t, moment, 0.01))
    assert found is not None and defects(linearisation, moment, found) <= module.AT_ONCE


def test_interval_by_interval_where_it_does_not_get_there(
    linearisation: Linearisation, moment: Moment
) -> None:
    """From so far away the first step on all intervals makes it worse; one interval is easier."""
    t = linearisation.t
    w = broken(t, moment, 0.1)
    rollout = Rollout(t, linearisation)
    assert rollout._at_once(moment, Trajectory.of(t, w)) is None
    found = rollout(moment, w)
    assert found is not None and defects(linearisation, moment, found) < 1e-6
