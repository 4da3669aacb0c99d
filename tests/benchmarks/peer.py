"""softmpc beside a peer, soromox (JAX): `python -m tests.benchmarks.peer`.

Needs `pip install soromox`, which softmpc does not depend on; without it one line says so and the
exit status is 2. `--solver` and `--tolerance` change how soromox integrates.

Prints two motions of 10 s, a row for soromox and four for softmpc: pressures given directly (the
same content) and full hydraulics (which soromox does not have), each in CasADi's virtual machine
and compiled by a C compiler, nothing being compiled before. Times are the medians of 5 processes of
their own; the rows take turns.

Alike: two constant-strain sections with stretch, bending and twist (soromox's shears are switched
off), start straight and unstretched, lengths, weight, mass spread along the arm (2 Gauss points),
rotary inertia (soromox's solid circle has the radius and mass of our discs), stretching, bending
and twisting stiffness, forces and moments of the drive on the strains, a sample every 10 ms.
soromox's curvatures are per rest length, ours per current length, so its own quadratic law would
be another material: the bending energy λ/2 κ·Kκ/(1 + ε) is added through its interface for passive
elements. So both have the same rest, and the tips at the end show it.

Not alike: damping in soromox is a constant matrix, that of our straight arm at rest (material and
environment); ours depends on the posture. The integrators: ours Radau IIA, implicit, at most 1 µm
at the tip a step; soromox's rollout with its own choice, diffrax's Tsit5, explicit, here with
diffrax's adaptive controller, rtol = atol = 1e-4 (strains and rates in SI), which makes errors of
the tip comparable; with no controller given soromox takes steps of 0.1 ms. A step of the input
begins a new rollout of one compiled function. The error is the largest distance of the tip, at any
sample, from the same model with a tolerance of 1e-10, ours by IDAS. While the arm rests an implicit
method takes long steps and an explicit one cannot: the second motion, with a step every second,
leaves less rest.

Set up is construction, compilation and, ours, the start of the integrator; imports are only in the
time from the start of the process to the result. Ratios are soromox's time over that of the row.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import statistics
import sys
import tempfile
import time
from collections.abc import Sequence
from importlib.metadata import version
from typing import Any

import numpy as np

from tests.benchmarks.common import answer_of, arguments, key, need_or_exit, need_package
from tests.benchmarks.peer_soromox import (
    DURATION,
    MOTIONS,
    PRESSURE,
    SAMPLE,
    TIGHT,
    arm_for_soromox,
    inputs,
    run_soromox,
)

RUNS = 5
PEER = "soromox"
# Row -> drive, and what SOFTMPC_COMPILE is.
OURS = {
    "softmpc, pressures": ("pressure", "never"),
    "softmpc, pressures, compiled": ("pressure", "require"),
    "softmpc, hydraulics": ("hydraulic", "never"),
    "softmpc, hydraulics, compiled": ("hydraulic", "require"),
}
SOLVER, TOLERANCE = "Tsit5", 1e-4
Answer = dict[str, Any]


def run_softmpc(motion: str, drive: str, check: bool) -> Answer:
    """One motion in this process; called in a process of its own."""
    from softmpc import HydraulicDrive, PressureDrive, Scene, build, chen2022
    from softmpc.simulation.inputs import InputProfile, Step
    from softmpc.simulation.run import simulate

    began = time.perf_counter()
    arm = chen2022()
    actuation = PressureDrive() if drive == "pressure" else HydraulicDrive()
    model = build(Scene(arm, actuation=actuation))
    high = PRESSURE / actuation.matrices(arm).static_gain[0, 0]
    rows = inputs(motion, high, arm.units)
    hold = DURATION / len(rows)
    profile = InputProfile.of(
        arm.units,
        [Step(i + 1, k * hold, to) for k, row in enumerate(rows) for i, to in enumerate(row)],
    )
    built = time.perf_counter() - began
    moved = simulate(model, profile, DURATION, sample_time=SAMPLE, start="straight")
    answer = {
        "ready": time.time(),
        "setup": built + moved.setup_s,
        "seconds": moved.wall_s,
        "tip": moved.final_tips[-1].tolist(),
        "finished": moved.finished,
    }
    if check:
        tight = {"method": "idas", "tolerance": TIGHT, "sample_time": SAMPLE, "start": "straight"}
        exact = simulate(model, profile, DURATION, **tight)
        answer["error"] = np.linalg.norm(moved.tips[:, -1] - exact.tips[:, -1], axis=1).max()
    return answer


def measured(call: Answer, mode: str) -> Answer:
    """The answer of a process of its own, which finds nothing compiled before."""
    with tempfile.TemporaryDirectory() as cache:
        variables = {"SOFTMPC_COMPILE": mode, "SOFTMPC_CACHE": cache}
        began = time.time()
        answer: Answer = answer_of("tests.benchmarks.peer", "--one", call=call, variables=variables)
    if not answer["finished"]:
        raise RuntimeError(f"{call['library']} did not finish {call['motion']!r}")
    return answer | {"whole": answer["ready"] - began}


def answers_of(
    motion: str, peer: Answer, rows: Sequence[str], runs: int
) -> dict[str, list[Answer]]:
    """What each row found in each run, by turns; `peer` is how soromox is to be called."""
    calls = {PEER: ({"library": PEER, "motion": motion} | peer, "never")}
    for row in rows:
        drive, mode = OURS[row]
        calls[row] = ({"library": "softmpc", "motion": motion, "drive": drive}, mode)
    answers: dict[str, list[Answer]] = {row: [] for row in calls}
    for run in range(runs):
        for row, (call, mode) in calls.items():
            answers[row].append(measured(call | {"check": run == 0}, mode))
    return answers


def numbers(quick: bool) -> dict[str, float]:
    """Times of soromox over ours: of the motion, and from the start to the result; errors.

    One run without compiling in quick mode, else five of all rows.
    """
    need_package(PEER, PEER)
    rows = [row for row in OURS if not (quick and OURS[row][1] == "require")]
    peer, found = {"solver": SOLVER, "tolerance": TOLERANCE, "arm": arm_for_soromox()}, {}
    for motion in MOTIONS:
        answers = answers_of(motion, peer, rows, 1 if quick else RUNS)
        for row, many in answers.items():
            name = key(motion, row.removeprefix("softmpc, "))
            found[f"{name}_motion_s"] = middle(many, "seconds")
            found[f"{name}_error_mm"] = 1e3 * many[0]["error"]
            if row != PEER:
                for what, of in (("motion", "seconds"), ("start_to_result", "whole")):
                    ratio = middle(answers[PEER], of) / middle(many, of)
                    found[f"{name}_{what}_time_ratio_soromox_to_ours"] = ratio
    return found


def table(motion: str, answers: dict[str, list[Answer]]) -> None:
    """Print the rows of one motion."""
    title = f"{motion}, {DURATION:g} s"
    print(f"{title:29}  set up  motion  × real  start to  ratio of        error   end of the tip")
    print(f"{'':29}  s       s       time    result s  motion  result  mm      mm")
    for row, many in answers.items():
        m = {name: middle(many, name) for name in ("setup", "seconds", "whole")}
        by = {name: middle(answers[PEER], name) / m[name] for name in m}
        tip = ", ".join(f"{1e3 * x:.2f}" for x in many[0]["tip"])
        print(
            f"{row:29}  {m['setup']:6.2f}  {m['seconds']:6.3f}  {DURATION / m['seconds']:6.0f}  "
            f"{m['whole']:8.2f}  {by['seconds']:6.1f}  {by['whole']:6.1f}  "
            f"{1e3 * many[0]['error']:.4f}  {tip}",
            flush=True,
        )


def middle(answers: list[Answer], name: str) -> float:
    return statistics.median(answer[name] for answer in answers)


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--solver", default=SOLVER, help="of diffrax, for soromox")
    parser.add_argument("--tolerance", type=float, default=TOLERANCE, help="its rtol and atol")
    parser.add_argument("--one", action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.one:
        call = json.load(sys.stdin)
        print(json.dumps((run_soromox if call.pop("library") == PEER else run_softmpc)(**call)))
        return
    need_or_exit(PEER, PEER)
    names = ("softmpc", "casadi", PEER, "jax", "diffrax")
    print(f"Python {platform.python_version()}, {os.cpu_count()} cores, "
          + ", ".join(f"{name} {version(name)}" for name in names))  # fmt: skip
    print(f"medians of {RUNS} processes; {PEER} by {given.solver}, tolerance {given.tolerance:g}")
    peer = {"solver": given.solver, "tolerance": given.tolerance, "arm": arm_for_soromox()}
    for motion in MOTIONS:
        table(motion, answers_of(motion, peer, list(OURS), RUNS))


if __name__ == "__main__":
    main()
