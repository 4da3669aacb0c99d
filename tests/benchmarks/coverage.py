"""How often the 95 % intervals of a calibration hold the truth, over fixed seeds.

    python -m tests.benchmarks.coverage [SEEDS]

Data are made by a scene of known numbers, with normal noise. Two studies, each with the noise
known (normal intervals) and with it estimated from the residuals (Student's t).
"""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from softmpc import PressureDrive, Scene, chen2022
from softmpc.simulation.inputs import InputProfile, Ramp, Step
from softmpc.study.arm_at import ArmAt
from softmpc.study.calibrate import CalibrationProblem
from softmpc.study.calibration_report import report
from softmpc.study.free_parameters import FreeParameter, Tie
from softmpc.study.observations import MotionRecord, Observation, StaticPose
from softmpc.study.residuals import Data
from softmpc.sweeps import sweep
from tests.benchmarks.common import key

SEEDS = 200
NOISE = 5e-4  # m
SPATIAL = ("epsilon", "kappa_x", "kappa_y")  # of an arm that is not twisted
PLANAR = ("epsilon", "kappa_y")
AXES = ("x_1", "y_1", "z_1")


def one_section(strains: tuple[str, ...]) -> Scene:
    """The truth: the first section of the paper's arm, under pressures."""
    arm = replace(chen2022(), sections=chen2022().sections[:1])
    return Scene(arm, strains=strains, actuation=PressureDrive())


def static_problem() -> CalibrationProblem:
    """Ten poses; stiffness radius, Young's modulus and mass."""
    truth, generator = one_section(SPATIAL), np.random.default_rng(20220113)
    arm = ArmAt(truth)
    poses = []
    for k in range(10):
        p = generator.uniform(0, 1e6, 3)
        tip = arm.tips(arm.rest(p))[0]
        tips = dict(zip(AXES, tip.tolist(), strict=True))
        poses.append(StaticPose(tips, p.tolist(), sigma=NOISE, name=f"pose {k + 1}"))
    free = (
        FreeParameter("sections.bending_radius", start=0.030, low=0.01, high=0.1, log=True),
        FreeParameter("sections.young_modulus", start=1.22e6, low=1e5, high=1e7, log=True),
        FreeParameter("sections.mass", start=0.55, low=0.05, high=5.0),
    )
    ties = (Tie("sections.shear_modulus", "sections.young_modulus", 1 / 3),)
    return CalibrationProblem(truth, free, tuple(poses), ties)


def motion_problem() -> CalibrationProblem:
    """A second of motion in a plane, seen 25 times; stiffness radius, viscosity and mass."""
    truth = one_section(PLANAR)
    moves = [Step(1, 0.0, 5e5), *(Ramp(j, 0.3, 0.6, 1e6) for j in (2, 3))]
    profile, time_ = InputProfile.of(3, moves), np.linspace(0.04, 1.0, 25)
    tips = ArmAt(truth).motion("truth", profile, time_, "rest").tips[:, 0]
    columns = dict(zip(AXES[::2], tips.T[::2], strict=True))
    record = MotionRecord(profile, time_, columns, {"tips": NOISE})
    free = (
        FreeParameter("sections.bending_radius", start=0.0300, low=0.01, high=0.1, log=True),
        FreeParameter("sections.viscosity", start=1.03e4, low=1e2, high=1e6, log=True),
        FreeParameter("sections.mass", start=0.55, low=0.05, high=5.0),
    )
    return CalibrationProblem(truth, free, (record,))


PROBLEMS = {"static poses": static_problem, "motion record": motion_problem}


def noisy(observation: Observation, generator: np.random.Generator) -> Observation:
    """The same observation with normal noise on its values."""
    if isinstance(observation, StaticPose):
        tips = {k: v + generator.normal(0, NOISE) for k, v in observation.tips.items()}
        return replace(observation, tips=tips)
    assert isinstance(observation, MotionRecord)
    columns = {k: v + generator.normal(0, NOISE, len(v)) for k, v in observation.columns.items()}
    return replace(observation, columns=columns)


@dataclass(frozen=True)
class Study:
    """Which of the 95 % intervals hold the truth, for one seed: with sigma known and estimated."""

    name: str

    @cached_property
    def problem(self) -> CalibrationProblem:
        return PROBLEMS[self.name]()

    @cached_property
    def estimating(self) -> CalibrationProblem:
        problem = replace(self.problem, estimate_sigma=True)
        problem.__dict__["predictions"] = self.problem.predictions  # the same arms
        return problem

    def __call__(self, seed: int) -> dict[str, Any]:
        generator = np.random.default_rng(seed)
        data = Data([noisy(o, generator) for o in self.problem.observations])
        held = {}
        for label, problem in (("known", self.problem), ("estimated", self.estimating)):
            fit, factor = problem.settled(data, problem.space.start)
            found = report(problem, fit, factor, data)
            truth = dict(zip(problem.space.names, true_values(problem), strict=True))
            held[label] = [
                found.converged and e.low95 <= truth[e.path] <= e.high95 for e in found.estimates
            ]
        return held


def true_values(problem: CalibrationProblem) -> list[float]:
    """The numbers the data were made with: those of the problem's own scene."""
    scene = problem.scene.manipulator.sections[0]
    return [getattr(scene, path.rpartition(".")[2]) for path in problem.space.names]


def coverage(name: str, seeds: int, workers: int | None = None) -> dict[str, dict[str, float]]:
    """Shares (0 to 1) of intervals that hold the truth, by how sigma is known and parameter."""
    study = Study(name)
    found = sweep(study, range(seeds), executor=workers, chunk=max(1, seeds // 8))
    paths = study.problem.space.names
    return {
        label: dict(zip(paths, np.mean([row[label] for row in found], axis=0), strict=True))
        for label in ("known", "estimated")
    }


def numbers(quick: bool) -> dict[str, float]:
    """Static poses and 24 seeds in quick mode; else both studies and 200 seeds."""
    found: dict[str, float] = {}
    for name in list(PROBLEMS)[: 1 if quick else None]:
        for label, shares in coverage(name, 24 if quick else SEEDS).items():
            for path, share in shares.items():
                found[key(name, path.rpartition(".")[2], "sigma", label, "share")] = share
    return found


def main(seeds: int) -> None:
    print(f"{'study':14} {'parameter':26} {'sigma known':>12} {'sigma estimated':>16}")
    for name in PROBLEMS:
        began = time.perf_counter()
        shares = coverage(name, seeds)
        for path in shares["known"]:
            row = [100 * shares[label][path] for label in ("known", "estimated")]
            print(f"{name:14} {path:26} {row[0]:10.1f} % {row[1]:14.1f} %")
        print(f"{name:14} {seeds} seeds in {time.perf_counter() - began:.0f} s")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else SEEDS)
