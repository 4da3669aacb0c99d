"""Is the estimator right about its errors, and what does it cost?

    python -m tests.benchmarks.estimation [--runs 100] [--seed 0] [--quick]

Squares of errors and innovations, normalised by the covariances that the filter states for them,
are averaged over runs at each time (NEES and NIS). Without mismatch such a mean lies within its
χ² band at 95 % of the times, and their mean over all times is near 1 (Bar-Shalom, Li and
Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, 5.4). "early" are the
first 0.25 s, in which the initial errors are found.

With mismatch the plant has 4 segments a section, is 15 % stiffer and carries 200 g; a disturbance
of the model stands for all this, so there is no true one, and the state is that of segments which
the plant does not have.

The times are medians by the clock: of 25 ms of readings (camera 100 Hz and 10 ms late, pressures
100 Hz), and of one real-time iteration of 20 intervals, one after the other in one process.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from softmpc.control.mpc import Mpc
from softmpc.control.ocp import tracking_problem
from softmpc.control.real_time import RealTime
from softmpc.control.transcription import Transcription
from softmpc.estimation.sensing import Sample, Sensing
from softmpc.estimation.sensors import TICK
from softmpc.simulation.idas import Idas
from tests.benchmarks.common import key
from tests.consistency import CONTROL, Laboratory, Line, Runs, line

STEPS, EARLY = 120, 10
HEADER = f"{'':<26}{'mean':>8}   {'95 % band':<14}{'within':>9}"


def table(lab: Laboratory, found: Runs) -> list[Line]:
    """All squares of some runs."""
    size, nx = lab.process.size, lab.process.nx
    lines = []
    if found.whole:
        early = [squares[:EARLY] for squares in found.whole]
        lines += [line("NEES of (x, d)", found.whole, size)]
        lines += [line("NEES of (x, d), early", early, size)]
        lines += [line("NEES of (x, d), later", found.whole, size, EARLY)]
    lines.append(line("NEES of x", found.state, nx))
    for sensor, reading, squares in zip(
        lab.sensors, lab.estimator.readings, found.by_sensor, strict=True
    ):
        lines.append(line(f"NIS of {sensor.name}", squares, len(reading.names)))
    return lines


def show(title: str, lab: Laboratory, found: Runs) -> None:
    """Print the table of some runs."""
    print(f"{title}, {len(found.state)} runs of {STEPS * CONTROL * TICK:g} s")
    print(HEADER)
    for one in table(lab, found):
        print(one)
    print(f"{'readings turned away':<26}{found.refused:8d}")
    if found.tips:
        rms = float(np.sqrt(np.mean(np.square(found.tips))))
        print(f"{'tip, RMS, second half':<26}{rms:8.2f} mm")
    print(flush=True)


def costs(lab: Laboratory, steps: int) -> tuple[float, float, float]:
    """Medians of seconds a step: of the estimator, of the controller, and of the estimator alone,
    told the same again with no controller in between."""
    model, estimator = lab.model, lab.estimator
    ocp = replace(tracking_problem(model, 20, CONTROL * TICK), disturbance=lab.disturbance)
    transcription = Transcription(ocp)
    mpc = Mpc(transcription, RealTime(transcription))
    plant, sensing = Idas(model, 1e-7), Sensing(lab.sensors, model, 1)
    x, u = lab.start.x, lab.start.u
    tip = np.asarray(model.tip(x[: model.strains])).ravel()
    estimator.reset(x, u)
    waiting, took, told = [], [], []
    for k in range(steps):
        tick = k * CONTROL
        arrived = [one for one in waiting if one.arrival <= tick]
        waiting = [one for one in waiting if one.arrival > tick]
        places = tip + 0.02 * np.sin(0.2 * (k + np.arange(1, 21)))[:, None]
        began = time.perf_counter()
        estimator.receive(arrived)
        now = estimator.estimate(tick)
        estimated = time.perf_counter()
        given = {"tip": places, "disturbance": np.tile(now.d, (20, 1))}
        u = mpc.step(now.x, u, given).u
        took.append((estimated - began, time.perf_counter() - estimated))
        estimator.applied(u, tick)
        told.append((tick, arrived, u))
        moved = plant.advance(x, u, CONTROL * TICK, CONTROL)
        for i, x in enumerate(moved, tick + 1):
            samples = [sensing.sample(number, i, x, u) for number in sensing.due(i)]
            waiting += [one for one in samples if one is not None]
    ours, theirs = np.median(np.array(took[5:]), axis=0)
    return float(ours), float(theirs), alone(lab, told)


def alone(lab: Laboratory, told: Sequence[tuple[int, list[Sample], np.ndarray]]) -> float:
    """Median of the estimator's seconds a step, told what it was told before."""
    estimator, took = lab.estimator, []
    estimator.reset(lab.start.x, lab.start.u)
    for tick, arrived, u in told:
        began = time.perf_counter()
        estimator.receive(arrived)
        estimator.estimate(tick)
        took.append(time.perf_counter() - began)
        estimator.applied(u, tick)
    return float(np.median(took[5:]))


def numbers(quick: bool) -> dict[str, float]:
    """Times, and how consistent the filter is over 4 runs (quick) or 100."""
    runs, lab = 4 if quick else 100, Laboratory()
    seconds = dict(zip(("estimate", "controller", "estimate_alone"), costs(lab, 40), strict=True))
    found = {f"{name}_step_ms_median": 1e3 * took for name, took in seconds.items()}
    found["estimate_to_controller_time_ratio"] = seconds["estimate"] / seconds["controller"]
    for title, some in {
        "matched": lab.matched(runs, STEPS, 0),
        "mismatched": lab.mismatched(max(2, runs // 5), STEPS, 0),
    }.items():
        for one in table(lab, some):
            found |= {
                key(title, one.name, "mean"): one.mean,
                key(title, one.name, "share"): one.within,
            }
        found[key(title, "readings turned away count")] = some.refused
    return found


def main() -> None:
    """Print all tables."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--runs", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0, help="of the first run")
    parser.add_argument("--quick", action="store_true", help="10 runs, and fewer steps")
    chosen = parser.parse_args()
    runs = 10 if chosen.quick else chosen.runs
    lab = Laboratory()
    ours, theirs, bare = costs(lab, 40 if chosen.quick else 200)
    share = 100 * ours / theirs
    print(f"estimator {1e3 * ours:.2f} ms a step, controller {1e3 * theirs:.2f} ms: {share:.0f} %")
    print(f"estimator with no controller between: {1e3 * bare:.2f} ms\n", flush=True)
    show("without mismatch", lab, lab.matched(runs, STEPS, chosen.seed))
    show("with mismatch", lab, lab.mismatched(max(2, runs // 5), STEPS, chosen.seed))


if __name__ == "__main__":
    main()
