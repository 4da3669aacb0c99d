"""What a controller costs: time of a step, to build it, memory, instructions, C code."""

from __future__ import annotations

import tempfile
import time
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from softmpc.accuracy.configuration import AS_GIVEN, Configuration, Task
from softmpc.accuracy.environment import environment
from softmpc.accuracy.loop_task import IN_C, prepared, shortened, tracking
from softmpc.accuracy.made_once import made_once
from softmpc.accuracy.timing import clock, memory_mib, spread
from softmpc.codegen.compiled_controller import CompiledController
from softmpc.codegen.generate import generate_controller
from softmpc.codegen.model_functions import controller_functions
from softmpc.compiled import instructions
from softmpc.control.closed_loop import Controller, close_loop
from softmpc.control.real_time import RealTime
from softmpc.control.step import Step
from softmpc.control.track_scene import Plant
from softmpc.control.tracking import Setup

__all__ = ["loop_cost"]

BEGINNING = 1.0  # s of the path that is run
BLOCK = 12  # steps of a run; runs of both controllers take turns
FIRST = 2  # of a run, from nothing, do not count
TURNS = {True: 2, False: 6}  # by `quick`
PATIENCE = 20.0  # s of steps, after which there are no more turns
Numbers = dict[str, Any]


def loop_cost(task: Task, configuration: Configuration) -> Numbers:
    """Processor times of a controller step (s) at the beginning of the path, on its own model.

    Runs of 12 steps take turns with those of the scene as given; the first two of a run do not
    count. `time_s` is the time that 95 % of the steps stay below, `median_s` and `spread_s` beside
    it, `ratio` that of the medians. `build_s` is from the scene to the end of the first step, the
    checks of that part of the path with it, nothing compiled before; `compile_s`, of the controller
    in C, its compiler's. `memory_mib` is the most until then, with steps. `instructions` are those
    of its functions of a stage, `c_bytes` of the sources that its C code is, in quick mode of a
    controller in C alone.
    """
    with ExitStack() as stack:
        folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="softmpc-"))
        stack.enter_context(environment(SOFTMPC_CACHE=f"{folder}/cache"))
        own, found = _built(task, configuration, Path(folder) / "controller")
        own.steps(1 + FIRST)
        found["memory_mib"] = memory_mib()
        with environment(SOFTMPC_COMPILE=AS_GIVEN.compile):
            beside = made_once("loop", task, lambda: _Timed.of(task, AS_GIVEN))
        found |= _by_turns(own, beside, TURNS[task.quick])
        whole = not task.quick or configuration.variant == IN_C
        return found | _code(own.setup, Path(folder) / "code", whole)


class _Clocked:
    """A controller whose steps are timed by the clock of all costs."""

    def __init__(self, controller: Controller) -> None:
        self.controller, self.ocp = controller, controller.ocp
        self.seconds: list[float] = []

    def reset(self) -> None:
        self.controller.reset()
        self.seconds = []

    def step(self, x: Any, u_before: Any, given: Any) -> Step:
        began = clock()
        taken = self.controller.step(x, u_before, given)
        self.seconds.append(clock() - began)
        return taken


@dataclass(frozen=True, eq=False)
class _Timed:
    """A controller on its own model."""

    setup: Setup
    controller: Controller

    @classmethod
    def of(cls, task: Task, configuration: Configuration) -> _Timed:
        scene, asked = tracking(task, configuration)
        asked = shortened(asked, BEGINNING)
        plant = Plant(asked.controller.scene, asked.plant.method)
        setup = prepared(scene, replace(asked, plant=plant))
        return cls(setup, setup.controller)

    def steps(self, count: int) -> np.ndarray:
        """Seconds of each of so many steps from the start."""
        setup, timed = self.setup, _Clocked(self.controller)
        seconds = count * setup.ocp.step
        run = close_loop(timed, setup.plant, setup.guide, setup.start, duration=seconds)
        if run.status == "interrupted":
            raise KeyboardInterrupt
        return np.array(timed.seconds)


def _built(task: Task, configuration: Configuration, folder: Path) -> tuple[_Timed, Numbers]:
    """From the scene to the end of the first step, and how long that took."""
    began, found = time.perf_counter(), Numbers()
    own = _Timed.of(task, configuration)
    if configuration.variant == IN_C:
        generate_controller(own.setup.controller, folder, start=own.setup.start)
        before = time.perf_counter()
        controller = CompiledController(folder, own.setup.controller.transcription)
        found["compile_s"] = time.perf_counter() - before
        own = replace(own, controller=controller)
    own.steps(1)
    return own, found | {"build_s": time.perf_counter() - began}


def _by_turns(own: _Timed, beside: _Timed, turns: int) -> Numbers:
    """Times of steps; a busy machine slows both."""
    times: tuple[list[float], list[float]] = [], []
    began = time.perf_counter()
    for _ in range(turns):
        for one, kept in zip((own, beside), times, strict=True):
            kept += one.steps(BLOCK)[FIRST:].tolist()
        if time.perf_counter() - began > PATIENCE:
            break
    ours, theirs = (np.array(one) for one in times)
    return {
        "time_s": float(np.percentile(ours, 95)),
        "median_s": float(np.median(ours)),
        "spread_s": spread(ours),
        "beside_s": float(np.median(theirs)),
        "ratio": float(np.median(ours) / np.median(theirs)),
        "steps": len(ours),
    }


def _code(setup: Setup, folder: Path, whole: bool) -> Numbers:
    """Sizes of the functions of a stage, and with `whole` of the C code.

    Real-time iteration and SQP have the former, the latter real-time iteration alone.
    """
    solver = setup.controller.solver
    if not isinstance(solver, RealTime):
        return {}
    functions = controller_functions(solver.linearisation)
    found: Numbers = {"instructions": sum(instructions(one.function) for one in functions)}
    if whole and solver.splits:
        generate_controller(setup.controller, folder, start=setup.start)
        found["c_bytes"] = sum(path.stat().st_size for path in folder.rglob("*.[ch]"))
    return found
