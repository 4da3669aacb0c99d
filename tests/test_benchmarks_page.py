"""docs/performance.md is what the last stored run gives."""

from __future__ import annotations

import importlib
import re
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import pytest

from tests.benchmarks.listing import benchmarks
from tests.benchmarks.stored import DONE, Result, Run, last_stored, new_run

DOCS = Path(__file__).resolve().parents[1] / "docs"


@pytest.fixture
def maker(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """docs/make_performance.py."""
    monkeypatch.syspath_prepend(str(DOCS))
    return importlib.import_module("make_performance")


@pytest.fixture
def stored() -> Run:
    """The run that the page is of."""
    run = last_stored("quick")
    assert run is not None
    return run


def test_page_is_of_the_stored_run(maker: ModuleType, stored: Run) -> None:
    made = maker.page(stored)
    assert (DOCS / "performance.md").read_text(encoding="utf-8") == made, (
        "run python docs/make_performance.py"
    )


def test_stored_run_is_whole(stored: Run) -> None:
    """Nothing failed, and what its benchmarks measured has numbers."""
    assert [name for name, one in stored.benchmarks.items() if one.failed] == []
    assert all(one.numbers for one in stored.benchmarks.values() if one.status == DONE)


def test_every_row_names_a_number_of_the_run(maker: ModuleType, stored: Run) -> None:
    """Where a benchmark ran, no row of the page is empty."""
    done = {name for name, one in stored.benchmarks.items() if one.status == DONE}
    missing = [
        (benchmark, name)
        for benchmark, name in shown(maker)
        if benchmark in done and name not in stored.benchmarks[benchmark].numbers
    ]
    optional = "acados|do_mpc"  # of benchmarks that run without them
    assert [row for row in missing if not re.search(optional, row[1])] == []


def shown(maker: ModuleType) -> set[tuple[str, str]]:
    """Benchmarks and names of numbers in the tables of single rows."""
    rows = [*((b, n) for _, b, n in (*maker.CALLS, *maker.FACTORS))]
    rows += [(b, n) for _, _, b, n in maker.PEERS]
    return {*rows, *((b, n) for _, b, n, _ in maker.QUALITY)}


def test_every_benchmark_has_its_details_and_its_row(maker: ModuleType, stored: Run) -> None:
    assert set(benchmarks()) <= set(maker.DETAILS)
    text = maker.page(stored)
    assert all(f"| `{name}` |" in text for name in benchmarks())


def test_times_and_numbers_as_text(maker: ModuleType) -> None:
    texts = [maker.time(x) for x in (2.34e-7, 4.2e-6, 0.0315, 0.9996, 59.96, 1234.5, None)]
    assert texts == ["0.234 µs", "4.2 µs", "31.5 ms", "1 s", "60 s", "1,230 s", "–"]
    assert [maker.plain(x) for x in (1234567, 3.0, 0.012345, None)] == [
        "1,234,567", "3", "0.0123", "–",
    ]  # fmt: skip


@pytest.mark.slow
def test_a_page_of_a_run_without_peers(maker: ModuleType) -> None:
    run = new_run("quick")
    empty = maker.page(run)
    assert "not in this run" in empty and "nan" not in empty
    some = {"compiling": Result(DONE, 2.0, 1.0, 1.5, {"1_segment_residual_us": 6.0})}
    some["peer"] = Result("left out: soromox is not installed: pip install soromox", 0.5)
    text = maker.page(replace(run, benchmarks=some))
    assert "| residual, CasADi's virtual machine | 6 µs |" in text
    assert "left out: soromox is not installed" in text
