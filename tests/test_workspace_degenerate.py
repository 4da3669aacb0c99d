"""Workspaces that are no bodies: planes, surfaces, curves, points; and one that is off the axis."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from softmpc.model.effects import Gravity, Payload
from softmpc.model.model import Model, build
from softmpc.model.presets import chen2022
from softmpc.model.scene import Scene
from softmpc.statics.equilibrium import find_equilibrium
from softmpc.statics.rest_limits import rest_limits
from softmpc.statics.workspace import find_workspace
from softmpc.statics.workspace_check import check_workspace
from softmpc.statics.workspace_edge import EdgeSearch
from softmpc.statics.workspace_limits import ExtremeSearch
from softmpc.statics.workspace_rays import RaySearch
from softmpc.statics.workspace_result import Workspace
from softmpc.statics.workspace_samples import Samples, box_samples, solve
from softmpc.statics.workspace_shell import clenshaw_curtis

PAPER = chen2022()
ONE = replace(PAPER, sections=PAPER.sections[:1])
COARSE = {"azimuths": 8, "polars": 7, "samples": 300, "executor": 1}


@pytest.fixture(scope="module")
def one() -> Model:
    return build(Scene(ONE))


def test_all_units_stuck_is_a_point(one: Model) -> None:
    held = {1: 0.0, 2: 3e5, 3: 1e6}
    space = find_workspace(one, held=held, **COARSE)
    tip = find_equilibrium(one, list(held.values())).tips[-1]
    assert space.dimension == 0 and space.volume == 0 and space.outer is None
    assert space.extents == pytest.approx(np.stack([tip, tip], axis=1), abs=1e-9)
    assert space.points == pytest.approx(tip[None])
    assert space.contains(tip[None]).all() and not space.contains(tip[None] + 0.01).any()
    bend = space.extreme("bending_angle", "largest").value
    assert bend == pytest.approx(space.extreme("bending_angle", "smallest").value)


def test_no_range_of_pressure_is_a_point() -> None:
    limits = replace(PAPER.limits, pressure_min=4e5, pressure_max=4e5)
    space = find_workspace(build(Scene(replace(ONE, limits=limits))), **COARSE)
    assert space.dimension == 0 and space.volume == 0
    assert np.ptp(space.extents, axis=1) == pytest.approx(np.zeros(3), abs=1e-9)


def test_no_pressure_at_all_is_a_point() -> None:
    limits = replace(PAPER.limits, pressure_min=0.0, pressure_max=0.0)
    space = find_workspace(build(Scene(replace(ONE, limits=limits))), **COARSE)
    assert space.dimension == 0
    assert space.extents[2] == pytest.approx(space.samples.tips[0, [2, 2]])


def test_two_units_stuck_is_a_curve(one: Model) -> None:
    space = find_workspace(one, held={1: 0.0, 2: 3e5}, **COARSE)
    assert space.dimension == 1 and space.volume == 0 and space.shell is None
    tips = np.array([find_equilibrium(one, [0, 3e5, p]).tips[-1] for p in np.linspace(0, 1e6, 101)])
    assert space.distance_outside(tips).max() < 1.5e-3
    brute = np.stack([tips.min(axis=0), tips.max(axis=0)], axis=1)
    assert space.extents == pytest.approx(brute, abs=1e-4)
    found = check_workspace(one, space, 100)
    assert found.outside < 1e-6 and found.points == 0


@pytest.mark.slow
def test_one_unit_stuck_is_a_surface(one: Model) -> None:
    space = find_workspace(one, held={2: 3e5}, **COARSE | {"samples": 900})
    assert space.dimension == 2 and space.volume == 0 and space.shell is None
    steps = np.linspace(0, 1e6, 21)
    tips = [find_equilibrium(one, [p, 3e5, r]).tips[-1] for p in steps for r in steps]
    brute = np.stack([np.min(tips, axis=0), np.max(tips, axis=0)], axis=1)
    assert np.all(space.extents[:, 0] <= brute[:, 0] + 1e-7)
    assert np.all(space.extents[:, 1] >= brute[:, 1] - 1e-7)
    assert space.extents == pytest.approx(brute, abs=2e-3)
    assert space.distance_outside(np.array(tips)).max() < 0.02


@pytest.mark.sampled
@pytest.mark.parametrize(("strain", "axis"), [("kappa_y", 0), ("kappa_x", 1)])
def test_planar_arms_have_an_area(strain: str, axis: int) -> None:
    arm = build(Scene(ONE, strains=("epsilon", strain)))
    space = find_workspace(arm, **COARSE | {"polars": 13})
    assert space.dimension == 2 and space.volume == 0 and space.shell is not None
    assert space.outer is not None and np.all(space.outer.flags == 1)
    assert len(space.azimuths) == 2
    assert space.extents[1 - axis] == pytest.approx([0, 0], abs=1e-9)
    found = check_workspace(arm, space, 300, seed=3)
    assert found.outside < 1e-6 and found.unreachable == 0 and found.by_grid < 2e-3
    # Green's theorem along the edge: outer curves out and back on the inner ones
    area = 0.0
    for i in range(2):
        edge = np.concatenate([space.outer.tips[i], space.inner.tips[i][::-1]])
        u, z = edge[:, axis], edge[:, 2]
        area += abs(np.sum(u * np.roll(z, -1) - np.roll(u, -1) * z)) / 2
    assert space.shell.area == pytest.approx(area, rel=0.02)
    off = np.zeros(3)
    off[1 - axis] = 0.01
    inside = space.samples.tips[:5]
    assert space.distance_outside(inside + off) == pytest.approx(0.01, abs=3e-3)


def test_stretch_alone_is_a_line() -> None:
    space = find_workspace(build(Scene(ONE, strains=("epsilon",))), **COARSE)
    assert space.dimension == 1
    assert space.extents[:2] == pytest.approx(np.zeros((2, 2)), abs=1e-9)
    assert space.extreme("bending_angle", "largest").value == 0
    assert space.extreme("arc_length", "largest").value == pytest.approx(space.extents[2, 1])


def test_bend_alone_is_a_surface() -> None:
    """Three units, but only their differences count."""
    space = find_workspace(build(Scene(ONE, strains=("kappa_x", "kappa_y"))), **COARSE)
    assert space.dimension == 2 and space.shell is None
    length = ONE.sections[0].length
    assert space.extreme("arc_length", "largest").value == pytest.approx(length)


@pytest.mark.slow
def test_a_body_beside_the_axis() -> None:
    """The first section stuck in a bend: rays turn around the middle of what is left."""
    arm = build(Scene(PAPER))
    space = find_workspace(arm, held={1: 1e6, 2: 0.0, 3: 0.0}, **COARSE)
    assert space.dimension == 3 and space.volume > 0
    assert space.frame[2, 2] < 0.9
    assert space.frame.T @ space.frame == pytest.approx(np.eye(3), abs=1e-12)
    found = check_workspace(arm, space, 150, seed=5)
    assert found.outside < 1e-3 and found.unreachable == 0


@pytest.mark.slow
def test_lying_arm() -> None:
    """Weight across: the peaks of the rim are at no round azimuths, half-planes move there."""
    arm = build(Scene(ONE, effects=(Gravity(vector=(4.0, 9.0, 0.0)),)))
    space = find_workspace(arm, **COARSE)
    assert np.all(np.diff(space.azimuths) > 0)
    assert np.abs(space.azimuths - np.arange(8) * np.pi / 4).max() > 0.01
    found = check_workspace(arm, space, 500, seed=6)
    assert found.outside < 1e-3 and found.unreachable == 0 and found.by_grid < 0.012


def test_places_in_a_plane_of_any_azimuth_are_sought() -> None:
    angles = np.radians([45.0, 225.0])
    arm = replace(ONE, sections=(replace(ONE.sections[0], unit_angles=tuple(angles)),))
    model = build(Scene(arm))
    space = find_workspace(model, **COARSE | {"samples": 100})
    assert space.dimension == 2 and space.shell is not None
    assert check_workspace(model, space, 10, inside=10).filled > 0.8


def sampled(model: Model, count: int = 100) -> Samples:
    return solve(model, box_samples(rest_limits(model), count, 1), 2)


def test_limits_where_the_optimum_is_straight() -> None:
    """Pulled to one side by gravity, the arm is straight under no pressures at a limit."""
    model = build(Scene(PAPER, effects=(Gravity((9.81, 0.0, 0.0)),)))
    search, samples = ExtremeSearch(RaySearch(model, 2)), sampled(model)
    assert search.find("radius", 1, 1, samples)[1] == np.inf
    assert search.find("bending_angle", 1, -1, samples)[1] == 0.0


@pytest.fixture(scope="module")
def falling() -> Model:
    """Standing, with a load under which it falls over."""
    return build(Scene(PAPER, effects=(Gravity((0.0, 0.0, -9.81)), Payload(1.0))))


def test_a_limit_is_at_least_that_of_the_samples(falling: Model) -> None:
    samples = sampled(falling)
    place, value = ExtremeSearch(RaySearch(falling, 2)).find("x", 2, 1, samples)
    assert value >= samples.tips[:, 0].max() and place is not None and not place.best
    assert find_equilibrium(falling, place.pressures).stable


def test_no_rim_that_holds_leaves_no_shell(falling: Model) -> None:
    samples, azimuths = sampled(falling), np.arange(4) * np.pi / 2
    nodes, _ = clenshaw_curtis(5)
    search = EdgeSearch(
        lambda name, cases, share: [None] * len(cases), samples, np.eye(3), azimuths, nodes,
        False, falling.scene.manipulator.length, rest_limits(falling),
    )  # fmt: skip
    edge = search.edge()
    space = Workspace(
        2, {}, 3, np.eye(3), azimuths, edge.rims, nodes, edge.outer, edge.inner, (), samples, 0.0
    )
    assert space.shell is None and np.isnan(space.volume)
    assert np.array_equal(space.points, samples.tips)
