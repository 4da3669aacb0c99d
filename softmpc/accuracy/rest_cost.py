"""What a model costs that finds rests: its functions, built and called, and one rest."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np

from softmpc.accuracy.configuration import Configuration, Task
from softmpc.accuracy.made_once import made_once
from softmpc.accuracy.motion_variants import PRINTED_RATES, model_with
from softmpc.accuracy.timing import by_turns, memory_mib
from softmpc.errors import BuildError
from softmpc.model.counting import executed
from softmpc.model.model import Model, build
from softmpc.model.scene_file import scene_from_dict
from softmpc.statics.equilibrium import find_equilibrium

__all__ = ["rest_cost"]

REPEATS = {True: 15, False: 31}  # by `quick`
SAMPLE = 2e-3  # s of calls, a measurement
MOST_CALLS = 1000
SHARE = 0.3  # of full pressure, where a rest is found
# In all, where CasADi differentiates the whole arm: beyond, its Jacobian takes minutes.
MOST_SEGMENTS = {"newton-euler": 2, "newton-euler-full": 2, PRINTED_RATES: 4}
Numbers = dict[str, Any]


def rest_cost(task: Task, configuration: Configuration) -> Numbers:
    """Times of a configuration, beside those of the scene as given.

    `time_s` is a call of the residual and of its Jacobian, `build_s` the time to make both, with no
    function made before, `rest_s` that of one rest, found from the straight arm. Raises
    `BuildError` where the Jacobian is too large to be made in a minute.
    """
    scene = scene_from_dict(configuration.document(task))
    began = time.perf_counter()
    own = model_with(scene, configuration.variant)
    _check_size(own, configuration.variant or scene.formulation.name)
    functions = (own.residual, own.residual_jacobian)
    found: Numbers = {"build_s": time.perf_counter() - began}
    call = _calling(own)
    given = made_once("rest", task, lambda: _calling(_as_given(task)))
    call()
    began = time.perf_counter()
    call()
    calls = int(np.clip(SAMPLE / max(time.perf_counter() - began, 1e-9), 1, MOST_CALLS))
    found |= by_turns(call, given, REPEATS[task.quick], calls)
    found["instructions"] = sum(executed(each) for each in functions)
    return found | {"rest_s": _rest_time(own), "memory_mib": memory_mib()}


def _as_given(task: Task) -> Model:
    return build(task.scene)


def _check_size(model: Model, what: str) -> None:
    segments = len(model.chain.segments)
    if segments > MOST_SEGMENTS.get(what, segments):
        raise BuildError(
            f"not timed: the Jacobian of {what!r} is differentiated as a whole, which takes "
            f"minutes for {segments} segments in all"
        )


def _calling(model: Model) -> Callable[[], None]:
    """One call of the residual and of its Jacobian, without a conversion of numbers."""
    n, p = model.strains, np.full(model.scene.manipulator.units, 1e5)
    at = [np.full(n, 0.1), np.full(n, 0.1), np.full(n, 0.1), p]
    runs = [_runner(function, at) for function in (model.residual, model.residual_jacobian)]

    def call() -> None:
        for run in runs:
            run()

    return call


def _runner(function: ca.Function, arguments: list[np.ndarray]) -> Callable[[], Any]:
    """A call of a function with these arguments, its results thrown away."""
    buffer: Any
    buffer, run = function.buffer()
    results = [np.zeros(function.nnz_out(i)) for i in range(function.n_out())]
    for i, argument in enumerate(arguments):
        buffer.set_arg(i, argument.data)
    for i, result in enumerate(results):
        buffer.set_res(i, result.data)

    def call(kept: Any = (buffer, arguments, results)) -> None:  # as long as it is called
        run()

    return call


def _rest_time(model: Model) -> float:
    """Time (s) to find one rest, with all functions made."""
    limits = model.scene.manipulator.limits
    low, high = limits.pressure_min, limits.pressure_max
    p = np.full(model.scene.manipulator.units, low + SHARE * (high - low))
    p[::2] = low  # so that the arm bends
    find_equilibrium(model, p)
    began = time.perf_counter()
    find_equilibrium(model, p)
    return time.perf_counter() - began
