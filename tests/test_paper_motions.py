"""The motions of the paper's figures: settling times, overshoot, planes, and their inputs."""

from functools import cache
from pathlib import Path

import numpy as np

from softmpc.simulation.result import Simulation
from softmpc.simulation.run import simulate_file

EXAMPLES = Path(__file__).parent.parent / "examples"


@cache
def example(name: str) -> Simulation:
    return simulate_file(EXAMPLES / f"{name}.toml")


def settling_time(motion: Simulation) -> float:
    """Time after which the arm's tip stays within 2 % of its travel around where it ends."""
    tip = motion.tips[:, -1]
    away = np.linalg.norm(tip - tip[-1], axis=1)
    return float(motion.time[np.flatnonzero(away > 0.02 * away[0])[-1]])


def test_settling_times_are_those_of_the_paper() -> None:
    assert settling_time(example("step_fig6")) < 1.0
    assert settling_time(example("step_fig7")) < 1.5


def test_steps_oscillate_and_ramps_hardly() -> None:
    """Figs 6, 7 against Fig. 8, and Fig. 12 against Fig. 14: how far the tip swings too far."""
    overshoot = {}
    for name in ("step_fig6", "step_fig7", "ramp_fig8", "step_fig12", "ramp_fig14"):
        x = example(name).tips[:, -1, 0]
        overshoot[name] = (np.abs(x).max() - abs(x[-1])) / abs(x[-1])
    assert overshoot["step_fig7"] > 0.1
    assert overshoot["ramp_fig8"] < overshoot["step_fig6"] / 2
    assert overshoot["ramp_fig14"] < overshoot["step_fig12"] / 2


def test_fig6_stays_in_a_plane_and_fig7_bends_both_ways() -> None:
    plane = example("step_fig6")
    assert np.abs(plane.tips[:, :, 1]).max() < 1e-6
    names = plane.titles["q"]
    ky = [names.index(f"kappa_y_{s}_1 [1/m]") for s in (1, 2)]
    assert np.all(plane.q[-1, ky] < -1)
    first, second = example("step_fig7").q[-1, ky]
    assert first < -1
    assert second > 1


def test_examples_follow_the_paper() -> None:
    at = {"ramp_fig8": 2.5, "step_fig12": 6.0, "ramp_fig14": 7.0}
    torques = {name: example(name).u[round(100 * t)] for name, t in at.items()}
    np.testing.assert_allclose(torques["ramp_fig8"], [0, 0, 0, 0, 0.75, 0.75], atol=1e-12)
    np.testing.assert_allclose(torques["step_fig12"], [1.5, 0, 0, 1.5, 0, 0])
    np.testing.assert_allclose(torques["ramp_fig14"], [0.75, 0, 0, 1.5, 0, 0], atol=1e-12)
    assert [example(name).duration_s for name in at] == [10.0] * 3
