"""Inverse statics: what is in reach is held, what is not gets the nearest posture."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from arms import MIXED, ONE_UNIT, PAPER, SMALL, arm, model_of
from numpy.testing import assert_allclose

from softmpc.accuracy.rod import solve_rod
from softmpc.accuracy.rod_of_scene import rod_section
from softmpc.errors import InputError
from softmpc.model.actuation import FrictionDrive, PressureDrive, StaticDrive
from softmpc.model.effects import Gravity, TipLoad
from softmpc.model.formulations import FullNewtonEuler, NewtonEuler
from softmpc.model.model import Model
from softmpc.model.scene import default_effects
from softmpc.statics.equilibrium import find_equilibrium, pressures_from_torques
from softmpc.statics.inverse import InverseStatics
from softmpc.statics.inverse_batch import solve_many
from softmpc.statics.inverse_result import InverseResult
from softmpc.statics.rest_costs import ClosestPosture
from softmpc.statics.targets import Direction, Orientation, Position
from tests.benchmarks.inverse import LOAD, DenseSearch, random_pressures, tips_of

LOADED = {"effects": (*default_effects(), LOAD)}
HIT = 1e-5  # m
BASE, DISTAL = PAPER.sections
THREE = arm(BASE, replace(DISTAL, length=0.18, mass=0.3, bending_radius=0.026), SMALL)
ANGLED = Direction((0.2, 0.1, 1.0))


@cache
def paper() -> InverseStatics:
    return InverseStatics(model_of())


def at(place) -> Position:
    return Position(tuple(place))


def check_held(model: Model, found: InverseResult, place) -> None:
    """Forward statics of the pressures, by continuation from rest, lead to the place."""
    limits = model.scene.manipulator.limits
    assert found.status == "solved"
    assert np.all(
        (found.pressures >= limits.pressure_min) & (found.pressures <= limits.pressure_max)
    )
    again = find_equilibrium(model, found.pressures)
    assert again.stable and found.stable and found.on_rest_branch
    assert np.linalg.norm(again.tips[-1] - place) <= HIT
    assert found.distance <= HIT


# ---------------------------------------------------------------- in reach

CASES = {
    "1 segment": ({}, 150),
    "1 segment, load": (LOADED, 40),
    "2 segments": ({"segments": 2}, 40),
    "2 segments, load": ({"segments": 2, **LOADED}, 20),
    "one section": ({"manipulator": arm(BASE)}, 20),
    "other sizes": ({"manipulator": MIXED}, 20),
    "three sections": ({"manipulator": THREE}, 10),
    "pressures as input": ({"actuation": PressureDrive()}, 5),
    "Newton-Euler": ({"formulation": NewtonEuler()}, 10),
    "Newton-Euler, full wrench": ({"formulation": FullNewtonEuler()}, 10),
}


@pytest.mark.sampled
@pytest.mark.parametrize("case", CASES)
def test_every_tip_of_random_pressures_is_held(case: str) -> None:
    slots, count = CASES[case]
    model = model_of(**slots)
    inverse = InverseStatics(model)
    pressures = random_pressures(model, count, seed=8)
    stable = [find_equilibrium(model, p) for p in pressures]
    for rest in (rest for rest in stable if rest.stable):
        check_held(model, inverse.solve(at(rest.tips[-1])), rest.tips[-1])


@pytest.mark.slow
@pytest.mark.parametrize("case", [*CASES][:4])
def test_a_thousand_tips_are_held(case: str) -> None:
    model = model_of(**CASES[case][0])
    inverse = InverseStatics(model)
    for place in tips_of(model, random_pressures(model, 1000, seed=9)):
        check_held(model, inverse.solve(at(place)), place)


def test_torques_lead_to_the_pressures() -> None:
    found = paper().solve(at([0.1, -0.05, 0.55]))
    assert found.torques is not None
    assert_allclose(
        pressures_from_torques(paper().model, found.torques), found.pressures, rtol=1e-9
    )
    limits = PAPER.limits
    assert np.all((found.torques >= limits.torque_min) & (found.torques <= limits.torque_max))
    driven = InverseStatics(model_of(actuation=PressureDrive())).solve(at([0.1, -0.05, 0.55]))
    assert driven.torques is None


def test_friction_holds_within_a_band() -> None:
    """A torque T pushes the piston with 2π η T/lead."""
    rubbing = replace(PAPER, hydraulics=replace(PAPER.hydraulics, friction=30.0))
    found = InverseStatics(model_of(rubbing, actuation=FrictionDrive())).solve(at([0.0, 0.0, 0.58]))
    drive = PAPER.hydraulics
    expected = 30.0 * drive.screw_lead / (2 * math.pi * drive.efficiency)
    assert found.torque_band == pytest.approx(expected, rel=1e-9)
    assert paper().solve(at([0.0, 0.0, 0.58])).torque_band == 0.0


# The rod has no segments; four a section leave less than a millimetre.
@pytest.mark.parametrize(
    "place", [(0.1, 0.05, 0.55), (-0.2, 0.1, 0.5), (0.3, -0.1, 0.4), (0, 0, 0.7)]
)
def test_the_rod_lands_where_the_tip_was_wanted(place) -> None:
    found = fine().solve(Position(place))
    assert found.solved and found.stable
    rod = solve_rod([rod_section(s) for s in PAPER.sections], found.pressures)
    assert np.linalg.norm(rod.tip - place) <= 1e-3


def test_the_rod_under_a_load() -> None:
    inverse = InverseStatics(model_of(segments=4, effects=(Gravity(), LOAD)))
    place = (0.15, 0.1, 0.52)
    found = inverse.solve(Position(place))
    rod = solve_rod([rod_section(s) for s in PAPER.sections], found.pressures, tip_force=LOAD.force)
    assert found.solved and np.linalg.norm(rod.tip - place) <= 1e-3


@cache
def fine() -> InverseStatics:
    return InverseStatics(model_of(segments=4))


# ---------------------------------------------------------------- out of reach


@pytest.mark.slow
def test_nothing_is_nearer_than_the_nearest() -> None:
    """Against many random postures, refined by SciPy's least squares over the pressures."""
    model = paper().model
    dense = DenseSearch(model, 1000)
    low, high = dense.tips.min(axis=0), dense.tips.max(axis=0)
    rng, missed = np.random.default_rng(6), 0
    for _ in range(12):
        place = (low + high) / 2 + 1.5 * (high - low) / 2 * rng.uniform(-1, 1, 3)
        least = dense.distance(place)
        if least < 1e-4:
            continue
        missed += 1
        found = paper().solve(at(place))
        assert found.status == "unreachable"
        assert found.stable and found.on_rest_branch
        assert found.distance == pytest.approx(np.linalg.norm(found.tips[-1] - place), abs=1e-12)
        assert found.distance <= least + 1e-4
    assert missed >= 6


