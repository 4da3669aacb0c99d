"""Write the performance page from the last stored quick run: `python docs/make_performance.py`.

The run is made by `python -m tests.benchmarks --quick --store`. Every number of the page is one of
it; a dash stands where it has none, because something was not installed.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable
from pathlib import Path

DOCS = Path(__file__).resolve().parent
sys.path.insert(0, str(DOCS.parent))

from performance_rows import (  # noqa: E402
    CALLS,
    COUNTED,
    DETAILS,
    FACTORS,
    MOTIONS,
    PARTS,
    PEERS,
    QUALITY,
    SEGMENTS,
    SOLVERS,
    TEXT,
)

from tests.benchmarks.comparing import BAND  # noqa: E402
from tests.benchmarks.listing import ABOUT, benchmarks, purpose  # noqa: E402
from tests.benchmarks.stored import Run, last_stored  # noqa: E402

PAGE = DOCS / "performance.md"
UNITS = {"us": 1e-6, "ms": 1e-3, "s": 1.0}


class Numbers:
    """The numbers of a run as text."""

    def __init__(self, run: Run) -> None:
        self.run = run

    def value(self, benchmark: str, name: str) -> float | None:
        found = self.run.benchmarks.get(benchmark)
        return None if found is None else found.numbers.get(name)

    def seconds(self, benchmark: str, name: str) -> float | None:
        """A time in seconds, whatever the unit in its name."""
        value = self.value(benchmark, name)
        unit = next(UNITS[word] for word in reversed(name.split("_")) if word in UNITS)
        return None if value is None else value * unit

    def ratio(self, benchmark: str, name: str) -> str:
        return plain(self.value(benchmark, name))


def plain(value: float | None) -> str:
    """Three digits, whole numbers whole."""
    if value is None:
        return "–"
    if float(value).is_integer() or abs(value) >= 1000:
        return f"{value:,.0f}"
    return f"{value:.3g}"


def exact(value: float | None) -> str:
    """Five places, for what is nearly one."""
    return "–" if value is None else f"{value:.5f}"


def time(seconds: float | None) -> str:
    """With the unit that keeps it above one."""
    if seconds is None:
        return "–"
    seconds = float(f"{seconds:.3g}")
    units = {"s": 1.0, "ms": 1e-3, "µs": 1e-6}
    unit = next((unit for unit, size in units.items() if seconds >= size), "µs")
    return f"{plain(seconds / units[unit])} {unit}"


def table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    head = list(head)
    lines = [head, ["---"] * len(head), *map(list, rows)]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def link(benchmark: str) -> str:
    page = DETAILS[benchmark]
    return f"[{page}]({page}.md)" if (DOCS / f"{page}.md").exists() else ""


# ---------------------------------------------------------------- the parts of the page


def calls(n: Numbers) -> str:
    """What a user waits for, the quickest first."""
    known = [(n.seconds(b, name), what, b) for what, b, name in CALLS]
    there = sorted((row for row in known if row[0] is not None), key=lambda row: row[0] or 0.0)
    missing = [row for row in known if row[0] is None]
    rows = ([what, time(took), f"`{b}`", link(b)] for took, what, b in (*there, *missing))
    return table(("what", "median", "benchmark", "details"), rows)


def peers(n: Numbers) -> str:
    rows = ([w, p, n.ratio(b, name), f"`{b}`", link(b)] for w, p, b, name in PEERS)
    return table(("ours", "beside", "its time over ours", "benchmark", "details"), rows)


def motions(n: Numbers) -> str:
    rows = []
    for name in MOTIONS:
        of = ("times_real_time_ratio", "compiled_times_real_time_ratio", "error_mm")
        rows.append(
            [f"`{name}`", *(plain(n.value("simulating", f"{name}_1_segments_{w}")) for w in of)]
        )
    return table(("motion", "virtual machine", "compiled", "error, mm"), rows)


def instruction_counts(n: Numbers) -> str:
    rows = []
    for what, name in COUNTED.items():
        counts = [n.value("instructions", f"{s}_segments_{name}_instructions") for s in SEGMENTS]
        growth = counts[-1] / counts[-2] if counts[-1] and counts[-2] else None
        rows.append([what, *map(plain, counts), plain(growth)])
    return table(("function", *map(str, SEGMENTS), "8 over 4"), rows)


def step_times(n: Numbers) -> str:
    rows = []
    for what, pattern in SOLVERS.items():
        for word in ("free", "saturated"):
            name = pattern.format(word).replace(" ", "_")
            of = [
                n.value("controllers", f"{name}_{last}") for last in ("iterations", "cost_over_sqp")
            ]
            times = [n.seconds("controllers", f"{name}_step_{c}_median") for c in ("ms", "cpu_ms")]
            rows.append([what, word, *map(time, times), plain(of[0]), exact(of[1])])
    head = ("solver", "torque", "by the clock", "processor", "iterations", "cost over SQP's")
    return table(head, rows)


def parts_in_c(n: Numbers) -> str:
    """Shares of a step's machine instructions."""
    counts = {p: n.value("c_controller", f"unsaturated_{p}_machine_instructions") for p in PARTS}
    whole = n.value("c_controller", "unsaturated_all_machine_instructions")
    if whole is None:
        return "The stored run has no counts of machine instructions; they need Valgrind."
    rows = [[part, plain(c), plain(c and 100 * c / whole)] for part, c in counts.items()]
    rest = whole - sum(c or 0 for c in counts.values())
    rows += [["all else", plain(rest), plain(100 * rest / whole)], ["a step", plain(whole), "100"]]
    return table(("part", "machine instructions", "%"), rows)


