"""A run beside an earlier one: which numbers changed, and which changes mean something.

Names of numbers say what they are by their words. With `instructions` a number is a count that no
load changes: every difference is told, and one that grew is a fault; `machine_instructions` are
those of a processor, compared on the same machine beyond one part in MACHINE, for where things
lie in memory changes them a little. With a unit of time (`s`, `ms`, `us`) or `ratio` it is timed:
differences are told beyond a factor of BAND, for on a machine that does other work medians of one
program differ by that much; and only where both runs were on the same machine with the same
programs. All else (errors, shares, counts of failures; what ends with a word of UNTIMED) is told
beyond one part in EXACT, and beyond what rounding does.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from tests.benchmarks.stored import Result, Run

__all__ = ["BAND", "Change", "changes", "machine_note", "table"]

BAND = 1.3
EXACT = 100
MACHINE = 1000
ROUNDING = 1e-9
TIMED = {"s", "ms", "us", "ratio"}
UNTIMED = {"count", "share", "mm", "bytes"}  # as the last word


@dataclass(frozen=True)
class Change:
    """One number now and before."""

    name: str
    now: float
    before: float | None
    same_machine: bool

    @property
    def ratio(self) -> float | None:
        return self.now / self.before if self.before else None

    @property
    def words(self) -> set[str]:
        return set(self.name.split("_"))

    @property
    def grew(self) -> bool:
        """Whether this is a count of instructions that grew."""
        return self.verdict == "MORE INSTRUCTIONS"

    @property
    def verdict(self) -> str:
        """What the difference means; empty where it means nothing."""
        if self.before is None:
            return "new"
        if "instructions" in self.words:
            return self._counted(self.before)
        if self.words & TIMED and not self.name.endswith(tuple(UNTIMED)):
            return self._timed(self.before)
        size = max(abs(self.now), abs(self.before))
        return "differs" if abs(self.now - self.before) > max(size / EXACT, ROUNDING) else ""

    def _counted(self, before: float) -> str:
        if self.now == before:
            return ""
        little = abs(self.now - before) * MACHINE <= before
        if "machine" in self.words and (little or not self.same_machine):
            return ""  # another compiler makes other code
        return "MORE INSTRUCTIONS" if self.now > before else "fewer instructions"

    def _timed(self, before: float) -> str:
        low, high = sorted((self.now, before))
        if not self.same_machine or high <= BAND * low:
            return ""
        return "higher" if self.now > before else "lower"


def changes(now: Result, before: Result | None, same_machine: bool) -> list[Change]:
    """All numbers of a benchmark beside those of an earlier result."""
    old = before.numbers if before else {}
    return [Change(name, v, old.get(name), same_machine) for name, v in now.numbers.items()]


def table(rows: list[Change]) -> Iterator[str]:
    """One line a number: now, before, ratio, what it means."""
    width = max((len(row.name) for row in rows), default=0)
    for row in rows:
        before = "" if row.before is None else f"{row.before:,.6g}"
        ratio = "" if row.ratio is None else f"{row.ratio:.3f}"
        line = f"  {row.name:{width}} {row.now:>12,.6g} {before:>12} {ratio:>8}  {row.verdict}"
        yield line.rstrip()


def machine_note(now: Run, before: Run) -> str:
    """In what the machines differ; empty where times can be compared."""
    if now.fingerprint == before.fingerprint:
        return ""
    names = [*now.machine, *(name for name in before.machine if name not in now.machine)]
    other = [
        f"{name} {now.machine.get(name)} (was {before.machine.get(name)})"
        for name in names
        if name != "load" and now.machine.get(name) != before.machine.get(name)
    ]
    return f"another machine, so times are not judged: {'; '.join(other) or 'unknown'}"
