"""Calibration from motions, the coverage of its intervals, and the preset it gave."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest
from benchmarks.coverage import PROBLEMS, coverage, motion_problem, static_problem

from softmpc import load_scene
from softmpc.model.presets import FITTED, chen2022
from softmpc.study.arm_at import ArmAt
from softmpc.study.calibrate import calibrate
from softmpc.study.calibration_files import load_calibration

FOLDER = Path(__file__).parents[1] / "examples" / "calibration"


@pytest.mark.slow
def test_borrowed_functions_change_the_way_not_the_end() -> None:
    """An arm beside another one rests and moves as it does alone."""
    problem = motion_problem()
    record = problem.observations[0]
    one, other = (problem.space.scene_at(problem.space.start + d) for d in (0.0, 0.05))
    alone, beside = record.predict(ArmAt(other)), record.predict(ArmAt(other, ArmAt(one)))
    assert np.abs(alone - record.predict(ArmAt(one))).max() > 1e-3
    np.testing.assert_allclose(beside, alone, atol=2e-8)
    poses = static_problem()
    one, other = (poses.space.scene_at(poses.space.start + d) for d in (0.0, 0.02))
    near = ArmAt(one)
    for pose in poses.observations:
        np.testing.assert_allclose(
            pose.predict(ArmAt(other, near)), pose.predict(ArmAt(other)), atol=1e-10
        )


def test_derivatives_are_those_of_wider_differences() -> None:
    """The steps are small enough, and large against the error of the integration."""
    problem = motion_problem()
    x, every = problem.space.start, (True,)
    slopes = problem.predictions.slopes(x, every)
    step = 4e-3
    for k in range(len(x)):
        h = step * np.eye(len(x))[k]
        near, far = (
            (problem.predictions.at(x + s * h) - problem.predictions.at(x - s * h)) / (2 * s * step)
            for s in (1, 2)
        )
        np.testing.assert_allclose(
            slopes[:, k], (4 * near - far) / 3, atol=2e-5 * np.abs(slopes[:, k]).max()
        )


@pytest.mark.slow
def test_motion_without_noise_gives_the_truth_back() -> None:
    found = calibrate(motion_problem())
    assert found.converged
    values = found.values
    assert values["sections.bending_radius"] == pytest.approx(0.0298, rel=1e-5)
    assert values["sections.viscosity"] == pytest.approx(1e4, rel=1e-3)
    assert values["sections.mass"] == pytest.approx(0.56, rel=1e-4)


@pytest.mark.parametrize("name", PROBLEMS)
def test_problems_travel_to_workers(name: str) -> None:
    """A search may be done in another process, or on another machine."""
    problem = PROBLEMS[name]()
    away = pickle.loads(pickle.dumps(problem))
    x = problem.space.start
    np.testing.assert_array_equal(away.predictions.at(x), problem.predictions.at(x))


@pytest.mark.slow
def test_coverage_of_a_few_seeds() -> None:
    """Few seeds, so wide limits: 10 of 12 at least. The test below is the real one."""
    shares = coverage("static poses", 12, workers=1)
    assert all(share >= 10 / 12 for row in shares.values() for share in row.values()), shares


@pytest.mark.slow
@pytest.mark.parametrize("name", PROBLEMS)
def test_coverage(name: str) -> None:
    """The 95 % intervals hold the truth in 91 to 98 % of 200 fixed seeds."""
    shares = coverage(name, 200)
    assert all(0.91 <= share <= 0.98 for row in shares.values() for share in row.values()), shares


@pytest.mark.slow
def test_preset_is_what_the_calibration_gives() -> None:
    """`chen2022-v2`, refitted from the published summary values, within what it was rounded to."""
    scene = load_scene(FOLDER / "paper_arm.toml")
    found = calibrate(load_calibration(FOLDER / "chen2022.toml", scene))
    assert found.converged
    stored = FITTED["chen2022-v2"]
    assert set(stored) == set(found.values)
    for path, (value, source) in stored.items():
        assert source.startswith("fitted: ")
        assert value == pytest.approx(found.values[path], rel=2e-4, abs=1e-6), path
        assert ("not determined" in source) == (found[path].source == "prior"), path
    assert found["hydraulics.friction"].bound == "low"
    together = [line for line in found.undetermined if " with " in line]
    assert len(together) == 1
    assert "hydraulics.friction" in together[0] and "hydraulics.efficiency" in together[0]


def test_version_2_has_the_stored_numbers() -> None:
    arm, first = chen2022(version=2), chen2022()
    assert arm.name == "chen2022-v2"
    for path, (value, _) in FITTED["chen2022-v2"].items():
        part, _, field = path.partition(".")
        records = arm.sections if part == "sections" else (arm.hydraulics,)
        assert [getattr(record, field) for record in records] == [value] * len(records)
    assert arm.sections[0].mass == first.sections[0].mass
    assert arm.limits == first.limits