def test_straight_below_it_is_full_pressure() -> None:
    longest = find_equilibrium(paper().model, np.full(6, 1e6)).tips[-1, 2]
    found = paper().solve(Position((0.0, 0.0, longest + 0.1)))
    assert found.status == "unreachable"
    assert found.distance == pytest.approx(0.1, abs=1e-6)
    assert found.active == tuple(f"P_{j} = pressure_max" for j in range(1, 7))


def test_on_a_curve_the_nearest_point() -> None:
    """One unit moves the tip in a plane; beside the plane the distance is the way to it."""
    inverse = InverseStatics(model_of(arm(ONE_UNIT)))
    tip = find_equilibrium(inverse.model, [4e5]).tips[-1]
    across = np.array([-math.sin(0.7), math.cos(0.7), 0.0])  # the unit is at 0.7 rad
    assert inverse.solve(at(tip)).pressures == pytest.approx([4e5], rel=1e-5)
    found = inverse.solve(at(tip + 0.02 * across))
    assert found.status == "unreachable"
    assert found.distance == pytest.approx(0.02, abs=1e-9)
    assert found.pressures == pytest.approx([4e5], rel=1e-4)


@pytest.mark.slow
def test_the_nearest_may_be_far_from_its_neighbours() -> None:
    """In the hollow within reach: most starts end 4 mm further away, in another corner."""
    model = model_of(segments=2, **LOADED)
    place = (0.014394386524498905, 0.12354728497652176, 0.17549249688811386)
    corner = find_equilibrium(model, [1e6, 0, 1e6, 1e6, 1e6, 0]).tips[-1]
    found = InverseStatics(model).solve(Position(place))
    assert found.distance <= np.linalg.norm(corner - place) + 1e-6


def test_few_starts_are_enough_far_away_only() -> None:
    far, near = paper().solve(Position((0, 0, 1.2))), paper().solve(Position((0.0, 0.1, 0.15)))
    assert far.starts < 15
    assert near.starts == 40, "a place among the postures may be in reach after all"


# ---------------------------------------------------------------- kinds of targets


