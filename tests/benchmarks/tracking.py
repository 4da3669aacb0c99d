"""Closed loops of the paper's arm: `python -m tests.benchmarks.tracking [NAME …]`.

Two sections of one segment with their hydraulics (34 states), 25 ms, 20 intervals, real-time
iteration; the plant is the same scene, integrated by IDAS at a tolerance of 1e-9. Paths:

    eight    figure eight, 80 mm wide, 4 s a lap
    circle   circle of 80 mm, 4 s a lap
    fast     circle of 120 mm, 1.5 s a lap
    edge     circle of 80 mm at z = 0.50 m, partly out of reach, the nearest places followed
    void     circle of 80 mm at z = 0.45 m, in the void around the axis, nearest places followed
    jump     circle of 160 mm at z = 0.50 m, in reach, but of one posture only
    across   line of 160 mm at z = 0.45 m through that void: the nearest place jumps

Errors are those from what is followed, after the first second and but for 0.5 s after a jump. "at
rest" is the total variation of the torques that hold the path at rest. "converged" is the cost of
the same loop with the problem solved to convergence in every step, over that of real-time
iteration; it takes a minute, so only with the name "converged".
"""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np

from softmpc.control.baselines import converged
from softmpc.control.paths import Circle, FigureEight, Line, Reference, TimeLaw
from softmpc.control.track_result import TrackResult
from softmpc.control.track_scene import Plant, Tracking
from softmpc.control.tracking import set_up
from softmpc.model.presets import chen2022
from softmpc.model.scene import Scene
from softmpc.simulation.methods import Method

PATHS = {
    "eight": (FigureEight((0.12, 0.0, 0.57), 0.08, 0.04), TimeLaw(4.0, 2.0)),
    "circle": (Circle((0.12, 0.0, 0.57), 0.08), TimeLaw(4.0, 2.0)),
    "fast": (Circle((0.12, 0.0, 0.57), 0.12), TimeLaw(1.5, 4.0)),
    "edge": (Circle((0.54, 0.0, 0.50), 0.08), TimeLaw(4.0, 2.0)),
    "void": (Circle((0.06, 0.0, 0.45), 0.08), TimeLaw(4.0, 2.0)),
    "jump": (Circle((0.12, 0.0, 0.50), 0.16), TimeLaw(4.0, 2.0)),
    "across": (Line((-0.08, 0.01, 0.45), (0.08, 0.01, 0.45)), TimeLaw(4.0, 2.0)),
}
COLUMNS = "path        RMS (mm)  max (mm)  out of reach (mm)  torques (N·m)    variation  at rest"


def task_of(name: str) -> Tracking:
    """The task of one of the paths."""
    path, law = PATHS[name]
    plant = Plant(method=Method("idas", tolerance=1e-9))
    return Tracking(Reference(path, law), plant=plant, on_infeasible="project")


def run(name: str) -> TrackResult:
    """The closed loop along one of the paths."""
    setup = set_up(Scene(chen2022()), task_of(name))
    return setup.run(setup.controller)


def measured(result: TrackResult) -> dict[str, float]:
    """Errors and distances (mm), torques (N·m), times of a step (ms)."""
    off = 1e3 * result.reachable_error[result.counted]
    far = 0.0 if result.out_of_reach is None else 1e3 * float(result.out_of_reach.max())
    took = dict(zip(("50", "95", "100"), np.percentile(result.step_ms, (50, 95, 100)), strict=True))
    return {
        "rms_mm": float(np.sqrt(np.mean(off**2))),
        "max_mm": float(off.max()),
        "out_of_reach_mm": far,
        "least_torque_nm": float(result.u.min()),
        "most_torque_nm": float(result.u.max()),
        "variation_nm": result.variation,
        "variation_at_rest_nm": result.rest_variation or 0.0,
        "failed_count": result.failures,
        **{f"step_ms_{share}": float(ms) for share, ms in took.items()},
    }


def line(name: str, result: TrackResult) -> str:
    """One line of the table."""
    found = measured(result)
    torques = f"{found['least_torque_nm']:.3f} to {found['most_torque_nm']:.3f}"
    took = " ".join(f"{found[f'step_ms_{share}']:.1f}" for share in (50, 95, 100))
    return (
        f"{name:<10} {found['rms_mm']:9.4f} {found['max_mm']:9.4f} "
        f"{found['out_of_reach_mm']:18.1f}  {torques:<15}"
        f" {found['variation_nm']:9.2f} {found['variation_at_rest_nm']:8.2f}  "
        f"{took} ms, {found['failed_count']} failed, "
        f"jumps {np.round(() if result.jumps is None else result.jumps, 2).tolist()}"
    )


def numbers(quick: bool) -> dict[str, float]:
    """Figure eight, fast circle and edge in quick mode; else all paths, and beside convergence."""
    found = {
        f"{name}_{what}": value
        for name in (("eight", "fast", "edge") if quick else PATHS)
        for what, value in measured(run(name)).items()
    }
    if not quick:
        found["cost_over_converged"] = beside_converged()[3]
    return found


def beside_converged() -> tuple[int, float, float, float]:
    """Steps of the figure eight, its cost by real-time iteration and converged, their ratio."""
    path, _ = PATHS["eight"]
    task = replace(task_of("eight"), reference=Reference(path, TimeLaw(4.0, 0.875)))
    setup = set_up(Scene(chen2022()), task)
    quick, slow = setup.run(setup.controller), setup.run(converged(setup.ocp))
    both = quick.cost or 0.0, slow.cost or 1.0
    return len(quick.u), *both, both[0] / both[1]


def main() -> None:
    """Print the table."""
    names = sys.argv[1:] or list(PATHS)
    print(f"{COLUMNS}  step 50, 95, 100 %")
    for name in names:
        if name == "converged":
            steps, quick, slow, ratio = beside_converged()
            print(f"{steps} steps: cost {quick:.5f} by real-time iteration, {slow:.5f} converged: "
                  f"ratio {ratio:.6f}", flush=True)  # fmt: skip
        else:
            print(line(name, run(name)), flush=True)


if __name__ == "__main__":
    main()
