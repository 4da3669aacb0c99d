"""Plans against what is known otherwise: closed-form least times, another solver's least effort,
replays, and problems that have no solution by construction."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
import pytest
from oracles.bang_bang import Swing, elongation_swing
from oracles.shooting import least_effort
from test_shooting_oracle import SWINGS

from softmpc.control.limits import PressureLimit, TipBox
from softmpc.errors import InputError
from softmpc.model.actuation import Actuation, HydraulicDrive, PressureDrive, SlowDrive
from softmpc.model.model import Model, build
from softmpc.model.obstacles import Box, Plane, Sphere
from softmpc.model.presets import chen2022
from softmpc.model.scene import Scene
from softmpc.planning import goals
from softmpc.planning.attempt import Attempt
from softmpc.planning.goals import Goal, Start
from softmpc.planning.guesses import find_guesses
from softmpc.planning.planner import PlanSettings, plan
from softmpc.planning.problem import PlanProblem, arm_limits
from softmpc.planning.result import PlanResult
from softmpc.statics.inverse import InverseStatics
from softmpc.statics.targets import Direction, Position

QUICK = PlanSettings(intervals=16, change=0.05)
HERE, THERE = (0.12, 0.0, 0.57), (-0.05, 0.10, 0.56)
MIDDLE = (0.035, 0.05, 0.565)


class Arm(NamedTuple):
    model: Model
    start: Start


@cache
def paper() -> Arm:
    """The paper's arm with all of its hydraulics, at rest to one side."""
    model = build(Scene(chen2022()))
    rest = InverseStatics(model).solve(Position(HERE))
    return Arm(model, Start.at_rest(model, rest.q, np.asarray(rest.torques)))


def problem(**wanted: object) -> PlanProblem:
    """From one side to the other, as fast as it can."""
    arm = paper()
    given = {"goals": (Goal((Position(THERE),)),), "start": arm.start} | wanted
    return PlanProblem(arm.model, **given)  # type: ignore[arg-type]


# ---------------------------------------------------------------- least time


def stretched(actuation: Actuation) -> tuple[Swing, PlanResult]:
    """The arm that can only stretch, planned from rest to rest."""
    swing = elongation_swing(actuation)
    model = build(swing.scene)
    states = [np.r_[state[:2], np.repeat(state[2:], 3)] for state in swing.states]
    goal = Goal(state=states[1])
    asked = PlanProblem(model, Start(states[0], swing.start), (goal,))
    return swing, plan(asked, PlanSettings(intervals=24, change=0.002, most_intervals=96))


@pytest.mark.sampled
@pytest.mark.parametrize(
    ("actuation", "within"),
    [(PressureDrive(), 1e-3), (SlowDrive(), 2e-3)],
    ids=["pressures", "slow mode"],
)
def test_least_time_is_the_one_of_its_switching_times(actuation: Actuation, within: float) -> None:
    swing, found = stretched(actuation)
    assert found.solved
    assert found.time == pytest.approx(swing.time, rel=within)
    low, high = (b[0] for b in Attempt(found.problem, (2,)).t.variable_bounds())
    scaled = found.u / found.problem.model.layout.u.scale
    at_bound = (scaled - low < 1e-3) | (high - scaled < 1e-3)
    inside = len(scaled) - int(at_bound.all(axis=1).sum())
    assert inside <= len(swing.switches) + 1  # an interval with each switch, and the last one
    middle = (found.t[1:] + found.t[:-1]) / 2
    expected = np.array([swing.motion.input(t) for t in middle])
    apart = np.abs(middle[:, None] - swing.switches).min(axis=1) > np.diff(found.t)
    apart[-1] = False  # there the input is already the one that holds the arm
    off = np.abs(found.u.mean(axis=1) - expected)[apart] / (expected.max() - expected.min())
    assert off.max() < 0.02


@pytest.mark.slow
def test_least_time_with_all_of_the_hydraulics() -> None:
    swing, found = stretched(HydraulicDrive())
    assert found.solved and found.time == pytest.approx(swing.time, rel=0.01)


# ---------------------------------------------------------------- least effort


@pytest.mark.sampled
@pytest.mark.parametrize("name", SWINGS)
def test_least_effort_is_that_of_direct_shooting(name: str) -> None:
    """On the same intervals, with the same tolerances at the end; see the oracle for finer ones."""
    between = SWINGS[name]()
    model, n = between.model, between.model.strains
    start, end = (Start.at_rest(model, r.q, r.torques) for r in (between.start, between.end))
    asked = PlanProblem(
        model, start, (Goal(state=end.x, rest=False),), "effort", float(between.times[-1])
    )
    attempt = Attempt(asked, (48,))
    motion = attempt.from_guess(find_guesses(asked)[0])
    assert motion is not None
    found = attempt.improve(motion)
    assert found.met
    band = np.full(len(model.layout.x), goals.REST)
    band[:n] = goals.STRAIN
    other = least_effort(model, between.start, between.end, found.t, band=band)
    assert found.cost == pytest.approx(other.cost, rel=0.01)
    effort = float(np.sum(np.diff(found.t)[:, None] * found.u**2))
    assert found.cost == pytest.approx(effort)


# ---------------------------------------------------------------- obstacles and goals


def swing_around_a_ball() -> PlanResult:
    return plan(problem(obstacles=(Sphere(MIDDLE, 0.03),)), QUICK, executor=1)


