"""Starts of a plan: each guess improved on the first mesh, on any executor, and the best."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np

from softmpc.interrupts import InterruptLater
from softmpc.model.model import build
from softmpc.model.scene import Scene
from softmpc.planning.attempt import Attempt, Found
from softmpc.planning.guesses import Guess
from softmpc.planning.problem import PlanProblem
from softmpc.planning.result import FAILED, INFEASIBLE, NOT_LEAST, SOLVED, StartReport

__all__ = ["FirstMesh", "Portable", "ranked"]


@dataclass(frozen=True, eq=False)
class Portable:
    """A problem without its model, which cannot travel."""

    scene: Scene
    parts: dict[str, Any]

    @classmethod
    def of(cls, problem: PlanProblem) -> Portable:
        parts = {f.name: getattr(problem, f.name) for f in fields(problem) if f.name != "model"}
        return cls(problem.model.scene, parts)

    def problem(self) -> PlanProblem:
        return PlanProblem(build(self.scene), **self.parts)


@dataclass(frozen=True, eq=False)
class FirstMesh:
    """What a worker does with a guess: the best motion on the first mesh, as plain data."""

    portable: Portable
    intervals: int

    @cached_property
    def problem(self) -> PlanProblem:
        return self.portable.problem()

    @cached_property
    def attempt(self) -> Attempt:
        return Attempt(self.problem, (self.intervals,) * len(self.problem.goals))

    def __call__(self, guess: Guess) -> dict[str, Any]:
        began, attempt = time.perf_counter(), self.attempt
        motion = attempt.from_guess(guess)
        if motion is None:
            return {"found": None, "wrong": np.inf, "seconds": time.perf_counter() - began}
        with InterruptLater() as interrupt:
            found = attempt.improve(motion, lambda _: interrupt.asked)
        wrong = float(attempt.solved.rows.excess.max(initial=0.0))
        return {"found": vars(found), "wrong": wrong, "seconds": time.perf_counter() - began}


def ranked(
    guesses: Sequence[Guess], records: Sequence[dict[str, Any]]
) -> tuple[tuple[StartReport, ...], Found | None]:
    """How all starts ended, and the best motion: one that meets all, then the cheapest."""
    founds = [_found(record["found"]) for record in records]
    order = [
        (0.0 if found.met else record["wrong"], found.cost, i)
        for i, (found, record) in enumerate(zip(founds, records, strict=True))
        if found is not None
    ]
    best = min(order)[2] if order else None
    reports = tuple(
        StartReport(
            guess.name, _status(found), np.nan if found is None else found.cost,
            float(record["wrong"]), 0 if found is None else found.iterations, record["seconds"],
            i == best,
        )
        for i, (guess, found, record) in enumerate(zip(guesses, founds, records, strict=True))
    )  # fmt: skip
    return reports, None if best is None else founds[best]


def _found(record: dict[str, Any] | None) -> Found | None:
    if record is None:
        return None
    arrays = {k: np.array(record[k], float) for k in ("t", "durations", "u", "x", "a")}
    return Found(**{**record, **arrays, "ends": np.array(record["ends"], int)})


def _status(found: Found | None) -> str:
    if found is None:
        return FAILED
    if not found.met:
        return INFEASIBLE
    return SOLVED if found.converged else NOT_LEAST
