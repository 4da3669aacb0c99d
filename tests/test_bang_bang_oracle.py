"""The oracle for least time against textbook answers, Pontryagin's principle and the package."""

from __future__ import annotations

from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from arms import numbers
from numpy.testing import assert_allclose
from oracles.bang_bang import (
    BangBang,
    Linear,
    Swing,
    elongation_swing,
    held_least_time,
    least_time,
    stretching,
)
from scipy.integrate import solve_ivp

from softmpc.model.actuation import Actuation, HydraulicDrive, PressureDrive, SlowDrive
from softmpc.model.model import build

DRIVES = (PressureDrive(), SlowDrive(), HydraulicDrive())
MASS = Linear(np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([0.0, 1.0]), -2.0, 2.0)
SPRING = Linear(np.array([[0.0, 1.0], [-1.0, 0.0]]), np.array([0.0, 1.0]), -1.0, 1.0)
DECAY = Linear(np.diag([-1.0, -3.0, -10.0, -50.0]), np.array([1.0, 3.0, 10.0, 50.0]), 0.0, 1.0)


@cache
def swing(drive: Actuation) -> Swing:
    return elongation_swing(drive)


def check_pontryagin(motion: BangBang) -> None:
    """High where σ is positive, low where it is negative; it vanishes at the switches alone."""
    ends = np.concatenate([[0.0], motion.switches, [motion.time]])
    inside = [np.linspace(a, b, 402)[1:-1] for a, b in pairwise(ends)]
    times = np.concatenate(inside)
    sigma = motion.switching(times)
    assert np.array_equal(sigma > 0, motion.input(times) == motion.system.high)
    assert np.count_nonzero(np.diff(np.sign(sigma))) == len(motion.switches)
    size = np.abs(sigma).max()
    assert np.abs(motion.switching(motion.switches)).max() < 1e-9 * size


# ---------------------------------------------------------------- textbook answers


@pytest.mark.parametrize("distance", [0.02, 3.0])
def test_a_mass_is_pushed_half_the_way(distance: float) -> None:
    found = least_time(MASS, [0, 0], [distance, 0], 10.0)
    assert found.time == pytest.approx(2 * np.sqrt(distance / 2.0), rel=1e-9)
    assert_allclose(found.switches, [found.time / 2], rtol=1e-9)
    check_pontryagin(found)


@pytest.mark.parametrize("band", [0.0, 0.5])
def test_even_pieces_push_a_mass_as_well(band: float) -> None:
    """The switch is at a node; a band of the end is so much less way."""
    found = held_least_time(MASS, [0, 0], [3, 0], 10.0, 10, [band, 0.0])
    assert found == pytest.approx(2 * np.sqrt((3 - band) / 2.0), rel=1e-6)


@pytest.mark.parametrize("start, end", [(-0.5, 0.5), (-0.9, 0.1), (0.0, 0.8)])
def test_an_oscillator_goes_along_two_circles(start: float, end: float) -> None:
    """About the points that full input holds, 2 apart; the angles of the triangle are the times."""
    first, last = 1 - start, 1 + end
    spans = [np.arccos((a**2 + 4 - b**2) / (4 * a)) for a, b in ((first, last), (last, first))]
    found = least_time(SPRING, [start, 0], [end, 0], 10.0)
    assert_allclose([*found.switches, found.time], np.cumsum(spans), rtol=1e-9)
    check_pontryagin(found)


def test_an_oscillator_far_out_is_caught_in_half_periods() -> None:
    found = least_time(SPRING, [-5, 0], [0, 0], 40.0)
    assert_allclose(np.diff(found.switches), np.pi, rtol=1e-9)
    assert len(found.switches) == 3
    check_pontryagin(found)


def test_four_real_modes_take_three_switches() -> None:
    found = least_time(DECAY, DECAY.at_rest(0.2), DECAY.at_rest(0.8), 10.0)
    assert len(found.switches) == 3
    check_pontryagin(found)


# ---------------------------------------------------------------- an arm that can only stretch


@pytest.mark.parametrize("drive", DRIVES, ids=lambda drive: drive.name)
def test_the_stretching_arm_is_linear(drive: Actuation) -> None:
    """The equations written by hand are those of the package, far from rest too."""
    model = build(swing(drive).scene)
    system, random = stretching(model.scene, 5.0), np.random.default_rng(2)
    scale = model.layout.x.scale[[0, 1, *range(2, len(model.layout.x), 3)]]
    for _ in range(5):
        x, u = random.uniform(-1, 1, len(system.A)) * scale, random.uniform(system.low, system.high)
        found = numbers(model.x_dot([*x[:2], *np.repeat(x[2:], 3)], [u] * 3))
        wanted = system.A @ x + system.b * u + system.c
        assert_allclose(found[:2], wanted[:2], rtol=1e-11, atol=1e-9)
        assert_allclose(found[2:], np.repeat(wanted[2:], 3), rtol=1e-11)


@pytest.mark.parametrize("drive", DRIVES, ids=lambda drive: drive.name)
def test_the_swing_of_least_time(drive: Actuation) -> None:
    """As many switches as modes less one; the package's arm comes to rest where it should."""
    found = swing(drive)
    motion, model = found.motion, build(found.scene)
    assert len(found.switches) == len(found.states[0]) - 1
    check_pontryagin(motion)
    x = np.concatenate([found.states[0][:2], np.repeat(found.states[0][2:], 3)])
    times = [0.0, *found.switches, found.time]
    for (begin, end), u in zip(pairwise(times), motion.inputs, strict=True):
        run = solve_ivp(
            lambda t, x, u=u: numbers(model.x_dot(x, [u] * 3)),
            (begin, end), x, "Radau", rtol=1e-8, atol=1e-9 * model.layout.x.scale,
        )  # fmt: skip
        x = run.y[:, -1]
    goal = np.concatenate([found.states[1][:2], np.repeat(found.states[1][2:], 3)])
    assert_allclose(x / model.layout.x.scale, goal / model.layout.x.scale, atol=1e-6)
    assert float(model.tip(x[:1])[2]) == pytest.approx(found.heights[1], abs=1e-7)


def test_pieces_cost_time_and_fine_ones_hardly_any() -> None:
    found = swing(PressureDrive())
    times = [
        held_least_time(found.motion.system, *found.states, 1.0, pieces) for pieces in (10, 40, 160)
    ]
    longer = np.array(times) / found.time - 1
    assert np.all(longer > -1e-6) and longer[2] < 1e-4 < longer[0]
