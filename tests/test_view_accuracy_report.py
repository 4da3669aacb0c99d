"""The report of an accuracy study: one page, well formed, whole, and what it says in short."""

from __future__ import annotations

import io
from base64 import b64decode
from dataclasses import replace
from html.parser import HTMLParser
from xml.etree import ElementTree

import pytest
from test_view_accuracy import DOCUMENT, loop, motion, point, rest, series_of, study

from softmpc.accuracy.configuration import Configuration
from softmpc.accuracy.points import FamilyResult, Point
from softmpc.view.accuracy import study_figures
from softmpc.view.accuracy_report import report_html
from softmpc.view.accuracy_sentences import in_short

VOID = {"meta", "img"}


class Page(HTMLParser):
    """Elements, checked to be closed in order, and the text of each."""

    def __init__(self, text: str) -> None:
        super().__init__(convert_charrefs=True)
        self.open: list[str] = []
        self.texts: dict[str, list[str]] = {}
        self.tags: list[str] = []
        self.links: list[str] = []
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.links += [value or "" for name, value in attrs if name in ("src", "href")]
        if tag not in VOID:
            self.open.append(tag)
            self.texts.setdefault(tag, []).append("")

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open:
            self.texts[self.open[-1]][-1] += data


@pytest.fixture(scope="module")
def text() -> str:
    return report_html(study())


@pytest.fixture(scope="module")
def page(text: str) -> Page:
    return Page(text)


def test_it_is_one_page_without_a_net(text: str, page: Page) -> None:
    assert "script" not in page.tags
    assert "link" not in page.tags
    assert all(link.startswith("data:image/svg+xml;base64,") for link in page.links)
    assert "url(" not in text
    assert "@import" not in text
    assert page.texts["h1"] == ["An arm <of tests>"]


def test_pictures_are_whole(page: Page) -> None:
    assert len(page.links) == 11  # of test_view_accuracy.py
    for link in page.links:
        root = ElementTree.fromstring(b64decode(link.partition(",")[2]))
        assert root.tag.endswith("svg")


def test_all_points_are_in_it(page: Page) -> None:
    cells = page.texts["td"]
    for one in study().points:
        assert one.name in cells, one.name
    assert sum(text.startswith("All ") for text in page.texts["summary"]) == 3
    assert "broken: needs $inertia$ <first>" in page.texts["li"]
    assert "< 2 µm" in cells  # at the floor


def test_references_with_one_text_are_told_together() -> None:
    family = replace(loop(), references={"a": "a <rod>", "b": "a <rod>", "c": "", "d": "a model"})
    assert Page(report_html(study(family), figures={})).texts["li"][-3:] == [
        "a, b: a <rod>",
        "c",
        "d: a model",
    ]


def test_text_is_escaped(text: str) -> None:
    for raw in ("<of tests>", "<printed>", "<first>", "<processor>"):
        assert raw not in text
        assert raw.replace("<", "&lt;").replace(">", "&gt;") in text


def test_orders_and_front_are_tables(page: Page) -> None:
    cells = page.texts["td"]
    assert "as theory says" in cells
    assert "does not converge" in cells
    assert "1.99 ± 0.01" in cells
    assert page.texts["h3"].count("The Pareto front") == 3


def test_it_tells_how_it_was_made(page: Page) -> None:
    assert page.texts["pre"][0] == "softmpc study SCENE.toml --quick --out DIR"
    assert 'title = "An arm <of tests>"' in page.texts["pre"][1]
    own = Page(report_html(replace(study(loop()), quick=False), "softmpc study own.toml", {}))
    assert own.texts["pre"][0] == "softmpc study own.toml"


def test_words_of_its_configurations_are_explained(page: Page) -> None:
    words = page.texts["dt"]
    assert {"ratio", "Pareto front", "lumped", "full wrench", "does not converge"} <= set(words)
    assert "paper arc" not in words  # is not in this study


@pytest.mark.slow
def test_it_is_the_same_each_time() -> None:
    """But for pictures that were drawn before: their layout is done anew after another
    resolution, and may differ by rounding.
    """
    small = study(loop())
    figures = study_figures(small)
    for made in figures.values():
        made.savefig(io.BytesIO(), format="png")
    own, anew, again = report_html(small, figures=figures), report_html(small), report_html(small)
    assert anew == again
    assert Page(own).texts == Page(anew).texts
    assert len(Page(own).links) == len(Page(anew).links) == 2


def test_a_study_of_nothing() -> None:
    bare = Point(Configuration("as given", "as given"))
    families = FamilyResult("rest", {}, (bare,)), FamilyResult("loop", {}, (), "no path <here>")
    page = Page(report_html(replace(study(*families), status="interrupted", document={})))
    assert "img" not in page.tags
    assert "Not measured: no path <here>." in page.texts["p"]
    assert "Nothing was measured yet." in page.texts["li"]
    assert "interrupted" in page.texts["p"][0]
    assert "Points still to be measured, or to be timed: 1." in page.texts["p"]


# ---------------------------------------------------------------- in short


def test_the_cheapest_within_each_tolerance() -> None:
    told = in_short(study(motion()))[0]
    assert (
        "In motion, the cheapest within 10 mm and 5 mm is “slow mode alone” (2 mm in 40 ms" in told
    )
    assert "the cheapest within 1 mm is “2 Gauss points, 4 segments” (770 µm in" in told
    far = FamilyResult("rest", {}, (point("a", "near", {"error_m": 0.007}, 1e-3),))
    assert "nothing is within 5 mm or 1 mm" in in_short(study(far))[0]


def test_what_does_not_converge_is_named() -> None:
    (told,) = [one for one in in_short(study()) if "converge" in one]
    start = (
        "What does not converge when it is made finer: “Newton-Euler, as printed” (largest error"
    )
    assert told.startswith(start)
    assert "full wrench" not in told


def test_orders_beside_theory() -> None:
    table = {"slow": (2.0, (0.1, 0.05, 0.025, 0.0125)), "as it should": (1.0, (0.8, 0.4, 0.2, 0.1))}
    points = tuple(series_of("segments", table, "model.segments", 1e-5))
    told = in_short(study(FamilyResult("motion", {}, points)))[2]
    start = (
        "1 of 2 fitted orders that have a theory agree with it within 0.2; “slow” has 1.00 where"
    )
    assert told == f"{start} theory says 2 (largest tip error in motion)."


def test_the_largest_changes() -> None:
    told = in_short(study(rest(), motion()))[-1]
    start = "What changes most in motion when it is left out, added or replaced: “without weight”"
    assert told.startswith(f"{start} 110 mm, “drag in water” 40 mm")
    assert told.endswith("the smallest: “slow mode alone” 2 mm.")


def test_three_to_six_sentences() -> None:
    assert 3 <= len(in_short(study())) <= 6
    assert DOCUMENT["title"] not in " ".join(in_short(study()))
