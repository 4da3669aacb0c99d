"""The tables of docs/rig.md against the reader of [rig]: every key, no other, and the defaults."""

from __future__ import annotations

import re
from dataclasses import fields
from typing import Any

import pytest
from pages import ROOT

from softmpc.errors import SceneError
from softmpc.estimation.sensors import SENSORS
from softmpc.rig.faults import FAULTS
from softmpc.rig.scene_table import RigSettings, read_rig
from softmpc.rig.supervision import Supervision

PAGE = (ROOT / "docs" / "rig.md").read_text(encoding="utf-8")


def rows(title: str) -> dict[str, str]:
    """Default of each key of the table with this title."""
    after = PAGE.partition(f"| {title} | meaning | default |\n| --- | --- | --- |\n")[2]
    found: dict[str, str] = {}
    for line in after.partition("\n\n")[0].splitlines():
        keys, _, default = (cell.strip() for cell in line.strip("|").split(" | "))
        found |= dict.fromkeys(re.findall(r"`(\w+)`", keys), default.strip())
    return found


def known(data: dict[str, Any], table: str) -> set[str]:
    """The keys that the reader names where one is not known."""
    with pytest.raises(SceneError, match=re.escape(f"unknown key in {table}")) as caught:
        read_rig(data)
    return set(str(caught.value).partition("allowed: ")[2].split(", "))


def test_rig() -> None:
    assert known({"none": 1}, "[rig]") == set(rows("key of `[rig]`"))


def test_sensors() -> None:
    keys = set.union(*(known({name: {"none": 1}}, f"[rig.{name}]") for name in SENSORS))
    assert keys == set(rows("key of a sensor"))


def test_estimator() -> None:
    told = set(rows("key of `[rig.estimator]`"))
    assert known({"estimator": {"none": 1}}, "[rig.estimator]") == told
    parts = {"strains", "rates", "drive", "forces", "offsets"}
    for name in ("noise", "spread"):
        assert known({"estimator": {name: {"none": 1}}}, f"[rig.estimator.{name}]") >= parts


def test_supervision() -> None:
    table = rows("key of `[rig.supervision]`")
    assert known({"supervision": {"none": 1}}, "[rig.supervision]") == set(table)
    for one in fields(Supervision):
        if one.name != "resume":
            assert float(table[one.name]) == one.default, one.name
    settings = rows("key of `[rig]`")
    assert float(settings["wait"]) == RigSettings.wait


def test_faults_are_all_there() -> None:
    part = PAGE.partition("## Faults")[2].partition("## ")[0]
    told = set(re.findall(r"^\| (`.*?) \|", part, re.MULTILINE))
    names = {name for row in told for name in re.findall(r"`(\w+)`", row)} - {"kind"}
    assert names == set(FAULTS)
