"""The controller in C beside those in Python, IPOPT, do-mpc and acados: step times on one problem.

    python -m tests.benchmarks.c_controller [--quick]

Two tables: a path whose torques and pressures stay within their limits, and one partly out of
reach, where they are at them most of the time. The states are those of a closed loop with real-time
iteration and IDAS as the plant, recorded once; everybody is given the same ones, one after the
other, with one thread. Times are processor times of the thread for a whole step, prepare and
feedback together; `wall` is by the clock on the wall, which other work on the machine lengthens.
`off` is how far inputs are from those of the optimum (SQP to 1e-8). `ratio` is our C over the row,
of the same build.

The parts of a step in C are timed in a second program, whose clocks cost a little. Instructions
are counted by Valgrind, which makes them the same in every run.

acados (SQP_RTI with HPIPM) is given our residual and Jacobian, horizon, costs, limits (torque hard,
one slack an interval for all pressures) and tolerance. `GNSF` is the best that was found of it:
linear parts of the model as constant matrices, one Newton iteration, four blocks of partial
condensing. `IRK` is how one would write it first: derivatives by CasADi, no condensing. Shifting
its last solution and telling it references are not counted. See `acados_model` for the formulation
and `acados_task` for what is not quite the same. Builds: `default` is ours as its Makefile makes it
and acados with its -O2, `-march=native` both for this machine; its BLASFEO has AVX2 in either.

do-mpc solves by IPOPT with the exact Hessian. What is not installed is left out, with a line.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from tests.benchmarks.acados_environment import WHEEL
from tests.benchmarks.c_controller_bench import (
    BUILDS,
    CC,
    FEW_ROUNDS,
    FINE,
    INSIDE,
    SCENES,
    Bench,
    Extent,
    Row,
    refined,
)
from tests.benchmarks.c_controller_program import PARTS
from tests.benchmarks.common import LeftOut, arguments, key

MOST_MEDIAN, MOST_TAIL, MOST_RATIO = 1.0, 2.0, 1 / 3  # ms, ms, of acados
OURS = "softmpc in C"
FEW_STEPS = 20  # under Valgrind, in quick mode
MANY = 100  # steps of which the slowest ones say something


def times(bench: Bench, word: str) -> None:
    recorded, rows = bench.recorded[word], bench.rows[word]
    ours = {row.flags: float(np.median(row.cpu)) for row in rows if row.name == OURS}
    print(f"\n{word}: {recorded.name}, a torque or pressure at its limit in "
          f"{100 * recorded.limited:.0f} % of the steps; ms, off in mN·m\n{'':26}{'build':18}"
          "  steps   median    99.9 %      wall  off median      max   ratio")  # fmt: skip
    for row in rows:
        median, tail = np.percentile(row.cpu, [50, 99.9])
        far = 1e3 * np.array([np.median(row.off), row.off.max()])
        print(f"{row.name:26}{row.flags:18}  {len(row.cpu):5d}  {median:7.3f}  {tail:8.3f}  "
              f"{np.median(row.wall):8.3f}  {far[0]:10.4f}  {far[1]:7.4f}  "
              f"{ours[row.flags or 'default'] / median:6.3f}")  # fmt: skip


def parts(bench: Bench, word: str) -> None:
    print(f"\nA step in C, {word}: µs (medians; `rest` of the means), iterations of the quadratic "
          f"program\n{'build':18}" + "".join(f"{part:>11}" for part in (*PARTS, "rest", "all"))
          + "  iterations   most  active, most")  # fmt: skip
    for (of, flags), program in bench.programs.items():
        if of != word:
            continue
        t = program.run(bench.rounds, split=True)
        rest = float(np.mean(t.us - t.parts.sum(axis=1)))
        cells = [*np.median(t.parts, axis=0), rest, float(np.median(t.us))]
        print(f"{flags:18}" + "".join(f"{cell:11.1f}" for cell in cells)
              + f"  {np.median(t.iterations):10.0f}  {t.iterations.max():5.0f}"
              f"  {t.active.max():12.0f}")  # fmt: skip
        count = program.instructions() if flags == "default" else None
        if count is not None:
            rest = 2 * count["all"] - sum(count.values())
            cells = [*(count[part] for part in PARTS), rest, count["all"]]
            print(f"{'  instructions':18}" + "".join(f"{cell:11,.0f}" for cell in cells))


def inner(bench: Bench, word: str) -> None:
    """Where acados's time goes, by its own clocks."""
    print(f"\nA step of acados, {word}: µs (medians, by its clocks)\n{'':44}"
          + "".join(f"{part:>11}" for part in (*INSIDE, "rest")) + "  iterations")  # fmt: skip
    for name, flags in bench.answers:
        *cells, iterations = bench.inner(word, name, flags)
        print(f"{name:26}{flags:18}" + "".join(f"{1e3 * cell:11.1f}" for cell in cells)
              + f"  {iterations:10.0f}")  # fmt: skip


