"""Plans as files: what is written loads again, replays in the simulator and can be tracked."""

from __future__ import annotations

import csv
import json
from dataclasses import dataclass, fields, is_dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
from small_plans import GOAL, read

from softmpc import __version__
from softmpc.control.limits import TipBox
from softmpc.control.planned import read_planned
from softmpc.control.tracking import read_track_file, set_up
from softmpc.errors import InputError
from softmpc.model.effects import Effect
from softmpc.model.model import Model, build
from softmpc.planning.plan_files import load_plan, plan_summary, save_plan
from softmpc.planning.planner import plan
from softmpc.planning.problem import PlanProblem
from softmpc.planning.result import FAILED, PlanResult
from softmpc.simulation.inputs import InputProfile
from softmpc.simulation.run import simulate, simulate_file
from softmpc.statics.targets import Position

WALL: dict[str, Any] = {"kind": "plane", "point": [-0.12, 0.0, 0.0], "normal": [1.0, 0.0, 0.0]}
PARTS: dict[str, Any] = {
    "obstacles": [WALL],
    "limits": [
        {"kind": "tip_box", "axis": "z", "low": 0.1},
        {"kind": "tip_cone", "axis": [0, 0, 1], "angle": 90.0, "section": 1},
    ],
    "goals": [{**GOAL, "rest": False, "after": 0.3}, {"torques": [0.4, 0.0, 0.4]}],
    "least": "effort",
    "duration": 0.6,
}


@pytest.fixture(scope="module")
def result() -> PlanResult:
    planning = read(Path(), **PARTS)
    found = plan(planning.problem(), planning.settings)
    assert found.solved
    return replace(found, title="By the wall")


