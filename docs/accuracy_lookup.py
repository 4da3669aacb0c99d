"""Points of a study by their names, and their numbers as people read them."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

from softmpc.accuracy.points import FamilyResult, Point
from softmpc.accuracy.tables import piped, time_text
from softmpc.study.lengths import length_text

__all__ = ["MISSING", "along", "find", "length", "ratio", "seconds", "segment_table", "wrapped"]

MISSING = "–"
COUNTS = (1, 2, 4, 8, 16)
WIDTH = 100


def find(family: FamilyResult, axis: str, name: str) -> Point:
    """A point by its names; raises `KeyError` with what there is."""
    known = {point.name: point for point in family.axis(axis)}
    if name not in known:
        raise KeyError(f"{family.name}, {axis}: no {name!r} in {sorted(known)}")
    return known[name]


def along(family: FamilyResult, axis: str, series: str) -> dict[int, Point]:
    """The points of a series by the number of segments."""
    points = [p for p in family.axis(axis) if p.configuration.series == series]
    return {round(1 / p.configuration.size): p for p in points if p.configuration.size}


def length(point: Point | None, key: str = "error_m") -> str:
    """An error for people."""
    value = None if point is None else point.error.get(key)
    if value is None:
        return MISSING
    if key == "error_m" and point is not None and point.at_floor:
        return f"< {length_text(point.proved_m or 0.0)}"
    return length_text(value)


def seconds(point: Point | None) -> str:
    return MISSING if point is None or point.time_s is None else time_text(point.time_s)


def ratio(point: Point | None) -> str:
    value = None if point is None else point.cost.get("ratio")
    return MISSING if value is None else f"{value:.3g}"


def segment_table(
    rows: dict[str, dict[int, Point]], cell: str, counts: Sequence[int] = COUNTS
) -> str:
    """Rows of series, columns of segments a section."""
    shown = [n for n in counts if any(n in points for points in rows.values())]
    table = [["segments a section", *map(str, shown)]]
    for name, points in rows.items():
        table.append([name, *(length(points.get(n), cell) for n in shown)])
    return piped(table, 1)


def wrapped(text: str) -> str:
    """Markdown with its paragraphs in lines of the length that pages have."""
    blocks = text.split("\n\n")
    return "\n\n".join(block if block[:1] in "#|`!-" else _filled(block) for block in blocks)


def _filled(paragraph: str) -> str:
    words = " ".join(paragraph.split())
    return textwrap.fill(words, WIDTH, break_long_words=False, break_on_hyphens=False)
