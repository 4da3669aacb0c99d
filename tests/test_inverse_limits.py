"""Inverse statics where limits bind, units are stuck, or the arm does not stay where it is put."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from arms import PAPER, arm, model_of
from numpy.testing import assert_allclose

from softmpc.model.drive_effects import ChamberCoupling
from softmpc.model.effects import Gravity
from softmpc.model.model import Model
from softmpc.model.parameters import Limits
from softmpc.model.scene import default_effects
from softmpc.statics.equilibrium import find_equilibrium, refine_equilibrium
from softmpc.statics.inverse import InverseStatics
from softmpc.statics.rest_limits import piston_travel, rest_limits
from softmpc.statics.targets import Position

FAR = (0.0, 0.0, 0.8)  # needs nearly full pressure in all units
SIDE = (-0.35, 0.0, 0.45)


def limited(**limits: float) -> Model:
    return model_of(replace(PAPER, limits=Limits(**limits)))


def test_without_these_limits_it_is_in_reach() -> None:
    inverse = InverseStatics(model_of())
    assert inverse.solve(Position(FAR)).solved and inverse.solve(Position(SIDE)).solved


@pytest.mark.sampled
@pytest.mark.parametrize(
    ("limit", "place", "name"),
    [
        ({"pressure_max": 0.6e6}, FAR, "P_1 = pressure_max"),
        ({"torque_max": 1.5}, FAR, "P_1 = torque_max"),
        ({"stroke_max": 0.01}, FAR, "P_1 = stroke_max"),
        ({"stretch_max": 0.4}, FAR, "epsilon_1_1 = stretch_max"),
        ({"curvature_max": 1.0}, SIDE, "curvature of segment 1 = curvature_max"),
        ({"pressure_min": 0.2e6}, (0.0, 0.0, 0.55), "= pressure_min"),  # on the axis: any unit
    ],
)
def test_limits_are_kept_and_named(limit: dict[str, float], place, name: str) -> None:
    model = limited(**limit)
    found = InverseStatics(model).solve(Position(place))
    assert found.status == "unreachable" and found.distance > 1e-3
    assert any(name in active for active in found.active)
    limits = model.scene.manipulator.limits
    assert np.all(found.pressures <= limits.pressure_max)
    assert np.all(found.pressures >= limits.pressure_min)
    assert found.torques is not None and np.all(found.torques <= limits.torque_max)
    bounds = rest_limits(model)
    assert np.all((bounds.low <= found.pressures) & (found.pressures <= bounds.high))
    travel = piston_travel(model, found.q, found.pressures)
    assert travel is not None and np.abs(travel).max() <= limits.stroke_max * (1 + 1e-9)
    strains = found.q.reshape(-1, 4)
    assert strains[:, 0].max() <= limits.stretch_max + 1e-6
    assert np.linalg.norm(strains[:, 1:3], axis=1).max() <= limits.curvature_max + 1e-6


def test_stroke_that_depends_on_the_posture() -> None:
    """With chamber coupling a longer unit takes water: less pressure for the same stroke."""
    coupled = (*default_effects(), ChamberCoupling())
    tight = replace(PAPER, limits=Limits(stroke_max=0.012))
    model = model_of(tight, effects=coupled)
    found = InverseStatics(model).solve(Position(FAR))
    travel = piston_travel(model, found.q, found.pressures)
    assert found.status == "unreachable"
    assert any(name.startswith("stroke of unit") for name in found.active)
    assert travel is not None and travel.max() == pytest.approx(0.012, rel=1e-6)


def test_limits_that_leave_no_posture() -> None:
    """The arm hangs by its own weight: without stretch there is no posture at all."""
    found = InverseStatics(limited(stretch_max=0.0)).solve(Position((0.0, 0.0, 0.5)))
    assert found.status == "no convergence"
    assert not found.solved and found.solution is None
    assert np.isnan(found.cost) and np.isfinite(found.distance)
    again = find_equilibrium(model_of(), found.pressures)
    assert_allclose(found.tips, again.tips, atol=1e-9)


# ---------------------------------------------------------------- stuck units


def test_a_held_unit_stays() -> None:
    inverse = InverseStatics(model_of(), held={2: 0.3e6, 6: 0.0})
    place = find_equilibrium(model_of(), [1e5, 3e5, 2e5, 4e5, 2e5, 0.0]).tips[-1]
    found = inverse.solve(Position(tuple(place)))
    assert found.solved and found.stable
    assert found.pressures[1] == 0.3e6 and found.pressures[5] == 0.0
    assert {"P_2 held", "P_6 held"} <= set(found.active)
    assert_allclose(find_equilibrium(model_of(), found.pressures).tips[-1], place, atol=1e-5)


def test_all_units_held_leave_one_place() -> None:
    held = {j: 1e5 * j for j in range(1, 7)}
    inverse = InverseStatics(model_of(), held=held)
    rest = find_equilibrium(model_of(), list(held.values()))
    found = inverse.solve(Position(tuple(rest.tips[-1] + [0, 0.03, 0])))
    assert found.status == "unreachable"
    assert found.distance == pytest.approx(0.03, abs=1e-9)
    assert inverse.solve(Position(tuple(rest.tips[-1]))).solved


def test_no_range_of_pressure() -> None:
    inverse = InverseStatics(limited(pressure_min=0.0, pressure_max=0.0))
    rest = find_equilibrium(model_of(), np.zeros(6))
    assert inverse.solve(Position(tuple(rest.tips[-1]))).solved
    assert inverse.solve(Position((0.0, 0.0, 0.6))).status == "unreachable"


# ---------------------------------------------------------------- stability

SOFT = replace(PAPER.sections[0], mass=8.0, length=0.35)  # upright it falls over
UPRIGHT = (Gravity((0.0, 0.0, -9.81)),)


def test_straight_up_a_slender_arm_is_not_stable() -> None:
    """One section: the pressures are settled by the place, and there the arm would fall."""
    model = model_of(arm(SOFT), effects=UPRIGHT)
    straight = refine_equilibrium(model, np.full(3, 2e5), np.array([0.1, 0, 0, 0]))
    assert straight.converged and not straight.stable
    found = InverseStatics(model).solve(Position(tuple(straight.tips[-1])))
    assert found.solved and not found.stable
    assert found.smallest_stiffness < 0
    assert found.starts == 40, "others were tried"


def test_stable_postures_come_first() -> None:
    """Where the arm falls to one side, places there are held by a posture that stays."""
    model = model_of(arm(SOFT), effects=UPRIGHT)
    inverse, seen = InverseStatics(model), 0
    for rest in inverse.spread.postures[:40]:
        if rest.stable:
            seen += 1
            found = inverse.solve(Position(tuple(rest.tips[-1])))
            assert found.solved and found.stable
    assert seen > 5


@pytest.mark.slow
def test_a_stable_posture_is_nearer_than_none() -> None:
    """IPOPT's nearest equilibria here are where no arm would stay."""
    model = model_of(arm(SOFT), effects=UPRIGHT)
    inverse = InverseStatics(model)
    place = np.array([0.1, 0.0, 0.6])
    found = inverse.solve(Position(tuple(place)))
    stable = [rest.tips[-1] for rest in inverse.spread.postures if rest.stable]
    assert found.status == "unreachable" and found.stable and found.on_rest_branch
    assert found.distance <= min(np.linalg.norm(tip - place) for tip in stable) + 1e-12


@pytest.mark.slow
def test_what_is_flagged_is_so() -> None:
    """Two sections, upright: status and flags agree with forward statics."""
    model = model_of(arm(SOFT, PAPER.sections[1]), effects=UPRIGHT)
    inverse = InverseStatics(model)
    flags = set()
    for place in [(0, 0, 0.7), (0.1, 0.0, 0.6), (0.3, 0.1, 0.3), (0.0, 0.2, 0.55)]:
        found = inverse.solve(Position(place))
        again = find_equilibrium(model, found.pressures)
        same = again.converged and np.abs(again.tips - found.tips).max() < 1e-5
        K = np.asarray(model.stiffness(found.q, found.pressures)[0])
        assert found.on_rest_branch == same
        assert found.stable == (np.linalg.eigvalsh((K + K.T) / 2).min() > 0)
        flags.add((found.stable, found.on_rest_branch))
    assert (True, True) in flags
