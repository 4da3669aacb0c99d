"""How fast and how exact simulation is: `python -m tests.benchmarks.simulating [segments …]`.

For the paper's step of Fig. 12 and ramps of Figs 8 and 14, with full hydraulics: times real time in
CasADi's virtual machine and compiled, and the largest distance of a section tip from a reference
(IDAS at 1e-10). Then what one implicit step costs with the number of segments and with what a scene
has, and the time from the start of the process to the result. Times are medians.
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile
import time
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from softmpc import StaticDrive, load_scene
from softmpc.model.counting import executed
from softmpc.model.drive_effects import ChamberCoupling
from softmpc.model.model import Model, build
from softmpc.model.scene_file import read_document
from softmpc.simulation.cvodes import Cvodes
from softmpc.simulation.inputs import InputProfile
from softmpc.simulation.run import simulate, start_state
from softmpc.simulation.runge_kutta import RadauIIA
from softmpc.simulation.settings import read_settings

EXAMPLES = Path(__file__).parents[2] / "examples"
SCENES = ("step_fig12", "ramp_fig8", "ramp_fig14")
RUNS = 5


def median_time(work: Any) -> float:
    times = []
    for _ in range(RUNS):
        began = time.perf_counter()
        work()
        times.append(time.perf_counter() - began)
    return statistics.median(times)


def motion_of(name: str, segments: int) -> tuple[Model, Any]:
    path = EXAMPLES / f"{name}.toml"
    model = build(load_scene(path).with_(segments=segments))
    return model, read_settings(read_document(path), model, path.parent)


def speed_table(segments: list[int]) -> None:
    print("segments  scene        set up  virtual machine   compiled          error")
    print("a section              s       × real time       × real time       mm")
    for count in segments:
        for name in SCENES:
            model, settings = motion_of(name, count)
            profile, duration = settings.profile, settings.duration
            reference = simulate(model, profile, duration, method="idas", tolerance=1e-10)
            row = []
            for mode in ("never", "require"):
                os.environ["SOFTMPC_COMPILE"] = mode
                runs = [simulate(model, profile, duration) for _ in range(RUNS)]
                row.append(duration / statistics.median(run.wall_s for run in runs))
                error = np.linalg.norm(runs[0].tips - reference.tips, axis=2).max()
                setup = runs[-1].setup_s
            print(
                f"{count:9d}  {name:11}  {setup:6.2f}  {row[0]:15.0f}   {row[1]:15.0f}   "
                f"{1e3 * error:.4f}",
                flush=True,
            )
    os.environ.pop("SOFTMPC_COMPILE")


def scene_table() -> None:
    """One implicit step of scenes that have less, and a run under CVODES, drive included."""
    whole = load_scene(EXAMPLES / "ramp_fig14.toml")
    still = tuple(
        e for e in whole.effects if e.name not in ("inertia", "coriolis", "rotary_inertia")
    )
    flat = tuple(e for e in whole.effects if e.name != "rotary_inertia")
    plane = ("epsilon", "kappa_y")
    scenes = {
        "as given": whole,
        "no hydraulics (static drive)": whole.with_(actuation=StaticDrive()),
        "planar": whole.with_(strains=plane, effects=flat),
        "quasi-static": whole.with_(effects=still),
        "planar, quasi-static, static drive": whole.with_(
            strains=plane, effects=still, actuation=StaticDrive()
        ),
        "with chamber_coupling": whole.with_(effects=(*whole.effects, ChamberCoupling())),
    }
    print("\nscene                               states  one step        CVODES, 1 s of ramp")
    print("                                            µs     factor   s       factor")
    os.environ["SOFTMPC_COMPILE"] = "never"
    first: list[float] = []
    for name, scene in scenes.items():
        model = build(scene)
        rest, end = start_state(model, InputProfile.of(6)), np.array([0.4, 0, 0, 0, 0, 0])
        method = RadauIIA(model, step=0.01)
        step = 1e6 * median_time(partial(method.advance, rest, 0 * end, 0.5, 1, end)) / 50
        run = float("nan")
        if model.order == 2:
            cvodes = Cvodes(model, 1e-6)
            run = median_time(partial(cvodes.advance, rest, 0 * end, 1.0, 1, 2 * end))
        first = first or [step, run]
        states = len(model.layout.x) if model.order == 2 else len(model.layout.q + model.layout.z)
        print(
            f"{name:35} {states:6d}  {step:5.0f}  {step / first[0]:6.2f}   {run:.4f}  "
            f"{run / first[1]:6.3f}",
            flush=True,
        )
    os.environ.pop("SOFTMPC_COMPILE")


def growth_table(segments: list[int]) -> None:
    print("\nsegments   residual      Jacobian      one step (virtual machine)")
    print("a section  instructions  instructions  µs   against the row above")
    os.environ["SOFTMPC_COMPILE"] = "never"
    before = None
    for count in segments:
        model, settings = motion_of("ramp_fig14", count)
        rest = start_state(model, settings.profile)
        method = RadauIIA(model, step=0.01)
        ramp = partial(method.advance, rest, settings.profile(2.0), 0.5, 1, settings.profile(2.5))
        ramp()
        each = 1e6 * median_time(ramp) / 50
        growth = "" if before is None else f"{each / before:.2f}"
        counts = (executed(model.residual), executed(model.residual_jacobian))
        print(f"{count:9d}  {counts[0]:12,d}  {counts[1]:12,d}  {each:6.0f}  {growth}", flush=True)
        before = each
    os.environ.pop("SOFTMPC_COMPILE")


def start_to_result() -> None:
    command = [sys.executable, "-m", "softmpc.cli", "simulate", str(EXAMPLES / "step_fig12.toml")]
    print("\nfrom the start of the process to the result, step_fig12 (10 s of motion)")
    with tempfile.TemporaryDirectory() as cache:
        for mode in ("never", "require", "require"):
            variables = {**os.environ, "SOFTMPC_COMPILE": mode, "SOFTMPC_CACHE": cache}
            before = ", compiled before" if any(Path(cache).iterdir()) else ""
            began = time.perf_counter()
            subprocess.run(command, check=True, capture_output=True, env=variables)
            print(
                f"  SOFTMPC_COMPILE={mode:8} {time.perf_counter() - began:6.2f} s{before}",
                flush=True,
            )


if __name__ == "__main__":
    chosen = [int(word) for word in sys.argv[1:]] or [1, 2, 4, 8]
    speed_table(chosen)
    growth_table(chosen)
    scene_table()
    start_to_result()
