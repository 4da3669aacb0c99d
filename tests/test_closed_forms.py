"""Textbook answers: what is exact must be exact, the rest must converge at second order.

The rod has length, bending stiffness and mass of one, so that loads and frequencies are those of
the textbook. Where it says inextensible, the strain ε is no state: no stiff number, no error.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from arms import Array, arm, model_of
from numpy.testing import assert_allclose
from oracles.closed_forms import (
    PlanarTip,
    cantilever_axial_frequencies,
    cantilever_bending_frequencies,
    column_buckling_own_weight,
    column_buckling_tip_load,
    drive_arc,
    elastica_own_weight,
    elastica_tip_load,
)
from scipy.linalg import eigh

from softmpc.model.effects import Coriolis, Effect, Gravity, Inertia, RotaryInertia, TipLoad
from softmpc.model.kinematics import ConstantStrainArc, PaperArc
from softmpc.model.model import Model
from softmpc.model.parameters import Limits, Manipulator, Section
from softmpc.model.scene import STRAINS
from softmpc.statics.equilibrium import Equilibrium, find_equilibrium

E, DISC = 1e6, 0.05
UNIT = Section(
    length=1.0,
    young_modulus=E,
    shear_modulus=0.4 * E,
    bending_radius=(4.0 / (np.pi * E)) ** 0.25,
    disc_radius=DISC,
    unit_offset=0.02,
    unit_area=1e-5,
    wall_area=2e-4,
    mass=1.0,
    unit_angles=(0.3, 2.0, 4.1),
)
EA, EI, GJ = UNIT.axial_stiffness, UNIT.bending_stiffness, UNIT.torsional_stiffness
STIFFNESS = (EI, EI, GJ)
PLANE = ("kappa_y",)
by_segments = pytest.mark.parametrize("segments", [1, 3])
ARCS = pytest.mark.parametrize("arc", [ConstantStrainArc(), PaperArc()], ids=lambda a: a.name)


def rod() -> Manipulator:
    """Limits set the scales of the solver: a pressure that bends the rod about once around."""
    return replace(arm(UNIT), limits=Limits(pressure_max=2e7))


def rest(*effects: Effect, **slots: object) -> Equilibrium:
    """The posture without pressure."""
    found = find_equilibrium(model_of(rod(), effects=effects, **slots), np.zeros(3))
    assert found.converged
    return found


@cache
def model(strains: tuple[str, ...], segments: int, *effects: Effect) -> Model:
    return model_of(rod(), strains=strains, segments=segments, effects=effects)


def test_the_rod_has_unit_stiffness() -> None:
    assert pytest.approx((1.0, 0.8, 600.0)) == (EI, GJ, EA)


# ------------------------------------------------------------------------------------------ exact


@by_segments
@ARCS
@pytest.mark.parametrize("direction", [(0.0, 1.0), (-0.6, 0.8)])
def test_full_circle_under_a_moment(
    segments: int, arc: object, direction: tuple[float, float]
) -> None:
    """M = 2π EI/L closes an inextensible rod: the tip is back at the base."""
    load = TipLoad(moment=(*(2 * np.pi * np.array(direction)).tolist(), 0.0))
    found = rest(load, segments=segments, kinematics=arc, strains=STRAINS[1:])
    assert_allclose(found.tips[0], 0, atol=1e-10)
    assert_allclose(found.rotations[0], np.eye(3), atol=1e-10)


@by_segments
@ARCS
@pytest.mark.parametrize(
    "force, moment",
    [
        ((0, 0, 0), (0.0, 2.0, 0.0)),
        ((0, 0, 0), (-1.2, 0.9, 0.0)),
        ((0, 0, 0), (0.0, 0.0, 1.5)),
        ((0, 0, 30.0), (0, 0, 0)),
        ((0, 0, -5.0), (0, 0, 0)),
        ((0, 0, 20.0), (0, 0, -2.0)),
    ],
    ids=["moment", "oblique", "twist", "pull", "push", "pull and twist"],
)
def test_uniform_loads_are_exact(
    segments: int, arc: object, force: tuple[float, ...], moment: tuple[float, ...]
) -> None:
    """Moment, axial load and twist: n E A_s ε = F + ½ k·Kk, an arc of length (1 + ε) L."""
    found = rest(TipLoad(force, moment), segments=segments, kinematics=arc)  # type: ignore[arg-type]
    exact = drive_arc(1.0, force[2], moment, EA, STIFFNESS)
    assert_allclose(found.tips[0], exact.position, atol=1e-10)
    assert_allclose(found.rotations[0], exact.rotation, atol=1e-10)


@by_segments
@ARCS
def test_pressures_bend_a_weightless_arm_into_an_arc(segments: int, arc: object) -> None:
    pressures = np.array((9e6, 4e6, 1e6))
    light = model_of(rod(), effects=(), segments=segments, kinematics=arc)
    found = find_equilibrium(light, pressures)
    thrusts = UNIT.unit_area * pressures
    moment = sum(
        f * np.array((y, -x, 0.0)) for f, (x, y) in zip(thrusts, UNIT.unit_positions, strict=True)
    )
    exact = drive_arc(1.0, thrusts.sum(), moment, EA, STIFFNESS)
    assert_allclose(found.tips[0], exact.position, atol=1e-10)
    assert_allclose(found.rotations[0], exact.rotation, atol=1e-10)


@by_segments
def test_hanging_rod_stretches_by_half_its_weight(segments: int) -> None:
    found = rest(Gravity((0, 0, 9.81)), TipLoad((0, 0, 3.0)), segments=segments)
    assert_allclose(found.tips[0], (0, 0, 1 + (3 + 9.81 / 2) / EA), atol=1e-12)


# ---------------------------------------------------------------------------------------- elastica


def second_order(found: list[Array], exact: Array, rest_of: float) -> None:
    """Errors fall by 3.5 to 4.5 a doubling; extrapolated, no more than `rest_of` is left."""
    errors = [float(np.linalg.norm(value - exact)) for value in found]
    ratios = [coarse / fine for coarse, fine in pairwise(errors)]
    assert all(3.5 <= ratio <= 4.5 for ratio in ratios), (errors, ratios)
    left = float(np.linalg.norm((4 * found[-1] - found[-2]) / 3 - exact))
    assert left <= rest_of, (left, errors)


LOADS = {
    **{f"tip force {a:g}": (TipLoad((a, 0, 0)), elastica_tip_load(a)) for a in (0.25, 1, 5, 10)},
    **{f"weight {g:g}": (Gravity((g, 0, 0)), elastica_own_weight(g)) for g in (1, 10)},
}


@pytest.mark.sampled
@pytest.mark.parametrize("load, tip", LOADS.values(), ids=LOADS.keys())
def test_elastica(load: Effect, tip: PlanarTip) -> None:
    """Dead force P L²/EI or weight w L³/EI across the rod, in the plane, inextensible."""
    found = [rest(load, strains=PLANE, segments=n).tips[0] for n in (3, 6, 12)]
    second_order(found, np.array((tip.y, 0, tip.x)), 3e-5)


# ------------------------------------------------------------------------------------- frequencies


def frequencies(strains: tuple[str, ...], segments: int, *effects: Effect) -> Array:
    """Natural frequencies of the straight arm (rad/s), lowest first."""
    m = model(strains, segments, Inertia(), Coriolis(), *effects)
    K, M = m.stiffness(0, 0)[0], m.M(0)
    return np.sqrt(eigh(np.asarray(K), np.asarray(M), eigvals_only=True))


@pytest.mark.parametrize("mode", [0, 1])
def test_bending_frequencies(mode: int) -> None:
    """ω L² √(ρA/EI) -> 3.516 and 22.03."""
    exact = cantilever_bending_frequencies(2)[mode]
    found = [frequencies(PLANE, n)[mode] / exact for n in (3, 6, 12)[mode:]]
    second_order(found, np.ones(1), 5e-4)


@pytest.mark.parametrize(
    "strain, scale, extra",
    [
        ("epsilon", np.sqrt(EA), ()),
        ("kappa_z", np.sqrt(GJ / (DISC**2 / 2)), (RotaryInertia(),)),
    ],
    ids=["axial", "torsional"],
)
def test_axial_and_torsional_frequencies(
    strain: str, scale: float, extra: tuple[Effect, ...]
) -> None:
    """ω L √(ρ/E) -> π/2, and the same of torsion with √(GJ/I_p)."""
    for mode, exact in enumerate(cantilever_axial_frequencies(2) * scale):
        found = [frequencies((strain,), n, *extra)[mode] / exact for n in (3, 6, 12)]
        second_order(found, np.ones(1), 5e-4)


def test_rotary_inertia_lowers_bending_frequencies_a_little() -> None:
    """Rayleigh: ω²/ω₀² ≈ 1 - ¼ r² ∫φ'² = 1 - 4.65 r²/4 for the first mode φ of the unit rod."""
    slow, fast = (frequencies(PLANE, 12, *e)[0] for e in ((RotaryInertia(),), ()))
    assert 1 - (slow / fast) ** 2 == pytest.approx(4.65 * DISC**2 / 4, rel=0.02)


# ----------------------------------------------------------------------------------------- buckling


@pytest.mark.sampled
@pytest.mark.parametrize("own_weight", [True, False])
def test_buckling_loads(own_weight: bool) -> None:
    """w L³/EI = 7.837 and P L²/EI = π²/4: where the straight arm's tangent turns singular."""
    exact = column_buckling_own_weight() if own_weight else column_buckling_tip_load()

    def push(load: float) -> Effect:
        return Gravity((0, 0, -load)) if own_weight else TipLoad((0, 0, -load))

    @cache
    def critical(segments: int) -> Array:
        """The tangent at the straight arm is linear in the load."""
        free, loaded = (
            np.asarray(model(PLANE, segments, *effects).stiffness(0, 0)[0])
            for effects in ((), (push(1.0),))
        )
        return np.asarray(1 / eigh(free - loaded, free, eigvals_only=True).max())

    second_order([critical(n) / exact for n in (3, 6, 12)], np.ones(1), 5e-4)
    load = float(critical(6))
    below, above = (rest(push(x * load), strains=PLANE, segments=6) for x in (0.999, 1.001))
    assert below.stable
    assert not above.stable
    assert_allclose((below.tips[0], above.tips[0]), [(0, 0, 1)] * 2, atol=1e-12)
