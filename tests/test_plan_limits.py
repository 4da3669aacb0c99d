"""Limits of a section's tip: its place and direction, against the arm put together by hand."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest
from arms import MIXED, model_of
from oracles.moving_bodies import section_ends

from softmpc.control.limits import Limit, TipBox, TipCone
from softmpc.control.stage import Stage
from softmpc.errors import InputError

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
