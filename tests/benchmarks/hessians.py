"""What the Hessian costs: Gauss-Newton against exact, the same problem with IPOPT.

python -m tests.benchmarks.hessians [--intervals 20]
"""

from __future__ import annotations

import statistics
import time
from typing import Any

import numpy as np

from softmpc.control.ipopt import Ipopt
from softmpc.control.ocp import tracking_problem
from softmpc.control.solver import Solution
from softmpc.control.transcription import Transcription
from softmpc.model.model import build
from softmpc.model.presets import chen2022
from softmpc.model.scene import Scene
from softmpc.statics.equilibrium import find_equilibrium, pressures_from_torques
from tests.benchmarks.common import arguments, key

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


def measured(intervals: int) -> dict[str, dict[str, Any]]:
    """By Hessian: seconds to make, and of the last of three solves iterations, cost, status."""
    found: dict[str, dict[str, Any]] = {}
    for hessian in ("gauss-newton", "exact"):
        made, solutions = run(hessian, intervals)
        ms, last = 1e3 * statistics.median(s.seconds for s in solutions), solutions[-1]
        found[hessian] = {"make_s": made, "iterations": last.iterations, "solve_ms": ms}
        found[hessian] |= {"iteration_ms": ms / last.iterations, "cost": last.cost}
        found[hessian] |= {"status": last.status}
    return found


def numbers(quick: bool) -> dict[str, float]:
    """Five intervals in quick mode, else 20."""
    both = measured(5 if quick else 20)
    found = {
        key(name, what): float(value)
        for name, each in both.items()
        for what, value in each.items()
        if what != "status"
    }
    ratio = found["exact_iteration_ms"] / found["gauss_newton_iteration_ms"]
    return found | {"iteration_time_ratio_exact_to_gauss_newton": ratio}


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--intervals", type=int, default=20)
    intervals = parser.parse_args().intervals
    print(f"{intervals} intervals, two sections × 1 segment, hydraulic drive; medians of 3 solves")
    print("hessian        make s  iterations  solve ms  ms an iteration       cost  status")
    each = measured(intervals)
    for hessian, found in each.items():
        print(
            f"{hessian:13s} {found['make_s']:7.2f} {found['iterations']:11d} "
            f"{found['solve_ms']:9.0f} {found['iteration_ms']:16.1f}"
            f" {found['cost']:10.6f}  {found['status']}"
        )
    ratio = each["exact"]["iteration_ms"] / each["gauss-newton"]["iteration_ms"]
    print(f"an exact iteration costs {ratio:.0f} times a Gauss-Newton one")


if __name__ == "__main__":
    main()
