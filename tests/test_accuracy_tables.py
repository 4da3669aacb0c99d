"""A study as tables: what people read, columns, plain data that makes the same study again."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import pytest

from softmpc.accuracy.configuration import Configuration
from softmpc.accuracy.points import FamilyResult, Point, Study
from softmpc.accuracy.tables import columns, conclusions, markdown, terminal, time_text
from softmpc.simulation.columns import write_columns

MACHINE = {
    "processor": "Slow", "cores": 2, "memory_gib": 4.0, "system": "Linux", "python": "3.11",
    "casadi": "3.8", "compiler": None, "load": 0.25,
}  # fmt: skip
GAUSS = (0.0096, 0.0022, 0.00055)
PRINTED = (0.080, 0.046, 0.125)


def point(axis: str, name: str, error: dict[str, Any], cost: dict[str, Any], **more: Any) -> Point:
    parts = [{"status": "measured", **part} if part else {} for part in (error, cost)]
    return Point(Configuration(axis, name, {"name": name}, **more), *parts)


def series(axis: str, name: str, errors: tuple[float, ...], order: float | None) -> list[Point]:
    return [
        point(
            axis, f"{name} {2**i}", {"error_m": error, "doubt_m": 1e-6},
            {"time_s": 1e-5 * 2**i, "spread_s": 3e-7, "ratio": 2.0**i, "instructions": 2000 * 2**i},
            series=name, size=0.5**i, order=order,
        )
        for i, error in enumerate(errors)
    ]  # fmt: skip


@pytest.fixture
def study() -> Study:
    points = [
        point("as given", "as given", {"error_m": 0.0096}, {"time_s": 1e-5, "ratio": 1.0}),
        *series("mass", "gauss", GAUSS, 2.0),
        *series("formulation", "printed", PRINTED, None),
        point("effects", "with | weight", {"change_m": 0.0123}, {"time_s": 2.5e-3}),
        point("effects", "exact", {"error_m": 1e-9, "doubt_m": 2e-6, "by": [1.0, 2.0]}, {}),
        Point(Configuration("effects", "odd", {"a": 1}), {"status": "has no rest"}),
        Point(Configuration("effects", "later", {"a": 2})),
        Point(Configuration("effects", "later still", {"a": 3})),
    ]
    rods = {"rod": "a rod of 40 elements", "bent": "a rod of 40 elements", "old": "printed"}
    rods["far"] = "told at length, " * 10
    rest = FamilyResult("rest", rods, tuple(points))
    loop = FamilyResult("loop", {}, (), "the scene has no table [track]")
    return Study("Arm", "interrupted", True, MACHINE, (rest, loop), {"title": "Arm"})


def cells(text: str, name: str) -> list[str]:
    """The cells of a line of the terminal's tables; two spaces are between them."""
    (line,) = [line for line in text.splitlines() if line.strip().startswith(f"{name}  ")]
    return [cell.strip() for cell in line.strip().split("  ") if cell.strip()]


def test_points_for_people(study: Study) -> None:
    text = terminal(study)
    assert text.startswith("Arm: what accuracy costs in time (quick study, interrupted)\n\nrest: ")
    assert "\nreference rod, bent: a rod of 40 elements\nreference old: printed\n" in text
    assert cells(text, "gauss 1") == ["gauss 1", "9.6 mm", "10 ± 0.3 µs", "1.00", "2,000"]
    assert cells(text, "gauss 4 *") == ["gauss 4 *", "550 µm", "40 ± 0.3 µs", "4.00", "8,000"]
    assert cells(text, "printed 4") == ["printed 4", "125 mm", "40 ± 0.3 µs", "4.00", "8,000"]
    assert cells(text, "with | weight") == ["with | weight", "change 12.3 mm", "2.5 ms", "–", "–"]
    assert cells(text, "exact") == ["exact", "< 2 µm", "–", "–", "–"]
    assert "not measured:\nodd: has no rest\n3 points that are still to be measured\n" in text
    assert "\nloop: not measured, the scene has no table [track]\n" in text
    assert text.endswith("measured on Slow, 2 cores, 4.0 GiB, Linux, Python 3.11, CasADi 3.8, "
                         "compiler none, load 0.2")  # fmt: skip


def test_the_cheapest_of_equals_is_marked_once(study: Study) -> None:
    """The scene as given comes first, "gauss 1" is another one of the same error and time."""
    marked = [line.split(" *")[0].strip() for line in terminal(study).splitlines() if " *" in line]
    assert marked == ["as given", "gauss 2", "gauss 4"]


