"""Does the bound of `softmpc choose` hold in scenes it has not seen, and how wide is it?

    python -m tests.benchmarks.choosing [--calibrate] [--rest] [--motion] [--loop] [--keep FOLDER]
                                        [--first N] [--workers N] [--write]

Chooses for 20 scenes made of seeds (`choosing_scenes`), two at a time, and prints what was chosen,
the measured error, the bound and the true error, which is against twice the segments by another
integrator. With --calibrate it measures the scores of other scenes and prints the factors of
`softmpc/accuracy/bound.py`. Each scene is kept as soon as it is there, and the same command goes on
from what is kept. --write puts what is kept into docs/choose.md, without measuring anything.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from statistics import median
from typing import Any

from softmpc.accuracy.bound import bound_m, conformal_factor
from softmpc.files import replacing
from softmpc.sweeps import sweep
from tests.benchmarks.choosing_measures import Judged, Scores
from tests.benchmarks.choosing_scenes import CALIBRATING, JUDGING, TOLERANCES
from tests.benchmarks.common import ROOT, arguments

KEPT = ROOT / "out" / "choosing"
PAGE = ROOT / "docs" / "choose.md"
MARKS = "<!-- judged -->", "<!-- end -->"
MOST_RATIO = 3.0  # the median of bound over true error
SHARE = 0.9  # of scenes in which the bound has to hold
Row = dict[str, Any]


# ---------------------------------------------------------------- calibration


def calibrate(family: str, keep: Path, first: int | None, workers: int) -> float:
    """Print the scores and the factor; of each scene its largest score counts.

    Models that are beyond all tolerances are never chosen, and do not count.
    """
    start, count = CALIBRATING[family]
    seeds = range(start, start + min(first or count, count))
    print(f"{family}: calibrating with seeds {seeds[0]} to {seeds[-1]}", flush=True)
    largest: list[float] = []

    def arrived(_: int, rows: Any) -> None:
        for row in rows:
            told = (f"{key} {_number(value)}" for key, value in row.items())
            print("  " + "  ".join(told), flush=True)
        own = [row["score"] for row in rows if row.get("error_m", 1.0) <= 1e-3 * TOLERANCES[1]]
        largest.extend([max(own)] if own else [])

    file = _file(keep, "calibrating", family, len(seeds))
    sweep(Scores(family), seeds, executor=workers, chunk=1, keep=file, arrived=arrived)
    factor = conformal_factor(largest)
    print(f"{family}: conformal factor {factor:.3g} from {len(largest)} scenes, "
          f"scores {min(largest):.3g} to {max(largest):.3g}")  # fmt: skip
    return factor


def _number(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _file(folder: Path, what: str, family: str, count: int) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    return folder / f"{what}-{family}-{count}.jsonl"


# ---------------------------------------------------------------- judgement


def judge(family: str, keep: Path, first: int | None, workers: int) -> list[Row]:
    """Choose for each scene, and compare the bound with the true error."""
    start, count = JUDGING[family]
    seeds = range(start, start + min(first or count, count))

    def arrived(_: int, row: Any) -> None:
        print("  ".join(_cells(row)), flush=True)

    file = _file(keep, "judging", family, len(seeds))
    return sweep(Judged(family), seeds, executor=workers, chunk=1, keep=file, arrived=arrived)


def _cells(row: Row) -> list[str]:
    """A row of the table; lengths in mm."""
    head = [row["title"], f"{1e3 * row['tolerance_m']:.3g}"]
    if row["chosen"] is None:
        return [*head, "-", "-", "-", "-", "-", f"none: {row['reasons'][0]}"]
    lengths = [f"{1e3 * row[key]:.4g}" for key in ("error_m", "bound_m", "true_m")]
    holds = "yes" if _holds(row) else "**no**"
    return [*head, *lengths, f"{row['bound_m'] / row['true_m']:.2f}", holds, row["chosen"]]


def _holds(row: Row) -> bool:
    return bool(row["true_m"] <= row["bound_m"])


def summary(rows: Sequence[Row]) -> tuple[str, bool]:
    """What came of it for people, and whether it is as good as it has to be."""
    chosen = [row for row in rows if row["chosen"] is not None]
    if not chosen:
        return "nothing was chosen in any scene", False
    held = sum(map(_holds, chosen))
    ratio = median(row["bound_m"] / row["true_m"] for row in chosen)
    told = (
        f"the bound holds in {held} of {len(chosen)} scenes ({len(rows) - len(chosen)} of "
        f"{len(rows)} refused); the median of bound over true error is {ratio:.2f}"
    )
    return told, held >= SHARE * len(chosen) and ratio <= MOST_RATIO


def kept(keep: Path) -> list[Row]:
    """The rows of all scenes judged so far, by family and seed, with the bound as it is now."""
    rows = []
    for family, (_, count) in JUDGING.items():
        file = _file(keep, "judging", family, count)
        lines = file.read_text(encoding="utf-8").splitlines()[1:] if file.exists() else []
        found = [json.loads(line)["results"][0] for line in lines]
        for row in found:
            if row["chosen"] is not None:
                row["bound_m"] = bound_m(family, row)
        rows += sorted(found, key=lambda row: row["seed"])
    return rows


def write(keep: Path) -> None:
    """Put what is kept into the page."""
    rows, total = kept(keep), sum(count for _, count in JUDGING.values())
    head = ("scene", "tolerance, mm", "measured, mm", "bound, mm", "true, mm", "bound/true",
            "holds", "chosen")  # fmt: skip
    table = [f"| {' | '.join(cells)} |" for cells in (head, ["---"] * len(head))]
    table += [f"| {' | '.join(_cells(row))} |" for row in rows]
    told = f"{len(rows)} of {total} scenes are judged: {summary(rows)[0]}."
    text = PAGE.read_text(encoding="utf-8")
    before, _, rest = text.partition(MARKS[0])
    after = rest.partition(MARKS[1])[2]
    made = "\n\n".join([before + MARKS[0], "\n".join(table), told, MARKS[1] + after])
    with replacing(PAGE) as beside:
        beside.write_text(made, encoding="utf-8")


# ---------------------------------------------------------------- commands


def numbers(quick: bool) -> dict[str, float]:
    """Whether the bound holds and how wide it is; quick: of one scene, else three of a motion and
    one of a loop."""
    rows = []
    for family, count in (("motion", 1),) if quick else (("motion", 3), ("loop", 1)):
        start = JUDGING[family][0] + (2 if quick else 0)  # the third has one section
        rows += sweep(Judged(family), range(start, start + count), executor=1)
    chosen = [row for row in rows if row["chosen"] is not None]
    return {
        "chosen_count": len(chosen),
        "held_count": sum(map(_holds, chosen)),
        "bound_over_true_ratio": median(row["bound_m"] / row["true_m"] for row in chosen),
        "candidates_count": sum(row["tried"] for row in chosen),
    }


def main(words: Sequence[str] | None = None) -> int:
    """The command line."""
    parser = arguments(__doc__)
    for name in ("calibrate", *CALIBRATING, "write"):
        parser.add_argument(f"--{name}", action="store_true")
    parser.add_argument("--keep", type=Path, default=KEPT)
    parser.add_argument("--first", type=int, help="so many scenes of each family")
    parser.add_argument("--workers", type=int, default=2)
    asked = parser.parse_args(words)
    given = asked.keep, asked.first, asked.workers
    if asked.write:
        write(asked.keep)
        return 0
    known = CALIBRATING if asked.calibrate else JUDGING
    families = [name for name in known if getattr(asked, name)] or list(known)
    if asked.calibrate:
        for family in families:
            calibrate(family, *given)
        return 0
    told, good = summary([row for family in families for row in judge(family, *given)])
    print(told)
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
