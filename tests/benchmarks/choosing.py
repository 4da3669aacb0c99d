"""Does the bound of `softmpc choose` hold in scenes it has not seen, and how wide is it?

    python -m tests.benchmarks.choosing [--calibrate] [--motion | --loop] [--few] [--workers N]

Chooses for scenes made of seeds (`choosing_scenes`) and prints what was chosen, the measured error,
the bound and the true error, which is against twice the segments by another integrator. With
--calibrate it measures the scores of other scenes and prints the factors of
`softmpc/accuracy/bound.py`. --few: three scenes of each.
"""

from __future__ import annotations

import sys
import time
from argparse import ArgumentParser
from collections.abc import Iterator
from dataclasses import dataclass
from statistics import median
from typing import Any

import numpy as np

from softmpc.accuracy.bound import conformal_factor, score
from softmpc.accuracy.choose import choose
from softmpc.accuracy.choose_families import COUNTS
from softmpc.accuracy.choose_loop import loop_error
from softmpc.accuracy.configuration import Configuration, Task, changed
from softmpc.accuracy.motion_reference import COARSER, FINE, limit, weights
from softmpc.accuracy.motion_task import model_of, moved, settings_of
from softmpc.sweeps import sweep
from tests.benchmarks.choosing_scenes import (
    CALIBRATING,
    JUDGING,
    TOLERANCES,
    loop_scene,
    motion_scene,
)
from tests.benchmarks.choosing_truth import motion_truth, true_loop_error, true_motion_error

FEW = 3
PATIENCE = 3000.0  # s
MOST_RATIO = 3.0  # the median of bound over true error
SCENES = {"motion": motion_scene, "loop": loop_scene}
INTEGRATION = {"simulate.method": "radau", "simulate.tip_tolerance": 1e-4}
MODEL = "track.controller.scene.model.segments"
# What is calibrated with: models as coarse as those that a choice ends with.
COARSE = {
    "motion": [{"model.segments": n, "model.mass": "gauss-2"} | INTEGRATION for n in (1, 2)],
    "loop": [{MODEL: 1}],
}  # fmt: skip


@dataclass(frozen=True)
class Scores:
    """Scores of the coarse models of a scene; the work of a sweep over seeds."""

    family: str

    def __call__(self, seed: int) -> list[dict[str, Any]]:
        task = Task(SCENES[self.family](seed)[0])
        found = []
        for error in (_motion_errors if self.family == "motion" else _loop_errors)(task):
            true_m = error.pop("true_m")
            kept = {key: error[key] for key in ("error_m", "doubt_m")}
            row = {"seed": seed, **kept, "true_m": true_m, "score": score(error, true_m)}
            found.append(row)
        return found


def _motion_errors(task: Task) -> Iterator[dict[str, Any]]:
    """As a choice measures them; runs that several references share are made once."""
    runs = {
        n: np.array(limit(task, [n], PATIENCE)["tips"]) for n in {*COUNTS[FINE], *COUNTS[COARSER]}
    }
    fine, coarser = (
        np.sum([w * runs[n] for w, n in zip(weights(COUNTS[name]), COUNTS[name], strict=True)], 0)
        for name in (FINE, COARSER)
    )
    truth = motion_truth(task)
    for changes in COARSE["motion"]:
        document = changed(task.document, changes)
        model = model_of(document)
        tips = moved(model, settings_of(task, document, model), PATIENCE).tips
        error, doubt, true = (
            float(np.linalg.norm(one - other, axis=2).max())
            for one, other in ((tips, fine), (fine, coarser), (tips, truth))
        )
        yield {"error_m": error, "doubt_m": doubt, "true_m": true}


def _loop_errors(task: Task) -> Iterator[dict[str, Any]]:
    for changes in COARSE["loop"]:
        own = Configuration("calibration", str(changes), changes)
        yield loop_error(task, own) | {"true_m": true_loop_error(task, own)}


class True_:
    """True errors of configurations of one scene; the truth of a motion is run once."""

    def __init__(self, family: str, task: Task) -> None:
        self.family, self.task = family, task
        self.tips = motion_truth(task) if family == "motion" else None

    def error(self, configuration: Configuration) -> float:
        """The true error, m."""
        if self.tips is None:
            return true_loop_error(self.task, configuration)
        return true_motion_error(self.task, configuration, self.tips)


@dataclass(frozen=True)
class Truth:
    """The true error of one configuration; work of a sweep."""

    family: str

    def __call__(self, case: Any) -> float:
        document, name, changes = case
        return True_(self.family, Task(document)).error(Configuration("chosen", name, changes))


