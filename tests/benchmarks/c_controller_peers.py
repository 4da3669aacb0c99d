"""Controllers in Python on recorded states, each in a process of its own.

    python -m tests.benchmarks.c_controller_peers < CALL

CALL is JSON: the controller, the scene, the file of its recorded states, how many of them.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from softmpc.control.mpc import Mpc
from softmpc.control.solvers import make_solver
from tests.benchmarks.c_controller_states import transcription_of
from tests.benchmarks.common import answer_of
from tests.benchmarks.same_problem import Problem, Theirs

FIRST = 3  # steps that are not timed
# Controller -> softmpc's solver (None: do-mpc's), steps after the first ones; None is all of them.
PEERS: dict[str, tuple[str | None, int | None]] = {
    "softmpc, Python RTI": ("real-time", None),
    "softmpc, IPOPT": ("ipopt", 12),
    "do-mpc, our step, tuned": (None, 5),
}


class Recorded(Problem):
    """The problem of a scene; its time is the number of the recorded state."""

    def __init__(self, scene: str, given: np.ndarray) -> None:
        self.t, self.given = transcription_of(scene), given
        self.model = self.t.model

    def targets(self, now: float) -> np.ndarray:
        rows = self.given[round(now)]
        return np.vstack([rows[:1], rows])


def one(peer: str, scene: str, states: str, steps: int) -> dict[str, Any]:
    """Times (ms) and inputs of a controller in this process."""
    arrays, solver = dict(np.load(states)), PEERS[peer][0]
    problem = Recorded(scene, arrays["given"])
    if solver is None:
        controller: Any = Theirs(problem, "tuned")
    else:
        controller = Mpc(problem.t, make_solver(solver, problem.t))
    rows, inputs = [], []
    for k in range(steps):
        x, u = arrays["x"][k], arrays["u_before"][k]
        began, worked = time.perf_counter(), time.thread_time()
        if solver is None:
            taken = controller.step(x, np.append(u, np.zeros(problem.t.nu - len(u))), k)
        else:
            taken = controller.step(x, u, arrays["given"][k]).u
        rows.append([1e3 * (time.perf_counter() - began), 1e3 * (time.thread_time() - worked)])
        inputs.append(taken[: problem.t.inputs].tolist())
    return {"rows": rows[FIRST:], "inputs": inputs[FIRST:]}


def run_peer(peer: str, scene: str, states: Path, most: int) -> dict[str, Any]:
    """What `one` finds in a process of its own, with softmpc's own functions compiled."""
    steps = most if PEERS[peer][1] is None else min(most, FIRST + int(PEERS[peer][1] or 0))
    call = {"peer": peer, "scene": scene, "states": str(states), "steps": steps}
    variables = {"SOFTMPC_COMPILE": "require"}
    return dict(answer_of("tests.benchmarks.c_controller_peers", call=call, variables=variables))


if __name__ == "__main__":
    print(json.dumps(one(**json.loads(sys.stdin.read()))))
