"""One controller step beside do-mpc, on the same problem: `python -m tests.benchmarks.peer_mpc`.

Needs `pip install do-mpc`, which softmpc does not depend on; without it one line says so and the
exit status is 2. It is 1 where the two do not solve the same problem.

The arm follows a circle of 8 cm. Both packages get the same model (ours), costs, torque limits (and
no others), horizon and step. Every row is a process of its own with one thread, and gets the same
states, those of a closed loop with real-time iteration and IDAS as the plant.

do-mpc has three rows, see `same_problem`. It solves by IPOPT with the exact Hessian, here to a
tolerance of 1e-6, and starts from its last solution.

First come costs of the optimum from single states, without warm start. Ours with five stages an
interval instead of two tells where two are enough: there collocation has to agree to 1 %, our step
everywhere. After a jump, of the posture or of the torque, two are not enough in 25 ms. Then come
step times. `--refine` prints only how collocation and ours meet with more points an interval.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
import warnings
from typing import Any

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
for name in THREADS:
    os.environ.setdefault(name, "1")

import casadi as ca  # noqa: E402
import numpy as np  # noqa: E402

from tests.benchmarks.same_problem import (  # noqa: E402
    FULL,
    INTERVALS,
    STEP,
    Ours,
    Problem,
    Theirs,
    make,
)

AT = 40  # the loop's steps from AT on are timed; the first of them is left out
SAME = 0.01  # largest relative difference of costs
EXACT = 5  # stages
JUMP = "strains jumped by 0.01"  # of their scale
# Row -> what controls, SOFTMPC_COMPILE, steps.
ROWS = {
    "do-mpc, collocation": ("collocation", "never", 5),
    "do-mpc, our step": ("our step", "never", 5),
    "do-mpc, our step, tuned": ("tuned", "never", 11),
    "softmpc, SQP": ("sqp", "never", 41),
    "softmpc, RTI": ("real-time", "never", 41),
    "softmpc, SQP, compiled": ("sqp", "require", 41),
    "softmpc, RTI, compiled": ("real-time", "require", 41),
}
Answer = dict[str, Any]


# --- states --------------------------------------------------------------------------------------


def loop(problem: Problem, steps: int) -> list[tuple[list[float], list[float], float]]:
    """States, inputs before them and times of a closed loop."""
    from softmpc.simulation.idas import Idas

    plant, controller = Idas(problem.model, 1e-8), Ours(problem, "real-time")
    x, u, found = problem.start.x, problem.start.u, []
    for k in range(steps):
        found.append((x.tolist(), u.tolist(), k * STEP))
        u = controller.step(x, u, k * STEP)
        x = plant.advance(x, u, STEP, 1)[-1]
    return found


def single(problem: Problem, moving: list[Any]) -> dict[str, Any]:
    """States from which costs are compared: (x, input before, time) by name."""
    from softmpc.statics.equilibrium import find_equilibrium, pressures_from_torques

    model, start, t = problem.model, problem.start, problem.t
    found = {f"moving, {moving[k][2]:g} s": moving[k] for k in (40, 80)}
    for more in (0.02, 0.2):
        torque = np.minimum(start.u + more * np.eye(t.inputs)[0], FULL)
        q = find_equilibrium(model, pressures_from_torques(model, torque)).q
        x = np.concatenate([q, 0 * q, model.drive.at_rest(torque)])
        away = 1e3 * float(ca.norm_2(model.tip(q) - model.tip(start.x[: model.strains])))
        found[f"at rest {away:.0f} mm away"] = (x.tolist(), torque.tolist(), 0.0)
    x = start.x.copy()
    x[: model.strains] += 0.01 * t.x_scale[: model.strains]
    found[JUMP] = (x.tolist(), start.u.tolist(), 0.0)
    return {"at rest": (start.x.tolist(), start.u.tolist(), 0.0), **found}


# --- processes -----------------------------------------------------------------------------------


def one(kind: str, steps: list[Any], singles: dict[str, Any]) -> Answer:
    """A row in this process."""
    problem = Problem()
    began = time.perf_counter()
    controller = make(problem, kind)
    build, ms, cpu, inputs = time.perf_counter() - began, [], [], []
    for x, u, now in steps:
        state = np.array(x), np.array(u), now
        began, worked = time.perf_counter(), time.process_time()
        inputs.append(controller.step(*state).tolist())
        ms.append(1e3 * (time.perf_counter() - began))
        cpu.append(1e3 * (time.process_time() - worked))
    answer = {"build": build, "ms": ms[1:], "cpu": cpu[1:], "inputs": inputs, "peak": megabytes()}
    if kind != "real-time":
        answer["costs"] = {
            name: controller.cost(np.array(x), np.array(u), now)
            for name, (x, u, now) in singles.items()
        }
    return answer


def megabytes() -> float:
    """Largest memory of this process until now."""
    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 2**20


def measured(kind: str, mode: str, steps: list[Any], singles: dict[str, Any]) -> Answer:
    """The answer of a process of its own, which finds nothing compiled before."""
    with tempfile.TemporaryDirectory() as cache:
        variables = {**os.environ, **dict.fromkeys(THREADS, "1")}
        variables |= {"SOFTMPC_COMPILE": mode, "SOFTMPC_CACHE": cache, "PYTHONWARNINGS": "ignore"}
        call = json.dumps({"kind": kind, "steps": steps, "singles": singles})
        command = [sys.executable, "-m", "tests.benchmarks.peer_mpc", "--one"]
        done = subprocess.run(command, input=call, capture_output=True, text=True, env=variables)
    if done.returncode:
        sys.exit(f"{kind} failed:\n{done.stderr}")
    answer: Answer = json.loads(done.stdout.splitlines()[-1])
    return answer


# --- what is printed -----------------------------------------------------------------------------


def same_problem(found: dict[str, Answer], exact: dict[str, float]) -> bool:
    """Print costs; whether do-mpc's are ours within 1 %, collocated ones where 5 stages are too."""
    ours, columns = found["softmpc, SQP"]["costs"], list(ROWS)[:3]
    print(f"\nCost of the optimum, and how far from it others are (%)\n{'state':24}   softmpc  "
          f"{EXACT} stages  " + "  ".join(f"{c[8:]:>15}" for c in columns))  # fmt: skip
    same = True
    for name, cost in ours.items():
        apart = [found[c]["costs"][name] / cost - 1 for c in columns]
        refined = exact[name] / cost - 1
        print(f"{name:24}  {cost:8.4g}  {100 * refined:8.2f}  "
              + "  ".join(f"{100 * a:15.5f}" for a in apart))  # fmt: skip
        judged = apart if abs(refined) < SAME else apart[1:]
        same = same and all(abs(a) < SAME for a in judged)  # nan is not
    print("the same problem" if same else "NOT the same problem")
    return same


