"""The tables of [track] in docs/mpc.md have the keys, names and defaults of the reader."""

from __future__ import annotations

import json
import re
from dataclasses import fields
from pathlib import Path
from typing import Any

import pytest
from pages import ROOT
from plans import still_plan, write_plan

from softmpc.control.controller_table import SOFTENED, TERMINALS, ControllerSettings
from softmpc.control.costs import StrainRate, TipPosition, Torque, TorqueRate
from softmpc.control.solvers import SOLVERS
from softmpc.control.track_paths import PATHS
from softmpc.control.track_scene import ON_INFEASIBLE, Plant, read_tracking
from softmpc.errors import SceneError
from softmpc.simulation.methods import METHODS

PAGE = (ROOT / "docs" / "mpc.md").read_text(encoding="utf-8")
TABLES = {"[track]": "key", "[track.controller]": "key of `[track.controller]`"}
TABLES |= {"[track.plant]": "key of `[track.plant]`"}
SHAPES: dict[str, dict[str, Any]] = {
    "circle": {"center": [0.1, 0, 0.6], "diameter": 0.05},
    "figure-eight": {"center": [0.1, 0, 0.6], "width": 0.05, "height": 0.02},
    "helix": {"center": [0.1, 0, 0.6], "diameter": 0.05, "pitch": 0.01},
    "point": {"center": [0.1, 0, 0.6]},
    "line": {"start": [0.1, 0, 0.6], "end": [0.1, 0.01, 0.6]},
    "waypoints": {"file": "points.csv"},
    "plan": {},
}
CIRCLE = {"path": "circle", **SHAPES["circle"]}


def rows(table: str) -> dict[str, tuple[str, str]]:
    """Meaning and default of each key of a table of the page."""
    after = PAGE.partition(f"| {TABLES[table]} | meaning | default |\n| --- | --- | --- |\n")[2]
    found: dict[str, tuple[str, str]] = {}
    for line in after.partition("\n\n")[0].splitlines():
        keys, meaning, default = (cell.strip() for cell in line.strip("|").split(" | "))
        found |= dict.fromkeys(re.findall(r"`(\w+)`", keys), (meaning, default))
    return found


def known(data: dict[str, Any], table: str, folder: Path) -> set[str]:
    """The keys that the reader names where one is not known."""
    with pytest.raises(SceneError, match=re.escape(f"unknown key in {table}")) as caught:
        read_tracking(data, folder, {})
    return set(str(caught.value).partition("allowed: ")[2].split(", "))


def test_paths_have_all_their_keys(tmp_path: Path) -> None:
    (tmp_path / "points.csv").write_text("x,y,z\n0,0,0.6\n0.01,0,0.6\n")
    write_plan(tmp_path, still_plan())
    assert set(SHAPES) == set(PATHS)
    read = set()
    for name, shape in SHAPES.items():
        read |= known({"path": name, **shape, "none": 1}, "[track]", tmp_path)
    assert set(rows("[track]")) | {"controller", "plant"} == read


@pytest.mark.parametrize("name", ["controller", "plant"])
def test_controller_and_plant_have_all_their_keys(name: str, tmp_path: Path) -> None:
    table = f"[track.{name}]"
    assert set(rows(table)) == known(CIRCLE | {name: {"none": 1}}, table, tmp_path)


@pytest.mark.parametrize(
    ("table", "key", "names"),
    [
        ("[track]", "path", PATHS),
        ("[track]", "on_infeasible", ON_INFEASIBLE),
        ("[track.controller]", "solver", SOLVERS),
        ("[track.controller]", "terminal", TERMINALS),
        ("[track.controller]", "soft", SOFTENED),
        ("[track.controller]", "hessian", ("gauss-newton", "exact")),
    ],
)
def test_names_are_complete(table: str, key: str, names: Any) -> None:
    assert set(re.findall(r'"([\w-]+)"', rows(table)[key][0])) >= set(names)


def test_defaults_are_those_of_the_reader() -> None:
    settings, page = ControllerSettings(), rows("[track.controller]")
    costs = {type(cost): cost.deviation for cost in settings.costs}
    expected: dict[str, Any] = {
        "tip_deviation": costs[TipPosition],
        "torque_deviation": costs[Torque],
        "torque_rate_deviation": costs[TorqueRate],
        "strain_rate_deviation": costs[StrainRate],
    }
    values = {field.name: getattr(settings, field.name) for field in fields(settings)}
    expected |= {n: v for n, v in values.items() if isinstance(v, str | int | float)}
    for key, value in expected.items():
        shown = page[key][1].strip("`").split(", ")  # a row may hold two keys
        which = ("tolerance", "max_iterations").index(key) if len(shown) > 1 else 0
        as_text = isinstance(value, str | bool)  # as TOML has it
        assert shown[0] == json.dumps(value) if as_text else float(shown[which]) == value, key
    track = read_tracking(CIRCLE, ROOT, {})
    assert float(rows("[track]")["settle"][1]) == track.settle
    assert rows("[track.plant]")["method"][1].strip("`") == f'"{Plant().method.name}"'
    assert Plant().method.tolerance == 1e-8
    assert {number for takes in METHODS.values() for number in takes} <= set(rows("[track.plant]"))
