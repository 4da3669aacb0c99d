"""What a motion costs: to build, to run, in instructions, states and memory."""

from __future__ import annotations

import tempfile
import time
from dataclasses import dataclass, replace
from math import inf
from typing import Any

import numpy as np

from softmpc.accuracy.configuration import AS_GIVEN, Configuration, Task
from softmpc.accuracy.environment import environment
from softmpc.accuracy.made_once import made_once
from softmpc.accuracy.motion_task import PATIENCE, integrator_of, run, settings_of
from softmpc.accuracy.motion_variants import model_with
from softmpc.accuracy.timing import by_turns, memory_mib
from softmpc.compiled import default_mode
from softmpc.model.model import Model
from softmpc.model.scene_file import scene_from_dict
from softmpc.simulation.integrator import Integrator
from softmpc.simulation.run import start_state
from softmpc.simulation.settings import SimulationSettings
from softmpc.study.measure import Cost

__all__ = ["motion_cost"]

FEWEST, MOST = 3, 15  # runs whose median is the time
SPEND = {True: 0.4, False: 4.0}  # s of runs, by `quick`
CALLS = 20  # of a function, a measurement
Numbers = dict[str, Any]


def motion_cost(task: Task, configuration: Configuration) -> Numbers:
    """Times of a configuration by its own method, beside those of the scene as given.

    `time_s` is wall time a simulated second. `build_s` is from the scene to the state after the
    first sample, uncompiled, with no function made before; `compile_s` what compiling adds.
    `residual_us` and `jacobian_us` are a call of the residual and of its Jacobian, in CasADi's
    virtual machine. Raises `IntegrationError` for a run that does not come to its end in time.
    """
    mode = default_mode()
    with environment(SOFTMPC_COMPILE="never"):
        began = time.perf_counter()
        own = _Arm.of(task, configuration)
        own.first()
        found: Numbers = {"build_s": time.perf_counter() - began}
    if mode == "require":
        with tempfile.TemporaryDirectory() as cache, environment(SOFTMPC_CACHE=cache):
            began = time.perf_counter()
            own = own.again()
            found["compile_s"] = time.perf_counter() - began
            return found | _measured(task, configuration, own)
    return found | _measured(task, configuration, own)


def _measured(task: Task, configuration: Configuration, own: _Arm) -> Numbers:
    took = own.whole(PATIENCE[task.quick])
    found: Numbers = {"memory_mib": memory_mib()}
    with environment(SOFTMPC_COMPILE="never"):
        given = made_once("motion", task, lambda: own.as_given(task, configuration.variant))
        took += given.whole(PATIENCE[task.quick])
    repeats = int(np.clip(SPEND[task.quick] / took, FEWEST, MOST))
    times = by_turns(own.whole, given.whole, repeats, first=False)
    second = own.settings.duration
    for key in ("time_s", "spread_s", "beside_s"):
        times[key] /= second
    cost = Cost.of(own.model, times["time_s"] * second)
    found |= times | {"instructions": cost.instructions, "states": cost.states}
    return found | _calls(own.model)


@dataclass(frozen=True, eq=False)
class _Arm:
    """An arm at the start of its motion, and what moves it."""

    model: Model
    settings: SimulationSettings
    x: np.ndarray
    integrator: Integrator

    @classmethod
    def of(cls, task: Task, configuration: Configuration) -> _Arm:
        document = configuration.document(task)
        model = model_with(scene_from_dict(document), configuration.variant)
        settings = settings_of(task, document, model)
        x = start_state(model, settings.profile, settings.start)
        return cls(model, settings, x, integrator_of(model, settings))

    def again(self, settings: SimulationSettings | None = None) -> _Arm:
        """The same with an integrator made anew, in the mode of compilation that now holds."""
        settings = self.settings if settings is None else settings
        return _Arm(self.model, settings, self.x, integrator_of(self.model, settings))

    def as_given(self, task: Task, variant: str) -> _Arm:
        """The scene as given, with this model where that is the same."""
        document = dict(task.document)
        scene = scene_from_dict(document)
        if variant or self.model.scene != scene:
            return _Arm.of(task, AS_GIVEN)
        return self.again(settings_of(task, document, self.model))

    def first(self) -> None:
        """Up to the first sample."""
        settings = replace(self.settings, duration=self.settings.sample_time)
        run(self.integrator, settings, self.x, inf)

    def whole(self, patience: float = inf) -> float:
        """The whole motion; returns how long it took (s)."""
        began = time.perf_counter()
        run(self.integrator, self.settings, self.x, patience)
        return time.perf_counter() - began


def _calls(model: Model) -> Numbers:
    """Microseconds of a call, the median of some."""
    n, p = model.strains, np.zeros(model.scene.manipulator.units)
    at = [np.full(n, 0.1), np.full(n, 0.1), np.full(n, 0.1), p]
    pairs = (("residual_us", model.residual), ("jacobian_us", model.residual_jacobian))
    found = {}
    for name, function in pairs:
        seconds = by_turns(lambda f=function: f(*at), lambda: None, CALLS)  # type: ignore[misc]
        found[name] = 1e6 * seconds["time_s"]
    return found
