"""Replay through the controller in C: compiled for this machine, or on an emulated board."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from softmpc.codegen.compiled_controller import CompiledController
from softmpc.codegen.compiled_log import header_of, restore
from softmpc.codegen.emulate import Steps, run_steps
from softmpc.codegen.flight_format import (
    QP,
    SOURCES,
    STATUSES,
    Limits,
    Reset,
    Settings,
    Snapshot,
    StepRecord,
    qp_code,
)
from softmpc.codegen.flight_log import FlightLog
from softmpc.codegen.replay import Outcome, Replayed
from softmpc.control.transcription import Transcription

__all__ = ["CPlayer", "through_qemu"]

TIME_LIMIT, LATE = QP.index("time limit"), STATUSES.index("budget overrun")
BUDGET = 1.0  # s by the clock of a replay, which stands still unless the log says that time ran out
LONG = 1e3 * BUDGET


class _Clock:
    """Goes on by `pace` (s) whenever it is read."""

    def __init__(self) -> None:
        self.now = self.pace = 0.0

    def __call__(self) -> float:
        self.now += self.pace
        return self.now


class CPlayer:
    """The controller of a generated folder, compiled for this machine."""

    name = "c"

    def __init__(self, folder: Path, t: Transcription, log: FlightLog) -> None:
        self.clock, single = _Clock(), log.header.real_bytes == 4
        self.controller = CompiledController(folder, t, single=single, clock=self.clock)
        self.build = header_of(self.controller).build

    def reset(self) -> None:
        self.controller.max_iterations = 0
        self.controller.reset()

    def restore(self, snapshot: Snapshot) -> bool:
        return restore(self.controller, snapshot)

    def set(self, setting: Limits | Settings) -> None:
        if isinstance(setting, Limits):
            self.controller.set_limits(*setting.each)
        else:
            self.controller.max_iterations = setting.cap

    def step(self, record: StepRecord) -> Outcome:
        """Late: the clock jumps while it prepares; out of time: while the program is solved."""
        timed = bool(np.isfinite(record.prepare_seconds))  # with a clock programs go in pieces
        self.controller.budget = BUDGET if timed else None
        late, stopped = record.status == LATE, record.qp == TIME_LIMIT
        given = _named(self.controller.transcription, record.given)
        self.clock.pace = LONG if late and not stopped else 0.0
        self.controller.prepare(given, record.u_before)
        self.clock.pace = LONG if late and stopped else 0.0
        step = self.controller.feedback(record.x)
        return Outcome(
            u=step.u,
            status=STATUSES.index(step.status.partition(":")[0]),
            qp=qp_code(step.qp),
            source=SOURCES.index(step.source),
            iterations=step.iterations,
        )


def _named(t: Transcription, given: np.ndarray) -> dict[str, np.ndarray]:
    """References by name."""
    ends = np.cumsum([0, *t.objective.references.values()])
    names = zip(t.objective.references, ends[:-1], ends[1:], strict=True)
    return {name: given[:, a:b] for name, a, b in names}


# ---------------------------------------------------------------- on the emulated board


def through_qemu(log: FlightLog, folder: Path) -> Replayed:
    """All that the board's program can do again, from each reset on.

    That is up to where a user set something or the clock decided.

    Raises `BuildError` where compiler or emulator are missing, or fail.
    """
    found = Replayed("qemu", "C on the emulated board")
    precision = "float" if log.header.real_bytes == 4 else "double"
    for run in _runs(log):
        steps = [log.steps[place] for place in run]
        parts = ("given", "u_before", "x")
        given = (np.array([getattr(one, part) for one in steps]) for part in parts)
        answers = run_steps(folder, Steps(*given), precision=precision)
        for k, place in enumerate(run):
            figures = answers.status[k], answers.qp[k], answers.iterations[k]
            status, qp, iterations = (int(figure) for figure in figures)
            found.outcomes[place] = Outcome(answers.u[k], status, qp, iterations=iterations)
    found.left_out = len(log.steps) - len(found.outcomes)
    return found


def _runs(log: FlightLog) -> Sequence[Sequence[int]]:
    """Places of steps that follow a reset without anything that the board's program cannot do."""
    runs: list[list[int]] = []
    place, expected = 0, -1
    for event in log.events:
        if isinstance(event, Reset):
            expected = event.number
            runs.append([])
        elif isinstance(event, StepRecord):
            if event.number == expected and event.whole and event.status != LATE:
                runs[-1].append(place)
                expected += 1
            else:
                expected = -1
            place += 1
        elif isinstance(event, Limits | Settings):
            expected = -1
    return [run for run in runs if run]
