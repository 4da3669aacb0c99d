"""A controller that writes a flight log as it goes."""

from __future__ import annotations

import os
import platform
from dataclasses import dataclass
from importlib.metadata import version
from typing import Any

import numpy as np

from softmpc.codegen.compiled_controller import CompiledController
from softmpc.codegen.compiled_log import CompiledRecorder
from softmpc.codegen.flight_format import (
    SOURCES,
    STATUSES,
    UNKNOWN,
    Header,
    Limits,
    Settings,
    Snapshot,
    StepRecord,
    qp_code,
)
from softmpc.codegen.flight_writer import Closing, FlightWriter, LogFile
from softmpc.codegen.problem_hash import problem_hash
from softmpc.control.closed_loop import Controller
from softmpc.control.memory import memory_of, remembers
from softmpc.control.mpc import Mpc
from softmpc.control.real_time import RealTime
from softmpc.control.step import Step
from softmpc.errors import InputError

__all__ = ["Recorded", "python_build", "record", "snapshot_of"]

EVERY = 40  # steps between snapshots
PACKAGES = ("softmpc", "numpy", "scipy", "casadi", "daqp")


def record(
    controller: Controller,
    path: str | os.PathLike[str],
    scene: str | os.PathLike[str] = "",
    every: int = EVERY,
) -> Recorded | CompiledRecorder:
    """`with record(controller, "flight.log") as controller`: it does the same, and writes a log.

    A controller in Python writes it in Python, one in C by its own recorder in C.

    `scene` is the file that `softmpc replay` shall look for, `every` the steps between snapshots,
    at which a replay can begin. Each record is with the operating system before `step` returns, so
    that a crash of the program loses nothing. Raises `InputError` where the file cannot be written
    or the controller has no transcribed problem.
    """
    if every < 1:
        raise InputError(f"record(every={every!r}): must be 1 step or more")
    if isinstance(controller, CompiledController):
        return CompiledRecorder(controller, LogFile(path), every, str(scene))
    return Recorded(controller, FlightWriter(path, _header(controller, str(scene))), every)


def python_build() -> str:
    """What decides on the bits of a Python controller's results."""
    packages = (f"{name} {version(name)}" for name in PACKAGES)
    return f"Python on {platform.machine()}: {', '.join(packages)}"


def snapshot_of(mpc: Mpc, number: int) -> Snapshot:
    """What it remembers, for a log."""
    m = memory_of(mpc)
    return Snapshot(number, m.age, m.failures, m.violation, m.u, m.plan, m.expected, m.active)


def _header(controller: Any, scene: str) -> Header:
    t = getattr(controller, "transcription", None)
    if t is None:
        raise InputError(
            f"record: {type(controller).__name__} has no transcribed problem; an Mpc has one"
        )
    solver = getattr(controller, "solver", None)
    return Header(
        intervals=t.N,
        states=t.nx,
        inputs=t.inputs,
        references=t.nr,
        step=t.ocp.step,
        scene_hash=problem_hash(t, getattr(solver, "blocks", None)),
        version=version("softmpc"),
        build=python_build(),
        names=", ".join(f"{name}[{size}]" for name, size in t.objective.references.items()),
        scene=scene,
    )


@dataclass(frozen=True)
class _Asked:
    """What a step is given before the state is known."""

    references: np.ndarray
    u_before: np.ndarray


class Recorded(Closing):
    """The controller that it is made with, and its log; what it does not know it asks that one.

    Its own part of a step's time is in none of the times that are reported.
    """

    def __init__(self, controller: Any, writer: FlightWriter, every: int) -> None:
        self.controller, self.writer, self.every = controller, writer, every
        self._asked: _Asked | None = None
        self._u: np.ndarray | None = None
        self._usual = self._known = self._settings()
        self.writer.reset()

    def __getattr__(self, name: str) -> Any:
        return getattr(self.controller, name)

    @property
    def ocp(self) -> Any:
        """The problem."""
        return self.controller.ocp

    @property
    def budget(self) -> float | None:
        """The time (s) that a step may take; None sets none."""
        return getattr(self.controller, "budget", None)

    @budget.setter
    def budget(self, budget: float | None) -> None:
        self.controller.budget = budget

    def reset(self) -> None:
        """Forget what was before."""
        self.controller.reset()
        self._asked, self._u = None, None
        self._known = self._usual  # what is still set is written once more
        self.writer.reset()

    def step(self, x: Any, u_before: Any, given: Any) -> Step:
        """The input for the state x and the references at the coming nodes."""
        self._ask(given, u_before)
        return self._written(x, self.controller.step(x, u_before, given))

    def prepare(self, given: Any, u_before: Any = None) -> None:
        """See `Mpc.prepare`."""
        self.controller.prepare(given, u_before)
        self._ask(given, self._u if u_before is None else u_before)

    def feedback(self, x: Any) -> Step:
        """See `Mpc.feedback`."""
        return self._written(x, self.controller.feedback(x))

    def close(self) -> None:
        """End the log."""
        self.writer.close()

    # --- records ---------------------------------------------------------------------------------

    def _ask(self, given: Any, u_before: Any) -> None:
        self._note_settings()
        references = self.controller.transcription.references(given)
        self._asked = _Asked(references, np.array(u_before, float).ravel())

    def _written(self, x: Any, step: Step) -> Step:
        asked, self._asked = self._asked, None
        assert asked is not None
        self._u = step.u
        status, _, _ = step.status.partition(":")
        self.writer.step(
            StepRecord(
                number=self.writer.number,
                x=np.array(x, float).ravel(),
                u_before=asked.u_before,
                given=asked.references,
                u=step.u,
                status=STATUSES.index(status),
                qp=qp_code(step.qp),
                source=SOURCES.index(step.source),
                iterations=step.iterations,
                active=self._active(),
                kkt=step.kkt,
                violation=step.violation,
                prepare_seconds=step.prepare_seconds,
                feedback_seconds=step.feedback_seconds,
                clipped=step.clipped,
            )
        )
        if self.writer.number % self.every == 0 and remembers(self.controller):
            self.writer.snapshot(snapshot_of(self.controller, self.writer.number))
        return step

    def _active(self) -> int:
        """Rows of the last quadratic program at their bounds, where that is known."""
        active = memory_of(self.controller).active if remembers(self.controller) else None
        return UNKNOWN if active is None else int(np.count_nonzero(active))

    def set_limits(self, **narrower: Any) -> None:
        """See `Mpc.set_limits`."""
        self.controller.set_limits(**narrower)
        self.writer.limits(Limits(**narrower))

    def _settings(self) -> Settings:
        """What a user or a fault may change between steps."""
        solver = getattr(self.controller, "solver", None)
        cap = solver.qp.max_iterations if isinstance(solver, RealTime) else 0
        return Settings(self.budget or 0.0, cap)

    def _note_settings(self) -> None:
        now = self._settings()
        if now != self._known:
            self._known = now
            as_built = now.cap == self._usual.cap
            self.writer.settings(Settings(now.budget, 0 if as_built else now.cap))
