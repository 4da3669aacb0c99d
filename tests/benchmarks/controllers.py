"""Solvers of the tracking problem: step times, closed-loop costs, growth, time to build.

    python -m tests.benchmarks.controllers [--quick] [--real-time]

The arm follows a circle of 8 cm, 4 s a lap, for its plant integrated by IDAS. Every row is a
process of its own; times are those of whole controller steps, Python included: wall time, and
processor time, which other work on the machine does not change so much. "Saturated" is the same
circle with the torque limited to less than it asks for, "too weak" to less than holds the arm up:
it falls. "Cold" is from the start of Python to a controller, nothing compiled before.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import time
from typing import Any

from tests.benchmarks.common import answer_of, arguments, key

CENTER, DIAMETER, LAP = (0.12, 0.0, 0.57), 0.08, 4.0
STEP, FIRST = 0.025, 3  # steps before FIRST are not counted in step times
FEW = 12  # steps of what takes a second each
FULL, SATURATED, WEAK = 2.5, 0.8, 0.7  # N·m, torque limits
SOLVERS = {"IPOPT": "ipopt", "Fatrop": "fatrop", "SQP": "sqp", "RTI": "real-time"}
FAST = (("SQP", "auto"), ("RTI", "auto"), ("blocked", "auto"))
ROWS = (*((name, "never") for name in SOLVERS), *FAST)  # and SOFTMPC_COMPILE
QUICK = (("IPOPT", "never"), ("RTI", "never"), *FAST[:2])
BEGAN = "SOFTMPC_BENCHMARK_BEGAN"  # when a process was started
BLOCKS = (1, 1, 2, 4, 12)  # intervals that share a move


def one(
    solver: str, segments: int, intervals: int, steps: int, top: float, **options: Any
) -> dict[str, Any]:
    """A closed loop in this process."""
    from softmpc.control.mpc import Mpc
    from softmpc.control.solvers import make_solver

    reference, model, start, transcription = setting(segments, intervals, top)
    controller = Mpc(transcription, make_solver(solver, transcription, **options))
    cold = time.time() - float(os.environ[BEGAN]), sum(os.times()[:4])
    return run(controller, reference, model, start, steps, top) | {"cold": cold}


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
    x, u, found = start.x, np.minimum(start.u, top), []
    ms, cpu, costs = [], [], []
    for k in range(steps):
        targets = reference.position(k * STEP + mpc.ocp.nodes)
        began, worked = time.perf_counter(), time.process_time()
        taken = mpc.step(x, u, targets)
        ms.append(1e3 * (time.perf_counter() - began))
        cpu.append(1e3 * (time.process_time() - worked))
        found.append(taken)
        x = plant.advance(x, taken.u, STEP, 1)[-1]
        decisions = t.decisions(u), t.decisions(taken.u)
        costs.append(float(stage(*decisions, x / t.x_scale, targets[0], 1.0)[0]))
        u = taken.u
    inputs = np.array([s.u for s in found])
    return {
        "ms": ms[FIRST:],
        "cpu": cpu[FIRST:],
        "largest": float(inputs.max()),
        "costs": np.cumsum(costs).tolist(),
        "iterations": float(np.mean([s.iterations for s in found[FIRST:]])),
        "failed": sum(not s.solved for s in found),
        "at_limit": float(np.mean((inputs > 0.999 * top).any(axis=1))),
    }


def measured(cache: str | None, mode: str = "never", **call: Any) -> dict[str, Any]:
    """The answer of a process of its own; without `cache` it finds nothing compiled before."""
    with tempfile.TemporaryDirectory() as empty:
        variables = {"SOFTMPC_COMPILE": mode, "SOFTMPC_CACHE": cache or empty}
        variables[BEGAN] = str(time.time())
        answer = answer_of("tests.benchmarks.controllers", "--one", call=call, variables=variables)
    return dict(answer)


def steps_of(cache: str, name: str, mode: str, top: float, steps: int) -> dict[str, Any]:
    """A row of the step times."""
    call: dict[str, Any] = {"solver": SOLVERS.get(name, "real-time"), "top": top}
    call |= {"blocks": BLOCKS} if name == "blocked" else {}
    call["steps"] = FEW if name in ("IPOPT", "Fatrop") else steps
    return measured(cache, mode, segments=1, intervals=20, **call)


def numbers(quick: bool) -> dict[str, float]:
    """Step times, costs over those of SQP, growth of real-time iteration with the horizon."""
    steps, found = FIRST + (12 if quick else 40), {}
    with tempfile.TemporaryDirectory() as cache:
        for top, word in ((FULL, "free"), (SATURATED, "saturated")):
            rows = {row: steps_of(cache, *row, top, steps) for row in (QUICK if quick else ROWS)}
            best = rows["SQP", "auto"]["costs"][FEW - 1]
            for (name, mode), one in rows.items():
                where = key(name, word, "" if mode == "auto" else "not compiled")
                found |= {f"{where}_{what}": value for what, value in told(one, best).items()}
        for intervals in (10, 40):
            call = {"solver": "real-time", "segments": 1, "intervals": intervals, "top": FULL}
            one = measured(cache, "auto", steps=steps, **call)
            found[f"rti_{intervals}_intervals_step_cpu_ms_median"] = middle(one["cpu"])
    cold = measured(None, "auto", solver="real-time", segments=1, intervals=20, steps=4, top=FULL)
    return found | {"rti_cold_start_s": cold["cold"][0], "rti_cold_start_cpu_s": cold["cold"][1]}


def told(one: dict[str, Any], best: float) -> dict[str, float]:
    """Numbers of a row; costs are those of the first steps, over the best one's."""
    return {
        "step_ms_median": middle(one["ms"]),
        "step_cpu_ms_median": middle(one["cpu"]),
        "iterations": one["iterations"],
        "cost_over_sqp": one["costs"][FEW - 1] / best,
        "failed_count": one["failed"],
    }


