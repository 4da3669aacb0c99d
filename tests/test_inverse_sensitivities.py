"""Sensitivities of inverse statics against problems solved again beside the solution."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from arms import PAPER, arm, model_of
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from softmpc.model.actuation import PressureDrive
from softmpc.model.effects import TipLoad
from softmpc.model.formulations import FullNewtonEuler, NewtonEuler
from softmpc.model.scene import default_effects
from softmpc.statics.equilibrium import find_equilibrium
from softmpc.statics.inverse import InverseStatics
from softmpc.statics.rest_costs import ClosestPosture, GreatestMargin, LeastStrainEnergy
from softmpc.statics.sensitivities import tip_compliance
from softmpc.statics.targets import Direction, Orientation, Position

PLACE = np.array([0.1, 0.05, 0.55])
STEP = 1e-4  # m, rad


@cache
def paper() -> InverseStatics:
    return InverseStatics(model_of())


def differences(inverse: InverseStatics, moved, start) -> tuple[np.ndarray, np.ndarray]:
    """Central differences of pressures and strains (one column a move)."""
    columns = []
    for k in range(moved.count):
        ends = [inverse.solve(moved(k, sign * STEP), start) for sign in (1, -1)]
        pairs = [(end.pressures, end.q) for end in ends]
        columns.append([(a - b) / (2 * STEP) for a, b in zip(*pairs, strict=True)])
    pressures, strains = zip(*columns, strict=True)
    return np.stack(pressures, axis=1), np.stack(strains, axis=1)


class Place:
    count = 3

    def __init__(self, place) -> None:
        self.place = np.asarray(place, float)

    def __call__(self, k: int, by: float) -> list:
        return [Position(tuple(self.place + by * np.eye(3)[k]))]


class Turned:
    """Place, and direction or orientation, moved and turned about the axes of the base."""

    count = 6

    def __init__(self, place, rotation: np.ndarray, whole: bool) -> None:
        self.place, self.rotation, self.whole = np.asarray(place), rotation, whole

    def __call__(self, k: int, by: float) -> list:
        place = self.place + (by * np.eye(3)[k] if k < 3 else 0)
        R = self.rotation
        if k >= 3:
            R = Rotation.from_rotvec(by * np.eye(3)[k - 3]).as_matrix() @ R
        turned = Orientation(R) if self.whole else Direction(tuple(R[:, 2]))
        return [Position(tuple(place)), turned]


@pytest.mark.sampled
@pytest.mark.parametrize("cost", [None, LeastStrainEnergy(), ClosestPosture((0.0,) * 8)])
def test_pressures_follow_the_place(cost) -> None:
    inverse = InverseStatics(model_of(), cost)
    found = inverse.solve(Position(tuple(PLACE)))
    slopes = inverse.sensitivities(found)
    pressures, strains = differences(inverse, Place(PLACE), found)
    assert slopes.moves == ("x", "y", "z")
    assert_allclose(slopes.pressures, pressures, rtol=1e-3, atol=1e-4 * np.abs(pressures).max())
    assert_allclose(slopes.strains, strains, rtol=1e-3, atol=1e-4 * np.abs(strains).max())
    gain = paper().model.drive.static_gain
    assert_allclose(gain @ slopes.torques, slopes.pressures, rtol=1e-9)


def test_at_limits_the_others_follow() -> None:
    place = np.array([-0.25, 0.0, 0.45])
    found = paper().solve(Position(tuple(place)))
    assert any("pressure_min" in name for name in found.active)
    slopes = paper().sensitivities(found)
    pressures, _ = differences(paper(), Place(place + [0, 0.002, 0]), found)
    beside = paper().sensitivities(paper().solve(Place(place + [0, 0.002, 0])(0, 0.0)))
    assert_allclose(beside.pressures, pressures, rtol=5e-3, atol=1e-3 * np.abs(pressures).max())
    held = [int(name[2]) - 1 for name in found.active]
    assert_allclose(slopes.pressures[held], 0.0)


@pytest.mark.parametrize("whole", [False, True])
def test_pressures_follow_turns(whole: bool) -> None:
    rest = find_equilibrium(paper().model, [3e5, 1e5, 2e5, 1e5, 5e5, 2e5])
    moved = Turned(rest.tips[-1], rest.rotations[-1], whole)
    found = paper().solve(moved(0, 0.0))
    slopes = paper().sensitivities(found)
    assert found.solved
    assert slopes.moves == ("x", "y", "z", "turn_x", "turn_y", "turn_z")
    pressures, _ = differences(paper(), moved, found)
    assert_allclose(slopes.pressures, pressures, rtol=1e-2, atol=2e-3 * np.abs(pressures).max())


def test_names_of_moves_tell_the_section() -> None:
    rest = find_equilibrium(paper().model, np.full(6, 3e5))
    wanted = [Position((None, 0.0, rest.tips[0, 2]), section=1), Position(tuple(rest.tips[1]))]
    slopes = paper().sensitivities(paper().solve(wanted))
    assert slopes.moves == ("y_1", "z_1", "x", "y", "z")


def test_out_of_reach_the_nearest_posture_follows() -> None:
    place = np.array([0.15, 0.05, 0.9])
    found = paper().solve(Position(tuple(place)))
    slopes = paper().sensitivities(found)
    assert found.status == "unreachable"
    pressures, strains = differences(paper(), Place(place), found)
    assert_allclose(slopes.pressures, pressures, rtol=1e-2, atol=1e-3 * np.abs(pressures).max())
    away = (place - found.tips[-1]) / found.distance
    tip = np.asarray(paper().model.tip_jacobian(found.q))[-3:] @ slopes.strains
    assert np.abs(away @ tip).max() < 1e-6, "the nearest point moves along the edge"
    assert np.abs(strains).max() > 0


def test_without_torques() -> None:
    inverse = InverseStatics(model_of(actuation=PressureDrive()))
    slopes = inverse.sensitivities(inverse.solve(Position(tuple(PLACE))))
    assert slopes.torques is None
    same = paper().sensitivities(paper().solve(Position(tuple(PLACE))))
    assert_allclose(slopes.pressures, same.pressures, rtol=1e-5)


def test_tip_follows_where_the_margin_does_not_settle_it() -> None:
    """Units to spare: derivatives are NaN, or move the tip as asked."""
    inverse = InverseStatics(model_of(), GreatestMargin())
    found = inverse.solve(Position(tuple(PLACE)))
    slopes = inverse.sensitivities(found)
    J = np.asarray(inverse.model.tip_jacobian(found.q))[-3:]
    assert np.all(np.isnan(slopes.strains)) or np.allclose(J @ slopes.strains, np.eye(3), atol=1e-5)


# ---------------------------------------------------------------- compliance

ARMS = {
    "virtual power": {},
    "2 segments": {"segments": 2},
    "Newton-Euler": {"formulation": NewtonEuler()},
    "Newton-Euler, 2 segments": {"formulation": NewtonEuler(), "segments": 2},
    "Newton-Euler, full wrench": {"formulation": FullNewtonEuler()},
    "loaded": {"effects": (*default_effects(), TipLoad((0.5, -0.3, 1.0), (0.02, 0.05, -0.01)))},
    "loaded, Newton-Euler": {
        "effects": (*default_effects(), TipLoad((0.5, -0.3, 1.0), (0.02, 0.05, -0.01))),
        "formulation": NewtonEuler(),
    },
    "one section": {"manipulator": arm(PAPER.sections[0])},
}


@pytest.mark.sampled
@pytest.mark.parametrize("name", ARMS)
def test_compliance_is_how_forces_move_the_tip(name: str) -> None:
    """Central differences of forward statics under forces at the tip, pressures fixed."""
    slots = ARMS[name]
    model = model_of(**slots)
    pressures = np.resize([3e5, 1e5, 0.0, 0.5e5, 4e5, 1e5], model.scene.manipulator.units)
    load = model.scene.effect(TipLoad) or TipLoad()
    others = [e for e in model.scene.effects if not isinstance(e, TipLoad)]
    columns, step = [], 1e-3
    for axis in np.eye(3):
        tips = []
        for sign in (1, -1):
            force = tuple((np.array(load.force) + sign * step * axis).tolist())
            pushed = (*others, TipLoad(force, load.moment))
            tips.append(find_equilibrium(model_of(**{**slots, "effects": pushed}), pressures).tips)
        columns.append((tips[0][-1] - tips[1][-1]) / (2 * step))
    compliance = tip_compliance(model, find_equilibrium(model, pressures))
    wanted = np.stack(columns, axis=1)
    assert_allclose(compliance, wanted, atol=1e-5 * np.abs(wanted).max())
    if "Newton" not in name and "loaded" not in name:  # a dead moment has no potential
        assert_allclose(compliance, compliance.T, rtol=1e-9, atol=1e-12)


def test_compliance_is_part_of_the_sensitivities() -> None:
    found = paper().solve(Position(tuple(PLACE)))
    assert_allclose(
        paper().sensitivities(found).compliance, tip_compliance(paper().model, found.posture)
    )
