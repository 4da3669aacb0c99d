"""The tables of [plan] in docs/planning.md have the keys, names and defaults of the reader."""

from __future__ import annotations

import inspect
import re
from pathlib import Path
from typing import Any

import pytest
from pages import ROOT
from small_plans import PLAN, read

from softmpc.errors import SceneError
from softmpc.planning import result
from softmpc.planning.goal_tables import FREE, POSTURES
from softmpc.planning.planner import PlanSettings
from softmpc.planning.problem import LEAST
from softmpc.planning.scene_table import LIMITS

PAGE = (ROOT / "docs" / "planning.md").read_text(encoding="utf-8")
NONE = {"none": 1}
BOX = {"kind": "tip_box", "axis": "z", "low": 0}
CONE = {"kind": "tip_cone", "axis": [0, 0, 1], "angle": 30}
STRAIN = {"kind": "strain", "strain": "epsilon", "low": -1}


def rows(table: str) -> dict[str, tuple[str, str]]:
    """Meaning and default of each key of a table of the page."""
    head = f"| key of `{table}` | meaning | default |\n| --- | --- | --- |\n"
    assert head in PAGE
    found: dict[str, tuple[str, str]] = {}
    for line in PAGE.partition(head)[2].partition("\n\n")[0].splitlines():
        keys, meaning, default = (cell.strip() for cell in line.strip("|").split(" | "))
        found |= dict.fromkeys(re.findall(r"`(\w+)`", keys), (meaning, default))
    return found


def known(table: str, **plan: Any) -> set[str]:
    """The keys that the reader names where one is not known."""
    with pytest.raises(SceneError, match=re.escape(f"unknown key in {table}")) as caught:
        read(Path(), **plan)
    return set(str(caught.value).partition("allowed: ")[2].split(", "))


def test_all_keys_are_there() -> None:
    plan, pressed = known("[plan]", **NONE), {"actuation": {"kind": "pressure"}}
    with pytest.raises(SceneError) as caught:
        read(Path(), pressed, **{**PLAN, "torque_rate": None, "start": None, **NONE})
    plan |= set(str(caught.value).partition("allowed: ")[2].split(", "))
    start, goals, limits = "[plan.start]", "[[plan.goals]]", "[[plan.limits]]"
    assert set(rows("[plan]")) | {"start", "goals", "obstacles", "limits"} == plan
    state = {"time"}  # asked for where there is a state
    assert set(rows(start)) == known(start, start=NONE) | state
    assert set(rows(goals)) == known(goals, goals=[NONE]) | state
    read_limits = [known(limits, limits=[one | NONE]) for one in (BOX, CONE, STRAIN)]
    assert set(rows(limits)) == set().union(*read_limits)


def test_names_are_complete() -> None:
    def quoted(table: str, key: str) -> set[str]:
        return set(re.findall(r'"([\w-]+)"', rows(table)[key][0]))

    assert quoted("[plan]", "least") == set(LEAST)
    assert quoted("[[plan.limits]]", "kind") == set(LIMITS)
    assert quoted("[plan.start]", "posture") == set(POSTURES)
    assert quoted("[[plan.goals]]", "posture") == {FREE}  # the others are as above


def test_defaults_are_those_of_the_reader() -> None:
    page, settings = rows("[plan]"), PlanSettings()
    for name, value in vars(settings).items():
        assert float(page[name][1]) == value, name
    planning = read(Path())
    for name in ("margin", "back_off"):
        assert float(page[name][1]) == getattr(planning, name) == 0.0
    assert page["least"][1] == '`"time"`' and read(Path(), least=None).least == "time"


def test_all_statuses_are_explained() -> None:
    head = "| status | meaning | exit status |\n| --- | --- | --- |\n"
    lines = PAGE.partition(head)[2].partition("\n\n")[0].splitlines()
    shown = {line.strip("|").split(" | ")[0].strip().strip("`") for line in lines}
    names = [line.split(" = ")[0] for line in inspect.getsource(result).splitlines()
             if re.match(r"[A-Z_]+ = \"", line)]  # fmt: skip
    assert shown == {getattr(result, name) for name in names} and len(shown) >= 6
