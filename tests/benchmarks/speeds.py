"""How fast a path may be: the estimate before the run beside the closed loop.

    python -m tests.benchmarks.speeds

Circle of 120 mm and figure eight of 80 mm, from 1.5 to 0.2 s a lap, 3 s each; the default
controller (25 ms, N = 20), plant = model, IDAS. RMS of the tip error after the first second; the
estimate is without its factor `MEASURED`, which comes from the last column.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from softmpc.control.at_speed import MEASURED, AtSpeed
from softmpc.control.paths import Circle, FigureEight, Reference, TimeLaw
from softmpc.control.response import Response
from softmpc.control.tracking import set_up
from softmpc.model.presets import chen2022
from softmpc.model.scene import Scene
from tests.benchmarks.common import key
from tests.benchmarks.tracking import task_of

CENTER = (0.12, 0.0, 0.57)
PATHS = {"circle": Circle(CENTER, 0.12), "eight": FigureEight(CENTER, 0.08, 0.04)}
LAPS = (1.5, 0.6, 0.4, 0.3, 0.25, 0.2)  # s


def measured(name: str, lap: float) -> dict[str, Any]:
    """One path at one speed: the estimate and what came (mm), torques (N·m), what was named."""
    reference = Reference(PATHS[name], TimeLaw(lap, 3.0 / lap))
    setup = set_up(Scene(chen2022()), replace(task_of("circle"), reference=reference))
    rest = setup.preflight.rest
    response = Response(setup.plant.model, rest.middle.q, rest.middle.pressures)
    fast = AtSpeed(rest, response, setup.ocp)
    estimate = 1e3 * float(np.sqrt(np.mean(fast.off**2))) / MEASURED
    result = setup.run(setup.controller)
    error = 1e3 * result.error[result.time >= result.settle]
    rms = float(np.sqrt(np.mean(error**2)))
    return {
        "estimate_mm": estimate,
        "rms_mm": rms,
        "max_mm": float(error.max()),
        "at_limit_share": float(np.mean((result.u < 1e-6) | (result.u > 2.5 - 1e-6))),
        "least_torque_nm": float(fast.u.min()),
        "most_torque_nm": float(fast.u.max()),
        "failed_count": result.failures,
        "rms_over_estimate": rms / estimate,
        "named": ", ".join(sorted({one.kind for one in setup.preflight.findings})) or "-",
    }


def numbers(quick: bool) -> dict[str, float]:
    """The circle at 0.4 s a lap in quick mode; else both paths at all speeds."""
    cases = [("circle", 0.4)] if quick else [(name, lap) for name in PATHS for lap in LAPS]
    return {
        key(name, f"{1e3 * lap:.0f}", "ms a lap", what): value
        for name, lap in cases
        for what, value in measured(name, lap).items()
        if what != "named"
    }


def row(name: str, lap: float) -> str:
    """One line of the table."""
    found = measured(name, lap)
    return (
        f"{name:7} {lap:5.2f} {found['estimate_mm']:10.3f} {found['rms_mm']:8.3f} "
        f"{found['max_mm']:8.3f} {100 * found['at_limit_share']:9.1f} "
        f"{found['least_torque_nm']:8.2f} {found['most_torque_nm']:6.2f} "
        f"{found['failed_count']:7d}  {found['rms_over_estimate']:8.1f}  {found['named']}"
    )


def main() -> None:
    """Print the table."""
    print("path     s/lap  estimate  RMS (mm) max (mm)  at limit %  u from     to  failed  "
          "RMS/estimate  named before the run")  # fmt: skip
    for name in PATHS:
        for lap in LAPS:
            print(row(name, lap), flush=True)


if __name__ == "__main__":
    main()
