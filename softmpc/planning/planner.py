"""Plans: several starts on a coarse mesh, the best one refined until a replay agrees with it."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Any

import numpy as np

from softmpc.control.clearance import arm_clearance
from softmpc.control.one_thread import one_thread
from softmpc.errors import InputError
from softmpc.interrupts import InterruptLater
from softmpc.model.obstacles import obstacle_names
from softmpc.planning.attempt import Attempt, Found
from softmpc.planning.elastic import require_solver
from softmpc.planning.giving_way import gives_way, held_by
from softmpc.planning.guesses import Guess, find_guesses
from softmpc.planning.problem import PlanProblem
from softmpc.planning.replay import Replay, Replayer
from softmpc.planning.result import (
    FAILED,
    INFEASIBLE,
    INTERRUPTED,
    NOT_LEAST,
    NOT_VERIFIED,
    SOLVED,
    Level,
    PlanResult,
    StartReport,
)
from softmpc.planning.starts import FirstMesh, Portable, ranked
from softmpc.sweeps import sweep

__all__ = ["PlanSettings", "plan"]

COARSE, FINEST = 24, 384  # intervals a phase to begin with, and of all at most
ROOM = 1e-4  # m, of clearance beside what a motion lacked between nodes
LACKING = 2e-4  # m, of clearance that counts as kept
BEYOND = 2e-3  # scaled, of other limits between nodes
TURNED = 5e-3  # rad, of directions that count as met
ROUNDS = 8

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class PlanSettings:
    """How good a plan must be.

    `tolerance` (m): of section tips, between plan and replay; `change`: of the cost when the mesh
    is made twice as fine, relative; `intervals` of each phase to begin with, `most_intervals` of
    all phases together.
    """

    tolerance: float = 5e-4
    change: float = 0.01
    intervals: int = COARSE
    most_intervals: int = FINEST

    def __post_init__(self) -> None:
        for name in ("tolerance", "change"):
            value = getattr(self, name)
            if not 0 < value < np.inf:
                raise InputError(f"PlanSettings.{name} = {value!r}: must be a number above 0")
        for name in ("intervals", "most_intervals"):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, int) or value < 2:
                raise InputError(f"PlanSettings.{name} = {value!r}: must be a whole number from 2")


def plan(
    problem: PlanProblem,
    settings: PlanSettings | None = None,
    *,
    executor: Executor | int | None = None,
    progress: Progress | None = None,
) -> PlanResult:
    """The least motion that does what the problem asks, or the nearest there is.

    Starts run on `executor`, see `softmpc.sweeps.sweep`. `progress(done, total)` counts starts and
    then rounds of refinement. Raises `InputError` for a problem that makes no sense, `BuildError`
    where CasADi lacks the solver; whatever else goes wrong is told by the status of the result.
    Ctrl-C ends it with the best motion until then.
    """
    settings = settings or PlanSettings()
    _check_start(problem)
    require_solver()
    one_thread.look()  # CasADi's own library as well
    with one_thread:
        return _Planner(problem, settings, progress or _nobody).run(executor)


def _nobody(done: int, total: int) -> None:
    """Progress that nobody wants to see."""


def _check_start(problem: PlanProblem) -> None:
    """Raise `InputError` where the arm begins inside of an obstacle, or nearer than the margin."""
    if not problem.obstacles:
        return
    n = problem.model.strains
    closest = arm_clearance(problem.model, problem.obstacles)(problem.start.x[:n])
    names = obstacle_names(problem.obstacles)
    for name, room, section in zip(names, closest.clearance[0], closest.section[0], strict=True):
        if room < problem.margin:
            inside = f"{-1e3 * room:.3g} mm inside of {name}"
            near = f"{1e3 * room:.3g} mm from {name}, nearer than {1e3 * problem.margin:.3g} mm,"
            raise InputError(
                f"the arm begins {inside if room < 0 else near} with section {section}: start "
                "elsewhere, or move the obstacle"
            )


class _Planner:
    """One call of `plan`."""

    def __init__(self, problem: PlanProblem, settings: PlanSettings, progress: Progress) -> None:
        self.problem, self.settings, self.progress = problem, settings, progress
        self.began = time.perf_counter()
        self.levels: list[Level] = []
        self.more: dict[str, float] = {}
        self.total = 0
        self.cut = False  # by Ctrl-C

    def run(self, executor: Executor | int | None) -> PlanResult:
        with InterruptLater() as interrupt:
            guesses = find_guesses(self.problem)
        if interrupt.asked:
            raise KeyboardInterrupt
        self.total = len(guesses) + ROUNDS
        records = self._search(guesses, executor)
        done = [(g, r) for g, r in zip(guesses, records, strict=True) if r is not None]
        if not done:
            return PlanResult(self.problem, INTERRUPTED, (), seconds=self._since())
        reports, best = ranked(*zip(*done, strict=True))
        if best is None:
            status = INTERRUPTED if self.cut else FAILED
            return PlanResult(self.problem, status, reports, seconds=self._since())
        with InterruptLater() as interrupt:
            return self._refined(best, reports, lambda: self.cut or interrupt.asked)

    def _search(
        self, guesses: Sequence[Guess], executor: Executor | int | None
    ) -> list[dict[str, Any] | None]:
        """What became of each guess on the first mesh; None where Ctrl-C came before."""
        work = FirstMesh(Portable.of(self.problem), self.settings.intervals)
        records: list[dict[str, Any] | None] = [None] * len(guesses)
        if len(guesses) > 1 and executor != 1:
            try:
                sweep(
                    work, guesses, executor=executor, chunk=1, progress=self._told,
                    arrived=records.__setitem__,
                )  # fmt: skip
            except KeyboardInterrupt:
                self.cut = True
            return records
        with InterruptLater(shared=True) as interrupt:
            for i, guess in enumerate(guesses):
                self._told(i, len(guesses))
                records[i] = work(guess)
                if interrupt.asked:
                    self.cut = True
                    break
        return records

    def _told(self, done: float, total: float) -> None:
        self.progress(int(done), self.total)

    def _since(self) -> float:
        return time.perf_counter() - self.began

    def _refined(
        self, found: Found, reports: tuple[StartReport, ...], asked: Callable[[], bool]
    ) -> PlanResult:
        """Finer meshes, and more room for obstacles, until the replay agrees or an end is asked."""
        replayer, error = Replayer(self.problem), float("nan")
        attempt: Attempt | None = None
        seconds, status = 0.0, ""
        while not status:
            replay = replayer(found.t, found.u, found.x, found.u[-1], found.ends.tolist())
            self._note(found, replay, seconds)
            counts, status = self._next(found, replay, error)
            status = INTERRUPTED if asked() else status
            if status:
                break
            began = time.perf_counter()
            finer = Attempt(self.problem, counts, self.more)
            motion = finer.from_plan(found)
            better = finer.improve(motion, lambda _: asked()) if motion is not None else None
            if better is None or (not better.met and self._usable(found, replay)):
                status = NOT_LEAST if self._usable(found, replay) else NOT_VERIFIED
                break  # the coarser mesh has what the finer one lost
            attempt = finer
            error = abs(better.cost - found.cost) if counts != found.counts else error
            found, seconds = better, time.perf_counter() - began
        attempt = attempt or self._again(found)
        gave_way = gives_way(attempt, attempt.solved) if status == INFEASIBLE else ()
        if attempt.solved.step is None and not asked():
            # What holds it shows in a program around it.
            attempt.improve(attempt.solved.motion, lambda done: done > 0)
        return PlanResult(
            self.problem, status, reports, found, replay, tuple(self.levels), error,
            gives_way=gave_way, held_by=held_by(attempt, attempt.solved),
            seconds=self._since(), more=attempt.more,
        )  # fmt: skip

    def _again(self, found: Found) -> Attempt:
        """The attempt behind a motion that came from another process."""
        attempt = Attempt(self.problem, found.counts)
        motion = attempt.from_plan(found)
        assert motion is not None  # it is one already
        attempt.improve(motion, lambda _: True)
        return attempt

    def _note(self, found: Found, replay: Replay, seconds: float) -> None:
        self.progress(self.total - ROUNDS + min(len(self.levels), ROUNDS - 1), self.total)
        least = min(replay.clearance.values(), default=np.inf)
        self.levels.append(
            Level(len(found.u), found.cost, replay.defect, least, found.iterations, seconds)
        )

    def _next(self, found: Found, replay: Replay, error: float) -> tuple[tuple[int, ...], str]:
        """The mesh of the next round, or the status that ends them."""
        if not found.met:
            return found.counts, NOT_LEAST if self._passes(found, replay) else INFEASIBLE
        finest = 2 * len(found.u) > self.settings.most_intervals
        agrees = self._agrees(replay)
        settled = error <= self.settings.change * abs(found.cost)
        lacking = self._lacking(replay)
        done = SOLVED if found.converged else NOT_LEAST
        if agrees and (settled or finest) and not lacking:
            return found.counts, done if settled else NOT_LEAST
        if len(self.levels) >= ROUNDS or (finest and not agrees):
            return found.counts, NOT_VERIFIED
        for name, room in lacking.items():
            self.more[name] = self.more.get(name, 0.0) + room + ROOM
        if agrees and (settled or finest):
            return found.counts, ""
        return tuple(2 * n for n in found.counts), ""

    def _agrees(self, replay: Replay) -> bool:
        """Whether plan and replay are one motion, within all limits but obstacles."""
        beyond = max((one.scaled for one in replay.beyond.values()), default=0.0)
        return replay.defect <= self.settings.tolerance and beyond <= BEYOND

    def _usable(self, found: Found, replay: Replay) -> bool:
        return found.met and self._agrees(replay) and not self._lacking(replay)

    def _passes(self, found: Found, replay: Replay) -> bool:
        """Whether the replay does what was asked, though conditions are not met to rounding."""
        problem, within = self.problem, self.settings.tolerance
        turned = max(replay.turns, default=np.inf)  # none where the replay ended early
        arrives = max((*replay.misses, replay.drift)) <= within and turned <= TURNED
        change = np.abs(np.diff(np.vstack([problem.start.u, found.u]), axis=0))
        rate = np.inf if problem.rate is None else problem.rate * (1 + BEYOND)
        steady = bool(np.all(change <= rate * np.diff(found.t)[:, None]))
        return arrives and steady and self._agrees(replay) and not self._lacking(replay)

    def _lacking(self, replay: Replay) -> dict[str, float]:
        """Clearance (m) that is missing between nodes, by obstacle."""
        missing = {name: self.problem.margin - room for name, room in replay.clearance.items()}
        return {name: room for name, room in missing.items() if room > LACKING}
