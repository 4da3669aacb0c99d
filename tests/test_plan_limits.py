"""Limits of a section's tip: its place and direction, against the arm put together by hand."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from arms import MIXED, model_of
from oracles.moving_bodies import section_ends
from small_plans import read

from softmpc.control.limits import Limit, TipBox, TipCone
from softmpc.control.stage import Stage
from softmpc.errors import InputError, SceneError
from softmpc.planning.plan_files import load_plan, save_plan
from softmpc.planning.planner import plan

MODEL = model_of(MIXED)
LENGTHS = [section.length for section in MIXED.sections]
SOME = np.random.default_rng(3).normal(size=(5, MODEL.strains)) * MODEL.layout.q.scale


def value_and_slope(limit: Limit, q: np.ndarray) -> tuple[float, np.ndarray]:
    stage = Stage.of(MODEL)
    rows = limit.rows(stage)
    assert len(rows.names) == len(rows.scale) == len(rows.units) == rows.value.numel() == 1
    function = ca.Function("rows", [stage.x], [rows.value, ca.jacobian(rows.value, stage.x)])
    value, slope = function(np.append(q, np.zeros(len(MODEL.layout.x) - len(q))))
    return float(value), np.asarray(slope).ravel()[: len(q)]


def angle_between(a: np.ndarray, b: np.ndarray) -> float:
    return 2 * np.arctan2(np.linalg.norm(a - b), np.linalg.norm(a + b))


@pytest.mark.parametrize("section", [None, 1, 2])
def test_places_and_angles_of_section_tips(section: int | None) -> None:
    which = (section or 2) - 1
    aim = np.array([0.3, -0.2, 0.9])
    for q in SOME:
        places, rotations = section_ends(LENGTHS, q)
        for i, axis in enumerate("xyz"):
            found, _ = value_and_slope(TipBox(-1.0, 1.0, axis=axis, section=section), q)
            assert found == pytest.approx(places[which][i], abs=1e-12)
        expected = angle_between(rotations[which][:, 2], aim / np.linalg.norm(aim))
        found, _ = value_and_slope(TipCone(0.5, tuple(aim), section), q)
        assert found == pytest.approx(expected, abs=1e-7)


@pytest.mark.parametrize("axis", [(0.0, 0.0, 1.0), (0.0, 0.0, -1.0)])
def test_a_cone_has_slopes_where_the_tip_points_along_its_axis(axis: Any) -> None:
    """A straight arm along the axis and against it: angles 0 and π, rounded by a 10 000th."""
    value, slope = value_and_slope(TipCone(0.4, axis), np.zeros(MODEL.strains))
    assert value == pytest.approx(0.0 if axis[2] > 0 else np.pi, abs=1e-4)
    assert np.all(np.isfinite(slope)) and np.abs(slope).max() < 1e-9


def test_slopes_of_a_cone_are_those_of_differences() -> None:
    limit, q = TipCone(0.4, (1.0, 0.5, 0.2)), SOME[0]
    _, slope = value_and_slope(limit, q)
    for j, size in enumerate(MODEL.layout.q.scale):
        step = np.zeros(len(q))
        step[j] = 1e-4 * size
        difference = value_and_slope(limit, q + step)[0] - value_and_slope(limit, q - step)[0]
        assert slope[j] * size == pytest.approx(difference / 2e-4, abs=1e-6)


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: TipCone(0.0), r"TipCone\(angle=0.0\): must be between 0 and π"),
        (lambda: TipCone(float("nan")), "must be between"),
        (lambda: TipCone(0.3, (0.0, 0.0, 0.0)), "not all of them zero"),
        (lambda: TipCone(0.3, section=3).rows(Stage.of(MODEL)), r"section=3\): .* sections 1 to 2"),
        (lambda: TipBox(0, 1, section=0).rows(Stage.of(MODEL)), r"section=0\): .* sections 1 to 2"),
        (lambda: TipBox(0, 1, axis="w").rows(Stage.of(MODEL)), "must be 'x', 'y' or 'z'"),
    ],
)
def test_limits_that_make_no_sense(make: Any, said: str) -> None:
    with pytest.raises(InputError, match=said):
        make()


IN_THE_WAY: dict[str, tuple[dict[str, Any], str]] = {
    "box": ({"kind": "tip_box", "axis": "x", "high": 0.01}, "tip_x"),
    "cone": ({"kind": "tip_cone", "axis": [-0.3, 0, 1], "angle": 20.0}, "angle of tip direction"),
}


@pytest.mark.sampled
@pytest.mark.parametrize("kind", IN_THE_WAY)
def test_a_limit_in_the_way_of_a_goal_is_named(kind: str) -> None:
    """The goal gives way, the limit holds in the simulation, and the nearest is at it."""
    row, name = IN_THE_WAY[kind]
    planning = read(Path(), limits=[row])
    found = plan(planning.problem(), planning.settings)
    assert found.status == "infeasible" and found.held_by[0] == name
    assert found.gives_way[0].name == "goal 1: position of section tip 1"
    assert found.replay is not None and found.gives_way[0].time == pytest.approx(found.time)
    length = planning.model.scene.manipulator.length
    ends = [section_ends([length], q) for q in found.replay.x[:, : planning.model.strains]]
    if kind == "box":
        values = np.array([places[-1][0] for places, _ in ends]) - 0.01
        assert found.gives_way[0].amount == pytest.approx(0.02, abs=2e-3)  # from 0.01 to 0.03
    else:
        aim = np.array([-0.3, 0, 1]) / np.linalg.norm([-0.3, 0, 1])
        angles = [angle_between(turns[-1][:, 2], aim) for _, turns in ends]
        values = np.array(angles) - np.radians(20.0)
    assert -1e-3 < values[-1] < 1e-3 and values.max() < 1e-2


def test_backing_off_leaves_room(tmp_path: Path) -> None:
    planning = read(tmp_path, back_off=0.1, start={"torques": [0.5, 0.3, 0.3]})
    found = plan(planning.problem(), planning.settings)
    assert found.solved and found.replay is not None
    arm = planning.model.scene.manipulator.limits
    for values, low, high in (
        (found.u, arm.torque_min, arm.torque_max),
        (found.replay.pressures, arm.pressure_min, arm.pressure_max),
    ):
        room = min(values.min() - low, high - values.max()) / (high - low)
        assert room > 0.1 - 1e-4
        assert room < 0.11  # least time goes to what is left
    save_plan(found, tmp_path)
    assert load_plan(tmp_path).problem.back_off == 0.1


def test_a_start_without_room() -> None:
    drive, start = {"actuation": {"kind": "hydraulic"}}, {"torques": [0.5, 0.0, 0.3]}
    assert read(Path(), drive, start=start).problem().back_off == 0.0
    with pytest.raises(SceneError, match=r"back_off = 0.1: the arm starts with P_2 = .* smaller"):
        read(Path(), drive, start=start, back_off=0.1).problem()
    with pytest.raises(SceneError, match=r"back_off.*0.5"):
        read(Path(), back_off=0.5)
    with pytest.raises(InputError, match=r"back_off = 0.5: must be from 0 to below 0.5"):
        replace(read(Path()).problem(), back_off=0.5)