def times(found: dict[str, Answer]) -> None:
    optimum = np.array(found["softmpc, SQP"]["inputs"])
    print("\nStep times (medians), largest difference of the input from that of SQP (% of full "
          f"torque), time to build, memory\n{'':24}  steps    wall ms     CPU ms  input %  "
          "build s  peak MB")  # fmt: skip
    for name, row in found.items():
        inputs = np.array(row["inputs"])
        off = 100 * np.abs(inputs - optimum[: len(inputs)]).max() / FULL
        print(f"{name:24}  {len(row['ms']):5d}  {np.median(row['ms']):9.2f}  "
              f"{np.median(row['cpu']):9.2f}  {off:7.4f}  {row['build']:7.1f}  "
              f"{row['peak']:7.0f}")  # fmt: skip
    theirs, ours = list(ROWS)[:3], [name for name in found if name.startswith("softmpc")]
    print("\nRatio of step times, wall (CPU)\n" + " " * 24
          + "".join(f"{name[8:]:>18}" for name in theirs))  # fmt: skip
    for name in ours:
        ratios = [
            [np.median(found[peer][clock]) / np.median(found[name][clock])
             for clock in ("ms", "cpu")]
            for peer in theirs
        ]  # fmt: skip
        print(f"{name:24}" + "".join(f"{f'{w:.0f} ({c:.0f})':>18}" for w, c in ratios))


def refine() -> None:
    """A state that two points do not resolve, with more points."""
    first = Problem()
    x, u, now = first.start.x.copy(), first.start.u, 0.0
    x[: first.model.strains] += 0.01 * first.t.x_scale[: first.model.strains]
    print(
        f"Cost with more points an interval, {JUMP} of their scale\npoints   softmpc  collocation"
    )
    for points in (2, 3):  # with five do-mpc took more than 3 minutes
        problem = Problem(stages=points)
        ours = Ours(problem, "sqp").cost(x, u, now)
        theirs = Theirs(problem, "collocation", points).cost(x, u, now)
        print(f"{points:6}  {ours:8.5g}  {theirs:11.5g}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--refine", action="store_true", help="only more points an interval")
    parser.add_argument("--one", action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.one:
        print(json.dumps(one(**json.load(sys.stdin))))
        return
    if importlib.util.find_spec("do_mpc") is None:
        print("do-mpc is not installed: pip install do-mpc", file=sys.stderr)
        sys.exit(2)
    os.environ["SOFTMPC_COMPILE"] = "never"  # in this process, where nothing is timed
    warnings.simplefilter("ignore", FutureWarning)  # of CasADi, on how do-mpc uses NumPy
    if given.refine:
        refine()
        return
    sys.exit(0 if report() else 1)


def report() -> bool:
    """Measure and print; whether both solve the same problem."""
    from importlib.metadata import version

    from softmpc.compiler import compiler

    print(f"do-mpc {version('do-mpc')}, CasADi {version('casadi')}, IPOPT with MUMPS; one thread, "
          f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}; N = {INTERVALS}, "
          f"{1e3 * STEP:g} ms")  # fmt: skip
    problem = Problem()
    longest = max(steps for _, _, steps in ROWS.values())
    moving = loop(problem, AT + longest)
    singles, found = single(problem, moving), {}
    for name, (kind, mode, steps) in ROWS.items():
        if mode == "never" or compiler() is not None:
            print(f"measuring {name}", file=sys.stderr, flush=True)
            found[name] = measured(kind, mode, moving[AT : AT + steps], singles)
        else:
            print(f"{name}: left out, no C compiler", file=sys.stderr)
    fine = Ours(Problem(stages=EXACT), "sqp")
    exact = {name: fine.cost(np.array(x), np.array(u), t) for name, (x, u, t) in singles.items()}
    same = same_problem(found, exact)
    times(found)
    return same


if __name__ == "__main__":
    main()
