"""Solvers of the tracking problem: step times, closed-loop costs, growth, time to build.

    python -m tests.benchmarks.controllers [--quick]

The arm follows a circle of 8 cm, 4 s a lap, for its plant integrated by IDAS. Every row is a
process of its own with one thread; times are those of whole controller steps, Python included:
wall time, and processor time, which other work on the machine does not change so much.
"Saturated" is the same circle with the torque limited to less than it asks for.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from typing import Any

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
CENTER, DIAMETER, LAP = (0.12, 0.0, 0.57), 0.08, 4.0
STEP, FIRST = 0.025, 3  # steps before FIRST are not counted in step times
FULL, LOW = 2.5, 0.9  # N·m, torque limits: never reached, and reached
SOLVERS = {"IPOPT": "ipopt", "Fatrop": "fatrop", "SQP": "sqp", "RTI": "real-time"}


def one(solver: str, segments: int, intervals: int, steps: int, top: float) -> dict[str, Any]:
    """A closed loop in this process."""
    began = time.perf_counter()
    from softmpc.control.mpc import Mpc
    from softmpc.control.solvers import make_solver

    reference, model, start, transcription = setting(segments, intervals, top)
    built = time.perf_counter()
    controller = Mpc(transcription, make_solver(solver, transcription))
    build = time.perf_counter() - built
    return run(controller, reference, model, start, steps, top) | {
        "build": build, "ready": built + build - began
    }  # fmt: skip


def setting(segments: int, intervals: int, top: float) -> tuple[Any, ...]:
    from softmpc.control.closed_loop import start_at
    from softmpc.control.limits import PressureLimit, TorqueLimit
    from softmpc.control.ocp import PRESSURE_EXCESS, tracking_problem
    from softmpc.control.paths import Circle, Reference, TimeLaw
    from softmpc.control.transcription import Transcription
    from softmpc.model.model import build
    from softmpc.model.presets import chen2022
    from softmpc.model.scene import Scene
    from softmpc.statics.inverse import InverseStatics
    from softmpc.statics.targets import Position

    model = build(Scene(chen2022(), segments=segments))
    limits = (TorqueLimit(0, top), PressureLimit(0, 1e6, soft=PRESSURE_EXCESS))
    problem = tracking_problem(model, intervals, STEP, limits=limits)
    reference = Reference(Circle(CENTER, DIAMETER, (0.0, 0.0, 1.0)), TimeLaw(LAP, 2.0, 1.0))
    posture = InverseStatics(model).solve(Position(tuple(reference.position([0.0])[0]))).posture
    return reference, model, start_at(model, posture), Transcription(problem)


def run(mpc: Any, reference: Any, model: Any, start: Any, steps: int, top: float) -> dict[str, Any]:
    import numpy as np

    from softmpc.simulation.idas import Idas

    plant, t = Idas(model, 1e-8), mpc.transcription
    stage = t.objective.cost
    x, u, cost, found, ms = start.x, np.minimum(start.u, top), 0.0, [], []
    cpu = []
    for k in range(steps):
        targets = reference.position(k * STEP + mpc.ocp.nodes)
        began, worked = time.perf_counter(), time.process_time()
        taken = mpc.step(x, u, targets)
        ms.append(1e3 * (time.perf_counter() - began))
        cpu.append(1e3 * (time.process_time() - worked))
        found.append(taken)
        x = plant.advance(x, taken.u, STEP, 1)[-1]
        decisions = t.decisions(u), t.decisions(taken.u)
        cost += float(stage(*decisions, x / t.x_scale, targets[0], 1.0)[0])
        u = taken.u
    inputs = np.array([s.u for s in found])
    return {
        "ms": ms[FIRST:],
        "cpu": cpu[FIRST:],
        "largest": float(inputs.max()),
        "cost": cost,
        "iterations": float(np.mean([s.iterations for s in found[FIRST:]])),
        "failed": sum(not s.solved for s in found),
        "at_limit": float(np.mean((inputs > 0.999 * top).any(axis=1))),
    }


def measured(mode: str = "never", **call: Any) -> dict[str, Any]:
    """The answer of a process of its own, which finds nothing compiled before."""
    with tempfile.TemporaryDirectory() as cache:
        variables = {**os.environ, **dict.fromkeys(THREADS, "1")}
        variables |= {"SOFTMPC_COMPILE": mode, "SOFTMPC_CACHE": cache}
        command = [sys.executable, "-m", "tests.benchmarks.controllers", "--one", json.dumps(call)]
        done = subprocess.run(command, capture_output=True, text=True, env=variables)
    if done.returncode:
        sys.exit(f"{call} failed:\n{done.stderr}")
    answer: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return answer


def percentiles(ms: list[float]) -> str:
    import numpy as np

    return "  ".join(f"{value:8.1f}" for value in np.percentile(ms, [50, 95, 100]))


def step_times(steps: int) -> None:
    print(f"\nStep times, N = 20, 2 × 1 segments, {steps} steps (ms: median, 95 %, 100 %)")
    print("solver  compiled  torque       50 %      95 %     100 %   CPU 50 %  iterations  "
          "cost/IPOPT  at limit  failed  build s")  # fmt: skip
    for top, word in ((FULL, "free"), (LOW, "saturated")):
        rows = [(name, "never") for name in SOLVERS] + [("SQP", "auto"), ("RTI", "auto")]
        best = 0.0
        for name, mode in rows:
            found = measured(
                mode, solver=SOLVERS[name], segments=1, intervals=20, steps=steps, top=top
            )
            best = best or found["cost"]
            print(
                f"{name:6}  {'yes' if mode == 'auto' else 'no':8}  {word:9}  "
                f"{percentiles(found['ms'])}  {middle(found['cpu']):9.1f}  "
                f"{found['iterations']:10.1f}  "
                f"{found['cost'] / best:10.4f}  {found['at_limit']:8.2f}  "
                f"{found['failed']:6d}  "
                f"{found['build']:7.1f}",
                flush=True,
            )


def closed_loop(steps: int) -> None:
    print(f"\nClosed-loop cost, {steps} steps: real-time iteration over SQP to convergence")
    for top, word in ((FULL, "free"), (LOW, "saturated")):
        call = {"segments": 1, "intervals": 20, "steps": steps, "top": top}
        rti, sqp = (measured("auto", solver=name, **call) for name in ("real-time", "sqp"))
        print(f"{word:9}  {rti['cost']:.6g} / {sqp['cost']:.6g} = {rti['cost'] / sqp['cost']:.5f}",
              flush=True)  # fmt: skip


def growth(steps: int, quick: bool) -> None:
    print("\nGrowth (medians of processor time; ms a step of RTI, ms an iteration of the "
          "others), not compiled but for RTI*")  # fmt: skip
    print("segments   N       RTI      RTI*   build*   IPOPT    Fatrop")
    sizes = [(1, 10), (1, 20), (1, 40), (2, 20), (4, 20)]
    for segments, intervals in sizes[:3] if quick else sizes:
        call = {"segments": segments, "intervals": intervals, "steps": steps, "top": FULL}
        rti = measured(solver="real-time", **call)
        fast = measured("auto", solver="real-time", **call)
        each = []
        for name in ("ipopt", "fatrop"):
            found = measured(solver=name, **(call | {"steps": FIRST + 4}))
            each.append(middle(found["cpu"]) / found["iterations"])
        print(
            f"{segments:8d}  {intervals:2d}  {middle(rti['cpu']):8.2f}  "
            f"{middle(fast['cpu']):8.2f}  {fast['build']:7.1f}  {each[0]:6.1f}  {each[1]:8.1f}",
            flush=True,
        )


def middle(ms: list[float]) -> float:
    return sorted(ms)[len(ms) // 2]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true", help="fewer steps and sizes")
    parser.add_argument("--one", type=json.loads, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.one:
        print(json.dumps(one(**given.one)))
        return
    print(f"{os.cpu_count()} cores, one thread a process, load {os.getloadavg()[0]:.1f}")
    closed_loop(40 if given.quick else 160)
    step_times(12 if given.quick else 80)
    growth(12 if given.quick else 40, given.quick)


if __name__ == "__main__":
    main()
