"""All controllers of `c_controller` on the same recorded states, by turns."""

from __future__ import annotations

import importlib.util
import os
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from softmpc.codegen.generate import generate
from softmpc.control.mpc import Mpc
from softmpc.control.solvers import make_solver
from softmpc.control.transcription import Transcription
from tests.benchmarks.acados_environment import AcadosFailed, run_peer
from tests.benchmarks.acados_task import write_task
from tests.benchmarks.c_controller_peers import FIRST as UNTIMED
from tests.benchmarks.c_controller_peers import PEERS
from tests.benchmarks.c_controller_peers import run_peer as run_python
from tests.benchmarks.c_controller_program import Program, Timed
from tests.benchmarks.c_controller_states import Recorded, record

__all__ = ["BUILDS", "CC", "FEW_ROUNDS", "FINE", "INSIDE", "SCENES", "Bench", "Extent", "Row",
           "refined"]  # fmt: skip

SCENES = {"unsaturated": "figure_eight", "saturated": "circle_edge"}
# How each is compiled: what `make` is told in our directory, and flags for acados's generated code.
BUILDS = {"default": ((), "-O2"), "-march=native": (("ARCH=-march=native",), "-O3 -march=native")}
CC = os.environ.get("CC", "gcc")
PEER = "tests.benchmarks.acados_peer"
ROUNDS = 6
FEW_ROUNDS = 2
OURS_ROUNDS = 3  # rounds of ours in each of them
FINE = 5  # stages
TOLERANCE = {f"qp_solver_tol_{kind}": 1e-6 for kind in ("stat", "eq", "ineq", "comp")}
HPIPM = {"qp_solver": "PARTIAL_CONDENSING_HPIPM", **TOLERANCE}
VARIANTS: tuple[tuple[str, dict[str, Any]], ...] = (
    ("acados, GNSF", HPIPM
    | {"integrator_type": "GNSF", "sim_method_newton_iter": 1, "qp_solver_cond_N": 4,
       "qp_solver_cond_ric_alg": 0, "hpipm_mode": "SPEED_ABS"}),
    ("acados, IRK", HPIPM | {"integrator_type": "IRK", "qp_solver_cond_N": 20}),
)  # fmt: skip
INSIDE = ("functions", "algebra", "integrator", "costs", "condensing", "HPIPM")


Array = np.ndarray


@dataclass(frozen=True)
class Extent:
    """How much is measured: rounds of the states, scenes, the first builds and variants."""

    rounds: int = ROUNDS
    scenes: tuple[str, ...] = tuple(SCENES)
    builds: int = len(BUILDS)
    variants: int = len(VARIANTS)


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


class Bench:
    """All controllers on the states of some scenes; what they need is in `folder`."""

    def __init__(self, folder: Path, extent: Extent) -> None:
        self.folder, self.extent, self.rounds = folder, extent, extent.rounds
        self.recorded = {word: record(SCENES[word]) for word in extent.scenes}
        self.programs: dict[tuple[str, str], Program] = {}
        self.timed: dict[tuple[str, str], list[Timed]] = {}
        self.built: dict[tuple[str, str], dict[str, Any]] = {}  # calls of the variants of acados
        self.optima: dict[str, Any] = {}
        self.answers: dict[tuple[str, str], list[dict[str, Any]]] = {}
        self.rows: dict[str, list[Row]] = {word: [] for word in extent.scenes}
        for each in self.recorded.values():
            each.save(folder)
            write_task(each.setup.controller.transcription, folder)

    def measure(self) -> None:
        """All of it, one stage after the other."""
        for stage in (self.build, self.take_turns, self.gather, self.python):
            print(f"measuring: {stage.__name__}", file=sys.stderr, flush=True)
            stage()

    @property
    def builds(self) -> list[tuple[str, tuple[tuple[str, ...], str]]]:
        return [*BUILDS.items()][: self.extent.builds]

    def build(self) -> None:
        for word, each in self.recorded.items():
            for flags, (ours, _) in self.builds:
                folder = self.folder / f"{word}{flags}"
                generate(each.setup, folder)
                self.programs[word, flags] = Program(folder, each, CC, ours)
        for name, options in VARIANTS[: self.extent.variants]:
            for flags, (_, theirs) in self.builds:
                built = self.folder / f"{name}{flags}".replace(" ", "_")
                built.mkdir()
                call = {"folder": str(self.folder), "rounds": 0}
                call["states"] = [each.name for each in self.recorded.values()]
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
                self.timed.setdefault(key, []).append(program.run(OURS_ROUNDS))
            for other, call in self.built.items():
                self.answers.setdefault(other, []).append(run_peer(PEER, call))

    def gather(self) -> None:
        for word, each in self.recorded.items():
            optimum = each.arrays["optimum"]
            for flags, _ in self.builds:
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
