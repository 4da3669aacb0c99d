"""Measure what the accuracy page says, and write it: `python docs/make_accuracy.py`.

    python docs/make_accuracy.py            # all of it
    python docs/make_accuracy.py --quick    # a first look
    python docs/make_accuracy.py --render   # the page and its pictures from the stored run alone

Runs what `softmpc study examples/accuracy.toml` runs. What is measured is kept in out/accuracy (or
out/accuracy-quick) as it comes: after an interruption the same command goes on, repeating nothing.
The finished study is stored in docs/accuracy.json; page and pictures are made from that file.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable
from pathlib import Path

from tqdm import tqdm

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(Path(__file__).parent))

from accuracy_story import story  # noqa: E402
from make_motion_images import save  # noqa: E402

from softmpc.accuracy.points import Study  # noqa: E402
from softmpc.accuracy.study import read_task, run_study  # noqa: E402
from softmpc.files import as_json, replacing  # noqa: E402
from softmpc.view.accuracy import front_figure, study_figures  # noqa: E402

STORED = ROOT / "docs" / "accuracy.json"
PAGE = ROOT / "docs" / "accuracy.md"
IMAGES = ROOT / "docs" / "images"
SCENE = ROOT / "examples" / "accuracy.toml"
# Name of a picture of the page -> that of the study.
PICTURES = {
    "accuracy_segments": "convergence-rest-segments-and-mass.png",
    "accuracy_formulation": "convergence-rest-formulation.png",
    "accuracy_changes": "changes-motion.png",
    "accuracy_controllers": "controllers-loop.png",
}


def stage(what: str) -> Callable[[float, float], None]:
    """A progress bar for a part of the study."""
    bar = tqdm(desc=what, unit="case")

    def report(done: float, total: float) -> None:
        bar.total = total
        bar.update(done - bar.n)
        if done >= total:
            bar.close()

    return report


def measure(quick: bool, fresh: bool) -> Study:
    """The study; raises `KeyboardInterrupt` when interrupted."""
    folder = ROOT / "out" / ("accuracy-quick" if quick else "accuracy")
    folder.mkdir(parents=True, exist_ok=True)
    keep = folder / "measurements.jsonl"
    study = run_study(read_task(SCENE, quick), keep=keep, fresh=fresh, stage=stage)
    if study.status != "finished":
        raise KeyboardInterrupt
    return study


def stored() -> Study:
    """The study of the page."""
    return Study.from_summary(json.loads(STORED.read_text(encoding="utf-8")))


def render(study: Study) -> None:
    """Write the page and its pictures."""
    figures = study_figures(study)
    save(front_figure(study, "motion"), IMAGES / "accuracy_front.png")
    for name, own in PICTURES.items():
        save(figures[own], IMAGES / f"{name}.png")
    with replacing(PAGE) as beside:
        beside.write_text(story(study), encoding="utf-8")
    print(PAGE)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true", help="a first look, some minutes")
    parser.add_argument("--fresh", action="store_true", help="measure anew what was kept")
    parser.add_argument("--render", action="store_true", help="from the stored run alone")
    given = parser.parse_args()
    began = time.perf_counter()
    if not given.render:
        study = measure(given.quick, given.fresh)
        with replacing(STORED) as beside:
            beside.write_text(as_json(study.summary()) + "\n", encoding="utf-8")
    render(stored())
    print(f"took {time.perf_counter() - began:.0f} s")


if __name__ == "__main__":
    main()
