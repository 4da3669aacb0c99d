"""The workspace of an arm, against closed forms, brute force and postures it has not seen."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from oracles.one_section import OneSection

from softmpc.errors import InputError
from softmpc.model.actuation import PressureDrive
from softmpc.model.effects import Gravity, Payload, TipLoad
from softmpc.model.model import Model, build
from softmpc.model.parameters import Manipulator
from softmpc.model.presets import chen2022
from softmpc.model.scene import Scene, default_effects
from softmpc.statics.equilibrium import find_equilibrium
from softmpc.statics.workspace import find_workspace
from softmpc.statics.workspace_check import WorkspaceCheck, check_workspace
from softmpc.statics.workspace_result import BEYOND, Workspace

PAPER = chen2022()
ONE = replace(PAPER, sections=PAPER.sections[:1])
GRID = {"azimuths": 12, "polars": 9, "samples": 300, "executor": 1}
COARSE = {"azimuths": 6, "polars": 5, "samples": 300, "executor": 1}
SECTION = PAPER.sections[0]
ORACLE = OneSection(
    SECTION.length, SECTION.young_modulus, SECTION.bending_radius, SECTION.unit_offset,
    SECTION.unit_area, SECTION.wall_area, SECTION.unit_angles, 1e6,
)  # fmt: skip


def weightless(arm: Manipulator = ONE, **slots: object) -> Model:
    return build(Scene(arm, effects=(), actuation=PressureDrive(), **slots))


@pytest.fixture(scope="module")
def model() -> Model:
    return weightless()


@pytest.fixture(scope="module")
def space(model: Model) -> Workspace:
    return find_workspace(model, **GRID)


def assert_holds(found: WorkspaceCheck) -> None:
    assert found.outside < 1e-3, found
    assert found.unreachable == 0, found
    assert found.off <= 1.1e-5, found


# ---------------------------------------------------------------- closed forms


def test_the_closed_form_is_the_arm(model: Model) -> None:
    for p in ([0, 1e6, 1e6], [1e6, 0, 0], [2e5, 7e5, 4e5]):
        assert find_equilibrium(model, p).tips[-1] == pytest.approx(ORACLE.tips(p)[0], abs=1e-9)
        assert ORACLE.pressures_at(ORACLE.tips(p))[0] == pytest.approx(p, abs=1)


def test_points_of_the_edge_are_on_the_edge(space: Workspace) -> None:
    """A little further out, or in, no admissible pressure holds the tip; a little less far, one."""
    assert space.outer is not None and space.inner is not None and space.shell is not None
    directions = space.shell.directions()
    for side, sense in ((space.outer, 1), (space.inner, -1)):
        assert np.all(side.flags == 1)
        inner = np.s_[:, :-1]  # at the rim both surfaces meet
        rays, radii = directions[inner].reshape(-1, 3), side.radii[inner].reshape(-1, 1)
        assert np.all(ORACLE.holds(rays * (radii - 1e-6 * sense), slack=1.0))
        assert not np.any(ORACLE.holds(rays * (radii + 1e-6 * sense)))
    rims = space.outer.tips[:, -1]
    turned = rims + 2e-6 * (space.shell.polars[:, -1, None] > 0) * np.array([0, 0, -1.0])
    assert not np.any(ORACLE.holds(turned))


def test_limits_of_bend_and_length(space: Workspace) -> None:
    """All three are extreme at corners of the box of pressures."""
    corners = np.array(np.meshgrid(*[[0.0, 1e6]] * 3)).reshape(3, -1).T
    lengths, k = ORACLE.shape(corners)
    curvature = np.linalg.norm(k, axis=1)
    wanted = {
        ("bending_angle", "largest"): (lengths * curvature).max(),
        ("bending_angle", "smallest"): 0.0,
        ("arc_length", "largest"): lengths.max(),
        ("arc_length", "smallest"): ORACLE.length,
        ("radius", "smallest"): 1 / curvature.max(),
        ("radius", "largest"): np.inf,
    }
    for (quantity, sense), value in wanted.items():
        found = space.extreme(quantity, sense)
        assert found.value == pytest.approx(value, rel=1e-6, abs=1e-6), (quantity, sense)
        assert found.place is not None


def test_extents_against_a_dense_grid(space: Workspace) -> None:
    steps = np.linspace(0, 1e6, 81)
    tips = ORACLE.tips(np.array(np.meshgrid(steps, steps, steps)).reshape(3, -1).T)
    brute = np.stack([tips.min(axis=0), tips.max(axis=0)], axis=1)
    assert np.all(space.extents[:, 0] <= brute[:, 0] + 1e-9)
    assert np.all(space.extents[:, 1] >= brute[:, 1] - 1e-9)
    assert space.extents == pytest.approx(brute, abs=2e-4)


@pytest.mark.slow
def test_volume_against_rejection(model: Model) -> None:
    """Share of random places that admissible pressures hold; standard error 0.2 %."""
    space = find_workspace(model, azimuths=24, polars=9, samples=300, executor=1)
    low, high = space.extents.T
    places = np.random.default_rng(3).uniform(low, high, (400_000, 3))
    share = ORACLE.holds(places).mean()
    volume = float(share * np.prod(high - low))
    assert space.volume == pytest.approx(volume, rel=0.02)
    assert abs(space.volume - volume) < 2 * space.volume_error + 0.005 * volume


def test_contains(space: Workspace) -> None:
    places = np.random.default_rng(4).uniform(*space.extents.T, (20_000, 3))
    truth, found = ORACLE.holds(places), space.contains(places, 0.0)
    assert np.mean(truth != found) < 0.02  # the strip next to a coarse grid's surfaces
    away = space.distance_outside(places)
    assert np.all((away == 0) == found)
    assert away[truth].max() < 5e-3
    far = np.array([[0.0, 0, 1.0], [0, 0, -0.5]])
    assert space.distance_outside(far)[0] == pytest.approx(1.0 - space.extents[2, 1], abs=1e-6)
    assert np.all(space.distance_outside(far) > 0.4)


# ---------------------------------------------------------------- what it has not seen


@pytest.mark.slow
def test_one_section_with_weight_and_load() -> None:
    scene = Scene(ONE, effects=(Gravity(), TipLoad(force=(1.0, 0.5, 0.0))))
    loaded = build(scene)
    space = find_workspace(loaded, **GRID)
    assert_holds(check_workspace(loaded, space, 1000, seed=11))
    hanging = find_equilibrium(loaded, np.zeros(3)).tips[-1]
    assert hanging[0] > 0.004 and hanging[1] > 0.002  # the load pulls it to this side
    assert space.contains(hanging[None], space.grid_error)  # the tip of a cone on the inner surface


@pytest.mark.slow
def test_two_sections() -> None:
    two = build(Scene(PAPER))
    space = find_workspace(two, **COARSE)
    assert space.section == 2 and space.dimension == 3
    found = check_workspace(two, space, 1000, seed=12)
    assert_holds(found)
    assert found.points == 2 * 6 * 5
    assert found.searched > 10


def test_share_in_reach_is_that_of_the_closed_form(model: Model, space: Workspace) -> None:
    """Below one only for the strips that a coarse grid cuts off or adds."""
    places = np.random.default_rng(6).uniform(*space.extents.T, (20_000, 3))
    inside = ORACLE.holds(places[space.distance_outside(places) == 0]).mean()
    found = check_workspace(model, space, 10, inside=100).filled
    assert found == pytest.approx(inside, abs=0.06)  # 2.5 standard errors
    assert found > 0.9
    assert np.isnan(check_workspace(model, space, 10).filled)


def test_a_check_finds_what_is_wrong(model: Model, space: Workspace) -> None:
    assert space.outer is not None
    radii = space.outer.radii.copy()
    radii[3] *= 0.9
    spoiled = replace(space, outer=replace(space.outer, radii=radii))
    found = check_workspace(model, spoiled, 300)
    assert found.by_grid > 5e-3
    assert found.unreachable > 5
    assert found.off > 1e-2


@pytest.mark.slow
def test_limits_of_strains_count() -> None:
    limits = replace(ONE.limits, curvature_max=4.0, stretch_max=0.3)
    tight = build(Scene(replace(ONE, limits=limits)))
    space = find_workspace(tight, **GRID)
    assert_holds(check_workspace(tight, space, 600, seed=13))
    assert space.extreme("radius", "smallest").value == pytest.approx(0.25, rel=1e-6)
    assert space.extreme("arc_length", "largest").value == pytest.approx(0.325, rel=1e-6)


@pytest.mark.slow
def test_tip_of_the_first_section() -> None:
    """The second one moves as well: its weight moves the tip of the first."""
    two = build(Scene(PAPER))
    space = find_workspace(two, section=1, **COARSE)
    assert_holds(check_workspace(two, space, 300, seed=14))
    assert space.extents[2, 1] < 0.43  # the first one's length, stretched


# ---------------------------------------------------------------- arms that fall


@pytest.mark.slow
def test_upright_arms_end_where_they_fall() -> None:
    """Soft and upright: IPOPT goes on along equilibria that do not hold."""
    falling = build(Scene(PAPER, effects=(Gravity(vector=(0, 0, -9.81)), Payload(mass=0.3))))
    space = find_workspace(falling, **COARSE)
    assert space.outer is not None and space.inner is not None
    for side in (space.outer, space.inner):
        assert np.all(side.stable[side.flags > 0])
    assert np.any(space.outer.flags == BEYOND)
    found = check_workspace(falling, space, 100)
    assert found.unreachable == 0
    assert np.isfinite(space.extents).all()


def test_an_arm_without_a_posture_within_its_limits() -> None:
    limits = replace(ONE.limits, pressure_min=5e5, stretch_max=0.01)
    with pytest.raises(InputError, match="stable and within"):
        find_workspace(build(Scene(replace(ONE, limits=limits))), **COARSE)


# ---------------------------------------------------------------- acceptance

SIZES = (
    replace(SECTION, length=0.3, mass=0.7, bending_radius=0.034),
    replace(SECTION, length=0.2, mass=0.35, unit_angles=tuple(np.radians([60.0, 180.0, 300.0]))),
    replace(SECTION, length=0.12, mass=0.15, unit_offset=0.014, bending_radius=0.026),
)
ARMS = {"one": ONE, "two": PAPER, "three": replace(PAPER, sections=SIZES)}
LOADS = {"free": (), "loaded": (TipLoad(force=(0.6, -0.4, 1.0)),)}


@pytest.mark.slow
@pytest.mark.parametrize("arm", ARMS)
@pytest.mark.parametrize("load", LOADS)
def test_ten_thousand_postures(arm: str, load: str) -> None:
    loaded = build(Scene(ARMS[arm], effects=(*default_effects(), *LOADS[load])))
    space = find_workspace(loaded)
    found = check_workspace(loaded, space, 10_000, seed=100)
    assert found.samples == 10_000
    assert_holds(found)


# ---------------------------------------------------------------- wrong input


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"section": 2}, "sections 1 to 1"),
        ({"section": 0}, "sections 1 to 1"),
        ({"azimuths": 7}, "even number"),
        ({"azimuths": 2}, "even number"),
        ({"polars": 8}, "odd number"),
        ({"polars": 3}, "odd number"),
        ({"samples": 5}, "at least 100"),
        ({"held": {4: 0.0}}, "units 1 to 3"),
        ({"held": {1: 5e6}}, "between"),
    ],
)
def test_wrong_input(model: Model, options: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        find_workspace(model, **options)
