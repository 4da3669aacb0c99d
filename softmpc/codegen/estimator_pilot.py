"""Estimator, supervision and their times as C: all that a rig's controller needs beside the MPC.

Times of the supervision become whole ticks with the same comparisons as in Python, so that both
change their states at the same tick.
"""

from __future__ import annotations

from collections.abc import Callable

from softmpc.codegen import c_text, estimator_data
from softmpc.codegen.directory import c_source
from softmpc.codegen.estimator_data import Window
from softmpc.estimation.sensors import TICK
from softmpc.rig.pilot import DOUBTFUL, Pilot

__all__ = ["files", "window_of"]

SOURCES = (
    "estimator.h", "estimator_parts.h", "supervision.h", "pilot.h", "estimator.c",
    "estimator_drive.c", "estimator_knots.c", "estimator_step.c", "estimator_views.c", "kalman.c",
    "readings.c", "supervision.c", "pilot.c", "board/pilot_main.c",
)  # fmt: skip
LOG = 16  # transitions that the supervisor remembers
NEVER = 2**31 - 1


def window_of(pilot: Pilot, late: float | None = None) -> Window:
    """What the estimator remembers: readings up to `late` (s) beyond the latency of their sensors,
    a step of the controller without it."""
    step = round(pilot.mpc.ocp.step / TICK)
    return Window(step, None if late is None else round(late / TICK))


def files(pilot: Pilot, late: float | None = None) -> dict[str, str]:
    """Names and texts of all files of a pilot beside those of its MPC.

    `late` is as in `window_of`. Raises `InputError` where a sensor cannot be written as C.
    """
    found = {name: c_source(name) for name in SOURCES}
    found |= estimator_data.files(pilot.estimator, window_of(pilot, late))
    found["supervision_sizes.h"] = c_text.guard("supervision_sizes.h", _sizes(pilot))
    arrays = _arrays(pilot)
    lines = "".join(c_text.declaration(name, len(values), kind) for name, values, kind in arrays)
    found["pilot_data.h"] = c_text.guard("pilot_data.h", f'#include "real.h"\n\n{lines}')
    found["pilot_data.c"] = '#include "pilot_data.h"\n\n' + "".join(
        c_text.array(*one) for one in arrays
    )
    return found


def _sizes(pilot: Pilot) -> str:
    s, step = pilot.supervisor.settings, round(pilot.mpc.ocp.step / TICK)
    values: list[tuple[str, object, str]] = [
        ("SMPC_DELAY", pilot.delay, "ticks until an input acts"),
        ("SMPC_PENDING", pilot.delay // step + 2, "inputs that are on their way"),
        ("SMPC_STOP_AFTER", _first(lambda t: t * TICK >= s.stop_after), "ticks in fall-back"),
        ("SMPC_RECOVER_AFTER", _first(lambda t: t * TICK >= s.recover_after), "good ticks"),
        ("SMPC_DOUBTFUL", _first(lambda t: t * TICK >= DOUBTFUL), "ticks after a contradiction"),
        ("SMPC_FAILED_STEPS", s.failed_steps, "in a row"),
        ("SMPC_TIP_SPREAD", float(s.tip_spread), "m, standard deviation of the tip"),
        ("SMPC_RESUMES", int(s.resume), "whether it leaves a safe stop by itself"),
        ("SMPC_LOG", LOG, "transitions that are remembered"),
    ]
    return "".join(c_text.define(*one) for one in values)


def _arrays(pilot: Pilot) -> list[tuple[str, list[float], str]]:
    s, sensors = pilot.supervisor.settings, pilot.estimator.sensors
    usual = [sensor.period * TICK + sensor.latency for sensor in sensors]
    blind = [
        _silent(own, s.blind_after) if i in pilot._tips else NEVER for i, own in enumerate(usual)
    ]
    silent = [_silent(own, s.silent_after) for own in usual]
    most = pilot._scale * pilot.mpc.ocp.step / s.ramp
    return [
        ("smpc_blind_after", blind, "int"),
        ("smpc_silent_after", silent, "int"),
        ("smpc_ramp", most.tolist(), "smpc_real"),
    ]


def _silent(usual: float, limit: float) -> int:
    """The age (ticks) of a good reading at which a sensor counts as silent."""
    return _first(lambda t: t * TICK - usual > limit)


def _first(holds: Callable[[int], bool]) -> int:
    """The first tick at which something holds that holds ever after."""
    low, high = -1, 1
    while not holds(high):
        low, high = high, 2 * high
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if holds(middle) else (middle, high)
    return high