@pytest.mark.slow
def test_swing_around_a_ball() -> None:
    """The straight way is blocked; the replay by IDAS ends within 1 mm, and clear all along."""
    free = plan(problem(), QUICK)
    found = swing_around_a_ball()
    assert found.solved and found.replay is not None
    assert found.replay.misses[0] < 1e-3 and found.replay.drift < 1e-3
    assert found.replay.clearance["sphere 1"] > -1e-3
    assert found.time > 1.02 * free.time
    assert len(found.starts) > 1 and sum(start.won for start in found.starts) == 1
    assert "clearance of sphere 1" in found.held_by
    full = ((found.u < 1e-3) | (found.u > 2.5 - 1e-3)).mean(axis=1)
    assert full @ np.diff(found.t) > 0.75 * found.time  # bang-bang, but along the ball


@pytest.mark.slow
def test_waypoints_and_times() -> None:
    """One waypoint is passed at its time, the next when it is best, with a direction at last."""
    way = (
        Goal((Position((0.08, 0.06, None)),), rest=False, after=0.3),
        Goal((Position((0.0, 0.1, None)),), rest=False),
        Goal((Position(THERE), Direction((-0.25, 0.45, 1.0)))),
    )
    found = plan(problem(goals=way, least="jerk", duration=0.9), PlanSettings(intervals=12))
    assert found.solved and found.replay is not None and found.found is not None
    assert found.found.durations[0] == pytest.approx(0.3)
    assert found.time == pytest.approx(0.9)
    assert max(found.replay.misses) < 5e-4 and max(found.replay.turns) < 5e-3
    tips = found.replay.tips[:, -1]
    passed = np.linalg.norm(tips[:, :2] - (0.08, 0.06), axis=1).argmin()
    assert found.replay.t[passed] == pytest.approx(0.3, abs=0.02)


@pytest.mark.slow
def test_a_start_in_motion() -> None:
    """Stopping: from full swing to rest anywhere."""
    arm = paper()
    swing = plan(problem(), PlanSettings(intervals=8, change=0.5, tolerance=5e-3))
    half = len(swing.u) // 2
    start = Start(swing.x[half], swing.u[half - 1])
    assert np.abs(start.x[arm.model.strains : 2 * arm.model.strains]).max() > 1.0
    found = plan(problem(start=start, goals=(Goal(),)), QUICK)
    assert found.solved and found.replay is not None
    assert found.replay.drift < 1e-3
    assert found.x[0] == pytest.approx(start.x)


# ---------------------------------------------------------------- no solution


REACH = (Goal((Position(THERE),)),)
NO_WAY: dict[str, tuple[dict[str, object], str, str]] = {
    "out of reach": (
        {"goals": (Goal((Position((0.0, 0.0, 0.95)),)),)}, "goal 1: position", "P_a",
    ),
    "no time": (
        {"goals": (Goal((Position(THERE),), after=0.05),), "least": "effort"}, "goal 1", "limit of",
    ),
    "slow motors": (
        {"goals": REACH, "least": "jerk", "duration": 0.3, "rate": 0.5}, "goal 1", "rate of T",
    ),
    "goal in a box": (
        {"obstacles": (Box(THERE, (0.08, 0.08, 0.08)),)}, "goal 1", "clearance of box",
    ),
    "a wall between": (
        {"obstacles": (Plane((0.0, 0.08, 0.0), (0.0, -1.0, 0.0)),)}, "goal 1", "clearance of plane",
    ),
}  # fmt: skip


LONG = ("goal in a box", "a wall between")  # nine starts, each to the end


@pytest.mark.sampled
@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=pytest.mark.slow) if n in LONG else n for n in NO_WAY]
)
def test_the_right_limit_is_named(name: str) -> None:
    wanted, gives_way, to_blame = NO_WAY[name]
    settings = PlanSettings(intervals=12, tolerance=5e-3, change=0.5)
    found = plan(problem(**wanted), settings, executor=1)
    assert found.status == "infeasible"
    assert found.gives_way[0].name.startswith(gives_way)
    assert any(limit.startswith(to_blame) for limit in found.held_by[:3]), found.held_by
    assert found.replay is not None and found.replay.misses[0] > 1e-3
    assert np.all(np.isfinite(found.u))


@pytest.mark.slow
def test_a_limit_that_the_start_breaks() -> None:
    arm = paper()
    tight = (*arm_limits(arm.model), TipBox(-1.0, 0.0, axis="x"))
    asked = problem(limits=tight, least="jerk", duration=0.5)
    found = plan(asked, PlanSettings(intervals=12, tolerance=5e-3, change=0.5))
    assert found.status == "infeasible"
    assert found.gives_way[0].name == "tip_x" and found.gives_way[0].unit == "m"
    assert found.gives_way[0].time < 0.1  # at the beginning


def test_wrong_arguments() -> None:
    arm = paper()
    for wanted, said in [
        ({"goals": ()}, "goals is empty"),
        ({"least": "energy"}, "did you mean"),
        ({"least": "effort"}, "needs a time"),
        ({"duration": -1.0}, "must be a number above 0"),
        ({"rate": float("nan")}, "must be a number above 0"),
        ({"start": Start(np.zeros(3), np.zeros(6))}, "Start.x of shape"),
        ({"goals": (Goal((Position(THERE, section=4),)),)}, "section 4"),
        ({"obstacles": (Sphere((0.12, 0.0, 0.57), 0.05),)}, "begins .* inside of sphere 1"),
    ]:
        with pytest.raises(InputError, match=said):
            plan(problem(**wanted))
    with pytest.raises(InputError, match="above 0 s"):
        Goal((Position(THERE),), after=0.0)
    with pytest.raises(InputError, match="whole number from 2"):
        PlanSettings(intervals=1)
    assert PressureLimit(0.0, 1e6) in arm_limits(arm.model)
