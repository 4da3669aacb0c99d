"""The bound of a choice in three of the scenes it was not calibrated with."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from choosing_work import measured_here

from softmpc.accuracy import motion_cost, study
from softmpc.accuracy.bound import CALIBRATED
from tests.benchmarks import choosing
from tests.benchmarks.choosing import summary
from tests.benchmarks.choosing_measures import Judged, Scores
from tests.benchmarks.choosing_scenes import CALIBRATING, JUDGING, SCENES, motion_scene


@pytest.mark.slow
@pytest.mark.parametrize("seed", [102, 105, 108])  # one section: the quickest ones
def test_the_bound_holds_and_is_not_wide(monkeypatch: pytest.MonkeyPatch, seed: int) -> None:
    monkeypatch.setattr(study, "measure_alone", measured_here)
    monkeypatch.setitem(motion_cost.SPEND, True, 0.05)
    row = Judged("motion")(seed)
    assert row["chosen"], row["reasons"]
    assert row["true_m"] <= row["bound_m"] <= row["tolerance_m"]
    assert row["bound_m"] <= 3 * row["true_m"]


def test_scenes_to_judge_are_not_those_to_calibrate() -> None:
    for family, (first, count) in JUDGING.items():
        other, more = CALIBRATING[family]
        assert not set(range(first, first + count)) & set(range(other, other + more))
    assert sum(count for _, count in JUDGING.values()) == 20


def test_scenes_are_made_of_their_seed_alone() -> None:
    for make in SCENES.values():
        assert make(7) == make(7)
        assert make(7) != make(8)
    assert {len(motion_scene(k)[0]["manipulator"]["section_mass"]) for k in range(100, 112)} == {
        1,
        2,
        3,
    }


@pytest.mark.slow
def test_a_rod_is_its_own_truth() -> None:
    """Both models are off by far more than the two solutions of the rod differ."""
    rows = Scores("rest")(3000)
    assert [row["error_m"] for row in rows] == sorted((r["error_m"] for r in rows), reverse=True)
    for row in rows:
        assert row["true_m"] == pytest.approx(row["error_m"], abs=1e-8)
        assert row["doubt_m"] < 1e-6 < row["error_m"]
        assert abs(row["score"]) < 0.01


def judged(title: str, true_mm: float, bound_mm: float = 5.0) -> dict[str, Any]:
    """A row of the benchmark."""
    lengths = {"true_m": 1e-3 * true_mm, "bound_m": 1e-3 * bound_mm, "error_m": 1e-3}
    lengths["doubt_m"] = (lengths["bound_m"] - 1e-3) / CALIBRATED["motion"].factor
    head = {"seed": int(title.split()[1]), "title": title, "tolerance_m": 6e-3}
    return head | lengths | {"chosen": "2 segments", "tried": 9}


def test_what_came_of_it_counts_what_does_not_hold() -> None:
    rows = [judged(f"motion {k}", 2.0) for k in range(9)]
    refused = {"title": "motion 10", "tolerance_m": 1e-3, "chosen": None, "reasons": ["no"]}
    told, good = summary([*rows, judged("motion 9", 6.0), refused])
    assert good and told.startswith("the bound holds in 9 of 10 scenes (1 of 11 refused)")
    assert told.endswith("is 2.50")
    assert not summary([*rows, judged("motion 9", 6.0), judged("motion 10", 6.0)])[1]
    assert not summary([judged(f"motion {k}", 1.6) for k in range(9)])[1], "too wide"
    assert not summary([refused])[1]


def test_the_page_is_written_from_what_is_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    page = tmp_path / "page.md"
    page.write_text("before\n\n<!-- judged -->\nold\n<!-- end -->\n\nafter\n", encoding="utf-8")
    monkeypatch.setattr(choosing, "PAGE", page)
    rows = [judged("motion 101", 6.0), judged("motion 100", 2.0)]
    lines = [json.dumps({"chunk": k, "results": [row]}) for k, row in enumerate(rows)]
    kept = tmp_path / f"judging-motion-{JUDGING['motion'][1]}.jsonl"
    kept.write_text("\n".join(["{}", *lines]) + "\n", encoding="utf-8")
    assert choosing.main(["--write", "--keep", str(tmp_path)]) == 0
    text = page.read_text(encoding="utf-8")
    assert text.startswith("before\n") and text.endswith("<!-- end -->\n\nafter\n")
    first, second = (line for line in text.splitlines() if line.startswith("| motion"))
    assert first == "| motion 100 | 6 | 1 | 5 | 2 | 2.50 | yes | 2 segments |"
    assert "| 0.83 | **no** |" in second
    assert "2 of 20 scenes are judged: the bound holds in 1 of 2 scenes" in text
    choosing.main(["--write", "--keep", str(tmp_path)])
    assert page.read_text(encoding="utf-8") == text
