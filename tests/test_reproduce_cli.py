"""`softmpc reproduce` end to end: answers, files, pictures, the page of the docs, errors."""

from __future__ import annotations

import csv
import importlib.util
import json
import re
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from click.testing import CliRunner, Result
from matplotlib.figure import Figure
from pages import ROOT

from softmpc.cli.main import main
from softmpc.model.presets import DEFAULT_PRESET, PRESETS
from softmpc.simulation.integrator import IntegrationError
from softmpc.study import paper_readings
from softmpc.study.paper_readings import READINGS
from softmpc.study.reproduce import TOPICS, Reproduction, reproduce
from softmpc.view import paper_figures as figures
from softmpc.view import style
from softmpc.view.paper_figures import FIGURES, paper_figures
from softmpc.view.paper_tables import markdown

STILL = ("drive", "limit+x", "limit-x", "fig11a", "fig11b")
NUMBER = re.compile(r"[+−]?\d+(?:\.(\d+))?")
PAGE = (ROOT / "docs" / "reproduce.md").read_text(encoding="utf-8")
LARGEST = 150_000  # bytes of a picture of the docs


def softmpc(*words: object) -> Result:
    return CliRunner().invoke(main, [str(word) for word in words])


def script() -> ModuleType:
    """docs/make_reproduce.py."""
    place = ROOT / "docs" / "make_reproduce.py"
    spec = importlib.util.spec_from_file_location("make_reproduce", place)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@dataclass
class Answered:
    result: Result
    out: Path
    data: dict[str, Any]


@pytest.fixture(scope="module")
def answered(tmp_path_factory: pytest.TempPathFactory) -> Answered:
    out = tmp_path_factory.mktemp("reproduce")
    result = softmpc("reproduce", "--only", ",".join(STILL), "--out", out, "--json")
    return Answered(result, out, json.loads(result.stdout))


# ---------------------------------------------------------------- answers and files


def test_answer(answered: Answered) -> None:
    assert answered.result.exit_code == 0
    assert answered.data["status"] == "finished"
    assert answered.data["parameters"] == DEFAULT_PRESET
    assert [topic["key"] for topic in answered.data["topics"]] == list(STILL)
    record = answered.data["topics"][1]["rows"][0]
    assert record["what"] == "bending angle"
    assert record["printed"] == 165.7
    assert record["difference"] == pytest.approx(record["value"] - 165.7)
    assert record["difference_percent"] == pytest.approx(100 * record["difference"] / 165.7)


def test_files(answered: Answered) -> None:
    names = {path.name for path in answered.out.iterdir()}
    assert names == {"reproduce.json", "reproduce.csv", "reproduce.md", "fig10.png", "fig11.png"}
    assert json.loads((answered.out / "reproduce.json").read_text()) == answered.data
    with open(answered.out / "reproduce.csv", newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    records = [record for topic in answered.data["topics"] for record in topic["rows"]]
    assert [row["what"] for row in rows] == [record["what"] for record in records]
    assert [float(row["value"]) for row in rows] == [record["value"] for record in records]
    assert {row["parameters"] for row in rows} == {DEFAULT_PRESET}
    text = (answered.out / "reproduce.md").read_text(encoding="utf-8")
    assert text.count("\n## ") == len(STILL) - 1


def test_table_for_people() -> None:
    result = softmpc("reproduce", "--only", "limit+x , drive")
    assert result.exit_code == 0
    lines = result.stdout.splitlines()
    assert any(line.split()[:3] == ["arc", "(m)", "0.401"] for line in lines)
    assert any(line.startswith("as read: (33) with s") for line in lines)
    assert max(map(len, lines)) < 160


@pytest.mark.parametrize("name", PRESETS)
def test_every_preset(name: str) -> None:
    result = softmpc("reproduce", "--preset", name, "--only", "drive,limit-x", "--json")
    assert json.loads(result.stdout)["parameters"] == name


# ---------------------------------------------------------------- errors


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--only", "fig5"), "unknown topic: 'fig5'; did you mean"),
        (("--only", ","), "unknown topic: ','; allowed: drive"),
        (("--preset", "chen2022"), "unknown preset: 'chen2022'"),
        (("--picture",), "No such option"),
    ],
)
def test_wrong_input(words: tuple[str, ...], said: str) -> None:
    result = softmpc("reproduce", *words)
    assert result.exit_code == 2
    (line,) = result.stderr.strip().splitlines()
    assert said in line


def raising(error: BaseException) -> Any:
    def run(*_: Any, **__: Any) -> None:
        raise error

    return run


