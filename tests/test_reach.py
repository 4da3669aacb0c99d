"""Postures that hold the tip, and the distance to the workspace's edge."""

from dataclasses import replace

import numpy as np
import pytest

from softmpc.errors import InputError
from softmpc.model.actuation import PressureDrive
from softmpc.model.model import Model, build
from softmpc.model.presets import chen2022
from softmpc.model.scene import Scene
from softmpc.statics.equilibrium import find_equilibrium
from softmpc.statics.reach import Reach, pressure_range

DOWN = np.array([0.0, 0.0, 1.0])


@pytest.fixture(scope="module")
def model() -> Model:
    return build(Scene(chen2022()))


@pytest.fixture(scope="module")
def reach(model: Model) -> Reach:
    return Reach(model)


@pytest.mark.parametrize("place", [(0, 0, 0.6), (0.1, -0.05, 0.58), (-0.2, 0.1, 0.5)])
def test_posture_holds_the_tip_within_the_pressures(reach: Reach, model: Model, place) -> None:
    found = reach.posture(np.array(place))
    assert found is not None
    assert found.stable
    assert found.tips[-1] == pytest.approx(place, abs=1e-7)
    low, high = pressure_range(model)
    assert np.all(found.pressures >= low - 1) and np.all(found.pressures <= high + 1)
    again = find_equilibrium(model, found.pressures)
    assert again.tips[-1] == pytest.approx(place, abs=1e-6)


def test_every_tip_of_random_pressures_is_found(model: Model) -> None:
    """One start misses about a quarter of these; a few starts miss none."""
    reach, rng = Reach(model), np.random.default_rng(0)
    low, high = pressure_range(model)
    for _ in range(60):
        share = rng.choice([0.0, 1.0], 6) * rng.uniform(size=6)
        tip = find_equilibrium(model, low + share * (high - low)).tips[-1]
        assert reach.posture(tip) is not None, tip


def test_straight_down_the_edge_is_full_and_zero_pressure(reach: Reach, model: Model) -> None:
    """On the axis the arm is longest at full pressure and shortest at none."""
    low, high = pressure_range(model)
    place = np.array([0, 0, 0.6])
    lowest = find_equilibrium(model, low).tips[-1, 2]
    highest = find_equilibrium(model, high).tips[-1, 2]
    assert reach.to_edge(place, DOWN) == pytest.approx(highest - 0.6, abs=1e-6)
    assert reach.to_edge(place, -DOWN) <= 0.6 - lowest + 1e-6


def test_out_of_reach_gives_the_nearest_posture(reach: Reach, model: Model) -> None:
    """Straight below the arm the nearest place is the tip at full pressure."""
    longest = find_equilibrium(model, pressure_range(model)[1]).tips[-1, 2]
    found, distance = reach.nearest(np.array([0, 0, longest + 0.1]))
    assert found is not None
    assert distance == pytest.approx(0.1, abs=1e-5)
    assert found.tips[-1] == pytest.approx([0, 0, longest], abs=1e-4)
    assert reach.posture(np.array([0, 0, longest + 0.1])) is None


def test_fewer_units_than_directions(model: Model) -> None:
    """One unit: the tip has a curve to live on, places beside it are out of reach."""
    sections = (replace(chen2022().sections[0], unit_angles=(0.0,)),)
    single = build(Scene(replace(chen2022(), sections=sections)))
    on_curve = find_equilibrium(single, [4e5]).tips[-1]
    found = Reach(single).posture(on_curve)
    assert found is not None
    assert found.pressures == pytest.approx([4e5], rel=1e-3)
    assert Reach(single).nearest(on_curve + [0, 0.02, 0])[1] == pytest.approx(0.02, rel=0.05)


def test_clearance_is_the_smallest_distance(reach: Reach) -> None:
    places = np.array([[0, 0, 0.6], [0.02, 0, 0.56]])
    found = reach.clearance(places)
    assert found is not None
    distances = [reach.to_edge(place, found.direction) for place in places]
    assert found.distance == pytest.approx(min(d for d in distances if d is not None), abs=1e-6)
    assert reach.clearance(np.array([[0, 0, 2.0]])) is None


def test_torque_limits_count(model: Model) -> None:
    low, high = pressure_range(model)
    assert high == pytest.approx(np.full(6, 1e6), rel=1e-2)
    assert low == pytest.approx(np.zeros(6))
    driven = build(Scene(chen2022(), actuation=PressureDrive()))
    assert pressure_range(driven)[1] == pytest.approx(np.full(6, 1e6))


def test_places_are_checked(reach: Reach) -> None:
    with pytest.raises(InputError, match="three finite numbers"):
        reach.posture(np.array([0, 0, np.nan]))
