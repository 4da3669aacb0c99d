"""A study as tables: for a terminal, in Markdown, as columns, and as plain data."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from softmpc.accuracy.families import FAMILIES
from softmpc.accuracy.front import front
from softmpc.accuracy.orders import Fit, fits
from softmpc.accuracy.points import TO_COME, FamilyResult, Point, Study
from softmpc.accuracy.work import MEASURED
from softmpc.study.lengths import length_text

__all__ = [
    "columns", "conclusions", "machine_text", "markdown", "order_table", "piped", "terminal",
    "time_text",
]  # fmt: skip

Table = list[list[str]]  # the head first
NONE = "–"
MARK = "*"
HEAD = ["", "error", "time ± spread", "ratio", "instructions"]
ORDERS = ["series", "of", "verdict", "order", "theory", "sizes"]
EXPLAINED = {
    MARK: "no other point is as exact, within 1 %, in less time",
    "<": "the error is below what the reference itself may be off",
    "change": "of the tip from the scene as given, by what is no error",
    "spread": "between the quartiles of the times",
    "ratio": "time over that of the scene as given, measured by turns",
    "order": "fitted to the errors at these sizes, with its standard error",
}
WIDTH = 100
MOST_PARTS = 32  # that a size is told by, 1/32 rather than 0.03125
TIMES = (("ns", 1e-9), ("µs", 1e-6), ("ms", 1e-3))


# ---------------------------------------------------------------- for programs


def conclusions(study: Study) -> dict[str, Any]:
    """The summary of a study, with the fits and the front of each family; plain data."""
    data = study.summary()
    for one, family in zip(data["families"], study.families, strict=True):
        one["fits"] = [fit.summary() for fit in fits(family)]
        one["front"] = front(family).summary()
    return data


def columns(study: Study) -> dict[str, np.ndarray]:
    """A row a point, a column a number; None where a point does not have it."""
    rows = [_numbers(family, point) for family in study.families for point in family.points]
    names = dict.fromkeys(name for row in rows for name in row)
    return {name: np.array([row.get(name) for row in rows], object) for name in names}


def _numbers(family: FamilyResult, point: Point) -> dict[str, Any]:
    one = point.configuration
    row: dict[str, Any] = {
        "family": family.name, "axis": one.axis, "name": one.name, "series": one.series,
        "size": one.size, "theory": one.order, "status": point.status,
        "on_front": point in front(family), "at_floor": point.at_floor,
    }  # fmt: skip
    for part in (point.error, point.cost):
        for name, value in part.items():
            if name != "status":
                row |= _flat(name if name not in row else f"cost_{name}", value)
    return row


def _flat(name: str, value: Any) -> dict[str, Any]:
    """A value as columns: lists are numbered, tables have their names in front."""
    if isinstance(value, Mapping):
        inner = [_flat(f"{name}_{key}", item) for key, item in value.items()]
    elif isinstance(value, list | tuple):
        inner = [_flat(f"{name}_{i}", item) for i, item in enumerate(value, 1)]
    else:
        return {re.sub(r"\W+", "_", name).strip("_"): value}
    return {key: item for one in inner for key, item in one.items()}


# ---------------------------------------------------------------- for people


@dataclass(frozen=True)
class _Style:
    """How names look in a table of points."""

    axis: str
    alone: str
    marked: str


TERMINAL = _Style("{}", "  {}", f"{{}} {MARK}")
PAGE = _Style("**{}**", "{}", rf"{{}} \{MARK}")


def terminal(study: Study) -> str:
    """All families: points, orders beside theory, what could not be measured; the machine."""
    parts = [f"{study.title}: what accuracy costs in time ({_state(study)})"]
    for family in study.families:
        parts.append("\n".join(map(_wrapped, _about(family))))
        if table := _points(family, TERMINAL):
            parts.append("\n".join(_aligned(table, 1)))
        if table := order_table(family):
            parts.append("\n".join(_aligned(table, 3)))
        if lines := _failures(family):
            parts.append("\n".join(["not measured:", *lines]))
    if any(map(_has_numbers, study.points)):
        explained = "; ".join(f"{sign}: {text}" for sign, text in EXPLAINED.items())
        parts.append(_wrapped(explained))
    return "\n\n".join([*parts, _wrapped(machine_text(study.machine))])


def markdown(study: Study) -> str:
    """The same as a page."""
    blocks = [f"# {study.title}", _sentence(_state(study))]
    for family in study.families:
        first, *others = _about(family)
        blocks += [f"## {_capital(family.name)}", _sentence(first), *_listed(others)]
        if table := _points(family, PAGE):
            blocks.append(piped(table, 1))
        if table := order_table(family):
            blocks += ["### Orders of convergence", piped(table, 3)]
        if lines := _failures(family):
            blocks += ["### Not measured", *_listed(lines)]
    if any(map(_has_numbers, study.points)):
        lines = [f"`{sign}`: {text}" for sign, text in EXPLAINED.items()]
        blocks += ["## What the columns are", *_listed(lines)]
    return "\n\n".join([*blocks, "## Machine", _sentence(machine_text(study.machine))])


def time_text(seconds: float) -> str:
    """A time for people: three digits in ns, µs, ms or s."""
    size, unit = _unit(seconds)
    return f"{_digits(seconds / size, 3)} {unit}"


def _state(study: Study) -> str:
    return ("quick study" if study.quick else "full study") + f", {study.status}"


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def _sentence(text: str) -> str:
    return _capital(text) + ("" if text.endswith(".") else ".")


def _listed(lines: Sequence[str]) -> list[str]:
    """A list of Markdown, as one block or none."""
    return ["\n".join(f"- {line}" for line in lines)] if lines else []


def _about(family: FamilyResult) -> list[str]:
    """What is compared with what, or why nothing is."""
    about = FAMILIES[family.name].about
    if family.missing:
        return [f"{family.name}: not measured, {family.missing}"]
    alike: dict[str, list[str]] = {}
    for name, text in family.references.items():
        alike.setdefault(text, []).append(name)
    references = [f"reference {', '.join(names)}: {text}" for text, names in alike.items() if text]
    return [f"{family.name}: {about[0].lower()}{about[1:]}", *references]


def machine_text(machine: Mapping[str, Any]) -> str:
    """The machine in a line."""
    load = machine.get("load")
    shown = [
        f"measured on {machine.get('processor')}",
        f"{machine.get('cores')} cores",
        f"{machine.get('memory_gib')} GiB",
        str(machine.get("system")),
        f"Python {machine.get('python')}",
        f"CasADi {machine.get('casadi')}",
        f"compiler {machine.get('compiler') or 'none'}",
        f"load {load:.1f}" if load is not None else "",
    ]
    return ", ".join(filter(None, shown))


# ---------------------------------------------------------------- points


def _points(family: FamilyResult, style: _Style) -> Table:
    """A row a point with numbers, after one with the name of its axis."""
    best, rows = front(family), [HEAD]
    for axis in family.axes:
        shown = [point for point in family.axis(axis) if _has_numbers(point)]
        alone = [point.name for point in shown] == [axis]  # the scene as given
        if shown and not alone:
            rows.append([style.axis.format(axis), *[""] * (len(HEAD) - 1)])
        for point in shown:
            name = point.name if alone else style.alone.format(point.name)
            rows.append(_row(style.marked.format(name) if point in best else name, point))
    return rows if len(rows) > 1 else []


def _has_numbers(point: Point) -> bool:
    return MEASURED in (point.error.get("status"), point.cost.get("status"))


def _row(name: str, point: Point) -> list[str]:
    return [
        name,
        _error(point),
        _time(point),
        _given(point.cost.get("ratio"), "{:.2f}"),
        _given(point.cost.get("instructions"), "{:,}"),
    ]


def _given(value: Any, form: str) -> str:
    return NONE if value is None else form.format(value)


def _error(point: Point) -> str:
    if point.error_m is None:
        change = point.error.get("change_m")
        return NONE if change is None else f"change {length_text(change)}"
    proved = point.proved_m
    assert proved is not None
    return f"{'< ' if point.at_floor else ''}{length_text(proved)}"


def _time(point: Point) -> str:
    """As `12.3 ± 0.4 µs`."""
    if point.time_s is None:
        return NONE
    size, unit = _unit(point.time_s)
    spread = point.cost.get("spread_s")
    beside = "" if spread is None else f" ± {_digits(spread / size, 2)}"
    return f"{_digits(point.time_s / size, 3)}{beside} {unit}"


def _digits(value: float, digits: int) -> str:
    """So many digits, or more in front of the point."""
    return f"{value:.{digits}g}" if value < 10**digits - 0.5 else f"{value:.0f}"


def _unit(seconds: float) -> tuple[float, str]:
    for unit, size in TIMES:
        if seconds < 999.5 * size:
            return size, unit
    return 1.0, "s"


def _failures(family: FamilyResult) -> list[str]:
    """A line a point without its error or its cost; those that are still to come are counted."""
    states = [(point.name, point.status) for point in family.points if point.status != MEASURED]
    bad = [f"{name}: {status}" for name, status in states if status != TO_COME]
    left = len(states) - len(bad)
    return [*bad, *([f"{left} points that are still to be measured"] if left else [])]


def order_table(family: FamilyResult) -> Table:
    rows = [_fit_row(fit) for fit in fits(family)]
    return [ORDERS, *rows] if rows else []


def _fit_row(fit: Fit) -> list[str]:
    order = NONE if fit.order is None else f"{fit.order:.2f} ± {fit.standard_error:.2f}"
    theory = NONE if fit.theory is None else f"{fit.theory:g}"
    sizes = ", ".join(_size(size) for size in fit.sizes) or NONE
    what = fit.key.removesuffix("_m").replace("_", " ")
    return [fit.series, what, fit.verdict, order, theory, sizes]


def _size(size: float) -> str:
    """A size for people: 1/4 rather than 0.25."""
    whole = round(1 / size)
    return f"1/{whole}" if 1 < whole <= MOST_PARTS and abs(whole * size - 1) < 1e-9 else f"{size:g}"


def _wrapped(text: str) -> str:
    return textwrap.fill(text, WIDTH, subsequent_indent="  ")


def _aligned(rows: Sequence[Sequence[str]], texts: int) -> list[str]:
    """So many first columns to the left, the others to the right."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = []
    for row in rows:
        cells = [
            cell.ljust(width) if i < texts else cell.rjust(width)
            for i, (cell, width) in enumerate(zip(row, widths, strict=True))
        ]
        lines.append("  ".join(cells).rstrip())
    return lines


def piped(rows: Table, texts: int) -> str:
    """A table of Markdown."""
    head, *body = rows
    rule = ["---"] * texts + ["---:"] * (len(head) - texts)
    cells = [[cell.replace("|", r"\|") for cell in row] for row in body]
    return "\n".join(f"| {' | '.join(row)} |" for row in [head, rule, *cells])
