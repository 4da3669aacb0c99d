"""Pareto fronts: what nothing cheaper is as exact as."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite
from typing import Any

from softmpc.accuracy.points import FamilyResult, Point

__all__ = ["Front", "front"]

ALIKE = 0.01  # errors that differ by less are the same: it would not be worth any time


@dataclass(frozen=True, eq=False)
class Front:
    """The points of a family that no other one beats, in order of cost.

    Each is dearer than the one before, and more exact by 1 % or more. Errors below the doubt of the
    reference count as large as the doubt: what is below cannot be told apart, so that of the points
    at the floor only the cheapest is here. Of two that are equal it is the first one measured.
    """

    family: str
    points: tuple[Point, ...] = ()

    def __contains__(self, point: Point) -> bool:
        """Whether that point is one of these, or the same scene on another axis."""
        own = [one.configuration.identity for one in self.points]
        return point.configuration.identity in own

    def summary(self) -> list[dict[str, Any]]:
        """Plain data: where each point is found, its time and its error."""
        return [
            {
                "axis": one.axis,
                "name": one.name,
                "time_s": one.time_s,
                "error_m": one.error_m,
                "at_floor": one.at_floor,
            }
            for one in self.points
        ]


def front(family: FamilyResult) -> Front:
    """The front of a family, of the points that have both an error and a time."""
    best: list[Point] = []
    for point in sorted(filter(_is_complete, family.points), key=_place):
        if not best or _place(point)[1] < (1 - ALIKE) * _place(best[-1])[1]:
            best.append(point)
    return Front(family.name, tuple(best))


def _is_complete(point: Point) -> bool:
    numbers = point.time_s, point.error_m
    return all(number is not None and isfinite(number) for number in numbers)


def _place(point: Point) -> tuple[float, float]:
    """Time (s) and error (m), as far as it can be told."""
    assert point.time_s is not None and point.proved_m is not None
    return point.time_s, point.proved_m