def test_directions() -> None:
    found = paper().solve([Position((0.05, 0.05, 0.58)), ANGLED])
    axis = np.array([0.2, 0.1, 1.0]) / math.sqrt(1.05)
    assert found.solved
    assert_allclose(found.posture.rotations[-1][:, 2], axis, atol=1e-6)
    assert_allclose(found.tips[-1], [0.05, 0.05, 0.58], atol=1e-6)


def test_a_whole_pose() -> None:
    rest = find_equilibrium(paper().model, [0.3e6, 0.1e6, 0.2e6, 0.05e6, 0.5e6, 0.1e6])
    pose = [at(rest.tips[-1]), Orientation(rest.rotations[-1])]
    found = paper().solve(pose)
    assert found.solved and found.angle < 1e-6
    assert_allclose(found.posture.rotations[-1], rest.rotations[-1], atol=1e-6)
    assert_allclose(found.pressures, rest.pressures, rtol=1e-3)  # six numbers for six pressures


def test_a_pose_at_the_edge_is_not_missed_for_the_cost() -> None:
    """Where pressures hardly move the pose, a cost gains much by missing it a little."""
    pressures = [0.0, 4689.0, 0.0, 74323.0, 972213.0, 468875.0]
    rest = find_equilibrium(paper().model, pressures)
    found = paper().solve([at(rest.tips[-1]), Orientation(rest.rotations[-1])])
    assert found.solved
    assert found.distance < 1e-6


def test_both_section_tips() -> None:
    rest = find_equilibrium(paper().model, [0.3e6, 0.1e6, 0.2e6, 0.05e6, 0.5e6, 0.1e6])
    found = paper().solve([Position(tuple(rest.tips[0]), section=1), at(rest.tips[1])])
    assert found.solved
    assert_allclose(found.tips, rest.tips, atol=2e-6)


def test_free_coordinates() -> None:
    found = paper().solve(Position((None, 0.1, 0.5)))
    assert found.solved
    assert_allclose(found.tips[-1, 1:], [0.1, 0.5], atol=1e-6)
    fixed = paper().solve(at(found.tips[-1]))
    assert found.cost <= fixed.cost + 1e-9
    assert found.cost < paper().solve(Position((0.0, 0.1, 0.5))).cost


@pytest.mark.parametrize("turn", [0.3, 2.5])
def test_errors_of_angles(turn: float) -> None:
    """A rotation by `turn` about any axis, and the angle between two vectors."""
    rest = find_equilibrium(paper().model, np.full(6, 3e5))  # straight: the axes of the base
    x = np.array([1.0, 0.0, 0.0])
    R = np.array([[1, 0, 0], [0, np.cos(turn), -np.sin(turn)], [0, np.sin(turn), np.cos(turn)]])
    assert Orientation(R).error(rest.tips, rest.rotations) == pytest.approx(turn, abs=1e-9)
    assert Direction(tuple(R[:, 2])).error(rest.tips, rest.rotations) == pytest.approx(turn)
    assert Direction(tuple(5 * x)).error(rest.tips, rest.rotations) == pytest.approx(np.pi / 2)


@pytest.mark.slow
def test_where_place_and_direction_compete() -> None:
    """`angle_length` is the price of a radian: the dearer it is, the smaller the angle."""
    wanted = [Position((0.0, 0.0, 0.95)), Direction((1.0, 0.0, 0.3))]
    found = [InverseStatics(paper().model, angle_length=w).solve(wanted) for w in (0.05, 0.5, 5.0)]
    assert all(r.status == "unreachable" for r in found)
    assert found[0].angle > found[1].angle > found[2].angle
    assert found[0].distance < found[1].distance < found[2].distance


# ---------------------------------------------------------------- starts, paths, batches


def circle(count: int) -> list[Position]:
    angles = np.linspace(0, 2 * np.pi, count)
    return [Position((0.1 * np.cos(a), 0.1 * np.sin(a), 0.55)) for a in angles]


def test_a_path_is_solved_from_one_to_the_next() -> None:
    told: list[tuple[int, int]] = []
    results = paper().solve_path(circle(40), progress=lambda *done: told.append(done))
    assert told == [(k, 40) for k in range(1, 41)]
    assert all(r.solved and r.starts == 1 for r in results)
    warm = np.mean([r.iterations for r in results[1:]])
    cold = np.mean([paper().solve(target).iterations for target in circle(40)])
    assert warm < 0.8 * cold


