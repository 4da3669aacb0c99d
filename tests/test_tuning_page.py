"""The pictures of the tuning page: what is varied, one of its closed loops, and the drawing."""

from __future__ import annotations

import importlib
import re
import sys
from pathlib import Path
from types import ModuleType

import pytest
from pages import ROOT

from softmpc.control.controller_table import ControllerSettings
from softmpc.control.costs import TipPosition, TorqueRate

DOCS = ROOT / "docs"


@pytest.fixture(scope="module")
def script() -> ModuleType:
    sys.path.insert(0, str(DOCS))
    try:
        return importlib.import_module("make_tuning_images")
    finally:
        sys.path.remove(str(DOCS))


def test_defaults_are_the_controllers(script: ModuleType) -> None:
    for name, value in script.DEFAULTS.items():
        assert script.settings_of(name, value) == ControllerSettings(), name


def test_one_setting_is_changed(script: ModuleType) -> None:
    tip = script.settings_of("tip_deviation", 10).costs
    assert [cost.deviation for cost in tip if isinstance(cost, TipPosition)] == [0.01]
    slow = script.settings_of("step", 50)
    assert (slow.step, slow.horizon) == (0.05, 10)
    rates = [cost.deviation for cost in slow.costs if isinstance(cost, TorqueRate)]
    assert rates == [pytest.approx(0.2)]  # the same torque rate a second


@pytest.mark.slow
def test_a_loop_is_as_printed(script: ModuleType) -> None:
    error, rate, failed, _ = script.loop(("same", "step", 50.0))
    assert error == pytest.approx(0.164, rel=0.02)  # of the page's picture, mm
    assert rate == pytest.approx(0.435, rel=0.02)
    assert failed == 0


def test_pictures_are_drawn(script: ModuleType, tmp_path: Path) -> None:
    asked = script.WEIGHTS | script.TIMING
    found = {
        (plant, name, value): [0.1 * value, 0.2 * value, 0, 1.0]
        for plant in script.PLANTS
        for name, (_, values) in asked.items()
        for value in values
    }
    for some in (script.WEIGHTS, script.TIMING):
        made = script.sensitivity_figure(some, found, "title")
        assert len(made.axes) == 2 * len(some)
        for axes in made.axes:  # nothing is cut off
            low, high = axes.get_ylim()
            lines = [line.get_ydata() for line in axes.lines if len(line.get_ydata()) > 2]
            assert len(lines) == len(script.PLANTS)
            assert all(low <= min(line) and max(line) <= high for line in lines)
        script.save(made, tmp_path / "made.png")


def test_page_shows_the_pictures(script: ModuleType) -> None:
    written = set(
        re.findall(r'"(tuning_\w+\.png)"', (DOCS / "make_tuning_images.py").read_text("utf-8"))
    )
    page = (DOCS / "tuning.md").read_text(encoding="utf-8")
    assert written == set(re.findall(r"images/(tuning_\w+\.png)", page))
    assert all((DOCS / "images" / name).is_file() for name in written)