def same_problem(bench: Bench) -> None:
    """Whether acados has the same optimum, beside what a finer discretisation changes."""
    for word, recorded in bench.recorded.items():
        away = None
        for name, answers in bench.optima.items():
            found = answers[recorded.name]["optimum"]
            at = found["at"]
            apart = np.abs(np.array(found["inputs"]) - recorded.arrays["optimum"][at]).max()
            away = refined(recorded, at) if away is None else away
            print(f"{word}, {name}: inputs of its optimum within {1e3 * apart:.2f} mN·m of ours at "
                  f"{len(at)} states; {FINE} stages are {1e3 * away:.2f} away")  # fmt: skip


def judge(bench: Bench) -> None:
    """Targets and what was measured."""
    for word, rows in bench.rows.items():
        c = next(row for row in rows if row.name == OURS and row.flags == "default")
        median, tail = float(np.median(c.cpu)), float(np.percentile(c.cpu, 99.9))
        if word == "unsaturated":
            verdict(f"{word}, default, median (ms)", median, MOST_MEDIAN)
            verdict(f"{word}, default, 99.9 % (ms)", tail, MOST_TAIL)
        for flags in BUILDS:
            mine, best = (
                min((float(np.median(row.cpu)) for row in rows
                     if row.name.startswith(who) and row.flags == flags), default=np.nan)
                for who in (OURS, "acados")
            )  # fmt: skip
            verdict(f"{word}, {flags}, of the best acados", mine / best, MOST_RATIO)
    most = max(float(one.off.max()) for timed in bench.timed.values() for one in timed)
    print(f"largest difference of an input in C from the one in Python: {most:.1e} N·m")


def verdict(what: str, value: float, most: float) -> None:
    print(f"{what}: {value:.3f}, at most {most:.3f}: {'met' if value <= most else 'MISSED'}")


NEEDS = f"needs make and a C compiler; {CC!r} (CC) is the one that was looked for"


def tools() -> bool:
    return shutil.which(CC) is not None and shutil.which("make") is not None


def numbers(quick: bool) -> dict[str, float]:
    """Step times, those of others over ours of the same build, instructions.

    In quick mode the path within limits alone, two rounds, one build, the best variant of acados.
    """
    if not tools():
        raise LeftOut(NEEDS)
    found: dict[str, float] = {}
    extent = Extent(FEW_ROUNDS, ("unsaturated",), builds=1, variants=1) if quick else Extent()
    with tempfile.TemporaryDirectory() as folder:
        bench = Bench(Path(folder), extent)
        bench.measure()
        for word, rows in bench.rows.items():
            found |= {key(word, name): value for name, value in told(rows).items()}
            program = bench.programs[word, "default"]
            count = program.instructions(FEW_STEPS if quick else None)
            for part, value in (count or {}).items():
                found[key(word, part, "machine instructions")] = round(value)
        for timed in bench.timed.values():
            most = max(float(one.off.max()) for one in timed)
            found["input_off_python_nm"] = max(most, found.get("input_off_python_nm", 0.0))
    return found


def told(rows: list[Row]) -> dict[str, float]:
    """Numbers of one path; processor times."""
    found: dict[str, float] = {}
    ours = {row.flags: float(np.median(row.cpu)) for row in rows if row.name == OURS}
    for row in rows:
        name = key(row.name.partition(" (")[0], "" if row.flags == "default" else row.flags)
        median, tail = np.percentile(row.cpu, [50, 99.9])
        found[f"{name}_step_cpu_ms_median"] = median
        if len(row.cpu) >= MANY:
            found[f"{name}_step_cpu_ms_99_9"] = tail
        found[f"{name}_input_off_mnm_most"] = 1e3 * float(row.off.max())
        if row.name != OURS:
            found[f"{name}_time_ratio_to_ours"] = median / ours[row.flags or "default"]
    return found


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--quick", action="store_true", help="two rounds of the states, not six")
    given = parser.parse_args()
    if not tools():
        sys.exit(NEEDS)
    said = subprocess.run([CC, "--version"], capture_output=True, text=True).stdout.splitlines()[0]
    print(f"{said}; {WHEEL}; {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}")
    with tempfile.TemporaryDirectory() as folder:
        bench = Bench(Path(folder), Extent(FEW_ROUNDS) if given.quick else Extent())
        bench.measure()
        for word in SCENES:
            times(bench, word)
            parts(bench, word)
            inner(bench, word)
        print()
        same_problem(bench)
        judge(bench)


if __name__ == "__main__":
    main()
