"""What a study found: a point a configuration, with its error and its cost."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from softmpc.accuracy.configuration import Configuration
from softmpc.accuracy.work import MEASURED

__all__ = ["TO_COME", "FamilyResult", "Point", "Study"]

Numbers = Mapping[str, Any]
TO_COME = "to be measured"


@dataclass(frozen=True, eq=False)
class Point:
    """A configuration measured; parts that are not there yet, or could not be had, are empty."""

    configuration: Configuration
    error: Numbers = field(default_factory=dict)
    cost: Numbers = field(default_factory=dict)

    @property
    def axis(self) -> str:
        return self.configuration.axis

    @property
    def name(self) -> str:
        return self.configuration.name

    @property
    def error_m(self) -> float | None:
        """The error in pictures (m)."""
        return self.error.get("error_m")

    @property
    def doubt_m(self) -> float | None:
        """How far the reference itself may be off (m)."""
        return self.error.get("doubt_m")

    @property
    def at_floor(self) -> bool:
        """Whether the error is below the doubt of its reference: it is that small, or smaller."""
        return self.error_m is not None and self.error_m < (self.doubt_m or 0.0)

    @property
    def proved_m(self) -> float | None:
        """The error that is sure (m): of a point at the floor it is the doubt."""
        return self.doubt_m if self.at_floor else self.error_m

    @property
    def time_s(self) -> float | None:
        """The cost in pictures (s)."""
        return self.cost.get("time_s")

    @property
    def status(self) -> str:
        """ "measured", "to be measured", or why error or cost could not be had."""
        states = [part.get("status", TO_COME) for part in (self.error, self.cost)]
        return next((state for state in states if state != MEASURED), MEASURED)

    def summary(self) -> dict[str, Any]:
        """Plain data, from which `from_summary` makes the same point."""
        return {**vars(self.configuration), "error": dict(self.error), "cost": dict(self.cost)}

    @classmethod
    def from_summary(cls, data: Mapping[str, Any]) -> Point:
        own = dict(data)
        error, cost = own.pop("error"), own.pop("cost")
        return cls(Configuration(**own), error, cost)


@dataclass(frozen=True, eq=False)
class FamilyResult:
    """The points of one family, the scene as given first, and what they were measured against."""

    name: str
    references: Mapping[str, str]  # name -> what it is, for people
    points: tuple[Point, ...]
    missing: str = ""  # why there is none

    @property
    def lost(self) -> bool:
        """Whether there was something to measure, but no reference to be had."""
        return bool(self.missing and self.references)

    def axis(self, name: str) -> list[Point]:
        """The points of one axis, in its order."""
        return [point for point in self.points if point.axis == name]

    @property
    def axes(self) -> list[str]:
        return list(dict.fromkeys(point.axis for point in self.points))

    @property
    def as_given(self) -> Point | None:
        return self.points[0] if self.points else None


@dataclass(frozen=True, eq=False)
class Study:
    """A whole study; `status` is "finished" or "interrupted"."""

    title: str
    status: str
    quick: bool
    machine: Mapping[str, Any]
    families: tuple[FamilyResult, ...]
    document: Mapping[str, Any] = field(default_factory=dict)  # the scene file as parsed

    def family(self, name: str) -> FamilyResult:
        """The family of that name; raises `KeyError`."""
        return {family.name: family for family in self.families}[name]

    @property
    def points(self) -> Sequence[Point]:
        return [point for family in self.families for point in family.points]

    def summary(self) -> dict[str, Any]:
        """Plain data for JSON, from which `from_summary` makes the same study."""
        return {
            "title": self.title,
            "status": self.status,
            "quick": self.quick,
            "machine": dict(self.machine),
            "scene": dict(self.document),
            "families": [
                {
                    "name": family.name,
                    "missing": family.missing,
                    "references": dict(family.references),
                    "points": [point.summary() for point in family.points],
                }
                for family in self.families
            ],
        }

    @classmethod
    def from_summary(cls, data: Mapping[str, Any]) -> Study:
        families = [
            FamilyResult(
                one["name"],
                one["references"],
                tuple(Point.from_summary(point) for point in one["points"]),
                one["missing"],
            )
            for one in data["families"]
        ]
        return cls(
            data["title"],
            data["status"],
            data["quick"],
            data["machine"],
            tuple(families),
            data["scene"],
        )
