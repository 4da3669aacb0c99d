"""Postures at rest against an independent rod, solved as a boundary-value problem."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from arms import ONE_UNIT, PAPER, SMALL, arm, differences, model_of
from numpy.testing import assert_allclose

from softmpc.accuracy.rod import RodError, RodSolution, solve_rod
from softmpc.accuracy.rod_of_scene import rod_section
from softmpc.errors import InputError
from softmpc.model.actuation import PressureDrive, StaticDrive
from softmpc.model.effects import Gravity, TipLoad
from softmpc.model.elasticity import StrainElasticity
from softmpc.model.formulations import (
    Formulation,
    FullNewtonEuler,
    NewtonEuler,
    VirtualPower,
)
from softmpc.model.kinematics import Arc, ConstantStrainArc, PaperArc
from softmpc.model.mass import LumpedMass
from softmpc.model.model import Model
from softmpc.model.parameters import Section
from softmpc.model.scene import STRAINS
from softmpc.statics.equilibrium import (
    Equilibrium,
    find_equilibrium,
    pressures_from_torques,
    refine_equilibrium,
)

MPA = 1e6
Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Scenario:
    """An arm with pressures and loads, for the rod and for the model."""

    sections: tuple[Section, ...]
    pressures_mpa: tuple[float, ...]
    gravity: Vector = (0.0, 0.0, 9.81)
    force: Vector = (0.0, 0.0, 0.0)
    moment: Vector = (0.0, 0.0, 0.0)
    within: float = 1e-3  # m at four segments

    @property
    def pressures(self) -> list[float]:
        return [MPA * p for p in self.pressures_mpa]

    def rod(self) -> RodSolution:
        parts = [rod_section(s) for s in self.sections]
        return solve_rod(parts, self.pressures, self.gravity, self.force, self.moment)

    def posture(
        self, segments: int, formulation: Formulation | None = None, arc: Arc | None = None
    ) -> Equilibrium:
        loaded = any((*self.force, *self.moment))
        load = (TipLoad(self.force, self.moment),) if loaded else ()
        model = model_of(
            arm(*self.sections),
            segments=segments,
            effects=(Gravity(self.gravity), *load),
            formulation=formulation or VirtualPower(),
            kinematics=arc or ConstantStrainArc(),
        )
        return find_equilibrium(model, self.pressures)


BASE, DISTAL = PAPER.sections
THIRD = replace(BASE, length=0.18, mass=0.3, unit_angles=(0.4, 1.9, 3.3, 5.0), bending_radius=0.024)
PRINTED = Scenario(
    tuple(replace(s, bending_radius=0.029, mass=0.55) for s in PAPER.sections),
    (0.6, 0.0, 0.0, 0.0, 0.3, 0.3),
)
SCENARIOS = {
    "in the plane": PRINTED,
    "out of plane": Scenario((BASE, DISTAL), (0.6, 0.2, 0.0, 0.1, 0.5, 0.0)),
    "three sections": Scenario(
        (BASE, THIRD, SMALL), (0.5, 0.1, 0, 0.3, 0.2, 0, 0, 0.2, 0, 0.3, 0), (1.0, -2.0, 9.0)
    ),
    "tip force and moment": Scenario(
        (BASE, DISTAL),
        (0.4, 0.1, 0.0, 0.0, 0.3, 0.1),
        force=(0.8, -1.2, 0.5),
        moment=(0.05, 0.1, -0.3),
    ),
    "upright": Scenario((BASE, DISTAL), (0.05, 0.02, 0, 0, 0.05, 0), (0.0, 0.0, -9.81)),
    # A cantilever that hangs down by half its length: four segments miss the millimetre (1.28 mm).
    "sideways": Scenario(
        (BASE, DISTAL), (0.2, 0.0, 0.0, 0.1, 0.3, 0.0), (9.81, 0.0, 0.0), within=1.3e-3
    ),
    "units 3, 1 and 4": Scenario(
        (BASE, ONE_UNIT, SMALL), (0.3, 0, 0.2, 0.15, 0.1, 0, 0.3, 0.1), force=(0.0, 0.6, -0.2)
    ),
}
by_scenario = pytest.mark.parametrize("name", SCENARIOS)


@cache
def reference(name: str) -> RodSolution:
    return SCENARIOS[name].rod()


@cache
def posture(name: str, segments: int) -> Equilibrium:
    return SCENARIOS[name].posture(segments)


# ---------------------------------------------------------------- the table of EQUATIONS.md, 3


@pytest.mark.sampled
@pytest.mark.parametrize(
    "formulation, arc, column",
    [
        (NewtonEuler(), PaperArc(), {1: "0.080", 2: "0.046", 4: "0.125"}),
        (FullNewtonEuler(), PaperArc(), {1: "0.157", 2: "0.090", 4: "0.048"}),
        (
            VirtualPower(mass=LumpedMass()),
            ConstantStrainArc(),
            {1: "0.113", 2: "0.063", 4: "0.032", 8: "0.017"},
        ),
        (
            VirtualPower(),
            ConstantStrainArc(),
            {1: "0.0096", 2: "0.0022", 4: "0.00055", 8: "0.00014"},
        ),
    ],
    ids=["printed", "full wrench", "lumped", "default"],
)
def test_table_of_tip_errors(formulation: Formulation, arc: Arc, column: dict[int, str]) -> None:
    """Distance of the tip from the rod, to every digit of the table (half a unit of the last)."""
    exact = reference("in the plane").tip
    assert_allclose(exact, (-0.368840, 0.0, 0.361828), atol=6e-7)
    for segments, printed in column.items():
        found = PRINTED.posture(segments, formulation, arc)
        assert found.converged
        half_a_digit = 0.51 * 10.0 ** -len(printed.partition(".")[2])
        error = float(np.linalg.norm(found.tips[-1] - exact))
        assert error == pytest.approx(float(printed), abs=half_a_digit), segments


# --------------------------------------------------------------------------------- convergence


@pytest.mark.sampled
@by_scenario
def test_converges_to_the_rod(name: str) -> None:
    """Second order: the tip error falls by 3.5 or more a doubling, below 1 mm at 4 segments."""
    assert 0.5 <= sum(s.length for s in SCENARIOS[name].sections) <= 0.6
    exact = reference(name).section_tips
    found = [posture(name, n) for n in (1, 2, 4, 8)]
    assert all(p.converged and p.stable for p in found)
    errors = [float(np.linalg.norm(p.tips[-1] - exact[-1])) for p in found]
    ratios = [coarse / fine for coarse, fine in pairwise(errors)]
    assert errors[2] < SCENARIOS[name].within, errors
    assert min(ratios) >= 3.5, (errors, ratios)


@by_scenario
def test_all_section_tips_and_the_orientation_converge(name: str) -> None:
    """Extrapolated from 4 and 8 segments, places agree with the rod to 20 µm, turns to 0.2 mrad."""
    exact, coarse, fine = reference(name), posture(name, 4), posture(name, 8)
    assert_allclose((4 * fine.tips - coarse.tips) / 3, exact.section_tips, atol=2e-5)
    rotations = (4 * fine.rotations - coarse.rotations) / 3
    assert_allclose(rotations, exact.section_rotations, atol=2e-4)


def test_only_the_energy_law_is_the_rods() -> None:
    """The literal law (17)-(19) has another axial force: its limit is another posture."""
    name, literal = "out of plane", VirtualPower(elasticity=StrainElasticity())
    gaps = []
    for law in (VirtualPower(), literal):
        coarse, fine = (SCENARIOS[name].posture(n, law).tips[-1] for n in (2, 4))
        gaps.append(float(np.linalg.norm((4 * fine - coarse) / 3 - reference(name).tip)))
    assert gaps[0] < 3e-5
    assert gaps[1] > 1e-3


# ------------------------------------------------------------------------------------ stability


def upright(mass: float, segments: int = 4) -> Model:
    """Two sections on end; their weight buckles them at w L³/EI = 7.837, mass 1.19 kg a section."""
    parts = tuple(replace(s, mass=mass) for s in PAPER.sections)
    up = Gravity((0.0, 0.0, -9.81))
    return model_of(arm(*parts), segments=segments, effects=(up,), strains=STRAINS[:3])


def test_straight_column_loses_its_stability() -> None:
    light, heavy = (find_equilibrium(upright(m), np.zeros(6)) for m in (1.0, 1.4))
    assert light.stable
    assert heavy.converged
    assert not heavy.stable
    assert heavy.smallest_stiffness < 0 < light.smallest_stiffness
    for found in (light, heavy):
        assert_allclose(found.tips[:, :2], 0, atol=1e-12)


def test_buckled_column_is_stable() -> None:
    """From a bent guess Newton finds the posture that the column falls into."""
    model = upright(1.4)
    guess = np.tile((-0.01, 0.0, 4.0), 8)
    found = refine_equilibrium(model, np.zeros(6), guess)
    assert found.converged
    assert np.hypot(*found.tips[-1, :2]) > 0.1
    K = np.asarray(model.stiffness(found.q, np.zeros(6))[0])
    values = np.linalg.eigvalsh(K)
    assert abs(values[0]) < 1e-9 * values[-1], "free to turn about the vertical"
    assert values[1] > 1e-4 * values[-1]


def test_smallest_stiffness_is_that_of_the_tangent() -> None:
    """In scaled strains, by differences of the residual; the flag goes with its sign."""
    model = model_of(effects=(Gravity(),))
    found = find_equilibrium(model, (6e5, 0, 0, 0, 3e5, 3e5))
    scale = model.layout.q.scale
    slope = differences(lambda x: model.balance(x, found.pressures), found.q, 0.01 * scale)
    values = np.linalg.eigvals(slope * np.outer(scale, scale)).real
    assert found.smallest_stiffness == pytest.approx(values.min(), rel=1e-7)
    assert found.residual < 1e-12


# ------------------------------------------------------------------------- input, status, torques


@pytest.mark.parametrize(
    "pressures, message",
    [
        ((0.0,) * 5, "5 pressures given: this arm has 6 units"),
        ((), "0 pressures given"),
        ((0.0,) * 5 + (np.nan,), "nan.* Pa: all must be finite numbers"),
        ((np.inf,) + (0.0,) * 5, "finite"),
    ],
)
def test_bad_pressures(pressures: tuple[float, ...], message: str) -> None:
    for solve in (find_equilibrium, lambda m, p: refine_equilibrium(m, p, np.zeros(8))):
        with pytest.raises(InputError, match=message):
            solve(model_of(effects=(Gravity(),)), pressures)


def test_torques() -> None:
    static = model_of(effects=(Gravity(),), actuation=StaticDrive())
    torques = (1.5, 0.0, 0.0, 0.0, 1.0, 1.0)
    for model in (static, model_of(effects=(Gravity(),))):
        gain = pressures_from_torques(model, torques) / 1e6
        assert_allclose(gain, 0.4002 * np.array(torques), rtol=1e-4)
    with pytest.raises(InputError, match="2 torques given: this arm has 6 units"):
        pressures_from_torques(static, (1.0, 2.0))
    with pytest.raises(InputError, match="takes pressures, not torques"):
        pressures_from_torques(model_of(actuation=PressureDrive()), torques)


def test_no_equilibrium_is_a_status_not_an_answer() -> None:
    """A load that crushes the arm: the rod finds nothing either."""
    crushed = Scenario((BASE, DISTAL), (0.0,) * 6, force=(0.0, 0.0, -2000.0))
    with pytest.raises(RodError):
        crushed.rod()
    found = crushed.posture(1)
    assert found.status in ("no convergence", "outside the model's range")
    assert not found.converged
    assert not found.stable
    assert found.residual > 1e-6


def test_refining_a_posture_takes_few_steps() -> None:
    model = model_of(segments=2, effects=(Gravity(),))
    pressures = np.array((6e5, 2e5, 0, 0, 3e5, 3e5))
    start = find_equilibrium(model, pressures)
    near = refine_equilibrium(model, pressures * 1.02, start.q)
    assert near.converged
    assert near.iterations <= 5
    assert_allclose(near.tips, find_equilibrium(model, pressures * 1.02).tips, atol=1e-11)
    far = refine_equilibrium(model, pressures, np.full(model.strains, 40.0))
    assert_allclose(far.tips, start.tips, atol=1e-10)
