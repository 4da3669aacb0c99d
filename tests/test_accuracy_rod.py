"""Small oscillations of the reference rod against closed forms and against the model."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from arms import PAPER, model_of
from numpy.testing import assert_allclose
from oracles.closed_forms import (
    cantilever_axial_frequencies,
    cantilever_bending_frequencies,
    cantilever_with_end_mass,
    column_buckling_own_weight,
    hanging_chain_frequencies,
)

from softmpc.accuracy.rest_references import frequencies
from softmpc.accuracy.rod import solve_rod
from softmpc.accuracy.rod_modes import chebyshev, rod_frequencies
from softmpc.accuracy.rod_of_scene import rod_of_scene, unknown_to_rod
from softmpc.accuracy.rod_parts import RodError, RodSection
from softmpc.errors import SceneError
from softmpc.model.effects import (
    AddedMass,
    Buoyancy,
    Effect,
    Gravity,
    Payload,
    TipLoad,
    WaterMass,
)
from softmpc.model.elasticity import PrintedElasticity, StrainElasticity
from softmpc.model.formulations import VirtualPower
from softmpc.model.scene import STRAINS, default_effects
from softmpc.statics.equilibrium import find_equilibrium

STILL = (0.0, 0.0, 0.0)
# L = EI = mass = 1 and practically inextensible.
BEAM = RodSection(
    length=1.0,
    young_modulus=1.0,
    shear_modulus=1.0 / 3.0,
    bending_radius=(4.0 / np.pi) ** 0.25,
    unit_offset=0.0,
    unit_area=1.0,
    wall_area=1e9,
    mass=1.0,
    unit_angles=(0.0,),
)


def straight(section: RodSection, count: int, **about: float) -> np.ndarray:
    """Frequencies of the rod without gravity."""
    found = solve_rod([section], [0.0], STILL)
    return rod_frequencies([section], found, count, **about)


# ---------------------------------------------------------------- closed forms


def test_chebyshev_points_differentiate_polynomials() -> None:
    x, D = chebyshev(9)
    assert x[0] == 0.0 and x[-1] == 1.0 and np.all(np.diff(x) > 0)
    assert_allclose(D @ x**7, 7 * x**6, atol=1e-12)


def test_a_cantilever_bends_in_two_planes() -> None:
    wanted = np.repeat(cantilever_bending_frequencies(3), 2)
    assert_allclose(straight(BEAM, 6), wanted, rtol=1e-8)


def test_sections_of_a_cantilever_are_one_beam() -> None:
    """Cut at 30 % of its length, the rod is the same."""
    parts = [replace(BEAM, length=share, mass=share) for share in (0.3, 0.7)]
    found = solve_rod(parts, [0.0, 0.0], STILL)
    wanted = np.repeat(cantilever_bending_frequencies(2), 2)
    assert_allclose(rod_frequencies(parts, found), wanted, rtol=1e-8)


@pytest.mark.parametrize("ratio", [0.1, 1.0, 5.0])
def test_a_mass_at_the_tip(ratio: float) -> None:
    lowest = straight(BEAM, 2, tip_mass=ratio)
    assert_allclose(lowest, cantilever_with_end_mass(ratio), rtol=1e-8)


def test_a_disc_at_the_tip_turns_too() -> None:
    """A light beam with a disc: ω² of the two by two system of its tip."""
    light, mass, radius = replace(BEAM, mass=1e-9), 2.0, 1.2
    K = np.array([[12.0, -6.0], [-6.0, 4.0]])
    squares = np.linalg.eigvals(np.linalg.solve(np.diag([mass, mass * radius**2 / 4]), K))
    wanted = np.repeat(np.sqrt(np.sort(squares)), 2)
    # Torsion of the disc, GJ = 2/3, is the third: its moment of inertia is m r²/2.
    torsion = np.sqrt(2 / 3 / (mass * radius**2 / 2))
    found = straight(light, 5, tip_mass=mass, tip_radius=radius)
    assert_allclose(found, np.sort([*wanted, torsion]), rtol=1e-7)


def test_axial_and_torsional_waves() -> None:
    """A rod so stiff in bending that it only stretches and twists; the wave speeds are apart."""
    rod = replace(BEAM, bending_radius=50.0, wall_area=1.0, disc_radius=1.0)
    wanted = cantilever_axial_frequencies(2) * np.sqrt(1.0 / 1.0)  # √(E A / m L)
    assert_allclose(straight(rod, 2), wanted, rtol=1e-6)
    twisting = replace(BEAM, bending_radius=1.0, disc_radius=30.0)
    wave = np.sqrt(twisting.stiffness[2] / (30.0**2 / 2))  # √(G J / (m r²/2))
    found = straight(twisting, 12)
    assert np.abs(found / (wave * np.pi / 2) - 1).min() < 1e-6


def test_a_limp_rod_hangs_like_a_chain() -> None:
    """ω → 1.20241 √(g/L); its stiffness is felt in a layer of √(EI/(w L²)) at the base."""
    wanted = hanging_chain_frequencies(1)[0]
    gaps = []
    for weight in (1e2, 4e2, 16e2):
        found = solve_rod([BEAM], [0.0], (0.0, 0.0, weight))
        lowest = rod_frequencies([BEAM], found, 1, nodes=32)[0]
        gaps.append(lowest / np.sqrt(weight) / wanted - 1)
    assert 0 < gaps[2] < 0.02
    ratios = np.array(gaps[:-1]) / gaps[1:]
    assert 2.0 < ratios[1] < ratios[0] < 2.5  # half the layer, in the end half the gap


def test_frequency_vanishes_where_own_weight_buckles() -> None:
    """ω² crosses zero at w L³/EI = 7.837, nearly linearly."""
    critical = column_buckling_own_weight()
    assert critical == pytest.approx(7.837, abs=1e-3)
    loads = critical * np.array([0.98, 0.99, 0.999])
    squares = []
    for weight in loads:
        found = solve_rod([BEAM], [0.0], (0.0, 0.0, -weight))
        squares.append(rod_frequencies([BEAM], found, 1)[0] ** 2)
    line = np.polyfit(loads, squares, 2)
    roots = np.roots(line).real
    assert np.abs(roots - critical).min() < 1e-5 * critical
    above = solve_rod([BEAM], [0.0], (0.0, 0.0, -1.05 * critical))
    with pytest.raises(RodError, match="not stable"):
        rod_frequencies([BEAM], above, 1)


# ---------------------------------------------------------------- the rod of a scene

LOADED: tuple[Effect, ...] = (
    TipLoad((0.8, -0.6, 0.5)),
    Payload(mass=0.15, radius=0.05),
    Buoyancy(density=400.0),
    AddedMass(density=900.0),
)


@pytest.mark.sampled
@pytest.mark.parametrize(
    "more, law",
    [
        pytest.param(LOADED[:3], VirtualPower(), id="load, payload and buoyancy"),
        pytest.param(LOADED, VirtualPower(), id="and added mass", marks=pytest.mark.slow),
        pytest.param((), VirtualPower(elasticity=StrainElasticity()), id="the paper's elasticity"),
    ],
)
def test_the_model_comes_to_the_rod(more: tuple[Effect, ...], law: VirtualPower) -> None:
    """Tips and frequencies of a bent arm, two and four segments a section: error by four."""
    effects = (*default_effects(), *more)
    p = (5e5, 1e5, 0.0, 2e5, 6e5, 0.0)
    models = [model_of(segments=n, effects=effects, formulation=law) for n in (2, 4)]
    rod = rod_of_scene(models[0].scene)
    found = rod.rest(p)
    wanted = rod.frequencies(found)
    tips, modes = [], []
    for model in models:
        rest = find_equilibrium(model, p)
        tips.append(np.linalg.norm(rest.tips - found.section_tips, axis=1).max())
        modes.append(np.abs(frequencies(model, rest.q, p) / wanted - 1).max())
    assert tips[1] < 2e-3 and modes[1] < 0.03
    assert 3.5 < tips[0] / tips[1] < 4.5
    assert 3.5 < modes[0] / modes[1] < 4.6


@pytest.mark.parametrize(
    "slots, why",
    [
        ({"effects": (*default_effects(), WaterMass())}, "effect water_mass"),
        ({"strains": STRAINS[:3], "effects": default_effects(STRAINS[:3])}, "strain kappa_z"),
        ({"formulation": VirtualPower(elasticity=PrintedElasticity())}, "elasticity 'printed'"),
    ],
)
def test_what_the_rod_does_not_know(slots: dict, why: str) -> None:
    scene = model_of(PAPER, **slots).scene
    assert why in unknown_to_rod(scene)
    with pytest.raises(SceneError, match=why):
        rod_of_scene(scene)


def test_a_scene_without_gravity_has_a_straight_rod() -> None:
    rod = rod_of_scene(model_of(effects=default_effects()[1:]).scene)
    assert not rod.gravity.any() and Gravity not in map(type, default_effects()[1:])
    assert_allclose(rod.rest([0.0] * 6).tip, (0.0, 0.0, 0.5), atol=1e-12)
