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
import json
import os
import sys
import tempfile
import time
import warnings
from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

from softmpc.accuracy.timing import memory_mib
from softmpc.compiler import compiler
from tests.benchmarks.common import answer_of, arguments, key, need_or_exit, need_package
from tests.benchmarks.same_problem import FULL, INTERVALS, STEP, Ours, Problem, Theirs, make

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
QUICK = ("do-mpc, our step, tuned", "softmpc, RTI", "softmpc, SQP, compiled",
         "softmpc, RTI, compiled")  # fmt: skip
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
    answer = {
        "build": build,
        "ms": ms[1:],
        "cpu": cpu[1:],
        "inputs": inputs,
        "peak": memory_mib() or np.nan,
    }
    if kind != "real-time":
        answer["costs"] = {
            name: controller.cost(np.array(x), np.array(u), now)
            for name, (x, u, now) in singles.items()
        }
    return answer


def measured(kind: str, mode: str, steps: list[Any], singles: dict[str, Any]) -> Answer:
    """The answer of a process of its own, which finds nothing compiled before."""
    with tempfile.TemporaryDirectory() as cache:
        variables = {"SOFTMPC_COMPILE": mode, "SOFTMPC_CACHE": cache}
        call = {"kind": kind, "steps": steps, "singles": singles}
        return dict(answer_of("tests.benchmarks.peer_mpc", "--one", call=call, variables=variables))


def rows_of(names: Sequence[str]) -> tuple[dict[str, Answer], dict[str, Any]]:
    """What each row found, and the single states; compiled ones only with a compiler."""
    os.environ["SOFTMPC_COMPILE"] = "never"  # in this process, where nothing is timed
    warnings.simplefilter("ignore", FutureWarning)  # of CasADi, on how do-mpc uses NumPy
    problem = Problem()
    longest = max(ROWS[name][2] for name in names)
    moving = loop(problem, max(AT + longest, 81))  # `single` takes the state at 80, too
    singles, found = single(problem, moving), {}
    for name in names:
        kind, mode, steps = ROWS[name]
        if mode == "never" or compiler() is not None:
            print(f"measuring {name}", file=sys.stderr, flush=True)
            found[name] = measured(kind, mode, moving[AT : AT + steps], singles)
        else:
            print(f"{name}: left out, no C compiler", file=sys.stderr)
    return found, singles


def numbers(quick: bool) -> dict[str, float]:
    """Step times, and those of do-mpc over ours; without the slow rows in quick mode."""
    need_package("do_mpc", "do-mpc")
    rows, _ = rows_of(QUICK if quick else list(ROWS))
    peers = [name for name in rows if name.startswith("do-mpc")]
    found: dict[str, float] = {}
    for name, row in rows.items():
        found[key(name, "step_cpu_ms_median")] = float(np.median(row["cpu"]))
        found[key(name, "build_s")] = row["build"]
        found[key(name, "input off share")] = off(row, rows)
        for peer in peers if name not in peers else ():
            theirs, ours = (np.median(rows[which]["cpu"]) for which in (peer, name))
            found[key(name, "time ratio", peer, "to ours")] = float(theirs / ours)
    best = rows["softmpc, SQP, compiled" if "softmpc, SQP, compiled" in rows else "softmpc, SQP"]
    for peer in peers:
        apart = [abs(rows[peer]["costs"][name] / cost - 1) for name, cost in best["costs"].items()]
        found[key(peer, "cost apart share")] = max(apart)
    return found


def off(row: Answer, rows: dict[str, Answer]) -> float:
    """Largest difference of an input from that of SQP, a share of full torque."""
    optimum = next(np.array(one["inputs"]) for name, one in rows.items() if "SQP" in name)
    inputs = np.array(row["inputs"])
    count = min(len(inputs), len(optimum))
    return float(np.abs(inputs[:count] - optimum[:count]).max() / FULL)


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
    print("\nStep times (medians), largest difference of the input from that of SQP (% of full "
          f"torque), time to build, memory\n{'':24}  steps    wall ms     CPU ms  input %  "
          "build s  peak MB")  # fmt: skip
    for name, row in found.items():
        print(f"{name:24}  {len(row['ms']):5d}  {np.median(row['ms']):9.2f}  "
              f"{np.median(row['cpu']):9.2f}  {100 * off(row, found):7.4f}  {row['build']:7.1f}  "
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
    os.environ["SOFTMPC_COMPILE"] = "never"
    warnings.simplefilter("ignore", FutureWarning)
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
    parser = arguments(__doc__)
    parser.add_argument("--refine", action="store_true", help="only more points an interval")
    parser.add_argument("--one", action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.one:
        print(json.dumps(one(**json.load(sys.stdin))))
        return
    need_or_exit("do_mpc", "do-mpc")
    if given.refine:
        refine()
        return
    sys.exit(0 if report() else 1)


def report() -> bool:
    """Measure and print; whether both solve the same problem."""
    from importlib.metadata import version

    print(f"do-mpc {version('do-mpc')}, CasADi {version('casadi')}, IPOPT with MUMPS; one thread, "
          f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}; N = {INTERVALS}, "
          f"{1e3 * STEP:g} ms")  # fmt: skip
    found, singles = rows_of(list(ROWS))
    fine = Ours(Problem(stages=EXACT), "sqp")
    exact = {name: fine.cost(np.array(x), np.array(u), t) for name, (x, u, t) in singles.items()}
    same = same_problem(found, exact)
    times(found)
    return same


if __name__ == "__main__":
    main()
