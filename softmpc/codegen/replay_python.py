"""Replay through the controller in Python, in CasADi's virtual machine."""

from __future__ import annotations

import numpy as np

from softmpc.codegen.flight_format import (
    QP,
    SOURCES,
    STATUSES,
    Limits,
    Settings,
    Snapshot,
    StepRecord,
    qp_code,
)
from softmpc.codegen.flight_recorder import python_build
from softmpc.codegen.replay import Outcome
from softmpc.control.condensing import Program
from softmpc.control.daqp import Daqp, QpSolution
from softmpc.control.memory import Memory, put_back, remembers
from softmpc.control.mpc import Mpc
from softmpc.control.real_time import RealTime
from softmpc.errors import InputError

__all__ = ["PythonPlayer"]

TIME_LIMIT, LATE = QP.index("time limit"), STATUSES.index("budget overrun")
NO_TIME = 1e-9  # s, a budget that nothing keeps
SIDES, LOWER = ("low", "high", "fall", "rise"), ("low", "fall")  # of an `InputGuard`


class _ByTheLog:
    """DAQP that runs out of time where a log says so, and else never."""

    def __init__(self) -> None:
        self.daqp, self.out_of_time = Daqp(), False
        self.as_built = self.daqp.max_iterations

    def solve(
        self,
        program: Program,
        time_limit: float | None = None,
        multipliers: np.ndarray | None = None,
    ) -> QpSolution:
        """See `Daqp.solve`."""
        if not self.out_of_time:
            return self.daqp.solve(program, None, multipliers)
        nothing = np.full(len(program.f), np.nan)
        return QpSolution(False, QP[TIME_LIMIT], nothing, np.zeros(0), 0, 0.0)


class PythonPlayer:
    """The controller of the same problem, made anew from that one, without compiled functions."""

    name = "python"

    def __init__(self, mpc: Mpc) -> None:
        if not remembers(mpc):
            raise InputError(
                "replay: known is the controller by real-time iteration, solver = 'real-time' in "
                "[track.controller]"
            )
        t, given = mpc.transcription, mpc.solver
        assert isinstance(given, RealTime)
        blocks = [int(count) for count in np.bincount(given.blocks)]
        solver = RealTime(t, 1, given.tolerance, blocks, mode="never")
        self.qp = solver.qp = _ByTheLog()  # type: ignore[assignment]
        self.mpc = Mpc(t, solver, None, mpc.restart_after)
        self.build = python_build()

    def reset(self) -> None:
        self.mpc.reset()
        self.set(Limits())
        self.set(Settings())

    def restore(self, snapshot: Snapshot) -> bool:
        s = snapshot
        put_back(
            self.mpc, Memory(s.plan, s.expected, s.age, s.violation, s.u, s.active, s.failures)
        )
        return True

    def set(self, setting: Limits | Settings) -> None:
        if isinstance(setting, Settings):
            self.qp.daqp.max_iterations = setting.cap or self.qp.as_built
            return
        self.mpc.set_limits(**dict(zip(SIDES, setting.each, strict=True)))

    def step(self, record: StepRecord) -> Outcome:
        late = record.status == LATE
        self.qp.out_of_time = late and record.qp == TIME_LIMIT
        self.mpc.budget = NO_TIME if late else None
        t, first, given = self.mpc.transcription, 0, {}
        for name, size in t.objective.references.items():
            given[name] = record.given[:, first : first + size]
            first += size
        step = self.mpc.step(record.x, record.u_before, given)
        return Outcome(
            u=step.u,
            status=STATUSES.index(step.status.partition(":")[0]),
            qp=qp_code(step.qp),
            source=SOURCES.index(step.source),
            iterations=step.iterations,
        )
