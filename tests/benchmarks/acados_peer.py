"""acados (SQP_RTI, HPIPM) on recorded states; runs in the environment that has acados.

    python -m tests.benchmarks.acados_peer < CALL

CALL is JSON: the folder of `acados_task.write_task`, names of recorded states in it, options of the
solver, a folder to build it in, rounds. With no rounds it is built and asked for the optimum at
some of the states; else the built one is timed. The last line printed is JSON, with a part for each
name.
"""

from __future__ import annotations

import json
import os
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from tests.benchmarks.acados_model import Task, make_ocp

CONVERGED = 10  # iterations at one state until nothing changes
EVERY = 20  # states of which one is converged at
FIRST = 3  # steps of a round that are not timed
TIMES = ("tot", "lin", "sim", "sim_ad", "sim_la", "qp", "qp_solver_call", "qp_xcond")

Array = np.ndarray


class Peer:
    """A solver and the states that it is given."""

    def __init__(self, task: Task, solver: Any, states: dict[str, Array]) -> None:
        self.task, self.solver, self.states = task, solver, states

    def ask(self, k: int) -> None:
        """State k, the input before it, and references from there on."""
        task, solver = self.task, self.solver
        aims = self.states["given"][k] / task.by_tip
        for i in range(1, task.N + 1):
            name = "" if i < task.N else "_e"
            aim = np.array(getattr(solver.acados_ocp.cost, f"yref{name}"))
            aim[:3] = aims[i - 1]
            solver.set(i, "yref", aim)
        self.x = np.concatenate([
            self.states["x"][k] / task.x_scale, self.states["u_before"][k] / task.u_scale
        ])  # fmt: skip
        for name in ("lbx", "ubx", "x"):
            solver.set(0, name, self.x)

    def rest(self) -> None:
        """Begin with the arm staying where it is."""
        for i in range(self.task.N + 1):
            self.solver.set(i, "x", self.x)
        for i in range(self.task.N):
            self.solver.set(i, "u", np.append(self.x[self.task.nx :], 0.0))

    def shift(self) -> None:
        """Begin with the last solution, an interval later."""
        get, put, N = self.solver.get, self.solver.set, self.task.N
        x, u = [get(i, "x") for i in range(N + 1)], [get(i, "u") for i in range(N)]
        for i in range(N):
            put(i, "x", x[i + 1])
            put(i, "u", u[min(i + 1, N - 1)])

    def solve(self) -> tuple[bool, list[float]]:
        """One iteration: whether its program was solved, and wall and processor time (ms)."""
        began, worked = time.perf_counter(), time.thread_time()
        status = self.solver.solve()
        return status == 0, [1e3 * (time.perf_counter() - began),
                             1e3 * (time.thread_time() - worked)]  # fmt: skip

    @property
    def u(self) -> Array:
        return np.asarray(self.solver.get(0, "u")[: self.task.inputs] * self.task.u_scale)

    def converged(self) -> dict[str, Any]:
        """Inputs of the optimum at some of the states."""
        at = list(range(FIRST, len(self.states["x"]), EVERY))
        inputs = []
        for k in at:
            self.ask(k)
            self.rest()
            for _ in range(CONVERGED):
                self.solve()
            inputs.append(self.u.tolist())
        return {"at": at, "inputs": inputs}

    def round(self) -> dict[str, Any]:
        """One iteration at each state, from the last one's solution."""
        rows, inputs, failed = [], [], 0
        for k in range(len(self.states["x"])):
            self.ask(k) if k == 0 else self.shift()
            self.rest() if k == 0 else self.ask(k)
            solved, times = self.solve()
            inner = [1e3 * float(self.solver.get_stats(f"time_{name}")[0]) for name in TIMES]
            rows.append([*times, *inner, float(np.sum(self.solver.get_stats("qp_iter")))])
            inputs.append(self.u.tolist())
            failed += not solved
        return {"rows": rows[FIRST:], "inputs": inputs[FIRST:], "failed": failed}


def solver_in(folder: Path, task: Task, options: dict[str, Any], build: bool) -> Any:
    """The solver of a problem; generated and compiled in a folder, or what was built there."""
    from acados.acados_template import AcadosOcpSolver

    os.chdir(folder)  # acados writes beside
    ocp = make_ocp(task, folder, options)
    file = str(folder / "ocp.json")
    solver = AcadosOcpSolver(ocp, file, build=build, generate=build, verbose=False)
    return solver


def main() -> None:
    call = json.loads(sys.stdin.read())
    folder, built, answers = Path(call["folder"]), Path(call["built"]), {}
    task = Task(folder)
    solver = solver_in(built, task, call["options"], call["rounds"] == 0)
    for name in call["states"]:
        peer = Peer(task, solver, dict(np.load(folder / f"{name}.npz")))
        rounds = [peer.round() for _ in range(call["rounds"])]
        answers[name] = {
            "rows": [row for each in rounds for row in each["rows"]],
            "inputs": [row for each in rounds for row in each["inputs"]],
            "failed": sum(each["failed"] for each in rounds),
            "optimum": {} if rounds else peer.converged(),
        }
    print(json.dumps(answers))


if __name__ == "__main__":
    main()
