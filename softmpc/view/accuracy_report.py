"""A study of accuracy as one page in HTML that needs nothing beside it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from softmpc.accuracy.families import FAMILIES
from softmpc.accuracy.front import front
from softmpc.accuracy.orders import VERDICTS, fits
from softmpc.accuracy.points import TO_COME
from softmpc.accuracy.tables import time_text
from softmpc.accuracy.work import MEASURED
from softmpc.view.accuracy import study_figures
from softmpc.view.accuracy_convergence import key_label
from softmpc.view.accuracy_html import details, element, items, page, picture, table, terms
from softmpc.view.accuracy_sentences import in_short
from softmpc.view.accuracy_style import metres, situation

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from matplotlib.figure import Figure

    from softmpc.accuracy.points import FamilyResult, Point, Study

__all__ = ["report_html"]

NONE = "–"
CAPTIONS = {
    "work-precision": "A mark is a configuration, a line a series; further to the left is cheaper, "
    "further down more exact. Nothing measured is both cheaper and more exact than what is named.",
    "convergence": "Marks are measured, lines fitted to the finest sizes. A series that does not "
    "converge is joined by dots, in red, with crosses; lines are dashed where the order is not "
    "that of theory, or there is no theory.",
    "changes": "Left: how far the tip moves when a part of the scene is left out, added or "
    "replaced; right: what that does to the time. To the right of 1 is slower.",
    "controllers": "Errors above, times below; times above the budget cannot run at that rate.",
    "times": "The same numbers, made in different ways.",
}
READING = [
    ("error", "the largest distance of the tip from the reference; all that differs from it "
     "counts, the integration included"),
    ("doubt of the reference", "how far the reference moves when it is made one step coarser. An "
     "error below it is known to be that small, and not how small: “<”, and hollow marks"),
    ("change", "of the tip from the scene as given, for what is no error, like an effect added"),
    ("time ± spread", "median, and distance between the quartiles, of repeated runs in a process "
     "with a core of its own"),
    ("ratio", "time over that of the scene as given, both measured by turns in one process, so "
     "that a busy machine slows both: trust it more than times"),
    ("Pareto front", "what nothing measured beats in both time and, by 1 % or more, in error"),
    ("order", "error ≈ scale · size^order, fitted to the finest sizes whose errors are clear of "
     "the doubt; ± is the standard error"),
    ("frequency error", "relative, the largest of the lowest frequencies; “growing” counts those "
     "that are not real"),
    ("all points", "median: of errors over the postures, or of times; tip: error of the arm's tip "
     "alone; build: time to make the functions; rest: time to find one rest"),
]  # fmt: skip
# Words of configurations that readers of the paper may not know.
WORDS = {
    "lumped": "the mass of a segment at its tip, as in the paper",
    "Gauss point": "the mass of a segment at the points of Gauss quadrature along it",
    "as printed": "the paper's balance (13)–(31): a segment hands back its axial force and moment "
    "alone, Eq. (22)",
    "full wrench": "the same balance, the whole force and moment handed back",
    "angular velocity": "of a segment, as virtual power passes it on: exact, or ω = dw/dt of "
    "Eqs (5)–(6), which holds while the axis of rotation stands still",
    "paper arc": "the paper's Eq. (3), bending first and twisting after; otherwise arcs of "
    "constant strain",
    "elasticity": "the law of Eqs (17)–(19): “printed” as on the page, “strain” divided by the "
    "length, “energy” with the term that gives it a potential",
    "slow mode": "of the hydraulics (32)–(36), the slowest pole alone",
    "static gain": "of the hydraulics, pressures at once proportional to torques",
    "compilation": "whether CasADi's functions run in its virtual machine or as compiled C",
}


def report_html(
    study: Study, command: str = "", figures: Mapping[str, Figure] | None = None
) -> str:
    """The whole study as a page: results, what they are measured against, pictures, tables.

    `command` is the one that made the study, as shown at the end; by default the plain one.
    `figures` are those of `study_figures`, where they have been drawn before.
    """
    figures = study_figures(study) if figures is None else figures
    parts = [*_head(study), element("h2", "In short"), items(in_short(study))]
    parts += _references(study)
    for family in study.families:
        if family.points:
            parts += _family(family, figures)
    parts += [*_reading(study), *_machine(study), *_making(study, command)]
    return page(f"{study.title}: what accuracy costs in time", [part for part in parts if part])


def _head(study: Study) -> list[str]:
    measured = sum(point.status == MEASURED for point in study.points)
    kind = "quick study" if study.quick else "full study"
    lead = (
        f"What accuracy costs in time. A {kind}: {measured} of {len(study.points)} points measured"
    )
    if study.status != "finished":
        lead += f"; {study.status}, so that parts are missing"
    if study.quick:
        lead += (
            ". Quick studies have fewer postures and sizes and coarser references than full ones"
        )
    return [element("h1", study.title or "A study"), element("p", f"{lead}.", "lead")]


def _references(study: Study) -> list[str]:
    parts = [element("h2", "What was measured against what")]
    for family in study.families:
        known = FAMILIES[family.name]
        parts.append(element("h3", _capital(situation(family.name))))
        if family.missing:
            parts.append(element("p", f"Not measured: {family.missing}."))
        if family.points or not family.missing:
            parts.append(element("p", f"{_capital(known.about).rstrip('.')}."))
        same: dict[str, list[str]] = {}
        for name, text in family.references.items():
            same.setdefault(text, []).append(name)
        told = [": ".join(filter(None, [", ".join(names), text])) for text, names in same.items()]
        parts.append(items(told))
    return parts


def _family(family: FamilyResult, figures: Mapping[str, Figure]) -> list[str]:
    """Pictures and tables of one family."""
    own = {name: made for name, made in figures.items() if f"-{family.name}" in name}
    parts = [element("h2", f"Results {situation(family.name)}")]
    parts += _pictures(own, "work-precision")
    if rows := _front(family):
        parts += [element("h3", "The Pareto front"), table(rows, 2)]
    if rows := _orders(family):
        parts += [element("h3", "Orders of convergence"), table(rows, 4)]
    for kind in ("convergence", "changes", "controllers", "times"):
        parts += _pictures(own, kind)
    states = [point.status for point in family.points]
    failed = [f"{p.name}: {p.status}" for p in family.points if p.status not in (MEASURED, TO_COME)]
    if left := states.count(TO_COME):
        parts.append(element("p", f"Points still to be measured, or to be timed: {left}."))
    if failed:
        parts += [details(f"What could not be measured: {len(failed)}", items(failed))]
    every = table(_rows(family.points), 2)
    return [*parts, details(f"All {len(family.points)} points", every)]


def _pictures(figures: Mapping[str, Figure], kind: str) -> list[str]:
    """All of a kind, what is to be seen told once."""
    shown = [made for name, made in figures.items() if name.startswith(kind)]
    return [picture(made, "" if i else CAPTIONS[kind]) for i, made in enumerate(shown)]


def _front(family: FamilyResult) -> list[list[str]]:
    best = front(family).points
    return (
        _rows(best, ("time_s", "spread_s", "ratio", "instructions", "memory_mib")) if best else []
    )


def _orders(family: FamilyResult) -> list[list[str]]:
    rows = [["along", "series", "error", "verdict", "order", "theory"]]
    for fit in fits(family):
        order = (
            NONE
            if fit.order is None
            else f"{fit.order:.2f} ± {fit.standard_error:.2f}".replace("-", "−")
        )
        theory = NONE if fit.theory is None else f"{fit.theory:g}"
        what = key_label(family.name, fit.key).rpartition(" (")[0]
        rows.append([fit.axis, fit.series, what, fit.verdict, order, theory])
    return rows if len(rows) > 1 else []


def _rows(points: Sequence[Point], costs: Sequence[str] | None = None) -> list[list[str]]:
    """A row a point, a column a number that any of them has."""
    errors = ["error_m", "doubt_m", "change_m"]
    errors += [] if costs else _keys([p.error for p in points], errors)
    if costs is None:
        costs = _keys([p.cost for p in points], ["beside_s"])  # the ratio says it
    errors = [key for key in errors if any(p.error.get(key) is not None for p in points)]
    costs = [key for key in costs if any(p.cost.get(key) is not None for p in points)]
    rows = [["axis", "configuration", *map(_heading, [*errors, *costs])]]
    for point in points:
        cells = [_text(key, point.error.get(key)) for key in errors]
        if errors and errors[0] == "error_m" and point.at_floor:
            cells[0] = f"< {metres(point.proved_m or 0.0)}"
        cells += [_text(key, point.cost.get(key)) for key in costs]
        rows.append([point.axis, point.name, *cells])
    return rows


def _keys(parts: Sequence[Any], known: Sequence[str]) -> list[str]:
    """The keys of single numbers, in the order in which they come."""
    found = dict.fromkeys(
        key for part in parts for key, value in part.items()
        if isinstance(value, int | float) and not isinstance(value, bool)
    )  # fmt: skip
    return [key for key in found if key not in known]


def _heading(key: str) -> str:
    for end in ("_m", "_s", "_mib", "_gib", "_bytes"):
        key = key.removesuffix(end)
    return {"c": "C sources"}.get(key, key.replace("_", " "))


def _text(key: str, value: Any) -> str:
    """A number for people, by the unit in its name."""
    if not isinstance(value, int | float):
        return NONE
    if key.endswith("_m"):
        return metres(abs(value))
    if key.endswith("_s"):
        return time_text(value)
    if key.endswith("_mib"):
        return f"{value:.0f} MiB"
    if key.endswith("_bytes"):
        return f"{value / 1000:,.0f} kB"
    return f"{value:,}" if isinstance(value, int) else f"{value:.3g}"


def _reading(study: Study) -> list[str]:
    """What words mean, of the names of configurations those that are there."""
    named = " ".join(f"{p.axis} {p.name} {p.configuration.series}" for p in study.points)
    words = [(word, text) for word, text in WORDS.items() if word in named]
    given = {fit.verdict for family in study.families for fit in fits(family)}
    verdicts = [(name, text) for name, text in VERDICTS.items() if name in given]
    return [element("h2", "How to read it"), terms([*READING, *verdicts, *words])]


def _machine(study: Study) -> list[str]:
    rows = [["", ""], *([_heading(k), "none" if v is None else _machine_text(k, v)]
                        for k, v in study.machine.items())]  # fmt: skip
    note = "Times are those of this machine; ratios travel better."
    return [element("h2", "The machine"), element("p", note), table(rows, 2)]


def _machine_text(key: str, value: Any) -> str:
    if key == "memory_gib":
        return f"{value} GiB"
    return f"{value:.1f}" if isinstance(value, float) else str(value)


def _making(study: Study, command: str) -> list[str]:
    import tomli_w

    quick = " --quick" if study.quick else ""
    told = command or f"softmpc study SCENE.toml{quick} --out DIR"
    scene = element("pre", tomli_w.dumps(dict(study.document)))
    return [
        element("h2", "How it was made"),
        element("p", "By this command, with the scene file below:"),
        element("pre", told),
        details("The scene file", scene),
    ]


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]
