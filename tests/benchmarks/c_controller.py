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

import argparse
import importlib.util
import os
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(name, "1")

import numpy as np  # noqa: E402

from softmpc.codegen.generate import generate  # noqa: E402
from softmpc.control.mpc import Mpc  # noqa: E402
from softmpc.control.solvers import make_solver  # noqa: E402
from softmpc.control.transcription import Transcription  # noqa: E402
from tests.benchmarks.acados_environment import WHEEL, AcadosFailed, run_peer  # noqa: E402
from tests.benchmarks.acados_task import write_task  # noqa: E402
from tests.benchmarks.c_controller_peers import FIRST as UNTIMED  # noqa: E402
from tests.benchmarks.c_controller_peers import PEERS  # noqa: E402
from tests.benchmarks.c_controller_peers import run_peer as run_python  # noqa: E402
from tests.benchmarks.c_controller_program import PARTS, Program, Timed  # noqa: E402
from tests.benchmarks.c_controller_states import Recorded, record  # noqa: E402

SCENES = {"unsaturated": "figure_eight", "saturated": "circle_edge"}
# How each is compiled: what `make` is told in our directory, and flags for acados's generated code.
BUILDS = {"default": ((), "-O2"), "-march=native": (("ARCH=-march=native",), "-O3 -march=native")}
CC = os.environ.get("CC", "gcc")
PEER = "tests.benchmarks.acados_peer"
ROUNDS = 6
OURS = 3  # rounds of ours in each of them
FINE = 5  # stages
MOST_MEDIAN, MOST_TAIL, MOST_RATIO = 1.0, 2.0, 1 / 3  # ms, ms, of acados
TOLERANCE = {f"qp_solver_tol_{kind}": 1e-6 for kind in ("stat", "eq", "ineq", "comp")}
HPIPM = {"qp_solver": "PARTIAL_CONDENSING_HPIPM", **TOLERANCE}
VARIANTS: dict[str, dict[str, Any]] = {
    "acados, GNSF": HPIPM
    | {"integrator_type": "GNSF", "sim_method_newton_iter": 1, "qp_solver_cond_N": 4,
       "qp_solver_cond_ric_alg": 0, "hpipm_mode": "SPEED_ABS"},
    "acados, IRK": HPIPM | {"integrator_type": "IRK", "qp_solver_cond_N": 20},
}  # fmt: skip
INSIDE = ("functions", "algebra", "integrator", "costs", "condensing", "HPIPM")

Array = np.ndarray


@dataclass(frozen=True)
class Row:
    """One controller: times of its steps (ms), and how far its inputs were off (N·m)."""

    name: str
    flags: str
    cpu: Array
    wall: Array
    off: Array


def off(inputs: Any, optimum: Array) -> Array:
    """Largest difference of an input from that of the optimum, in each of the first steps."""
    inputs = np.asarray(inputs)
    return np.asarray(np.abs(inputs - optimum[UNTIMED:][: len(inputs)]).max(axis=1))


# --- what is measured ----------------------------------------------------------------------------