def percentiles(ms: list[float]) -> str:
    import numpy as np

    return "  ".join(f"{value:8.1f}" for value in np.percentile(ms, [50, 95, 100]))


def step_times(cache: str, steps: int, alone: bool) -> None:
    print(f"\nStep times, N = 20, 2 × 1 segments, {steps} steps, {FEW} of IPOPT and Fatrop "
          "(ms: median, 95 %, 100 %)")  # fmt: skip
    print("solver   compiled  torque          50 %      95 %     100 %   CPU 50 %  iterations  "
          "cost/IPOPT  at limit  failed")  # fmt: skip
    compiled = ""
    for top, word in ((FULL, "free"), (SATURATED, "saturated"), (WEAK, "too weak")):
        best: list[float] = []
        for name, mode in ROWS if top > WEAK else ROWS[3:]:
            if alone and name not in ("RTI", "blocked"):
                continue
            found = steps_of(cache, name, mode, top, steps)
            best = best or found["costs"]
            shown = top > WEAK and not alone  # there is an IPOPT to compare with
            ratio = f"{found['costs'][FEW - 1] / best[FEW - 1]:.4f}" if shown else ""
            print(row(name, mode, word, found, ratio), flush=True)
            if alone and mode == "auto" and not compiled:
                compiled = "until it was ready {:.1f} s, {:.1f} s of processor time".format(
                    *found["cold"]
                )
    if compiled:
        print(f"The first compiled one started cold: {compiled}")


def row(name: str, mode: str, word: str, found: dict[str, Any], ratio: str) -> str:
    return (
        f"{name:7}  {'yes' if mode == 'auto' else 'no':8}  {word:9}  "
        f"{percentiles(found['ms'])}  {middle(found['cpu']):9.1f}  {found['iterations']:10.1f}  "
        f"{ratio:>10}  {found['at_limit']:8.2f}  {found['failed']:6d}"
    )


def closed_loop(cache: str, steps: int) -> None:
    print(f"\nClosed-loop cost, {steps} steps: real-time iteration over SQP to convergence")
    for top, word in ((FULL, "free"), (SATURATED, "saturated")):
        call = {"segments": 1, "intervals": 20, "steps": steps, "top": top}
        both = (measured(cache, "auto", solver=name, **call) for name in ("real-time", "sqp"))
        rti, sqp = (found["costs"][-1] for found in both)
        print(f"{word:9}  {rti:.6g} / {sqp:.6g} = {rti / sqp:.5f}", flush=True)


def growth(steps: int, quick: bool) -> None:
    print("\nGrowth (medians of processor time): ms a step of RTI, ms an iteration of the "
          "others; RTI* is compiled,\nand so cold starts")  # fmt: skip
    print("segments   N       RTI      RTI*     IPOPT    Fatrop   cold s  cold CPU s")
    sizes = [(1, 10), (1, 20), (1, 40), (2, 20), (4, 20)]
    found: dict[tuple[int, int], list[float]] = {}
    for size in sizes[:3] if quick else sizes:
        call = {"segments": size[0], "intervals": size[1], "top": FULL}
        rti = measured(None, solver="real-time", steps=steps, **call)
        fast = measured(None, "auto", solver="real-time", steps=steps, **call)
        values = [middle(rti["cpu"]), middle(fast["cpu"])]
        for name in ("ipopt", "fatrop"):
            each = measured(None, solver=name, steps=FIRST + 2, **call)
            values.append(middle(each["cpu"]) / each["iterations"])
        found[size] = values
        times = "  ".join(f"{value:8.2f}" for value in values)
        print(f"{size[0]:8d}  {size[1]:2d}  {times}  {fast['cold'][0]:7.1f}  "
              f"{fast['cold'][1]:10.1f}", flush=True)  # fmt: skip
    for word, chosen in (("N", sizes[:3]), ("segments", [sizes[1], *sizes[3:]])):
        if all(size in found for size in chosen):
            print(f"grow with {word:8} to the power of  {exponents(chosen, found)}")


def exponents(sizes: list[tuple[int, int]], found: dict[tuple[int, int], list[float]]) -> str:
    """Slopes of the lines through logarithms of times over those of sizes, by least squares."""
    import numpy as np

    times = np.log([found[size] for size in sizes])
    slopes = np.polyfit(np.log([a * b for a, b in sizes]), times, 1)[0]
    names = ("RTI", "RTI*", "IPOPT", "Fatrop")
    return "  ".join(f"{name} {slope:.2f}" for name, slope in zip(names, slopes, strict=True))


def middle(ms: list[float]) -> float:
    return sorted(ms)[len(ms) // 2]


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--quick", action="store_true", help="fewer steps and sizes")
    parser.add_argument("--real-time", action="store_true", help="step times of nothing else")
    parser.add_argument("--one", action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.one:
        print(json.dumps(one(**json.load(sys.stdin))))
        return
    print(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}")
    with tempfile.TemporaryDirectory() as cache:
        if not given.real_time:
            closed_loop(cache, 40 if given.quick else 160)
        step_times(cache, 12 if given.quick else 40, given.real_time)
    if not given.real_time:
        growth(12 if given.quick else 40, given.quick)


if __name__ == "__main__":
    main()
