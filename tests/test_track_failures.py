"""Closed loops whose controller fails, as `softmpc track` runs them.

However it fails, torques stay finite and within their limits and those of their rate, every step
has a status, and the command ends with status 3 and says why. What one step does when its solver
fails is in test_controller_failures.py.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from softmpc.cli.main import main
from softmpc.control.baselines import FeedForward, Regulated
from softmpc.control.mpc import Mpc
from softmpc.control.real_time import RealTime
from softmpc.control.solvers import make_solver
from softmpc.control.track_result import TrackResult
from softmpc.control.tracking import Setup, read_track_file, set_up

RATE, STEP, FULL = 2.0, 0.025, 2.5  # N·m/s, s, N·m

SCENE = """
title = "Short line"
[effects]
gravity = [0, 0, 9.81]
[track]
path = "line"
start = [0.1, 0.0, 0.57]
end = [0.13, 0.02, 0.57]
lap_time = 1.2
laps = 0.5
smooth_start = 0.2
settle = 0.1
on_infeasible = "project"
[track.controller]
torque_rate = 2.0
horizon = 5
{controller}
[track.plant]
tolerance = 1e-6
"""


@pytest.fixture(scope="module", autouse=True)
def _no_clearance() -> Iterator[None]:
    """It takes as long as a run, and is not what these tests are about."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("softmpc.control.tracking.find_clearance", lambda *_: None)
        yield


def scene_file(folder: Path, controller: str = "", **changes: str) -> Path:
    """The scene with some keys changed."""
    text = SCENE.format(controller=controller)
    for key, value in changes.items():
        old = next(line for line in text.splitlines() if line.startswith(f"{key} ="))
        text = text.replace(old, f"{key} = {value}")
    (folder / "scene.toml").write_text(text)
    return folder / "scene.toml"


def keeps_its_limits(result: TrackResult) -> None:
    assert np.all(np.isfinite(result.u)) and np.all(np.isfinite(result.tips))
    assert result.u.min() >= 0.0 and result.u.max() <= FULL
    changes = np.abs(np.diff(np.vstack([result.u_start, result.u]), axis=0))
    assert changes.max() <= RATE * STEP + 1e-9
    assert len(result.statuses) == len(result.u) == len(result.step_ms)


@pytest.fixture(scope="module")
def line(tmp_path_factory: pytest.TempPathFactory) -> Setup:
    """A path that the arm can follow."""
    _, scene, task = read_track_file(scene_file(tmp_path_factory.mktemp("line")))
    return set_up(scene, task)


@pytest.fixture(scope="module")
def fast(tmp_path_factory: pytest.TempPathFactory) -> Setup:
    """One that it cannot follow: 120 mm there and back in 0.2 s."""
    changes = {"lap_time": "0.2", "laps": "5", "end": "[0.22, 0.02, 0.57]"}
    _, scene, task = read_track_file(scene_file(tmp_path_factory.mktemp("fast"), **changes))
    return set_up(scene, task)


def test_budget_that_is_never_met(line: Setup) -> None:
    """Each result is late, and used one step later: that is what the plan before had for it."""
    t = line.controller.transcription
    result = line.run(Mpc(t, RealTime(t), budget=1e-6))
    keeps_its_limits(result)
    assert all(status.startswith("budget overrun") for status in result.statuses)
    assert result.error[result.time >= result.settle].max() < 1e-3


def test_iteration_cap(line: Setup) -> None:
    """Not converged to the last digit, and said so; what breaks nothing is used."""
    t = line.controller.transcription
    result = line.run(Mpc(t, make_solver("sqp", t, tolerance=1e-10, max_iterations=2)))
    keeps_its_limits(result)
    assert any(status.startswith("iteration cap") for status in result.statuses)
    assert result.error[result.time >= result.settle].max() < 1e-3


def test_command_says_what_failed(tmp_path: Path) -> None:
    """A hard limit that the start breaks: named in every step, torques are held."""
    limits = 'strains = {epsilon = [-0.2, 0.05]}\nsoft = ["pressure", "tip_box"]'
    command = ["track", str(scene_file(tmp_path, limits)), "--json"]
    done = CliRunner().invoke(main, command)
    data = json.loads(done.stdout)
    assert done.exit_code == 3 and data["failures"] == data["steps"] == 28
    assert "28 of 28 steps of the controller failed; the first: failed: QP inf" in done.stderr
    assert "epsilon_1_1 in interval 1 by 0.1" in done.stderr
    assert data["input_variation"] < 1e-9


def test_path_faster_than_the_arm(fast: Setup) -> None:
    """Named before the run with place and amount; torques go at their fastest, no step fails."""
    kinds = {one.kind for one in fast.preflight.findings}
    assert {"torque rate", "torque rate at speed", "bandwidth"} <= kinds and "reach" not in kinds
    result = fast.run(fast.controller)
    keeps_its_limits(result)
    assert result.failures == 0
    changes = np.abs(np.diff(result.u, axis=0)).max(axis=1)
    assert np.mean(changes > 0.999 * RATE * STEP) > 0.5
    assert result.error[result.counted].max() > 0.02


def test_solver_that_raises_in_the_loop(line: Setup, monkeypatch: pytest.MonkeyPatch) -> None:
    """Five steps in the middle: the shifted plan, then the held torque, a cold start, and back."""
    t = line.controller.transcription
    solver = RealTime(t)
    prepare, reset, calls, resets = solver.prepare, solver.reset, [0], [0]

    def broken(*args: object) -> None:
        calls[0] += 1
        if 8 <= calls[0] < 13:
            raise RuntimeError("broken")
        prepare(*args)  # type: ignore[arg-type]

    def counted() -> None:
        resets[0] += 1
        reset()

    monkeypatch.setattr(solver, "prepare", broken)
    monkeypatch.setattr(solver, "reset", counted)
    result = line.run(Mpc(t, solver))
    keeps_its_limits(result)
    words = "failed: RuntimeError: broken"
    failed = [k for k, status in enumerate(result.statuses) if status.startswith(words)]
    assert failed == list(range(7, 12)) and result.failures == 5
    assert resets[0] > 2  # of a new controller, of a new run, and after three failures in a row
    assert result.error[-1] < 1e-3


@pytest.mark.parametrize("kind", [FeedForward, pytest.param(Regulated, marks=pytest.mark.slow)])
def test_baselines_keep_the_limits_too(fast: Setup, kind: type) -> None:
    result = fast.run(kind(fast.ocp, fast.guide))
    keeps_its_limits(result)
    assert np.abs(np.diff(result.u, axis=0)).max() > 0.999 * RATE * STEP
