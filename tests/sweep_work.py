"""Work for the tests of sweeps; workers import this module."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from softmpc import InputError, Model, Scene, build
from softmpc.statics.equilibrium import find_equilibrium, refine_equilibrium
from softmpc.sweeps import sweep


@dataclass(frozen=True)
class Tips:
    """Tips of an arm at rest; each case of a chunk starts from the posture before it."""

    scene: Scene

    @cached_property
    def model(self) -> Model:
        return build(self.scene)

    def begin(self) -> Callable[[Any], Any]:
        last: list[np.ndarray] = []

        def tips(pressures: list[float]) -> np.ndarray:
            found = (
                refine_equilibrium(self.model, pressures, last[-1])
                if last
                else find_equilibrium(self.model, pressures)
            )
            last.append(found.q)
            return found.tips

        return tips


@dataclass(frozen=True)
class Logged:
    """The square of a case; `log` gets a line for each case that is begun: its number and who."""

    log: str
    die_at: int | None = None  # its worker is killed when it first comes to this case
    always: bool = False  # … and whenever it comes there again
    seconds: float = 0.0

    def __call__(self, case: int) -> int:
        first = f"{case} " not in Path(self.log).read_text()
        with open(self.log, "a") as file:
            file.write(f"{case} {os.getpid()}\n")
        if case == self.die_at and (first or self.always):
            os.kill(os.getpid(), signal.SIGKILL)
        time.sleep(self.seconds)
        return case**2

    def begun(self) -> list[int]:
        """The cases that were begun."""
        return [int(line.split()[0]) for line in Path(self.log).read_text().splitlines()]

    def workers(self) -> set[int]:
        """The processes they were begun in."""
        return {int(line.split()[1]) for line in Path(self.log).read_text().splitlines()}


def plain_types(case: int) -> dict[str, Any]:
    return {"array": np.arange(case) / 3, "number": np.float64(case), "pair": (case, None)}


def threads(case: int) -> str:
    return os.environ["OMP_NUM_THREADS"] + os.environ["OPENBLAS_NUM_THREADS"]


def sweep_inside(case: int) -> bool:
    """Whether a sweep in a worker stays in that process."""
    return sweep(process, [0, 1]) == [os.getpid()] * 2


def process(case: int) -> int:
    return os.getpid()


def slow_first(case: int) -> int:
    time.sleep(0.3 if case == 0 else 0.0)
    return case


def inverse(case: float) -> float:
    if case < 0:
        raise InputError("must not be negative")
    return 1 / case


class NotLoaded:
    """Can be sent, and not received."""

    def __reduce__(self) -> tuple[Any, ...]:
        return inverse, (0,)


def no_result(case: int) -> object:
    return object()


def interrupted_in_casadi(case: int) -> int:
    if case == 3:
        raise RuntimeError("Error in Function::call: KeyboardInterrupt")
    return case
