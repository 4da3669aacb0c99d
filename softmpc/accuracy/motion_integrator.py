"""The axis of integrators: methods, tolerances and steps on the scene as given."""

from __future__ import annotations

from collections.abc import Iterator
from math import ceil, gcd
from typing import Any

import numpy as np

from softmpc.accuracy.configuration import Configuration, Task
from softmpc.accuracy.motion_task import model_of, settings_of
from softmpc.model.model import Model
from softmpc.simulation.run import CHUNK
from softmpc.simulation.settings import SimulationSettings

__all__ = ["INTEGRATOR", "integrator_axis", "steps_between"]

INTEGRATOR = "integrator"
TOLERANCES = {  # method -> the key of its tolerance, and values
    "radau": ("tip_tolerance", (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8)),
    "radau-2": ("tip_tolerance", (1e-3, 1e-4, 1e-5, 1e-6)),
    "idas": ("tolerance", (1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9)),
    "cvodes": ("tolerance", (1e-4, 1e-6, 1e-8)),
}
QUICK = {"radau": (1e-4, 1e-6, 1e-8), "radau-2": (), "idas": (1e-6,), "cvodes": (1e-6,)}
ORDERS = {"radau": 5, "radau-2": 3, "gauss": 6, "gauss-2": 4}  # of a smooth motion
QUICK_ORDERS = ("radau",)
LONGEST_STEP = 0.04  # s
HALVINGS = {True: 3, False: 5}  # steps of a series, by `quick`
RESOLVED = 1.0  # a step times the drive's fastest pole, up to which its motion is smooth
TICK = 1e-9  # s: times are whole numbers of these


def integrator_axis(task: Task) -> Iterator[Configuration]:
    """Tolerances of the methods that have one, then steps of those that keep it."""
    document = dict(task.document)
    model = model_of(document)
    for method, (key, values) in TOLERANCES.items():
        for value in QUICK[method] if task.quick else values:
            series = f"{method} by its tolerance"
            name = f"{method}, {key.replace('_', ' ')} {value:g}{' m' if 'tip' in key else ''}"
            yield Configuration(INTEGRATOR, name, _method(method, key, value), series, value)
    steps = steps_between(settings_of(task, document, model), HALVINGS[task.quick])
    for method in QUICK_ORDERS if task.quick else ORDERS:
        order = ORDERS[method]
        theory = float(order) if _is_smooth(model, max(steps)) else None
        for step in steps:
            name = f"{method}, step {1e3 * step:g} ms"
            own = _method(method, "step", step)
            yield Configuration(INTEGRATOR, name, own, f"{method} by its step", step, theory)


def _method(method: str, key: str, value: float) -> dict[str, Any]:
    numbers: dict[str, Any] = dict.fromkeys(("tip_tolerance", "tolerance", "step")) | {key: value}
    return {"simulate.method": method} | {f"simulate.{k}": v for k, v in numbers.items()}


def steps_between(settings: SimulationSettings, count: int) -> list[float]:
    """Steps (s), each half of the one before, that fit between all times at which a run is cut."""
    times = [*settings.profile.breakpoints, settings.duration]
    if settings.duration > CHUNK * settings.sample_time:
        times.append(CHUNK * settings.sample_time)
    inside = [t for t in times if 0 < t <= settings.duration]
    whole = gcd(*(round(t / TICK) for t in inside)) * TICK
    first = whole / ceil(whole / LONGEST_STEP - 1e-6)
    return [float(np.round(first / 2**k, 12)) for k in range(count)]


def _is_smooth(model: Model, step: float) -> bool:
    """Whether steps resolve what the drive does after a jump of its input.

    Elsewhere its fast modes are gone within a step, and methods lose order.
    """
    if not model.drive_is_linear:
        return False
    poles = np.linalg.eigvals(model.drive.A) if len(model.drive.A) else np.zeros(1)
    return bool(np.abs(poles).max() * step <= RESOLVED)
