"""What the Hessian costs: Gauss-Newton against exact, the same problem with IPOPT.

python -m tests.benchmarks.hessians [--intervals 20]
"""

from __future__ import annotations

import argparse
import statistics
import time

import numpy as np

from softmpc.control.ipopt import Ipopt
from softmpc.control.ocp import tracking_problem
from softmpc.control.solver import Solution
from softmpc.control.transcription import Transcription
from softmpc.model.model import build
from softmpc.model.presets import chen2022
from softmpc.model.scene import Scene
from softmpc.statics.equilibrium import find_equilibrium, pressures_from_torques

TORQUE = np.full(6, 0.9)
MOVE = (0.003, 0.002, 0.0)  # m, the tip is asked to


def run(hessian: str, intervals: int) -> tuple[float, list[Solution]]:
    """Seconds to make the solver, and three cold solves."""
    began = time.perf_counter()
    model = build(Scene(chen2022()))
    t = Transcription(tracking_problem(model, intervals))
    solver = Ipopt(t, "exact" if hessian == "exact" else "gauss-newton")
    made = time.perf_counter() - began
    posture = find_equilibrium(model, pressures_from_torques(model, TORQUE))
    z = model.drive.at_rest(TORQUE)
    x = np.concatenate([posture.q, np.zeros(model.strains), z])
    p = t.parameters(x, TORQUE, np.tile(posture.tips[-1] + MOVE, (intervals, 1)))
    return made, [solver.solve(p, t.resting(x, TORQUE)) for _ in range(3)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--intervals", type=int, default=20)
    intervals = parser.parse_args().intervals
    print(f"{intervals} intervals, two sections × 1 segment, hydraulic drive; medians of 3 solves")
    print("hessian        make s  iterations  solve ms  ms an iteration       cost  status")
    each = {}
    for hessian in ("gauss-newton", "exact"):
        made, solutions = run(hessian, intervals)
        ms = 1e3 * statistics.median(s.seconds for s in solutions)
        last = solutions[-1]
        each[hessian] = ms / last.iterations
        print(
            f"{hessian:13s} {made:7.2f} {last.iterations:11d} {ms:9.0f} {each[hessian]:16.1f}"
            f" {last.cost:10.6f}  {last.status}"
        )
    ratio = each["exact"] / each["gauss-newton"]
    print(f"an exact iteration costs {ratio:.0f} times a Gauss-Newton one")


if __name__ == "__main__":
    main()
