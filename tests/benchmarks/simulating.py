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
from collections.abc import Callable
from functools import partial, wraps
from typing import Any

import numpy as np

from softmpc import Scene, StaticDrive, load_scene
from softmpc.compiler import compiler
from softmpc.model.counting import executed
from softmpc.model.drive_effects import ChamberCoupling
from softmpc.model.model import Model, build
from softmpc.model.scene_file import read_document
from softmpc.simulation.cvodes import Cvodes
from softmpc.simulation.inputs import InputProfile
from softmpc.simulation.run import simulate, start_state
from softmpc.simulation.runge_kutta import RadauIIA
from softmpc.simulation.settings import read_settings
from tests.benchmarks.common import EXAMPLES, key, median_seconds, seconds_of

SCENES = ("step_fig12", "ramp_fig8", "ramp_fig14")
RUNS = 5
# SOFTMPC_COMPILE -> what its speed is called.
MODES = {"never": "times_real_time_ratio", "require": "compiled_times_real_time_ratio"}
STARTS = {"virtual machine": "never", "compiling": "require", "compiled before": "require"}


def uncompiled(work: Callable[..., Any]) -> Callable[..., Any]:
    """The same work in CasADi's virtual machine."""

    @wraps(work)
    def run(*given: Any) -> Any:
        os.environ["SOFTMPC_COMPILE"] = "never"
        try:
            return work(*given)
        finally:
            os.environ.pop("SOFTMPC_COMPILE")

    return run


def motion_of(name: str, segments: int) -> tuple[Model, Any]:
    path = EXAMPLES / f"{name}.toml"
    model = build(load_scene(path).with_(segments=segments))
    return model, read_settings(read_document(path), model, path.parent)


def speed(name: str, segments: int) -> dict[str, float]:
    """One motion: seconds to set up, times real time by how it is run, error (mm)."""
    model, settings = motion_of(name, segments)
    profile, duration = settings.profile, settings.duration
    reference = simulate(model, profile, duration, method="idas", tolerance=1e-10)
    found: dict[str, float] = {}
    for mode in MODES if compiler() else ("never",):
        os.environ["SOFTMPC_COMPILE"] = mode
        runs = [simulate(model, profile, duration) for _ in range(RUNS)]
        found[MODES[mode]] = duration / statistics.median(run.wall_s for run in runs)
        error = np.linalg.norm(runs[0].tips - reference.tips, axis=2).max()
        found |= {"set_up_s": runs[-1].setup_s, "error_mm": 1e3 * float(error)}
    os.environ.pop("SOFTMPC_COMPILE")
    return found


def scenes() -> dict[str, Scene]:
    """Scenes that have less or more than the ramp of Fig. 14."""
    whole = load_scene(EXAMPLES / "ramp_fig14.toml")
    still = tuple(
        e for e in whole.effects if e.name not in ("inertia", "coriolis", "rotary_inertia")
    )
    flat = tuple(e for e in whole.effects if e.name != "rotary_inertia")
    plane = ("epsilon", "kappa_y")
    return {
        "as given": whole,
        "no hydraulics (static drive)": whole.with_(actuation=StaticDrive()),
        "planar": whole.with_(strains=plane, effects=flat),
        "quasi-static": whole.with_(effects=still),
        "planar, quasi-static, static drive": whole.with_(
            strains=plane, effects=still, actuation=StaticDrive()
        ),
        "with chamber_coupling": whole.with_(effects=(*whole.effects, ChamberCoupling())),
    }


@uncompiled
def step_of(scene: Scene) -> tuple[int, float, float]:
    """States; one implicit step (µs); 1 s of ramp under CVODES, drive included (s)."""
    model = build(scene)
    rest, end = start_state(model, InputProfile.of(6)), np.array([0.4, 0, 0, 0, 0, 0])
    method = RadauIIA(model, step=0.01)
    step = median_seconds(partial(method.advance, rest, 0 * end, 0.5, 1, end), RUNS)
    run = float("nan")
    if model.order == 2:
        cvodes = Cvodes(model, 1e-6)
        run = median_seconds(partial(cvodes.advance, rest, 0 * end, 1.0, 1, 2 * end), RUNS)
    states = len(model.layout.x) if model.order == 2 else len(model.layout.q + model.layout.z)
    return states, 1e6 * step / 50, run