@pytest.fixture(scope="module")
def folder(result: PlanResult, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("plan")
    names = {"plan.json", "plan.npz", "plan.csv", "replay.csv", "replay.toml", "track.toml"}
    assert {path.name for path in save_plan(result, folder)} == names
    assert {path.name for path in folder.iterdir()} == names
    return folder


def assert_same(a: Any, b: Any, where: str = "") -> None:
    """Two objects hold the same numbers and words, to the last bit."""
    assert type(a) is type(b), where
    if isinstance(a, Model):
        assert a.scene == b.scene
    elif is_dataclass(a):
        for f in fields(a):
            assert_same(getattr(a, f.name), getattr(b, f.name), f"{where}.{f.name}")
    elif isinstance(a, np.ndarray):
        assert np.array_equal(a, b, equal_nan=True), where
    elif isinstance(a, tuple):
        assert len(a) == len(b), where
        for i, pair in enumerate(zip(a, b, strict=True)):
            assert_same(*pair, f"{where}[{i}]")
    elif isinstance(a, dict):
        assert_same(tuple(a.items()), tuple(b.items()), where)
    else:
        assert a == b or (a != a and b != b), where


def test_a_stored_plan_is_the_result_again(result: PlanResult, folder: Path) -> None:
    assert_same(load_plan(folder), result)
    assert_same(load_plan(folder / "plan.npz"), result)


def test_a_loaded_plan_writes_the_same_files(folder: Path, tmp_path: Path) -> None:
    save_plan(load_plan(folder), tmp_path)
    for name in ("plan.json", "plan.csv", "replay.csv", "replay.toml", "track.toml"):
        assert (tmp_path / name).read_bytes() == (folder / name).read_bytes(), name


def test_the_simulator_moves_as_planned(result: PlanResult, folder: Path) -> None:
    """To the end, and within the time before, with another sampling than the plan's."""
    motion = simulate_file(folder / "replay.toml")
    assert motion.finished and motion.time[-1] == pytest.approx(result.time, abs=1e-9)
    replay = result.replay
    assert replay is not None
    assert motion.tips[-1] == pytest.approx(replay.tips[-1], abs=1e-7)
    for i in range(3):
        along = np.interp(motion.time, replay.t, replay.tips[:, -1, i])
        assert motion.tips[:, -1, i] == pytest.approx(along, abs=5e-4)
    goal = result.problem.goals[1].state
    assert goal is not None
    held = result.problem.model.frames(goal[: result.problem.model.strains])[0]
    assert motion.tips[-1][0] == pytest.approx(np.asarray(held).ravel(), abs=1e-3)


def test_the_table_holds_its_inputs(result: PlanResult, folder: Path) -> None:
    with open(folder / "plan.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0])[:6] == [
        "t [s]",
        "T_1 [N·m]",
        "T_2 [N·m]",
        "T_3 [N·m]",
        "x_1 [m]",
        "y_1 [m]",
    ]
    assert list(rows[0])[-1] == "P_3 [MPa]" and float(rows[-1]["t [s]"]) == pytest.approx(0.6)
    for row in rows[:-1]:
        k = np.flatnonzero(result.t <= float(row["t [s]"]) + 1e-9)[-1]
        torques = [float(row[f"T_{j} [N·m]"]) for j in (1, 2, 3)]
        assert torques == result.u[k].tolist()
        pressures = [1e6 * float(row[f"P_{j} [MPa]"]) for j in (1, 2, 3)]
        gain = result.problem.model.drive.static_gain
        assert pressures == pytest.approx(gain @ torques, rel=1e-9, abs=1e-6)


def test_the_plan_can_be_tracked(result: PlanResult, folder: Path) -> None:
    motion = read_planned(folder / "plan.npz")
    assert np.array_equal(motion.u, result.u) and np.array_equal(motion.u_before, [0.5, 0.0, 0.0])
    _, scene, task = read_track_file(folder / "track.toml")
    setup = set_up(scene, task)
    assert not setup.preflight.findings
    assert np.array_equal(setup.start.x, result.problem.start.x)


def test_the_summary_names_its_origin(result: PlanResult, folder: Path) -> None:
    data = json.loads((folder / "plan.json").read_text())
    assert data["title"] == "By the wall" and data["softmpc"] == __version__
    other = read(Path(), {"effects": {"gravity": [0.0, 0.0, 9.8]}}, **PARTS).problem()
    hashes = {plan_summary(replace(result, problem=one))["scene_sha256"]
              for one in (result.problem, other)}  # fmt: skip
    assert len(hashes) == 2 and data["scene_sha256"] in hashes


def test_the_next_plan_starts_where_one_ends(result: PlanResult, folder: Path) -> None:
    replay = result.replay
    assert replay is not None
    for time, x, u in (
        (None, replay.x[-1], result.u[-1]),
        (0.0, replay.x[0], result.problem.start.u),
        (result.t[3], replay.x[24], result.u[2]),
        (result.t[3] + 1e-4, replay.x[24], result.u[2]),  # the sample before
    ):
        state = {"state": "plan.npz"} if time is None else {"state": "plan.npz", "time": time}
        start = read(folder, start=state).problem().start
        assert np.array_equal(start.x, x) and np.array_equal(start.u, u)


def test_an_arm_in_motion_is_brought_to_rest(result: PlanResult, tmp_path: Path) -> None:
    """From a state of a simulation, in less time than it would take by itself."""
    model, inputs = result.problem.model, InputProfile.constant([0.5, 0.0, 0.0])
    simulate(model, inputs, 0.06, method="idas", start="straight").save(tmp_path)
    planning = read(tmp_path, start={"state": "simulation.npz"}, goals=[{"rest": True}])
    found = plan(planning.problem(), planning.settings)
    assert found.solved and found.replay is not None and found.replay.drift < 3e-4
    rates = found.replay.x[:, model.strains : 2 * model.strains] / model.layout.dq.scale
    assert np.abs(rates[0]).max() > 100 * np.abs(rates[-1]).max()
    alone = simulate(model, inputs, 3 * found.time, start=found.replay.x[0], method="idas")
    assert alone.tip_speeds[-1, -1] > 0.02  # m/s


DRIVES: dict[str, tuple[dict[str, Any], str]] = {
    "pressure": (
        {"torque_rate": None, "pressure_rate": 20.0, "start": {"pressures": [0.2, 0, 0]}},
        "t [s],P_1 [MPa],P_2 [MPa],P_3 [MPa]",
    ),
    "hydraulic": ({}, "t [s],T_1 [N·m],T_2 [N·m],T_3 [N·m]"),
}


@pytest.mark.sampled
@pytest.mark.parametrize("kind", DRIVES)
def test_plans_of_other_drives(kind: str, tmp_path: Path) -> None:
    keys, header = DRIVES[kind]
    planning = read(tmp_path, {"actuation": {"kind": kind}}, **keys)
    found = plan(planning.problem(), planning.settings)
    assert found.solved and found.replay is not None
    save_plan(found, tmp_path)
    assert_same(load_plan(tmp_path), found)
    assert (tmp_path / "replay.csv").read_text().splitlines()[0] == header
    motion = simulate_file(tmp_path / "replay.toml")
    assert motion.tips[-1] == pytest.approx(found.replay.tips[-1], abs=1e-7)
    assert motion.p[-1] == pytest.approx(found.replay.pressures[-1], abs=1.0)


# ---------------------------------------------------------------- what files do not know


@dataclass(frozen=True)
class Ribbon(Effect):
    name: ClassVar[str] = "ribbon"


@dataclass(frozen=True)
class Low(TipBox):
    name: ClassVar[str] = "low"


def with_other(result: PlanResult, **changes: Any) -> PlanProblem:
    return replace(result.problem, **changes)


@pytest.mark.parametrize("part", ["effect", "limit"])
def test_parts_of_ones_own(part: str, result: PlanResult, tmp_path: Path) -> None:
    if part == "effect":
        scene = result.problem.model.scene
        model = build(replace(scene, effects=(*scene.effects, Ribbon())))
        problem = with_other(result, model=model)
    else:
        problem = with_other(result, limits=(Low(0.0, 1.0),))
    names = {path.name for path in save_plan(replace(result, problem=problem), tmp_path)}
    assert ("replay.toml" in names) is (part == "limit")
    with pytest.raises(InputError, match="give load_plan the problem as well"):
        load_plan(tmp_path)
    assert_same(load_plan(tmp_path, problem), replace(result, problem=problem))


def test_without_a_motion_there_is_a_summary_alone(result: PlanResult, tmp_path: Path) -> None:
    failed = PlanResult(result.problem, FAILED, ())
    assert [path.name for path in save_plan(failed, tmp_path)] == ["plan.json"]
    with pytest.raises(InputError, match="no such file"):
        load_plan(tmp_path)


def test_files_that_are_no_plans(tmp_path: Path) -> None:
    (tmp_path / "plan.npz").write_text("nothing")
    with pytest.raises(InputError, match="is not a saved plan"):
        load_plan(tmp_path)


def test_targets_of_sections_and_turns_load_again(result: PlanResult, tmp_path: Path) -> None:
    turned = {"tip": ["-", 0.02, "-"], "rotation": [0.0, 20.0, 0.0], "rest": False, "after": 0.3}
    planning = read(Path(), **{**PARTS, "goals": [turned, {"rest": True}]})
    problem = planning.problem()
    save_plan(replace(result, problem=problem), tmp_path)
    goal = load_plan(tmp_path).problem.goals[0]
    assert goal.targets[0] == Position((None, 0.02, None))
    a, b = (np.array(one.targets[1].rotation) for one in (goal, problem.goals[0]))  # type: ignore[attr-defined]
    assert a == pytest.approx(b, abs=1e-14)
