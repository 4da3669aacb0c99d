"""Flights of a small controller, recorded, and their replay by Python."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import codegen_small as small
import numpy as np

from softmpc.codegen.flight_format import QP, STATUSES
from softmpc.codegen.flight_log import FlightLog, read_log
from softmpc.codegen.flight_recorder import record
from softmpc.codegen.replay import Comparison, compare, play
from softmpc.codegen.replay_python import PythonPlayer
from softmpc.control.daqp import QpSolution
from softmpc.simulation.runge_kutta import RadauIIA

LATE, TIME_LIMIT = STATUSES.index("budget overrun"), QP.index("time limit")


class OutOfTime:
    """A solver of quadratic programs that has no time left."""

    max_iterations = 1000

    def solve(self, program: Any, time_limit: Any = None, multipliers: Any = None) -> QpSolution:
        nothing = np.full(len(program.f), np.nan)
        return QpSolution(False, "time limit", nothing, np.zeros(0), 0, 0.0)


def fly(controller: Any, steps: int, before: Callable[[int], Any] = lambda k: None) -> np.ndarray:
    """Inputs of a loop whose target jumps.

    `before` each step a test may interfere; what it gives is added to the state.
    """
    at, random = small.start(), np.random.default_rng(3)
    plant, x, u = RadauIIA(small.transcription().model, tolerance=1e-5), at.x, at.u
    inputs = []
    for k in range(steps):
        if k % 10 == 0:
            target = small.home() + random.uniform(-1, 1, 3) * [0.1, 0.1, 0.02]
            references = np.tile(target, (small.INTERVALS, 1))
        measured = x if (off := before(k)) is None else x + off
        u = controller.step(measured, u, references).u
        inputs.append(u)
        x = plant.advance(x, u, small.STEP)[-1]
    return np.array(inputs)


def fly_in_trouble(path: Path) -> FlightLog:
    """A log of Python's controller with everything in it that can go wrong."""
    mpc = small.controller()
    usual = mpc.solver.qp

    with record(mpc, path, every=10) as recorded:

        def before(k: int) -> Any:
            recorded.budget = 1e-9 if k in (5, 6, 33) else None
            mpc.solver.qp = OutOfTime() if k in (13, 14) else usual
            usual.max_iterations = 1 if k in (23, 24) else 1000
            if k == 28:
                recorded.reset()
            return np.nan if k in (17, 18) else None

        fly(recorded, 40, before)
    usual.max_iterations = 1000
    return read_log(path)


def by_python(log: FlightLog) -> Comparison:
    return compare(log, play(log, PythonPlayer(small.controller())))
