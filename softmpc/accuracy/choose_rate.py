"""Does it keep the rate? What has to fit into 1/rate, and how long that takes."""

from __future__ import annotations

import re
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from softmpc.accuracy.work import Case, Measure
from softmpc.errors import InputError
from softmpc.model.model import build
from softmpc.model.scene_file import scene_from_dict
from softmpc.simulation.methods import integrator_for
from softmpc.simulation.run import start_state
from softmpc.simulation.settings import read_settings

__all__ = ["AtRate", "at_rate", "rate_hz", "rate_text", "step_time_s"]

HERTZ = {"Hz": 1.0, "kHz": 1e3}
FORM = re.compile(r"\s*([0-9.eE+-]+)\s*([a-zA-Z]+)\s*")
LOWEST, HIGHEST = 0.1, 1e5  # Hz
MOST = 95  # per cent of the steps that have to keep the rate
LONGEST = 400  # steps that are timed


def rate_hz(text: str) -> float:
    """The rate in Hz of a text such as 100Hz; raises `InputError` for what is none."""
    allowed = "a number with its unit, like 100Hz, 40 Hz or 0.1kHz"
    match = FORM.fullmatch(text)
    if not match or match[2] not in HERTZ:
        raise InputError(f"rate {text!r}: must be {allowed}")
    try:
        value = float(match[1]) * HERTZ[match[2]]
    except ValueError:
        raise InputError(f"rate {text!r}: {match[1]!r} is no number; must be {allowed}") from None
    if not LOWEST <= value <= HIGHEST:
        raise InputError(f"rate {text!r} = {value:g} Hz: must be between 0.1 Hz and 100 kHz")
    return value


def rate_text(hertz: float) -> str:
    """A rate for people."""
    return f"{hertz:g} Hz"


def step_time_s(family: str, cost: Mapping[str, Any]) -> float | None:
    """What has to fit into 1/rate (s): of a loop the 95 % that its cost is, else see `AtRate`."""
    key = "step_s" if family == "motion" else "time_s"
    return cost.get(key)


def at_rate(case: Case, hertz: float) -> Case:
    """The case whose cost is the time to advance by 1/rate."""
    own = replace(case.configuration, variant=rate_text(hertz), compile="auto")
    return replace(case, configuration=own)


@dataclass(frozen=True)
class AtRate(Measure):
    """The time to advance a motion by 1/rate, for 95 % of the steps of the scene's motion.

    One call a step, as a program does that waits for the next input. The motion is run twice, and
    the second time counts: what is made or compiled on the way is then there.
    """

    rate_hz: float = 100.0

    def _numbers(self, case: Case) -> dict[str, Any]:
        document = case.configuration.document(self.task)
        model = build(scene_from_dict(document))
        settings = read_settings(document, model, Path(self.task.folder))
        numbers = {key: getattr(settings, key) for key in ("tip_tolerance", "tolerance", "step")}
        integrator = integrator_for(model, settings.method, **numbers)
        start = start_state(model, settings.profile, settings.start)
        integrator.prepare()
        step = 1.0 / self.rate_hz
        count = max(1, min(LONGEST, int(settings.duration / step + 1e-9)))
        times: list[float] = []
        for _ in range(2):
            x, times = start, []
            for k in range(count):
                u = settings.profile(np.array([k * step]))[0]
                began = time.perf_counter()
                x = integrator.advance(x, u, step, 1)[-1]
                times.append(time.perf_counter() - began)
        return {"step_s": float(np.percentile(times, MOST)), "steps": count}