def calibrate(family: str, workers: int, few: bool) -> float:
    """Print the scores and the factor; of each scene its largest score counts.

    Models that are beyond all tolerances are never chosen, and do not count.
    """
    first, count = CALIBRATING[family]
    seeds = range(first, first + (FEW if few else count))
    print(f"{family}: calibrating with seeds {seeds[0]} to {seeds[-1]}", flush=True)
    largest = []

    def arrived(_: int, rows: Any) -> None:
        for row in rows:
            print("  " + "  ".join(f"{key} {_number(value)}" for key, value in row.items()),
                  flush=True)  # fmt: skip
        own = [row["score"] for row in rows if row["error_m"] <= 1e-3 * TOLERANCES[1]]
        largest.extend([max(own)] if own else [])

    sweep(Scores(family), seeds, executor=workers, chunk=1, arrived=arrived)
    factor = conformal_factor(largest)
    print(f"{family}: factor {factor:.3g} from {len(largest)} scenes")
    return factor


def _number(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


HEAD = ("scene", "tolerance", "chosen", "measured", "bound", "truth", "ratio", "holds", "s")
ROW = "{:<28} {:>9} {:>9} {:>9} {:>9} {:>6} {:>6} {:>6}  {}"


def judge(family: str, workers: int, few: bool) -> dict[str, Any]:
    """Choose for each scene, and compare the bound with the true error; lengths in mm."""
    first, count = JUDGING[family]
    print(ROW.format("scene", *HEAD[1:2], *HEAD[3:], "chosen"), flush=True)
    ratios, held, refused = [], 0, 0
    for seed in range(first, first + (FEW if few else count)):
        row = judged(family, seed, workers)
        if row["chosen"] is None:
            refused += 1
            print(ROW.format(row["title"], f"{1e3 * row['tolerance_m']:.3g}", *"-----", "-",
                             row["reasons"][0]), flush=True)  # fmt: skip
            continue
        ratio = row["bound_m"] / row["true_m"]
        holds = row["true_m"] <= row["bound_m"]
        ratios.append(ratio)
        held += holds
        lengths = (row[key] for key in ("tolerance_m", "error_m", "bound_m", "true_m"))
        numbers = [f"{1e3 * length:.3g}" for length in lengths]
        print(ROW.format(row["title"], *numbers, f"{ratio:.2f}", "yes" if holds else "NO",
                         f"{row['seconds']:.0f}", row["chosen"]), flush=True)  # fmt: skip
    return {"held": held, "chosen": len(ratios), "refused": refused, "ratios": ratios}


def judged(family: str, seed: int, workers: int) -> dict[str, Any]:
    """One scene: what is chosen with its bound (m), and its true error (m)."""
    document, tolerance_m = SCENES[family](seed)
    began = time.perf_counter()
    choice = choose(Task(document), tolerance_m, executor=workers)
    found = {"title": choice.title, "tolerance_m": tolerance_m, "reasons": choice.reasons,
             "seconds": time.perf_counter() - began, "chosen": None}  # fmt: skip
    if choice.chosen is None:
        return found
    own = choice.chosen.configuration
    (true_m,) = sweep(Truth(family), [(document, own.name, dict(own.changes))], executor=1)
    error_m = choice.chosen.point.error_m
    return found | {"chosen": own.name, "error_m": error_m, "bound_m": choice.chosen.bound_m,
                    "true_m": true_m}  # fmt: skip


def main(words: list[str]) -> int:
    parser = ArgumentParser(prog="python -m tests.benchmarks.choosing")
    parser.add_argument("--calibrate", action="store_true")
    parser.add_argument("--motion", action="store_true")
    parser.add_argument("--loop", action="store_true")
    parser.add_argument("--few", action="store_true")
    parser.add_argument("--workers", type=int, default=2)
    asked = parser.parse_args(words)
    families = [name for name in SCENES if getattr(asked, name)] or list(SCENES)
    if asked.calibrate:
        for family in families:
            calibrate(family, asked.workers, asked.few)
        return 0
    results = [judge(family, asked.workers, asked.few) for family in families]
    chosen, held = (sum(one[key] for one in results) for key in ("chosen", "held"))
    ratios = [ratio for one in results for ratio in one["ratios"]]
    refused = sum(one["refused"] for one in results)
    print(f"the bound holds in {held} of {chosen} scenes ({refused} refused); "
          f"median of bound over truth {median(ratios):.2f}")  # fmt: skip
    return 0 if 10 * held >= 9 * chosen and median(ratios) <= MOST_RATIO else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