def factors(n: Numbers) -> str:
    rows = ([what, n.ratio(b, name), f"`{b}`", link(b)] for what, b, name in FACTORS)
    return table(("what", "times as long", "benchmark", "details"), rows)


def quality(n: Numbers) -> str:
    rows = (
        [what, with_unit(n, b, name, unit), f"`{b}`", link(b)] for what, b, name, unit in QUALITY
    )
    return table(("what", "value", "benchmark", "details"), rows)


def with_unit(n: Numbers, benchmark: str, name: str, unit: str) -> str:
    """A value with its unit, or a count "of" another one."""
    value = n.value(benchmark, name)
    if unit.startswith("of "):
        unit = f"of {plain(n.value(benchmark, unit[3:]))}"
    text = exact(value) if "over" in name else plain(value)
    return f"{text} {unit}".strip() if value is not None else text


def overview(run: Run) -> str:
    rows = []
    for part, names in ABOUT.items():
        for name in names:
            if name in benchmarks():
                found = run.benchmarks.get(name)
                status = "not in this run" if found is None else found.status
                took = "–" if found is None else f"{found.seconds:.0f} s"
                rows.append([part, f"`{name}`", purpose(name), status, took, link(name)])
    return table(("part", "name", "what it is for", "status", "took", "details"), rows)


def about(run: Run) -> str:
    """Machine and programs of the run."""
    m = run.machine
    commit = (
        "" if run.commit is None else f", commit {run.commit}{' and changes' * bool(run.changed)}"
    )
    loads = [one.load for one in run.benchmarks.values() if one.load is not None]
    busy = f", load {plain(min(loads))} to {plain(max(loads))}" if loads else ""
    seconds = sum(one.seconds for one in run.benchmarks.values())
    versions = ", ".join(f"{name} {m[name]}" for name in ("casadi", "numpy", "scipy", "daqp"))
    return (
        f"Run of {run.date[:10]}{commit}, {seconds / 60:.0f} minutes: {m['processor']}, "
        f"{m['cores']} cores, {m['memory_gib']} GiB, {m['system']}{busy}; Python {m['python']}, "
        f"softmpc {m['softmpc']}, {versions}; compiler: {m['compiler'] or 'none'}."
    )


def page(run: Run) -> str:
    """The page of a run."""
    n = Numbers(run)
    return TEXT.format(
        machine=about(run),
        band=BAND,
        calls=calls(n),
        peers=peers(n),
        motions=motions(n),
        instructions=instruction_counts(n),
        steps=step_times(n),
        parts=parts_in_c(n),
        factors=factors(n),
        quality=quality(n),
        overview=overview(run),
    )


def main() -> None:
    """Write the page."""
    run = last_stored("quick")
    if run is None:
        sys.exit("no stored quick run: python -m tests.benchmarks --quick --store")
    PAGE.write_text(page(run), encoding="utf-8")
    print(PAGE)


if __name__ == "__main__":
    main()
