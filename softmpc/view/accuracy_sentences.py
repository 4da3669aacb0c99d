"""What a study says, in a few sentences."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from softmpc.accuracy.families import FAMILIES
from softmpc.accuracy.front import front
from softmpc.accuracy.model_axes import AS_GIVEN
from softmpc.accuracy.orders import AGREES, AS_THEORY, DIFFERS, DIVERGES, Fit, fits
from softmpc.accuracy.tables import time_text
from softmpc.view.accuracy_changes import change_m, changed_points
from softmpc.view.accuracy_convergence import key_label
from softmpc.view.accuracy_style import metres, situation

if TYPE_CHECKING:
    from softmpc.accuracy.points import FamilyResult, Point, Study

__all__ = ["in_short"]

Fitted = tuple["FamilyResult", Fit]
TOLERANCES = (10e-3, 5e-3, 1e-3)  # m
MOST_NAMED = 3
ALIKE = 0.05  # a ratio as near to 1 is that of the machine's mood


def in_short(study: Study) -> list[str]:
    """The cheapest within tolerances, what does not converge, orders, the largest changes."""
    found = [_cheapest(family) for family in study.families]
    known = [(family, fit) for family in study.families for fit in fits(family)]
    found += [_divergent(known), _orders(known), _changes(study)]
    return [one for one in found if one] or ["Nothing was measured yet."]


def _cheapest(family: FamilyResult) -> str:
    """One sentence a family; a point that is the cheapest for several tolerances is named once."""
    best = [point for point in front(family).points if point.proved_m is not None]
    if not best:
        return ""
    chosen: dict[str, list[float]] = {}
    for tolerance in TOLERANCES:
        within = [point for point in best if (point.proved_m or 0.0) <= tolerance]
        chosen.setdefault(_named(within[0]) if within else "", []).append(tolerance)
    missed = chosen.pop("", [])
    parts = [f"the cheapest within {_joined([metres(t) for t in ts], 'and')} is {name}"
             for name, ts in chosen.items()]  # fmt: skip
    if missed:
        parts.append(f"nothing is within {_joined([metres(t) for t in missed], 'or')}")
    cost = FAMILIES[family.name].cost_label.rpartition(" (")[0]
    start = situation(family.name)
    return f"{start[:1].upper()}{start[1:]}, {'; '.join(parts)}. The time is: {cost}."


def _named(point: Point) -> str:
    """A point with its error and its time."""
    error = f"{'below ' if point.at_floor else ''}{metres(point.proved_m or 0.0)}"
    return f"“{point.name}” ({error} in {time_text(point.time_s or 0.0)}{_beside_given(point)})"


def _beside_given(point: Point) -> str:
    """Its time over that of the scene as given."""
    ratio = point.cost.get("ratio")
    if ratio is None or point.axis == AS_GIVEN:
        return ""
    if abs(ratio - 1.0) < ALIKE:
        return ", as fast as the scene as given"
    return f", {ratio:.2g} times that of the scene as given"


def _divergent(known: Sequence[Fitted]) -> str:
    where: dict[str, list[str]] = {}
    for family, fit in known:
        if fit.verdict == DIVERGES:
            where.setdefault(fit.series, []).append(_what(family, fit))
    if not where:
        return "All series whose order could be fitted converge." if known else ""
    told = [f"“{series}” ({', '.join(dict.fromkeys(what))})" for series, what in where.items()]
    return f"What does not converge when it is made finer: {'; '.join(told)}."


def _orders(known: Sequence[Fitted]) -> str:
    """How many fitted orders are those of theory, and which are not."""
    good = [fit for _, fit in known if fit.verdict == AS_THEORY]
    other = [(family, fit) for family, fit in known if fit.verdict == DIFFERS]
    count = len(good) + len(other)
    if not count:
        return ""
    start = f"{len(good)} of {count} fitted orders that have a theory agree with it within {AGREES}"
    told = [
        f"“{fit.series}” has {fit.order:.2f} where theory says {fit.theory:g} "
        f"({_what(family, fit)})"
        for family, fit in other[:MOST_NAMED]
    ]
    left = len(other) - MOST_NAMED
    more = [f"{left} more are in the tables"] if left > 0 else []
    return "; ".join([start, *told, *more]) + "."


def _what(family: FamilyResult, fit: Fit) -> str:
    """The error that is fitted, without its unit."""
    return key_label(family.name, fit.key).rpartition(" (")[0]


def _changes(study: Study) -> str:
    """The largest changes of the family in which the arm moves most freely and has some."""
    order = {"motion": 0, "rest": 1, "loop": 2}
    families = [family for family in study.families if changed_points(family)]
    if not families:
        return ""
    family = min(families, key=lambda one: order.get(one.name, 3))
    largest = sorted(changed_points(family), key=lambda p: -(change_m(p) or 0.0))
    told = [f"“{p.name}” {metres(change_m(p) or 0.0)}" for p in largest[:MOST_NAMED]]
    least = largest[-1]
    end = f"; the smallest: “{least.name}” {metres(change_m(least) or 0.0)}"
    return (
        f"What changes most {situation(family.name)} when it is left out, added or replaced: "
        f"{', '.join(told)}{end if len(largest) > MOST_NAMED else ''}."
    )


def _joined(words: Sequence[str], last: str) -> str:
    return f" {last} ".join(filter(None, [", ".join(words[:-1]), words[-1]]))
