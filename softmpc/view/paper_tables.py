"""The comparison with the paper as tables: for a terminal, and in Markdown."""

from __future__ import annotations

import textwrap
from math import isnan
from typing import TYPE_CHECKING

from softmpc.study.paper_readings import AS_PRINTED, OURS, READINGS

if TYPE_CHECKING:
    from softmpc.study.reproduce import Reproduction
    from softmpc.study.reproduce_records import Row, Topic

__all__ = ["explained", "markdown", "terminal"]

WIDTH = 100
NONE = "–"
COMPARED = (AS_PRINTED, OURS)  # whose differences from the paper have a column


def terminal(found: Reproduction) -> str:
    """All topics, one table each, with its reason below."""
    parts = [f"the paper's numbers beside ours; parameters {found.parameters}"]
    for topic in found.topics:
        lines = [f"{topic.title} ({topic.where})", *_aligned(_cells(topic))]
        lines += textwrap.wrap(topic.why, WIDTH)
        lines += [f"{name}: {text}" for name, text in _own(topic).items()]
        lines += [f"{name}: {reason}" for name, reason in topic.failures.items()]
        parts.append("\n".join(lines))
    return "\n\n".join([*parts, "\n".join(f"{n}: {text}" for n, text in explained().items())])


def explained() -> dict[str, str]:
    """What the columns of the tables are."""
    return {
        "printed": "what the paper says",
        **READINGS,
        f"{OURS} − printed": "difference, and in % of what is printed; a bound is kept or not",
    }


def _own(topic: Topic) -> dict[str, str]:
    """What the columns are where they are not what they are elsewhere."""
    return {name: text for name, text in topic.readings.items() if READINGS.get(name) != text}


def markdown(found: Reproduction) -> dict[str, str]:
    """A heading, a table and its reason by topic; pictures go between."""
    made = {}
    for topic in found.topics:
        head, *body = _cells(topic)
        lines = [_row(head), _row(["---", *["---:"] * (len(head) - 1)]), *map(_row, body)]
        blocks = [f"## {topic.title[0].upper()}{topic.title[1:]}", f"Paper: {topic.where}."]
        blocks += ["\n".join(lines), "\n".join(textwrap.wrap(topic.why, WIDTH))]
        if own := _own(topic):
            blocks.append("\n".join(f"- {name}: {text}" for name, text in own.items()))
        if topic.failures:
            blocks.append(f"No motion to the end: {'; '.join(topic.failures)}.")
        made[topic.key] = "\n\n".join(blocks)
    return made


def _row(cells: list[str]) -> str:
    return f"| {' | '.join(cells)} |"


def _cells(topic: Topic) -> list[list[str]]:
    """A head and a line a quantity; differences have a column where a number is printed."""
    readings = list(topic.readings)
    compared = [
        name
        for name in COMPARED
        if name in readings
        and any(r.printed and r.printed.difference(0.0) is not None for r in topic.rows)
    ]
    head = ["", "printed", *readings, *(f"{name} − printed" for name in compared)]
    return [head, *(_line(row, readings, compared) for row in topic.rows)]


def _line(row: Row, readings: list[str], compared: list[str]) -> list[str]:
    unit = f" ({row.unit})" if row.unit else ""
    printed = row.printed.shown if row.printed else NONE
    values = [_values(row.values[name], row.digits) for name in readings]
    differences = [_difference(row, row.values[name][0]) for name in compared]
    return [row.what + unit, printed, *values, *differences]


def _values(values: tuple[float, ...], digits: int) -> str:
    return ", ".join(_number(value, digits) for value in values)


def _number(value: float, digits: int, sign: str = "") -> str:
    """A number with a real minus; nothing that rounds to zero has a sign."""
    if isnan(value):
        return NONE
    rounded = round(value, digits) + 0.0
    return f"{rounded:{sign if rounded else ''}.{digits}f}".replace("-", "−")


def _difference(row: Row, value: float) -> str:
    """Absolute, and in % of what is printed; for a bound, whether it is kept."""
    printed = row.printed
    difference = printed.difference(value) if printed else None
    if printed is None or difference is None:
        return ""
    if isnan(value):
        return NONE
    percent = printed.percent(value)
    shown = _number(difference, row.digits, "+")
    if percent is not None:
        shown += f" ({_number(percent, 1, '+')} %)"
    if printed.relation == "<":
        shown += ", kept" if value < (printed.value or 0.0) else ", not kept"
    return shown


def _aligned(rows: list[list[str]]) -> list[str]:
    """The first column to the left, the others to the right."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = []
    for first, *rest in rows:
        cells = [cell.rjust(width) for cell, width in zip(rest, widths[1:], strict=True)]
        lines.append("  ".join([first.ljust(widths[0]), *cells]).rstrip())
    return lines
