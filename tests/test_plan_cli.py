"""`softmpc plan`: answers, files, exit statuses, and what is kept on Ctrl-C."""

from __future__ import annotations

import json
import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner, Result
from pages import ROOT
from small_plans import GOAL, write

from softmpc.cli.main import main
from softmpc.control.clearance import arm_clearance
from softmpc.planning import planner, scene_table
from softmpc.planning.plan_files import load_plan
from softmpc.planning.result import INTERRUPTED
from softmpc.simulation.run import simulate_file
from softmpc.statics.targets import Position

OUT_OF_REACH: dict[str, Any] = {"goals": [{"tip": [0.2, 0.0, 0.15]}]}


def softmpc(*words: str | Path) -> Result:
    return CliRunner().invoke(main, ["plan", *map(str, words)])


def test_an_answer_and_its_files(tmp_path: Path) -> None:
    out = tmp_path / "out"
    done = softmpc(write(tmp_path), "--json", "--out", out, "--no-animate", "--workers", "1")
    assert done.exit_code == 0, done.output
    data = json.loads(done.stdout)
    assert data["status"] == "solved" and data["title"] == "Small swing"
    assert data["time_s"] == pytest.approx(0.08, abs=0.02) and data["misses_mm"][0] < 0.5
    assert json.loads((out / "plan.json").read_text()) == data
    assert {path.name for path in out.iterdir()} >= {"plan.npz", "plan.png", "replay.toml"}
    loaded = load_plan(out)
    assert loaded.time == data["time_s"] and loaded.title == "Small swing"


@pytest.mark.slow
def test_people_are_told(tmp_path: Path) -> None:
    ball = {"kind": "sphere", "center": [0.1, 0.1, 0.2], "radius": 0.03}
    scene = write(tmp_path, obstacles=[ball], most_intervals=16)
    done = softmpc(scene, "--least", "effort", "--duration", "0.4", "--intervals", "8")
    assert done.exit_code in (0, 3), done.output
    lines = done.stdout.splitlines()
    assert lines[0] == "Small swing" and lines[1].startswith("status  ")
    for begin in ("time ", "least effort ", "plan and simulation ", "misses goal 1 by ",
                  "drift after arrival ", "clearance of sphere 1 ", "held by "):  # fmt: skip
        assert any(line.startswith(begin) for line in lines), begin
    assert sum(" won " in line for line in lines) == 1
    assert [line.split()[0] for line in lines[-2:]] == ["8", "16"]


@pytest.mark.slow
def test_what_gives_way_is_named(tmp_path: Path) -> None:
    done = softmpc(write(tmp_path, **OUT_OF_REACH), "--out", tmp_path / "out", "--no-animate")
    assert done.exit_code == 3
    assert "gives way: goal 1: position of section tip 1 by" in done.stderr
    assert "in the way: " in done.stderr
    assert "gives way " in done.stdout and "position of section tip 1, by" in done.stdout
    kept = load_plan(tmp_path / "out")  # the nearest
    assert kept.status == "infeasible" and kept.gives_way[0].amount > 0.01


def test_pressures_have_their_unit_and_what_fails_no_sensitivities(tmp_path: Path) -> None:
    hurried = {"least": "effort", "duration": 0.003, "torque_rate": None, "start": None}
    scene = write(tmp_path, {"actuation": {"kind": "pressure"}}, **hurried)
    done = softmpc(scene, "--sensitivity", "sections.mass", "--workers", "1")
    assert done.exit_code == 3
    assert " Pa²s, on one mesh only" in done.stdout
    assert "no sensitivities: they are those of a plan that is solved" in done.stdout


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--least", "energy"), "'energy' is not one of 'time', 'effort', 'jerk'"),
        (("--duration", "-1"), "duration = -1 s: must be above 0"),
        (("--duration", "1"), "least time chooses the time"),
        (("--intervals", "1"), "intervals = 1: must be a whole number from 2"),
        (("--workers", "1", "--dask", "tcp://127.0.0.1:1"), "give --workers or --dask"),
    ],
)
def test_wrong_options(words: tuple[str, ...], said: str, tmp_path: Path) -> None:
    done = softmpc(write(tmp_path), *words)
    assert done.exit_code == 2 and said in done.stderr
    assert done.stdout == ""


def test_wrong_scene_file(tmp_path: Path) -> None:
    done = softmpc(write(tmp_path, goals=[{**GOAL, "after": "soon"}]), "--json")
    assert done.exit_code == 2
    said = json.loads(done.stdout)["error"]
    assert "scene.toml: [[plan.goals]] 1 after = 'soon': must be a number in s" in said


def interrupting(at: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Ctrl-C when the planner tells of its progress for the `at`-th time."""
    count = 0

    def plan(*given: Any, progress: Any, **options: Any) -> Any:
        def told(done: int, total: int) -> None:
            nonlocal count
            count += 1
            if count == at:
                signal.raise_signal(signal.SIGINT)
            progress(done, total)

        return planner.plan(*given, progress=told, **options)

    monkeypatch.setattr(scene_table, "plan", plan)


@pytest.mark.sampled
@pytest.mark.parametrize("at", [1, 2])
def test_what_there_is_is_kept(at: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Ctrl-C in the first start, and before the refinement."""
    interrupting(at, monkeypatch)
    before = signal.getsignal(signal.SIGINT)
    done = softmpc(write(tmp_path), "--out", tmp_path / "out")
    assert done.exit_code == 130, done.output
    assert "interrupted; the best motion until then is kept" in done.stderr
    kept = load_plan(tmp_path / "out")
    assert kept.status == INTERRUPTED and len(kept.levels) == 1
    assert kept.replay is not None and kept.replay.finished and np.isfinite(kept.replay.defect)
    assert signal.getsignal(signal.SIGINT) is before


@pytest.mark.slow
def test_starts_that_are_done_are_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In other processes, which are ended."""
    interrupting(2, monkeypatch)
    ball = {"kind": "sphere", "center": [-0.01, 0.015, 0.345], "radius": 0.05}
    scene = write(tmp_path, obstacles=[ball])
    done = softmpc(scene, "--out", tmp_path / "out", "--workers", "2")
    assert done.exit_code == 130, done.output
    kept = load_plan(tmp_path / "out")
    assert kept.status == INTERRUPTED and 1 <= len(kept.starts) < 9


@pytest.mark.slow
@pytest.mark.parametrize("name", ["plan_swing", "plan_waypoints"])
def test_examples_are_what_they_say(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Simulated again, with other samples, they end at the goal and keep clear within 1 mm."""
    monkeypatch.delenv("SOFTMPC_COMPILE")  # as people run them
    done = softmpc(ROOT / "examples" / f"{name}.toml", "--out", tmp_path, "--no-animate")
    assert done.exit_code == 0, done.output
    problem = load_plan(tmp_path).problem
    motion = simulate_file(tmp_path / "replay.toml")
    place = problem.goals[-1].targets[0]
    assert isinstance(place, Position)
    assert motion.tips[-1, -1] == pytest.approx(place.place, abs=1e-3)
    clear = arm_clearance(problem.model, problem.obstacles, places=150)(motion.q).clearance
    assert clear.min() > problem.margin - 1e-3