def test_an_interrupted_command_keeps_what_there_is(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(paper_readings, "motion_of", raising(KeyboardInterrupt()))
    words = ("--only", "drive,fig6,fig11b", "--out", tmp_path, "--json")
    result = softmpc("reproduce", *words)
    assert result.exit_code == 130
    data = json.loads(result.stdout)
    assert (data["status"], [t["key"] for t in data["topics"]]) == ("interrupted", ["drive"])
    assert "error: interrupted after 1 topics" in result.stderr
    assert {path.name for path in tmp_path.iterdir()} == {
        "reproduce.json", "reproduce.csv", "reproduce.md",
    }  # fmt: skip


def test_interrupted_at_once(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(paper_readings, "motion_of", raising(KeyboardInterrupt()))
    result = softmpc("reproduce", "--only", "fig6", "--out", tmp_path)
    assert result.exit_code == 130
    assert [path.name for path in tmp_path.iterdir()] == ["reproduce.json"]


def test_interrupted_while_drawing(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(style, "save_figure", raising(KeyboardInterrupt()))
    result = softmpc("reproduce", "--only", "fig11b", "--out", tmp_path)
    assert result.exit_code == 130
    assert "interrupted while drawing; the numbers are complete" in result.stderr
    assert (tmp_path / "reproduce.csv").is_file()


@pytest.mark.slow
def test_our_own_model_failing_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(paper_readings, "motion_of", raising(IntegrationError("no step")))
    result = softmpc("reproduce", "--only", "fig6")
    assert result.exit_code == 3
    assert "error: fig6: no step" in result.stderr


# ---------------------------------------------------------------- pictures


def check(made: Figure) -> None:
    """Every pair of axes has names with units, every figure a legend and a title."""
    assert made.get_suptitle()
    assert made.legends or any(axes.get_legend() for axes in made.axes)
    for axes in made.axes:
        spec = axes.get_subplotspec()
        assert spec is not None
        if spec.is_first_col() or not axes.get_shared_y_axes().get_siblings(axes)[1:]:
            assert re.search(r"\(\S+\)$", axes.get_ylabel()), axes.get_title(loc="left")
        if spec.is_last_row():
            assert re.search(r"\(\S+\)$", axes.get_xlabel()), axes.get_title(loc="left")


@pytest.mark.sampled
@pytest.mark.parametrize("name", ["fig10", "fig11"])
def test_pictures_of_the_arm_at_rest(name: str) -> None:
    found = reproduce(only=[FIGURES[name][0]])
    made = dict(paper_figures(found))
    check(made[name])
    assert DEFAULT_PRESET in made[name].get_suptitle()


def test_only_figures_of_topics_that_were_computed() -> None:
    assert dict(paper_figures(reproduce(only=["drive"]))) == {}
    assert {topic for topic, *_ in FIGURES.values()} <= set(TOPICS)
    assert set(FIGURES) >= {f"fig{n}" for n in (5, 6, 7, 8, 10, 11, 12, 13, 14)}


# ---------------------------------------------------------------- the page of the docs


def same(found: str, kept: str) -> bool:
    """Whether texts agree, numbers to two units of their last digit or 2 %."""
    if NUMBER.sub("#", found) != NUMBER.sub("#", kept):
        return False
    pairs = zip(NUMBER.finditer(found), NUMBER.finditer(kept), strict=True)
    return all(
        abs(_value(a) - _value(b)) <= max(2.0 * 10 ** -len(b[1] or ""), 0.02 * abs(_value(b)))
        for a, b in pairs
    )


def _value(match: re.Match[str]) -> float:
    return float(match[0].replace("−", "-"))


def test_numbers_are_compared_and_not_only_words() -> None:
    assert same("a 0.364 (−9.1 %)", "a 0.365 (−9.0 %)")
    assert not same("a 0.364", "a 0.394")
    assert not same("a 0.364", "b 0.364")
    assert not same("1 −2.0", "1 2.0")


@pytest.mark.sampled
@pytest.mark.parametrize("key", STILL)
def test_page_has_what_the_command_gives(key: str) -> None:
    (text,) = markdown(reproduce(only=[key])).values()
    own = PAGE.partition(text.splitlines()[0])[2].partition("\n## ")[0]
    kept = re.sub(r"\n!\[.*", "", own).strip()
    assert same(text.partition("\n")[2].strip(), kept), "run python docs/make_reproduce.py"


def test_page_explains_its_columns() -> None:
    assert all(f"- **{name}**: {text}" in PAGE for name, text in READINGS.items())


def test_pictures_of_the_page() -> None:
    shown = re.findall(r"\]\(images/(reproduce_\S+\.png)\)", PAGE)
    assert sorted(shown) == sorted(script().picture(name) for name in FIGURES)
    for name in shown:
        assert (ROOT / "docs" / "images" / name).stat().st_size < LARGEST


@pytest.fixture(scope="module")
def whole() -> Reproduction:
    return reproduce()


@pytest.mark.slow
def test_whole_page_is_current(whole: Reproduction) -> None:
    found, kept = script().page(whole).splitlines(), PAGE.splitlines()
    assert len(found) == len(kept), "run python docs/make_reproduce.py"
    assert [(a, b) for a, b in zip(found, kept, strict=True) if not same(a, b)] == []


@pytest.mark.slow
def test_all_pictures(whole: Reproduction) -> None:
    assert whole.lost == {}
    made = dict(paper_figures(whole))
    assert list(made) == list(figures.FIGURES)
    for each in made.values():
        check(each)
