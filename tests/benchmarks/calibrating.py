"""What a calibration computes with: `python -m tests.benchmarks.calibrating`.

How far derivatives by differences are off for each size of their steps, for poses and for a motion,
from extrapolated differences of 4e-3 and 8e-3. Then how long one arm takes alone and beside another
one, from which it borrows (`softmpc.study.arm_at`), for the paper's arm of two sections.
"""

from __future__ import annotations

import statistics
import time

import numpy as np

import softmpc.study.residuals as residuals
from softmpc import Scene, chen2022
from softmpc.simulation.inputs import InputProfile, Step
from softmpc.study.arm_at import ArmAt
from softmpc.study.calibrate import CalibrationProblem
from softmpc.study.free_parameters import FreeParameter, ParameterSpace
from tests.benchmarks.common import key
from tests.benchmarks.coverage import PROBLEMS

STEPS = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6)
RUNS = 7


def slopes(problem: CalibrationProblem, step: float) -> np.ndarray:
    """Derivatives of all predictions by differences of that step."""
    before, residuals.STEP = residuals.STEP, step
    try:
        fresh = CalibrationProblem(problem.scene, problem.parameters, problem.observations)
        return fresh.predictions.slopes(fresh.space.start, (True,) * len(problem.observations))
    finally:
        residuals.STEP = before


def errors(problem: CalibrationProblem) -> list[float]:
    """Largest relative error of a column, for each step."""
    exact = (4 * slopes(problem, 4e-3) - slopes(problem, 8e-3)) / 3
    size = np.abs(exact).max(axis=0)
    return [float((np.abs(slopes(problem, h) - exact) / size).max()) for h in STEPS]


def times() -> dict[str, list[float]]:
    """Seconds for a rest and for 2 s of motion, alone and beside another arm."""
    scene = Scene(chen2022())
    space = ParameterSpace(scene, [FreeParameter("sections.bending_radius", log=True)])
    pressures = np.array([6e5, 0, 0, 0, 3e5, 3e5])
    profile = InputProfile.of(6, [Step(1, 0.0, 1.0)])
    at = np.linspace(0.02, 2.0, 100)
    other = ArmAt(scene)
    other.inverse(pressures, ())
    other.motion("here", profile, at, "rest")
    found: dict[str, list[float]] = {}
    for run in range(RUNS):
        for name, near in (("alone", None), ("beside another", other)):
            arm = ArmAt(space.scene_at(space.start + 1e-4 * (run + 1)), near)
            began = time.perf_counter()
            arm.tips(arm.rest(pressures))
            middle = time.perf_counter()
            arm = ArmAt(arm.scene, near)
            arm.motion("here", profile, at, "rest")
            ends = (middle - began, time.perf_counter() - middle)
            for what, seconds in zip(("a rest", "2 s of motion"), ends, strict=True):
                found.setdefault(f"{what}, {name}", []).append(seconds)
    return found


def numbers(quick: bool) -> dict[str, float]:
    """Errors of derivatives (those of poses alone in quick mode), and times."""
    chosen = {name: PROBLEMS[name] for name in PROBLEMS if not quick or name == "static poses"}
    found = {
        key("derivative error", name, f"step {step:.0e}"): error
        for name, problem in chosen.items()
        for step, error in zip(STEPS, errors(problem()), strict=True)
    }
    took = {key(name): statistics.median(seconds) for name, seconds in times().items()}
    return found | {f"{name}_ms": 1e3 * seconds for name, seconds in took.items()}


def main() -> None:
    print(f"{'error of derivatives, step':28}" + "".join(f"{step:>10.0e}" for step in STEPS))
    for name, problem in PROBLEMS.items():
        print(f"{name:28}" + "".join(f"{error:10.1e}" for error in errors(problem())))
    print()
    for name, seconds in times().items():
        print(f"{name:28}{1e3 * statistics.median(seconds):8.0f} ms")


if __name__ == "__main__":
    main()