def test_orders_for_people(study: Study) -> None:
    text = terminal(study)
    order = cells(text, "gauss")
    assert order[:3] == ["gauss", "error", "as theory says"]
    assert order[3].startswith("2.06 ± 0.0") and order[4:] == ["2", "1, 1/2, 1/4"]
    order = cells(text, "printed")
    assert order[:3] == ["printed", "error", "does not converge"]
    assert order[3].startswith("-0.32 ± ") and order[4:] == ["–", "1, 1/2, 1/4"]


def test_lines_fit_a_terminal(study: Study) -> None:
    assert max(map(len, terminal(study).splitlines())) <= 100


def test_markdown(study: Study) -> None:
    """Each table has as many cells in each row as in its head."""
    text = markdown(study)
    for block in text.split("\n\n"):
        if block.startswith("|"):
            rows = [row.replace(r"\|", "").count("|") for row in block.splitlines()]
            assert len(set(rows)) == 1, block
    assert "| gauss 4 \\* | 550 µm | 40 ± 0.3 µs | 4.00 | 8,000 |" in text
    assert "| **formulation** |  |  |  |  |" in text
    assert "with \\| weight" in text and "- odd: has no rest" in text
    assert text.startswith("# Arm\n\nQuick study, interrupted.\n\n## Rest\n\nRest: ")
    assert "Loop: not measured, the scene has no table [track]." in text


def test_columns(study: Study, tmp_path: Path) -> None:
    write_columns(tmp_path / "study.csv", columns(study))
    with open(tmp_path / "study.csv", newline="") as file:
        rows = {row["name"]: row for row in csv.DictReader(file)}
    assert len(rows) == len(study.points)
    row = rows["gauss 4"]
    assert (row["family"], row["axis"], row["series"]) == ("rest", "mass", "gauss")
    assert (float(row["size"]), float(row["theory"])) == (0.25, 2.0)
    assert (float(row["error_m"]), float(row["time_s"])) == (0.00055, 4e-5)
    assert (row["status"], row["on_front"], row["at_floor"]) == ("measured", "True", "False")
    exact = rows["exact"]
    assert (exact["at_floor"], exact["by_1"], exact["by_2"]) == ("True", "1.0", "2.0")
    assert (rows["odd"]["status"], rows["odd"]["error_m"]) == ("has no rest", "")
    assert rows["later"]["status"] == "to be measured"


def test_columns_of_the_same_name(study: Study) -> None:
    both = point("a", "a", {"status": "measured", "wall_s": 1.0}, {"wall_s": 2.0})
    found = columns(Study("", "finished", False, {}, (FamilyResult("rest", {}, (both,)),)))
    assert (found["wall_s"].tolist(), found["cost_wall_s"].tolist()) == ([1.0], [2.0])


def test_plain_data_makes_the_same_study_again(study: Study) -> None:
    data = json.loads(json.dumps(conclusions(study)))
    again = Study.from_summary(data)
    assert again.summary() == study.summary()
    assert conclusions(again) == conclusions(study)
    assert terminal(again) == terminal(study)
    assert [fit["verdict"] for fit in data["families"][0]["fits"]][:1] == ["as theory says"]
    front = data["families"][0]["front"]
    assert [one["name"] for one in front] == ["as given", "gauss 2", "gauss 4"]
    assert data["families"][1]["fits"] == data["families"][1]["front"] == []


def test_a_study_without_points() -> None:
    family = FamilyResult("rest", {}, (), "there is no reference 'rod': no rest")
    empty = Study("Arm", "finished", False, MACHINE, (family,))
    assert "rest: not measured, there is no reference 'rod': no rest\n\nmeasured on" in terminal(
        empty
    )
    assert "## What the columns are" not in markdown(empty)
    assert columns(empty) == {}


def test_a_spread_that_is_larger_than_its_time() -> None:
    """As it is on a busy machine."""
    busy = point("a", "a", {}, {"time_s": 7.5e-5, "spread_s": 4.12e-4})
    text = terminal(Study("", "finished", False, MACHINE, (FamilyResult("rest", {}, (busy,)),)))
    assert "75 ± 412 µs" in text


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (0.0, "0 ns"), (3.21e-9, "3.21 ns"), (9.996e-7, "1 µs"), (1.234e-6, "1.23 µs"),
        (4.5e-3, "4.5 ms"), (0.9994, "999 ms"), (0.9996, "1 s"), (1234.0, "1234 s"),
    ],
)  # fmt: skip
def test_times_for_people(seconds: float, text: str) -> None:
    assert time_text(seconds) == text
