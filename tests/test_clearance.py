"""The distance of a path from the edge of the workspace."""

from dataclasses import replace

import numpy as np
import pytest

from softmpc.model.model import Model, build
from softmpc.model.presets import chen2022
from softmpc.model.scene import Scene
from softmpc.statics.clearance import find_clearance
from softmpc.statics.equilibrium import find_equilibrium
from softmpc.statics.inverse import InverseStatics
from softmpc.statics.targets import Position


@pytest.fixture(scope="module")
def model() -> Model:
    return build(Scene(chen2022()))


@pytest.fixture(scope="module")
def inverse(model: Model) -> InverseStatics:
    return InverseStatics(model)


@pytest.mark.slow
def test_the_ball_is_in_reach(inverse: InverseStatics) -> None:
    place, rng = np.array([0.1, 0.02, 0.6]), np.random.default_rng(1)
    found = find_clearance(inverse, place[None])
    assert found is not None
    assert found.distance > 0.1
    assert found.place == pytest.approx(place)
    ways = rng.normal(size=(60, 3))
    for way in ways / np.linalg.norm(ways, axis=1)[:, None]:
        there = place + 0.99 * found.distance * way
        assert inverse.solve(Position(tuple(there))).solved, there


def test_the_end_of_the_ray_is_in_reach_and_the_next_place_is_not(inverse: InverseStatics) -> None:
    place = np.array([0.1, 0.02, 0.6])
    found = find_clearance(inverse, place[None])
    assert found is not None
    inside = inverse.solve(Position(tuple(place + found.distance * found.direction * 0.999)))
    beyond = inverse.solve(Position(tuple(place + (found.distance + 2e-3) * found.direction)))
    assert inside.solved
    assert beyond.distance == pytest.approx(2e-3, rel=0.02)  # at a right angle


@pytest.mark.slow
def test_the_worst_place_counts(inverse: InverseStatics) -> None:
    places = np.array([[0, 0, 0.6], [0.02, 0, 0.56], [0, 0, 0.8]])
    steps: list[tuple[int, int]] = []
    found = find_clearance(inverse, places, lambda *step: steps.append(step))
    alone = [find_clearance(inverse, place[None]) for place in places]
    assert found is not None
    assert found.distance == pytest.approx(min(one.distance for one in alone if one), abs=1e-6)
    assert found.place == pytest.approx(places[2])
    assert steps == [(1, 3), (2, 3), (3, 3)]


def test_out_of_reach_is_none(inverse: InverseStatics) -> None:
    assert find_clearance(inverse, np.array([[0, 0, 0.6], [0, 0, 2.0]])) is None


def test_a_curve_has_no_room() -> None:
    """One unit: the tip lives on a curve, its edge is everywhere."""
    section = replace(chen2022().sections[0], unit_angles=(0.0,))
    single = build(Scene(replace(chen2022(), sections=(section,))))
    tip = find_equilibrium(single, [4e5]).tips[-1]
    found = find_clearance(InverseStatics(single), tip[None])
    assert found is not None
    assert found.distance < 1e-5
