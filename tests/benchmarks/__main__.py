"""All benchmarks, one after the other, each in a process of its own with one BLAS thread.

    python -m tests.benchmarks [--quick | --full] [--list] [--store] [--resume] [--compare FILE]
                               [NAME …]

Prints the numbers of each as it ends, beside those of the last stored run of the same mode (or of
FILE); counts of instructions are compared exactly, times only beyond a factor of {band}. Every
result is on the disk when it is printed, in {folder}/MODE.json (MODE-some.json with names):
Ctrl-C loses only the one that runs, and `--resume` goes on. `--store` keeps a whole run in
{results}, which `docs/make_performance.py` makes a page of.

Exit status: 0; 2 for wrong arguments; 3 where a benchmark failed, or a count of instructions grew;
130 after Ctrl-C. What is left out, because something is not installed, is no failure.
"""

from __future__ import annotations

import argparse
import signal
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from softmpc.errors import InputError
from tests.benchmarks.common import ROOT, arguments
from tests.benchmarks.comparing import BAND, Change, changes, machine_note, table
from tests.benchmarks.listing import ABOUT, benchmarks, purpose
from tests.benchmarks.running import measured
from tests.benchmarks.stored import RESULTS, Result, Run, last_stored, load, new_run, save, store

FAILED, INTERRUPTED = 3, 130
UNFINISHED = ROOT / "out" / "benchmarks"
Measure = Callable[[str, str], Result]


@dataclass(frozen=True)
class Bench:
    """What a run needs: how one is measured, where runs are kept, what is told."""

    measure: Measure
    file: Path  # written after each benchmark
    results: Path = RESULTS

    def begin(self, mode: str, resume: bool) -> Run:
        """A new run, or the one that was interrupted."""
        run = new_run(mode)
        if not resume:
            return run
        old = load(self.file)
        if (old.commit, old.fingerprint) != (run.commit, run.fingerprint):
            raise InputError(f"{self.file}: is of another commit or machine; leave --resume out")
        return replace(old, benchmarks={k: r for k, r in old.benchmarks.items() if not r.failed})

    def run(self, run: Run, names: Sequence[str], before: Run | None) -> list[Change]:
        """Measure what the run does not have; all numbers beside the earlier ones."""
        same = before is not None and before.fingerprint == run.fingerprint
        found: list[Change] = []
        for number, name in enumerate(names, 1):
            print(f"[{number}/{len(names)}] {name}: {purpose_of(name)}", flush=True)
            if name not in run.benchmarks:
                run.benchmarks[name] = self.measure(name, run.mode)
                save(run, self.file)
            result = run.benchmarks[name]
            old = None if before is None else before.benchmarks.get(name)
            rows = changes(result, old, same)
            print("\n".join([*table(rows), f"  {result.status}, {told_time(result)}"]), flush=True)
            found += [replace(row, name=f"{name}: {row.name}") for row in rows]
        return found


def told_time(result: Result) -> str:
    cpu = "" if result.cpu_s is None else f", {result.cpu_s:g} s of processor time"
    return f"{result.seconds:g} s{cpu}"


def purpose_of(name: str) -> str:
    return purpose(name) if name in benchmarks() else ""


def summary(run: Run, found: list[Change], before: Run | None) -> int:
    """Print what means something; the exit status."""
    failed = {name: one.status for name, one in run.benchmarks.items() if one.failed}
    left = {n: one.status for n, one in run.benchmarks.items() if one.status.startswith("left out")}
    for name, status in {**left, **failed}.items():
        print(f"{name}: {status}")
    if before is None:
        print(f"no stored run of mode {run.mode!r} to compare with")
    else:
        note = machine_note(run, before)
        print(f"\nbeside the run of {before.date}" + (f"\n{note}" if note else ""))
        told = [row for row in found if row.verdict not in ("", "new")]
        print("\n".join(table(told)) or "  nothing changed beyond the noise")
    seconds = sum(one.seconds for one in run.benchmarks.values())
    print(f"{len(run.benchmarks)} benchmarks, {seconds:.0f} s, {len(failed)} failed")
    return FAILED if failed or any(row.grew for row in found) else 0


def show_list() -> None:
    there = benchmarks()
    for part, names in ABOUT.items():
        print(part)
        for name in names:
            print(f"  {name:16} {purpose(name)}" if name in there else f"  {name:16} not there yet")


def parsed(words: Sequence[str] | None) -> argparse.Namespace:
    places = {"band": BAND, "folder": UNFINISHED.relative_to(ROOT)}
    text = (__doc__ or "").format(results=RESULTS.relative_to(ROOT), **places)
    parser = arguments(text)
    parser.add_argument("names", nargs="*", metavar="NAME", help="these alone")
    mode = parser.add_mutually_exclusive_group()
    chosen = {"dest": "mode", "action": "store_const", "default": "quick"}
    mode.add_argument("--quick", const="quick", help="some minutes in all; the default", **chosen)
    mode.add_argument("--full", const="full", help="as in the pages, hours", **chosen)
    parser.add_argument("--list", action="store_true", help="say what there is, and run nothing")
    parser.add_argument("--store", action="store_true", help="keep the run, if it is a whole one")
    parser.add_argument("--resume", action="store_true", help="go on with an interrupted run")
    parser.add_argument("--compare", type=Path, metavar="FILE", help="a stored run to compare with")
    given = parser.parse_args(words)
    unknown = [name for name in given.names if name not in benchmarks()]
    if unknown:
        parser.error(f"no benchmark {', '.join(unknown)}; there are {', '.join(benchmarks())}")
    if given.store and given.names:
        parser.error("--store keeps whole runs, which pages are made of: leave the names out")
    return given


def main(words: Sequence[str] | None = None) -> int:
    """Run what was asked for; the exit status."""
    given = parsed(words)
    if given.list:
        show_list()
        return 0
    file = UNFINISHED / f"{given.mode}{'-some' if given.names else ''}.json"
    bench = Bench(lambda name, mode: measured(f"tests.benchmarks.{name}", mode), file)
    try:
        before = load(given.compare) if given.compare else last_stored(given.mode)
        if before is not None and before.mode != given.mode:
            raise InputError(f"{given.compare}: is a {before.mode} run, this is a {given.mode} one")
        run = bench.begin(given.mode, given.resume)
    except InputError as error:
        print(error, file=sys.stderr)
        return 2
    return conducted(bench, run, given.names or benchmarks(), before, given.store)


def conducted(bench: Bench, run: Run, names: Sequence[str], before: Run | None, keep: bool) -> int:
    """Run, tell and keep; the exit status."""
    try:
        found = bench.run(run, names, before)
    except KeyboardInterrupt:
        print(f"\ninterrupted; {len(run.benchmarks)} results are in {bench.file}: go on with "
              "--resume", file=sys.stderr)  # fmt: skip
        return INTERRUPTED
    status = summary(run, found, before)
    if keep:
        print(f"stored: {store(run, bench.results)}")
    return status


if __name__ == "__main__":
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # ends what it started, like Ctrl-C
    raise SystemExit(main())
