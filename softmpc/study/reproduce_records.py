"""Records of a comparison with the paper: what is printed, what a reading gives, how far apart."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

__all__ = ["Printed", "Row", "Topic"]

Values = tuple[float, ...]


@dataclass(frozen=True)
class Printed:
    """What the paper says: a number, or only a text where `value` is None.

    `relation` is "=" for a number, "about" for a rounded one, "<" for a bound, and "rig" for a
    number that was measured against a rig whose data were not published: nothing compares to it.
    """

    value: float | None
    relation: str = "="
    text: str = ""  # as people read it, without the unit; by default the number

    def difference(self, value: float) -> float | None:
        """A value less the printed one; None where there is nothing to compare to."""
        return None if self.value is None or self.relation == "rig" else value - self.value

    def percent(self, value: float) -> float | None:
        """The same in % of the printed value."""
        difference = self.difference(value)
        return 100 * difference / abs(self.value) if difference is not None and self.value else None

    @property
    def shown(self) -> str:
        """As people read it."""
        sign = {"=": "", "about": "about ", "<": "< ", "rig": ""}[self.relation]
        return self.text or f"{sign}{self.value:g}"


@dataclass(frozen=True)
class Row:
    """One quantity: a value, or one for each of `parts`, by reading; nan where there is none."""

    what: str
    unit: str
    values: Mapping[str, Values]
    printed: Printed | None = None
    digits: int = 3  # decimals that people see
    parts: tuple[str, ...] = ("",)

    def completed(self, readings: Iterable[str]) -> Row:
        """The row with these readings in their order, nan where it has none."""
        lost = (float("nan"),) * len(self.parts)
        return replace(self, values={name: self.values.get(name, lost) for name in readings})

    def records(self) -> Iterator[dict[str, Any]]:
        """One flat record a value."""
        for reading, values in self.values.items():
            for part, value in zip(self.parts, values, strict=True):
                printed = self.printed
                yield {
                    "what": f"{self.what}: {part}" if part else self.what,
                    "unit": self.unit,
                    "printed": printed.value if printed else None,
                    "relation": printed.relation if printed else "",
                    "printed_text": printed.shown if printed else "",
                    "reading": reading,
                    "value": value,
                    "difference": printed.difference(value) if printed else None,
                    "difference_percent": printed.percent(value) if printed else None,
                }


@dataclass(frozen=True)
class Topic:
    """Quantities that belong together, with one reason: a row of the list of published numbers."""

    key: str
    title: str
    where: str  # in the paper
    rows: tuple[Row, ...]
    why: str
    readings: dict[str, str]  # what each column is
    failures: dict[str, str] = field(default_factory=dict)  # why a reading has no values

    def summary(self) -> dict[str, Any]:
        """What a program wants to know, ready for JSON."""
        about = {name: getattr(self, name) for name in ("key", "title", "where", "why", "readings")}
        return {**about, "failures": self.failures, "rows": list(self.records())}

    def records(self) -> Iterator[dict[str, Any]]:
        """All records of its rows."""
        for row in self.rows:
            yield from row.records()
