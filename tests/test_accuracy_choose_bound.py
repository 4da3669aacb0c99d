"""The bound of a choice in three of the scenes it was not calibrated with."""

from __future__ import annotations

import pytest
from choosing_work import measured_here

from softmpc.accuracy import motion_cost, study
from tests.benchmarks.choosing import judged
from tests.benchmarks.choosing_scenes import CALIBRATING, JUDGING, loop_scene, motion_scene


@pytest.mark.slow
@pytest.mark.parametrize("seed", [102, 105, 108])  # one section: the quickest ones
def test_the_bound_holds_and_is_not_wide(monkeypatch: pytest.MonkeyPatch, seed: int) -> None:
    monkeypatch.setattr(study, "measure_alone", measured_here)
    monkeypatch.setitem(motion_cost.SPEND, True, 0.05)
    row = judged("motion", seed, workers=1)
    assert row["chosen"], row["reasons"]
    assert row["true_m"] <= row["bound_m"] <= row["tolerance_m"]
    assert row["bound_m"] <= 3 * row["true_m"]


def test_scenes_to_judge_are_not_those_to_calibrate() -> None:
    for family, (first, count) in JUDGING.items():
        other, more = CALIBRATING[family]
        assert not set(range(first, first + count)) & set(range(other, other + more))
    assert sum(count for _, count in JUDGING.values()) == 20


def test_scenes_are_made_of_their_seed_alone() -> None:
    for make in (motion_scene, loop_scene):
        assert make(7) == make(7)
        assert make(7) != make(8)
    assert {len(motion_scene(k)[0]["manipulator"]["section_mass"]) for k in range(100, 112)} == {
        1,
        2,
        3,
    }