@uncompiled
def growth(segments: int) -> dict[str, float]:
    """Counts, and one implicit step in CasADi's virtual machine (µs)."""
    model, settings = motion_of("ramp_fig14", segments)
    rest = start_state(model, settings.profile)
    method = RadauIIA(model, step=0.01)
    ramp = partial(method.advance, rest, settings.profile(2.0), 0.5, 1, settings.profile(2.5))
    ramp()
    return {
        "residual_instructions": executed(model.residual),
        "jacobian_instructions": executed(model.residual_jacobian),
        "implicit_step_us": 1e6 * median_seconds(ramp, RUNS) / 50,
    }


def start_to_result() -> dict[str, float]:
    """Seconds from the start of the process to the result of step_fig12 (10 s of motion)."""
    command = [sys.executable, "-m", "softmpc.cli", "simulate", str(EXAMPLES / "step_fig12.toml")]
    found: dict[str, float] = {}
    with tempfile.TemporaryDirectory() as cache:
        for name, mode in STARTS.items() if compiler() else [*STARTS.items()][:1]:
            variables = {**os.environ, "SOFTMPC_COMPILE": mode, "SOFTMPC_CACHE": cache}
            run = partial(subprocess.run, command, check=True, capture_output=True, env=variables)
            found[name] = seconds_of(run)
    return found


# ---------------------------------------------------------------- what is told


def numbers(quick: bool) -> dict[str, float]:
    """Speed at one segment (quick) or 1 to 8, growth with them, scenes, start to result."""
    found: dict[str, float] = {}
    for count in (1,) if quick else (1, 2, 4, 8):
        for name in SCENES:
            for what, value in speed(name, count).items():
                found[key(name, count, "segments", what)] = value
    for count in (1, 2, 4) if quick else (1, 2, 4, 8):
        found |= {key(count, "segments", what): v for what, v in growth(count).items()}
    steps = {name: step_of(scene)[1] for name, scene in scenes().items()}
    whole = steps.pop("as given")
    found |= {key("step_time_ratio", name): us / whole for name, us in steps.items()}
    return found | {key("start to result", name, "s"): s for name, s in start_to_result().items()}


def speed_table(segments: list[int]) -> None:
    print("segments  scene        set up  virtual machine   compiled          error")
    print("a section              s       × real time       × real time       mm")
    for count in segments:
        for name in SCENES:
            found = speed(name, count)
            fast = found.get(MODES["require"], np.nan)
            print(
                f"{count:9d}  {name:11}  {found['set_up_s']:6.2f}  {found[MODES['never']]:15.0f}   "
                f"{fast:15.0f}   {found['error_mm']:.4f}",
                flush=True,
            )


def growth_table(segments: list[int]) -> None:
    print("\nsegments   residual      Jacobian      one step (virtual machine)")
    print("a section  instructions  instructions  µs   against the row above")
    before = None
    for count in segments:
        *counts, each = growth(count).values()
        told = "" if before is None else f"{each / before:.2f}"
        print(f"{count:9d}  {counts[0]:12,d}  {counts[1]:12,d}  {each:6.0f}  {told}", flush=True)
        before = each


def scene_table() -> None:
    """One implicit step of scenes that have less, and a run under CVODES, drive included."""
    print("\nscene                               states  one step        CVODES, 1 s of ramp")
    print("                                            µs     factor   s       factor")
    first: list[float] = []
    for name, scene in scenes().items():
        states, step, run = step_of(scene)
        first = first or [step, run]
        print(
            f"{name:35} {states:6d}  {step:5.0f}  {step / first[0]:6.2f}   {run:.4f}  "
            f"{run / first[1]:6.3f}",
            flush=True,
        )


def main(segments: list[int]) -> None:
    """Print the tables."""
    speed_table(segments)
    growth_table(segments)
    scene_table()
    print("\nfrom the start of the process to the result, step_fig12 (10 s of motion)")
    for name, seconds in start_to_result().items():
        print(f"  {name:22} {seconds:6.2f} s", flush=True)


if __name__ == "__main__":
    main([int(word) for word in sys.argv[1:]] or [1, 2, 4, 8])