def test_the_posture_before_is_the_closest() -> None:
    """Steps of the strains are smaller than with any other cost, where units are to spare."""
    inverse = InverseStatics(paper().model, ClosestPosture())
    start = paper().solve(circle(1)[0])
    close = inverse.solve_path(circle(30), start)
    scale = paper().model.layout.q.scale
    for before, after in zip([start, *close], close, strict=False):
        other = paper().solve(after.targets)
        steps = [np.linalg.norm((r.q - before.q) / scale) for r in (after, other)]
        assert steps[0] <= steps[1] + 1e-6


def test_results_do_not_depend_on_what_was_asked_before() -> None:
    first = InverseStatics(paper().model).solve(at([0.1, 0.0, 0.5]))
    again = paper().solve(at([0.1, 0.0, 0.5]))
    assert np.array_equal(first.pressures, again.pressures)


def test_a_posture_to_start_from() -> None:
    rest = find_equilibrium(paper().model, np.full(6, 3e5))
    found = paper().solve(at(rest.tips[-1] + [0.01, 0, 0]), start=rest)
    assert found.solved and found.starts == 1


def test_comparing_starts_costs_time_and_never_more() -> None:
    place = at([0.15, 0.05, 0.5])
    one, many = paper().solve(place), paper().solve(place, compare=5)
    assert many.starts >= 5
    assert many.cost <= one.cost * (1 + 1e-9)


@pytest.mark.sampled
@pytest.mark.parametrize("path", [False, True])
def test_batches_are_the_same_everywhere(path: bool, tmp_path) -> None:
    targets = [*circle(9), Position((0, 0, 1.0))]
    here = solve_many(paper(), targets, executor=1, path=path, keep=tmp_path / "kept.jsonl")
    there = solve_many(paper(), targets, executor=2, path=path)
    alone = [paper().solve(target) for target in targets]
    for a, b, c in zip(here, there, alone, strict=True):
        assert np.array_equal(a.pressures, b.pressures)
        assert a.status == b.status == c.status
        assert_allclose(a.pressures, c.pressures, atol=1e4 if path else 0.0)
        assert a.targets == c.targets
    again = solve_many(paper(), targets, executor=1, path=path, keep=tmp_path / "kept.jsonl")
    assert [r.seconds for r in again] == [r.seconds for r in here], "read from the file"
    slopes = paper().sensitivities(again[3])
    assert_allclose(slopes.pressures, paper().sensitivities(here[3]).pressures)


# ---------------------------------------------------------------- wrong input


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: Position((0.0, 1.0)), "must be three numbers in m"),
        (lambda: Position((None, None, None)), "must be three numbers in m"),
        (lambda: Position((0.0, float("nan"), 0.5)), "must be finite"),
        (lambda: Position(("a", 0.0, 0.5)), "must be numbers"),
        (lambda: Direction((0.0, 0.0, 0.0)), "not all of them zero"),
        (lambda: Direction((0.0, 1.0)), "must be three numbers"),
        (lambda: Orientation(np.eye(3) * 1.1), "orthonormal"),
        (lambda: Orientation(np.eye(2)), "orthonormal"),
        (lambda: Orientation(np.diag([1.0, 1.0, -1.0])), "mirror image"),
        (lambda: paper().solve(Position((0, 0, 0.5), section=3)), "has the sections 1 to 2"),
        (lambda: paper().solve([]), "no target is given"),
        (lambda: paper().solve([(0, 0, 0.5)]), "must be a Position, a Direction"),
        (lambda: paper().solve(0.5), "must be a Position, a Direction"),
        (lambda: paper().solve(Position((0, 0, 0.5)), compare=0), "compare = 0: must be a whole"),
        (lambda: InverseStatics(paper().model, angle_length=0.0), "positive number"),
        (lambda: InverseStatics(paper().model, starts=0), "whole number from 1"),
        (lambda: InverseStatics(paper().model, held={7: 0.0}), "units 1 to 6"),
    ],
)
def test_wrong_input(make, said: str) -> None:
    with pytest.raises(InputError, match=said):
        make()


def test_static_drive_has_torques_too() -> None:
    found = InverseStatics(model_of(actuation=StaticDrive())).solve(at([0.05, 0.0, 0.58]))
    same = paper().solve(at([0.05, 0.0, 0.58]))
    assert_allclose(found.torques, same.torques, rtol=1e-6)


def test_a_load_of_no_force_changes_nothing() -> None:
    idle = InverseStatics(model_of(effects=(*default_effects(), TipLoad())))
    place = at([0.1, 0.05, 0.55])
    assert_allclose(idle.solve(place).pressures, paper().solve(place).pressures, rtol=1e-6)
