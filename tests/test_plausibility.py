"""Readings that are wrong by themselves: jumps away and back, frozen ones, gaps."""

from __future__ import annotations

import numpy as np
import pytest

from softmpc.estimation.plausibility import AWAY, Plausibility
from softmpc.estimation.sensing import Sample
from softmpc.estimation.sensors import Reading, SectionTips, Sensor, UnitPressures

NONE = np.zeros((3, 1))


def judged(sensor: Sensor, values: list[tuple[int, float]]) -> list[str]:
    """What is said of readings, all three numbers alike but for noise, by their stamps."""
    random = np.random.default_rng(1)
    look = Plausibility((sensor,), (Reading(("a", "b", "c"), NONE, NONE),))
    return [
        look.fault(Sample(0, stamp, stamp, value + sensor.noise * random.standard_normal(3)))
        for stamp, value in values
    ]


def test_an_arm_that_moves_fast() -> None:
    """2 m/s, and noise: never a jump, also with samples missing."""
    values = [(10 * k, 2.0 * 0.01 * k) for k in range(100) if k % 7]
    assert set(judged(SectionTips(), values)) == {""}


def test_away_and_back() -> None:
    values = [(10 * k, 0.1 if 20 <= k < 60 else 0.0) for k in range(100)]
    found = judged(SectionTips(), values)
    assert found == [""] * 20 + ["after a jump"] * 40 + [""] * 40


def test_one_outlier() -> None:
    values = [(10 * k, 0.5 * (k == 5)) for k in range(12)]
    assert [k for k, said in enumerate(judged(SectionTips(), values)) if said] == [5]


def test_a_camera_that_was_moved_is_taken_for_it_after_a_while() -> None:
    values = [(10 * k, 0.2 * (k >= 10)) for k in range(300)]
    found = judged(SectionTips(), values)
    assert found[10 : 10 + AWAY // 10] == ["after a jump"] * (AWAY // 10)
    assert set(found[10 + AWAY // 10 :]) == {""}


def test_a_gap_in_which_the_arm_moved() -> None:
    values = [(10 * k, 0.0) for k in range(10)] + [(600 + 10 * k, 0.3) for k in range(10)]
    assert set(judged(SectionTips(), values)) == {""}


def test_frozen_while_the_arm_moves() -> None:
    """Equal readings are no news of where the arm is: what follows is no jump."""
    look = Plausibility((SectionTips(),), (Reading(("a",), NONE[:1], NONE[:1]),))
    places = [0.001 * min(k, 10) if k < 40 else 0.001 * k for k in range(60)]
    found = [look.fault(Sample(0, 10 * k, 10 * k, np.array([x]))) for k, x in enumerate(places)]
    assert found == [""] * 12 + ["frozen"] * 28 + [""] * 20


@pytest.mark.parametrize("value", [1e6, -1e6])
def test_pressures_may_jump(value: float) -> None:
    assert set(judged(UnitPressures(), [(0, 0.0), (10, value), (20, 0.0)])) == {""}


def test_late_readings_are_not_compared() -> None:
    assert set(judged(SectionTips(), [(0, 0.0), (100, 0.2), (90, 0.0), (110, 0.2)])) == {""}
