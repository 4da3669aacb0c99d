"""The table [plan]: what it makes, and what it says of input that makes no sense."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from small_plans import GOAL, PLAN, read, scene

from softmpc.control.limits import StrainLimit, TipBox, TipCone
from softmpc.control.planned_start import is_at_rest
from softmpc.errors import BuildError, InputError, SceneError
from softmpc.model.model import build
from softmpc.model.obstacles import Box, Plane, Sphere
from softmpc.model.scene_file import scene_from_dict
from softmpc.planning.goals import Goal
from softmpc.planning.planner import PlanSettings, plan
from softmpc.planning.scene_table import read_plan_file, read_planning
from softmpc.simulation.inputs import InputProfile
from softmpc.simulation.run import simulate
from softmpc.statics.equilibrium import find_equilibrium
from softmpc.statics.targets import Direction, Orientation, Position

HERE = Path()
MODEL = build(scene())
PRESSED: dict[str, Any] = {"actuation": {"kind": "pressure"}}
TWO: dict[str, Any] = {"manipulator": {"sections": 2}}
BALL: dict[str, Any] = {"kind": "sphere", "center": [0.1, 0.1, 0.2], "radius": 0.03}
FRICTION: dict[str, Any] = {
    "actuation": {"kind": "hydraulic-friction"},
    "hydraulics": {"friction": 50.0},
}


def goals(*given: dict[str, Any]) -> dict[str, Any]:
    return {"goals": list(given)}


# ---------------------------------------------------------------- what it makes


def test_numbers_become_a_problem() -> None:
    planning = read(
        HERE, tolerance=1e-3, most_intervals=50, margin=0.01, obstacles=[BALL],
        limits=[
            {"kind": "tip_box", "axis": "z", "low": 0.1},
            {"kind": "tip_cone", "axis": [0, 0, 2], "angle": 60.0, "section": 1},
            {"kind": "strain", "strain": "epsilon", "low": -0.3, "high": 0.9},
        ],
    )  # fmt: skip
    assert planning.settings == PlanSettings(1e-3, 0.2, 6, 50)
    problem = planning.problem()
    assert (problem.least, problem.duration, problem.rate) == ("time", None, 20.0)
    assert problem.obstacles == (Sphere((0.1, 0.1, 0.2), 0.03),) and problem.margin == 0.01
    assert problem.limits is not None and problem.limits[-3:] == (
        TipBox(0.1, np.inf, "z"), TipCone(np.radians(60.0), (0, 0, 1), 1),
        StrainLimit(-0.3, 0.9, "epsilon"),
    )  # fmt: skip
    assert {limit.name for limit in problem.limits[:-3]} >= {"torque", "pressure"}
    (goal,) = problem.goals
    assert goal.targets == (Position((0.03, 0.02, None)),) and goal.rest and goal.state is None


def test_all_targets_of_a_goal() -> None:
    given = {
        "tip": [0.05, 0.0, "-"], "direction": [0, 0, 3], "rest": False, "after": 0.4,
        "sections": {"1": {"tip": [0.02, 0.0, 0.26], "rotation": [0, 0, 90]}},
    }  # fmt: skip
    planning = read(
        HERE, TWO, **goals(given, {"rest": True}), start=None, least="jerk", duration=1.0
    )
    first, last = planning.problem().goals
    position, direction, place, turn = first.targets
    assert position == Position((0.05, 0.0, None)) and direction == Direction((0, 0, 1))
    assert place == Position((0.02, 0.0, 0.26), section=1)
    assert isinstance(turn, Orientation) and turn.section == 1
    assert np.array(turn.rotation) == pytest.approx(
        np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]), abs=1e-12
    )
    assert (first.rest, first.after, last.rest, last.after) == (False, 0.4, True, None)


def test_only_the_last_goal_rests_by_default() -> None:
    problem = read(HERE, **goals(GOAL, GOAL, GOAL)).problem()
    assert [goal.rest for goal in problem.goals] == [False, False, True]


def test_where_it_starts(tmp_path: Path) -> None:
    torques = np.array([0.5, 0.0, 0.0])
    rest = find_equilibrium(MODEL, MODEL.drive.static_gain @ torques)
    by_torques = read(HERE).problem().start
    assert by_torques.u == pytest.approx(torques)
    assert by_torques.x[: MODEL.strains] == pytest.approx(rest.q, abs=1e-9)
    pressures = (rest.pressures / 1e6).tolist()
    by_pressures = read(HERE, start={"pressures": pressures}).problem().start
    assert by_pressures.u == pytest.approx(torques, abs=1e-12)
    by_tip = read(HERE, start={"tip": rest.tips[-1].tolist()}).problem().start
    assert is_at_rest(MODEL, by_tip.x, by_tip.u)
    assert np.asarray(MODEL.tip(by_tip.x[: MODEL.strains])).ravel() == pytest.approx(rest.tips[-1])
    hanging = read(HERE, start=None).problem().start
    assert is_at_rest(MODEL, hanging.x, hanging.u) and not hanging.u.any()
    straight = read(HERE, start={"straight": True}).problem().start
    assert not straight.x.any() and not is_at_rest(MODEL, straight.x, straight.u)


@pytest.mark.parametrize("name", ["simulation.npz", "simulation.csv"])
def test_it_starts_from_a_state_of_a_motion(name: str, tmp_path: Path) -> None:
    profile = InputProfile.from_table([0.0, 0.1], [[0.5, 0, 0], [0.2, 0.1, 0]], hold=True)
    motion = simulate(MODEL, profile, 0.3, method="idas", start="straight")
    motion.save(tmp_path)
    last = read(tmp_path, start={"state": name}).problem().start
    assert np.array_equal(last.x, motion.x[-1]) and np.array_equal(last.u, motion.u[-1])
    early = read(tmp_path, start={"state": name, "time": 0.0551}).problem().start
    assert np.array_equal(early.x, motion.x[5]) and np.array_equal(early.u, motion.u[5])
    goal = read(tmp_path, **goals({"state": name, "time": 0.2})).problem().goals[0]
    assert not goal.rest and goal.state is not None and np.array_equal(goal.state, motion.x[20])
    with pytest.raises(SceneError, match=r"rest = True: must be false: the state given is in mo"):
        read(tmp_path, **goals({"state": name, "rest": True}))
    with pytest.raises(InputError, match=r"has the times 0 to 0.3 s, none at 0.4 s"):
        read(tmp_path, start={"state": name, "time": 0.4})
    with pytest.raises(InputError, match=r"has 8 states and the arm of this scene 16"):
        read(tmp_path, TWO, start={"state": name})


def test_given_postures_of_a_goal() -> None:
    chosen = {**GOAL, "posture": "least-strain-energy"}
    by_statics, by_torques = (
        read(HERE, **goals(given)).problem().goals[0]
        for given in (chosen, {"torques": [0.4, 0, 0]})
    )
    for goal in (by_statics, by_torques):
        assert goal.rest and goal.state is not None and goal.targets == ()
    tip = np.asarray(MODEL.tip(by_statics.state[: MODEL.strains])).ravel()  # type: ignore[index]
    assert tip[:2] == pytest.approx([0.03, 0.02], abs=1e-6)
    rest = find_equilibrium(MODEL, MODEL.drive.static_gain @ [0.4, 0, 0])
    assert by_torques.state[: MODEL.strains] == pytest.approx(rest.q)  # type: ignore[index]


def test_obstacles_of_contact_are_kept_clear_of_too() -> None:
    walls = {"effects": {"contact": {"obstacles": [{"kind": "plane", "point": [0, 0, 0.5]}]}}}
    found = read(HERE, walls, obstacles=[BALL]).obstacles
    assert [type(one) for one in found] == [Sphere, Plane]
    assert [type(one) for one in read(HERE, walls, obstacles=[BALL], touch=True).obstacles] == [
        Sphere
    ]


def test_inputs_may_be_pressures() -> None:
    table = {**PLAN, "start": {"pressures": [0.2, 0, 0]}, "pressure_rate": 2.0}
    del table["torque_rate"]
    problem = read_planning(table, scene(**PRESSED), HERE).problem()
    assert problem.rate == 2e6 and problem.start.u == pytest.approx([2e5, 0, 0])


def test_changes_go_before_the_file() -> None:
    _, planning = read_plan_file("examples/plan_swing.toml", {"least": "jerk", "duration": 2.0})
    assert (planning.least, planning.duration) == ("jerk", 2.0)
    with pytest.raises(SceneError, match=r"figure_eight.toml: \[plan\] is missing"):
        read_plan_file("examples/figure_eight.toml")


@pytest.mark.parametrize("name", ["goals", "obstacles"])
def test_tables_at_the_top_of_the_file(name: str) -> None:
    with pytest.raises(
        SceneError, match=rf"\[{name}\] at the top of the file: write \[\[plan.{name}"
    ):
        scene_from_dict({name: [{}]})


# ---------------------------------------------------------------- what makes no sense

WRONG: dict[str, tuple[dict[str, Any], str]] = {
    "unknown": ({"goal": 1}, r"unknown key in \[plan\]: 'goal'; did you mean 'goals'"),
    "least": ({"least": "energy"}, r"\[plan\] unknown least: 'energy'.*time, effort, jerk"),
    "duration": ({"duration": 0.0}, r"\[plan\] duration = 0 s: must be above 0"),
    "huge": ({"duration": 1e9}, r"duration = 1000000000 s: must be above 0 and at most 3600"),
    "word": ({"duration": "long"}, r"duration = 'long': must be a number in s"),
    "rate": ({"torque_rate": -1.0}, r"torque_rate = -1 N·m/s: must be above 0"),
    "other rate": ({"pressure_rate": 1.0}, r"takes torques, write torque_rate = … in N·m/s"),
    "tolerance": ({"tolerance": 1.0}, r"\[plan\] tolerance = 1 m: must be between"),
    "intervals": ({"intervals": 1}, r"intervals = 1: must be a whole number from 2"),
    "mesh": ({"intervals": 500}, r"intervals = 500 for each of 1 goals: more than most_intervals"),
    "margin": ({"margin": 30.0}, r"margin = 30 m: must be between -0.1 and 1 m"),
    "two times": ({"duration": 1.0}, r"\[plan\]: least time chooses the time"),
    "all times": (goals({**GOAL, "after": 1.0}), r"least time chooses the time"),
    "no time": ({"least": "effort"}, r"\[plan\]: least effort needs a time"),
    "too short": (
        {"least": "jerk", "duration": 1.0, **goals({**GOAL, "after": 1.0}, GOAL)},
        r"goals with times take 1 s already, the whole shall take 1 s",
    ),
    "contradict": (
        {"least": "jerk", "duration": 1.0, **goals({**GOAL, "after": 0.8})},
        r"the goals take 0.8 s and the whole 1 s: leave out one",
    ),
    "no goals": ({"goals": None}, r"\[plan\] goals = \[\].*\[\[plan.goals\]\], at least one"),
    "a goal": ({"goals": GOAL}, r"goals = \{.*: must be a list of tables"),
    "empty": (goals({}), r"\[\[plan.goals\]\] 1 asks for nothing"),
    "second": (goals(GOAL, {"tipp": [0, 0, 0.2]}), r"key in \[\[plan.goals\]\] 2: 'tipp'"),
    "flat": (goals({"tip": [0.1, 0.2]}), r"tip = \[0.1, 0.2\] \(2 values\): must be a list of 3"),
    "all free": (goals({"tip": ["-", "-", "-"]}), r"one of them must be given"),
    "nan": (goals({"tip": [float("nan"), 0, 0]}), r"\[\[plan.goals\]\] 1 tip\[0\] = nan"),
    "mm": (goals({"tip": [30.0, 0, 250.0]}), r"\[\[plan.goals\]\] 1 tip is far out of reach"),
    "axis": (goals({"direction": [0, 0, 0]}), r"1 direction: Direction.axis.*not all of them zero"),
    "turned": (goals({"direction": [0, 0, 1], "rotation": [0, 0, 0]}), r"leave one of them out"),
    "section": (goals({"sections": {"2": GOAL}}), r"unknown key in .* sections: '2'.*allowed: 1"),
    "no target": (goals({"sections": {"1": {}}}), r"sections.1 is empty: give tip or direction"),
    "after": (goals({**GOAL, "after": -1.0}), r"after = -1 s: must be above 0"),
    "posture": (goals({**GOAL, "posture": "given"}), r"unknown posture: 'given'.*free, least-pre"),
    "no tip": (goals({"torques": [0, 0, 0], "posture": "free"}), r"is for targets of inverse st"),
    "both": (goals({**GOAL, "torques": [0, 0, 0]}), r"1 has tip, .* and torques or press"),
    "twice": (goals({"torques": [0] * 3, "pressures": [0] * 3}), r"one follows from the other"),
    "too many": (goals({"torques": [0.0] * 6}), r"torques = .* \(6 values\): must be a list of 3"),
    "strong": (goals({"torques": [9.0, 0, 0]}), r"torques\[0\] = 9 N·m: must be between 0 and 2.5"),
    "high": (goals({"pressures": [-0.1, 0, 0]}), r"pressures\[0\] = -0.1 MPa: must be between 0"),
    "moves": (goals({"torques": [0.1, 0, 0], "rest": False}), r"rest = False: must be true: the"),
    "time alone": ({"start": {"time": 1.0}}, r"\[plan.start\] time: is of a file, give state"),
    "no file": ({"start": {"state": "none.npz"}}, r"\[plan.start\] state: none.npz: no such file"),
    "two starts": ({"start": {"straight": True, **GOAL}}, r"\[plan.start\] has tip.* and straight"),
    "shape": ({"obstacles": [{"kind": "cone"}]}, r"\[\[plan.obstacles\]\] 1 unknown kind: 'cone'"),
    "radius": ({"obstacles": [{**BALL, "radius": 0.0}]}, r"\[\[plan.obstacles\]\] 1 radius = 0 m"),
    "key": ({"obstacles": [{**BALL, "size": 1}]}, r"key in \[\[plan.obstacles\]\] 1: 'size'"),
    "base": (
        {"obstacles": [BALL, {"kind": "sphere", "center": [0, 0, 0.01], "radius": 0.2}]},
        r"\[\[plan.obstacles\]\] 2: the base of the arm, .* is inside of sphere 2",
    ),
    "outside": (
        {"obstacles": [{"kind": "sphere", "center": [0, 0, 5], "radius": 1, "side": "inside"}]},
        r"the base of the arm, .* is inside of sphere 1",
    ),
    "limit": ({"limits": [{"kind": "speed"}]}, r"\[\[plan.limits\]\] 1 unknown kind: 'speed'"),
    "open": ({"limits": [{"kind": "tip_box", "axis": "x"}]}, r"no low and no high"),
    "crossed": (
        {"limits": [{"kind": "tip_box", "axis": "x", "low": 1, "high": 0}]}, r"below high = 0"
    ),
    "letter": ({"limits": [{"kind": "tip_box", "axis": "w", "low": 0}]}, r"unknown axis: 'w'"),
    "wide": ({"limits": [{"kind": "tip_cone", "axis": [0, 0, 1], "angle": 200}]}, "most 179 deg"),
    "nowhere": ({"limits": [{"kind": "tip_cone", "axis": [0, 0, 0], "angle": 9}]}, "not all of th"),
    "third": (
        {"limits": [{"kind": "tip_box", "axis": "x", "low": 0, "section": 3}]}, "from 1 to 1"
    ),
    "strain": ({"limits": [{"kind": "strain", "strain": "shear", "low": 0}]}, "'shear'"),
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG)
def test_wrong_input_is_named(name: str, tmp_path: Path) -> None:
    changes, said = WRONG[name]
    with pytest.raises(InputError, match=said.replace("none.npz", r".*none\.npz")):
        read(tmp_path, **changes)


def test_torques_where_pressures_are_the_input() -> None:
    with pytest.raises(SceneError, match=r"start\] torques: .* takes pressures, write pressures"):
        read(HERE, PRESSED, torque_rate=None)
    with pytest.raises(SceneError, match=r"torque_rate: .* takes pressures, write pressure_rate"):
        read(HERE, PRESSED, start=None)


def test_a_drive_that_is_not_linear() -> None:
    with pytest.raises(BuildError, match=r"\[plan\]: .*friction"):
        read(HERE, FRICTION)


def test_starts_that_cannot_be() -> None:
    with pytest.raises(SceneError, match=r"\[plan.start\]: no posture at rest .* misses it by"):
        read(HERE, start={"tip": [0.2, 0.0, 0.2]}).problem()
    below = [{"kind": "tip_box", "axis": "z", "high": 0.2}]
    with pytest.raises(SceneError, match=r"limits\]\] 1: the arm starts with tip_z = 0.25"):
        read(HERE, limits=below).problem()


@pytest.mark.parametrize(
    ("margin", "said"),
    [(0.0, r"begins 1\d\.\d mm inside of box 1"), (0.2, r"mm from sphere 1, nearer than 200 mm")],
)
def test_starts_in_obstacles(margin: float, said: str) -> None:
    box = {"kind": "box", "center": [-0.05, 0.0, 0.28], "size": [0.02, 0.02, 0.02]}
    problem = read(HERE, obstacles=[BALL if margin else box], margin=margin).problem()
    assert isinstance(problem.obstacles[0], Sphere if margin else Box)
    with pytest.raises(InputError, match=said):
        plan(problem)


def test_a_goal_in_python_needs_something_to_do() -> None:
    with pytest.raises(InputError, match="give targets, or a state, or rest=True"):
        Goal(rest=False)
