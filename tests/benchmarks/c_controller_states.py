"""States of a closed loop, recorded once for all controllers that are compared on them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from softmpc.control.mpc import Mpc
from softmpc.control.solvers import make_solver
from softmpc.control.tracking import Setup, read_track_file, set_up
from softmpc.control.transcription import Transcription
from softmpc.model.model import build
from tests.benchmarks.common import EXAMPLES

__all__ = ["Recorded", "record", "transcription_of"]

CONVERGED = 1e-8  # of the optimum that inputs are compared with
AT_LIMIT = 1e-3  # of its range: as near is at a limit

Array = np.ndarray


@dataclass(frozen=True)
class Recorded:
    """What a controller was given in each step (K): state, input before, references; its input."""

    name: str
    setup: Setup
    arrays: dict[str, Array]

    @property
    def limited(self) -> float:
        """Share of the steps with a torque or a pressure at a limit."""
        t = self.setup.controller.transcription
        x, u = self.arrays["x"], self.arrays["u"]
        limits = {limit.name: limit for limit in t.ocp.limits}
        torque, pressure = limits["torque"], limits["pressure"]
        p = x[:, 2 * t.n :] @ t.model.drive.C.T
        return float(np.mean(_near(u, torque).any(axis=1) | _near(p, pressure).any(axis=1)))

    def save(self, folder: Path) -> None:
        np.savez(folder / f"{self.name}.npz", **self.arrays)


def _near(value: Array, limit: Any) -> Array:
    room = AT_LIMIT * (limit.high - limit.low)
    return np.asarray((value < limit.low + room) | (value > limit.high - room))


class _Recorder:
    """A controller that writes down what it is given."""

    def __init__(self, mpc: Mpc) -> None:
        self.mpc, self.ocp = mpc, mpc.ocp
        self.rows: list[tuple[Array, ...]] = []

    def reset(self) -> None:
        self.mpc.reset()

    def step(self, x: Any, u_before: Any, given: Any) -> Any:
        taken = self.mpc.step(x, u_before, given)
        references = self.mpc.transcription.references(given)
        self.rows.append((np.array(x), np.array(u_before), references, taken.u))
        return taken


def record(scene: str) -> Recorded:
    """The task of an example, run by real-time iteration; inputs of the optimum beside."""
    _, parsed, task = read_track_file(EXAMPLES / f"{scene}.toml")
    setup = set_up(parsed, replace(task, controller=replace(task.controller, budget=None)))
    setup.controller.budget = None  # whatever the machine is busy with
    recorder = _Recorder(setup.controller)
    setup.run(recorder)
    names = ("x", "u_before", "given", "u")
    columns = zip(*recorder.rows, strict=True)
    arrays = {name: np.array(column) for name, column in zip(names, columns, strict=True)}
    t = setup.controller.transcription
    best = Mpc(t, make_solver("sqp", t, tolerance=CONVERGED))
    arrays["optimum"] = np.array([best.step(*row[:3]).u for row in recorder.rows])
    return Recorded(scene, setup, arrays)


def transcription_of(scene: str) -> Transcription:
    """The problem of an example alone, without the checks of its path."""
    _, parsed, task = read_track_file(EXAMPLES / f"{scene}.toml")
    settings = task.controller
    return Transcription(settings.problem(build(parsed)), settings.stages)
