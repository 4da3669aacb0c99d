"""The motions of the paper's figures: settling times, overshoot, planes, and their inputs."""

from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

from softmpc.simulation.inputs import InputProfile, Ramp, Step
from softmpc.simulation.result import Simulation
from softmpc.simulation.run import simulate_file
from softmpc.simulation.settling import last_move, overshoot, settling_time

EXAMPLES = Path(__file__).parent.parent / "examples"


@cache
def example(name: str) -> Simulation:
    return simulate_file(EXAMPLES / f"{name}.toml")


@pytest.mark.slow
def test_settling_times_are_those_of_the_paper() -> None:
    """Printed: at rest within 1 s (Fig. 6) and 1.5 s (Fig. 7); not in a flash either."""
    assert 0.7 < settling_time(example("step_fig6")) < 1.0
    assert 0.7 < settling_time(example("step_fig7")) < 1.5
    # Ramps: counted from their end, when the tip has nearly arrived.
    assert settling_time(example("ramp_fig8")) < 0.7
    assert settling_time(example("ramp_fig14")) < 0.5


def test_steps_oscillate_and_ramps_hardly() -> None:
    """Figs 6, 7 against Fig. 8, and Fig. 12 against Fig. 14: how far the tip swings too far."""
    names = ("step_fig6", "step_fig7", "ramp_fig8", "step_fig12", "ramp_fig14")
    beyond = {name: overshoot(example(name)) for name in names}
    assert 0.08 < beyond["step_fig6"] < 0.14
    assert 0.18 < beyond["step_fig7"] < 0.30
    assert 0.01 < beyond["ramp_fig8"] < 0.05
    assert beyond["ramp_fig8"] < beyond["step_fig6"] / 2
    assert beyond["ramp_fig14"] < beyond["step_fig12"] / 4


def test_ramps_are_slower_at_the_tip() -> None:
    """The speeds of Figs 6 and 8: the step throws the tip, the ramp moves it."""
    step, ramp = example("step_fig6").tip_speeds, example("ramp_fig8").tip_speeds
    assert 2.0 < step[:, -1].max() < 5.0
    assert ramp[:, -1].max() < step[:, -1].max() / 5


def test_fig6_stays_in_a_plane_and_fig7_bends_both_ways() -> None:
    plane = example("step_fig6")
    assert np.abs(plane.tips[:, :, 1]).max() < 1e-6
    assert np.ptp(plane.tips[:, -1], axis=0)[[0, 2]].min() > 0.2
    assert max(np.abs(plane[f"kappa_{axis}_{s}_1"]).max() for axis in "xz" for s in (1, 2)) < 1e-5
    assert all(plane[f"kappa_y_{s}_1"][-1] < -1 for s in (1, 2))
    assert example("step_fig7")["kappa_y_1_1"][-1] < -1
    assert example("step_fig7")["kappa_y_2_1"][-1] > 1


# ---------------------------------------------------------------- settling and overshoot


def swing(damping: float, duration: float = 6.0) -> Any:
    """Response of a damped oscillator to a step at 1 s, its tip going along an oblique line."""
    time = np.arange(0.0, duration, 1e-3)
    way = np.where(time > 1, response(damping, np.maximum(time - 1, 0)), 0.0)
    tips = np.multiply.outer(way, [[0.0, 0.0, 0.1], [0.3, -0.2, 0.1]])
    profile = InputProfile.of(1, [Step(1, 0.2, 9.0), Step(1, 1.0, 5.0)])
    return SimpleNamespace(time=time, tips=tips, profile=profile)


def response(damping: float, t: Any) -> Any:
    own = 10.0 * np.sqrt(1 - damping**2)
    phase = np.cos(own * t) + 10.0 * damping / own * np.sin(own * t)
    return 1 - np.exp(-10.0 * damping * t) * phase


@pytest.mark.parametrize("damping", [0.2, 0.4, 0.7])
def test_against_a_damped_oscillator(damping: float) -> None:
    motion = swing(damping)
    share = np.exp(-np.pi * damping / np.sqrt(1 - damping**2))
    assert overshoot(motion) == pytest.approx(share, rel=1e-4)
    ends = np.linspace(0, 4, 4001)
    last = ends[np.flatnonzero(np.abs(response(damping, ends) - 1) > 0.02)[-1]]
    root = brentq(lambda t: abs(response(damping, t) - 1) - 0.02, last, last + 1e-3, disp=True)
    assert settling_time(motion) == pytest.approx(root, abs=3e-4)  # samples: 1e-3 s
    assert settling_time(motion, band=0.1) < settling_time(motion)


def test_what_has_not_settled_has_no_end() -> None:
    motion = swing(0.05, duration=3.0)
    assert np.isnan(settling_time(motion))
    assert np.isnan(overshoot(motion))
    still = SimpleNamespace(**{**vars(motion), "tips": 0 * motion.tips})
    assert np.isnan(settling_time(still))
    before = SimpleNamespace(**{k: v[:500] for k, v in vars(motion).items() if k != "profile"})
    before.profile = motion.profile  # ended before the last move began
    assert np.isnan(settling_time(before))


def test_last_move() -> None:
    assert last_move(InputProfile.constant([1.0, 2.0])) == (0.0, 0.0)
    steps = InputProfile.of(2, [Step(1, 0.5, 1.0), Step(2, 2.0, 1.0)])
    assert last_move(steps) == (2.0, 2.0)
    ramps = InputProfile.of(2, [Ramp(1, 0.0, 1.0, 1.0), Ramp(1, 3.0, 4.0, 1.0), Ramp(2, 3.5, 5, 1)])
    assert last_move(ramps) == (3.0, 5.0)


def test_examples_follow_the_paper() -> None:
    at = {"ramp_fig8": 2.5, "step_fig12": 6.0, "ramp_fig14": 7.0}
    torques = {name: example(name).u[round(100 * t)] for name, t in at.items()}
    np.testing.assert_allclose(torques["ramp_fig8"], [0, 0, 0, 0, 0.75, 0.75], atol=1e-12)
    np.testing.assert_allclose(torques["step_fig12"], [1.5, 0, 0, 1.5, 0, 0])
    np.testing.assert_allclose(torques["ramp_fig14"], [0.75, 0, 0, 1.5, 0, 0], atol=1e-12)
    assert [example(name).duration_s for name in at] == [10.0] * 3