class Bench:
    """All controllers on the states of all scenes; what they need is in `folder`."""

    def __init__(self, folder: Path, quick: bool) -> None:
        self.folder, self.rounds = folder, 2 if quick else ROUNDS
        self.recorded = {word: record(scene) for word, scene in SCENES.items()}
        self.programs: dict[tuple[str, str], Program] = {}
        self.timed: dict[tuple[str, str], list[Timed]] = {}
        self.built: dict[tuple[str, str], dict[str, Any]] = {}  # calls of the variants of acados
        self.optima: dict[str, Any] = {}
        self.answers: dict[tuple[str, str], list[dict[str, Any]]] = {}
        self.rows: dict[str, list[Row]] = {word: [] for word in SCENES}
        for each in self.recorded.values():
            each.save(folder)
            write_task(each.setup.controller.transcription, folder)

    def build(self) -> None:
        for word, each in self.recorded.items():
            for flags, (ours, _) in BUILDS.items():
                folder = self.folder / f"{word}{flags}"
                generate(each.setup, folder)
                self.programs[word, flags] = Program(folder, each, CC, ours)
        for name, options in VARIANTS.items():
            for flags, (_, theirs) in BUILDS.items():
                built = self.folder / f"{name}{flags}".replace(" ", "_")
                built.mkdir()
                call = {"folder": str(self.folder), "states": list(SCENES.values()), "rounds": 0}
                call["options"] = options | {"ext_fun_compile_flags": theirs}
                call["built"] = str(built)
                try:
                    self.optima[name] = run_peer(PEER, call)
                    self.built[name, flags] = call | {"rounds": 1}
                except AcadosFailed as error:
                    print(f"{name} is left out: {error}", file=sys.stderr)

    def take_turns(self) -> None:
        """Our C and acados in turn, so that both see the machine as busy as it is."""
        for _ in range(self.rounds):
            for key, program in self.programs.items():
                self.timed.setdefault(key, []).append(program.run(OURS))
            for other, call in self.built.items():
                self.answers.setdefault(other, []).append(run_peer(PEER, call))

    def gather(self) -> None:
        for word, each in self.recorded.items():
            optimum = each.arrays["optimum"]
            for flags in BUILDS:
                timed = self.timed[word, flags]
                cpu, wall = (1e-3 * np.concatenate([getattr(t, of) for t in timed])
                             for of in ("us", "wall"))  # fmt: skip
                far = off(timed[0].u[: len(optimum) - UNTIMED], optimum)
                self.rows[word].append(Row("softmpc in C", flags, cpu, wall, far))
            for (name, flags), answers in self.answers.items():
                found = [answer[each.name] for answer in answers]
                rows = np.concatenate([one["rows"] for one in found])
                failed = sum(one["failed"] for one in found)
                said = f"{name} ({failed} failed)" if failed else name
                far = off(found[0]["inputs"], optimum)
                self.rows[word].append(Row(said, flags, rows[:, 1], rows[:, 0], far))

    def inner(self, word: str, name: str, flags: str) -> Array:
        """Medians of where acados's time goes (ms), see INSIDE; iterations last."""
        found = [answer[SCENES[word]]["rows"] for answer in self.answers[name, flags]]
        total, lin, sim, ad, la, _, call, condensing, count = np.concatenate(found)[:, 2:].T
        rest = total - lin - condensing - call
        parts = [ad, la, sim - ad - la, lin - sim, condensing, call, rest]
        return np.asarray(np.median([*parts, count], axis=1))

    def python(self) -> None:
        for word, each in self.recorded.items():
            states = self.folder / f"{each.name}.npz"
            optimum = each.arrays["optimum"]
            for peer in PEERS:
                if PEERS[peer][0] is None and importlib.util.find_spec("do_mpc") is None:
                    print(f"{peer} is left out: pip install do-mpc", file=sys.stderr)
                    continue
                found = run_python(peer, each.name, states, len(optimum))
                wall, cpu = np.array(found["rows"]).T
                self.rows[word].append(Row(peer, "", cpu, wall, off(found["inputs"], optimum)))


def refined(recorded: Recorded, at: list[int]) -> float:
    """How far inputs of the optimum are from those with five stages an interval (N·m)."""
    arrays, fine = recorded.arrays, Transcription(recorded.setup.ocp, FINE)
    controller, most = Mpc(fine, make_solver("sqp", fine)), 0.0
    for k in at:
        controller.reset()
        u = controller.step(arrays["x"][k], arrays["u_before"][k], arrays["given"][k]).u
        most = max(most, float(np.abs(u - arrays["optimum"][k]).max()))
    return most


# --- what is printed -----------------------------------------------------------------------------


def times(bench: Bench, word: str) -> None:
    recorded, rows = bench.recorded[word], bench.rows[word]
    ours = {row.flags: float(np.median(row.cpu)) for row in rows if row.name == "softmpc in C"}
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
        c = next(row for row in rows if row.name == "softmpc in C" and row.flags == "default")
        median, tail = float(np.median(c.cpu)), float(np.percentile(c.cpu, 99.9))
        if word == "unsaturated":
            verdict(f"{word}, default, median (ms)", median, MOST_MEDIAN)
            verdict(f"{word}, default, 99.9 % (ms)", tail, MOST_TAIL)
        for flags in BUILDS:
            mine, best = (
                min((float(np.median(row.cpu)) for row in rows
                     if row.name.startswith(who) and row.flags == flags), default=np.nan)
                for who in ("softmpc in C", "acados")
            )  # fmt: skip
            verdict(f"{word}, {flags}, of the best acados", mine / best, MOST_RATIO)
    most = max(float(one.off.max()) for timed in bench.timed.values() for one in timed)
    print(f"largest difference of an input in C from the one in Python: {most:.1e} N·m")


def verdict(what: str, value: float, most: float) -> None:
    print(f"{what}: {value:.3f}, at most {most:.3f}: {'met' if value <= most else 'MISSED'}")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true", help="two rounds of the states, not six")
    given = parser.parse_args()
    if shutil.which(CC) is None or shutil.which("make") is None:
        sys.exit(f"needs make and a C compiler; {CC!r} (CC) is the one that was looked for")
    said = subprocess.run([CC, "--version"], capture_output=True, text=True).stdout.splitlines()[0]
    print(f"{said}; {WHEEL}; {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}")
    with tempfile.TemporaryDirectory() as folder:
        bench = Bench(Path(folder), given.quick)
        for stage in (bench.build, bench.take_turns, bench.gather, bench.python):
            print(f"measuring: {stage.__name__}", file=sys.stderr, flush=True)
            stage()
        for word in SCENES:
            times(bench, word)
            parts(bench, word)
            inner(bench, word)
        print()
        same_problem(bench)
        judge(bench)


if __name__ == "__main__":
    main()
