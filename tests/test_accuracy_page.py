"""docs/accuracy.md is what its stored study says, and that study says what the page is about."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path
from typing import Any

import pytest

from softmpc.accuracy.model_axes import AS_GIVEN
from softmpc.accuracy.orders import APPROACHES, AS_THEORY, DIFFERS, DIVERGES, Fit, fits
from softmpc.accuracy.points import Study
from softmpc.accuracy.work import MEASURED

ROOT = Path(__file__).resolve().parents[1]
REMADE = "run python docs/make_accuracy.py --render"


@pytest.fixture(scope="module")
def maker() -> Any:
    """docs/make_accuracy.py."""
    spec = importlib.util.spec_from_file_location(
        "make_accuracy", ROOT / "docs" / "make_accuracy.py"
    )
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def study(maker: Any) -> Study:
    stored: Study = maker.stored()
    return stored


def fitted(study: Study) -> dict[tuple[str, str, str], Fit]:
    return {
        (family.name, fit.series, fit.key): fit for family in study.families for fit in fits(family)
    }


def test_page_is_what_the_stored_study_says(maker: Any, study: Study) -> None:
    page = (ROOT / "docs" / "accuracy.md").read_text(encoding="utf-8")
    assert maker.story(study) == page, REMADE


def test_pictures_of_the_page_are_there() -> None:
    page = (ROOT / "docs" / "accuracy.md").read_text(encoding="utf-8")
    named = re.findall(r"\(images/(\w+\.png)\)", page)
    assert len(named) == 5
    for name in named:
        assert (ROOT / "docs" / "images" / name).is_file(), REMADE


def test_page_of_the_command_has_all_axes(study: Study) -> None:
    told = (ROOT / "docs" / "study.md").read_text(encoding="utf-8")
    axes = {axis for family in study.families for axis in family.axes if axis != AS_GIVEN}
    assert len(axes) > 15
    assert not [axis for axis in axes if f"`{axis}`" not in told]


def test_study_is_whole(study: Study) -> None:
    """All families, and of each the scene as given with its error and its time."""
    assert study.status == "finished"
    for family in study.families:
        assert not family.missing
        assert family.as_given is not None and family.as_given.status == MEASURED


def test_orders_are_those_of_theory(study: Study) -> None:
    """2 with Gauss points and the exact ω, 1 with lumped mass, at rest and in motion."""
    found = fitted(study)
    for family in ("rest", "motion"):
        assert found[family, "2 Gauss points", "error_m"].verdict == AS_THEORY
        assert found[family, "2 Gauss points", "error_m"].theory == 2.0
        assert found[family, "lumped mass", "error_m"].verdict == AS_THEORY
        assert found[family, "lumped mass", "error_m"].theory == 1.0
    with_theory = [fit for fit in found.values() if fit.theory is not None]
    assert not [fit for fit in with_theory if fit.verdict == DIFFERS]
    nearing = [fit.key for fit in with_theory if fit.verdict == APPROACHES]
    assert set(nearing) <= {"frequency_error"}


def test_what_does_not_converge_is_told_by_its_numbers(study: Study) -> None:
    """The printed transmission, and nothing else."""
    flagged = {series for (_, series, _), fit in fitted(study).items() if fit.verdict == DIVERGES}
    assert flagged == {"Newton-Euler, as printed"}
