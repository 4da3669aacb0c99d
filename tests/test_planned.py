"""A plan as the reference of a closed loop: its file, its torque fed forward, its start."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from plans import simulated_plan, still_plan, write_plan

from softmpc.control.baselines import FeedForward
from softmpc.control.closed_loop import Controller, close_loop, start_at
from softmpc.control.compare import BASELINES, OF_PLAN, controllers_of
from softmpc.control.controller_table import ControllerSettings
from softmpc.control.guide import PlanGuide
from softmpc.control.objective import Objective
from softmpc.control.planned import read_planned
from softmpc.control.planned_start import is_at_rest
from softmpc.control.track_result import TrackResult
from softmpc.control.tracking import (
    Setup,
    read_track_file,
    read_tracking,
    set_up,
    without_feed_forward,
)
from softmpc.errors import SceneError
from softmpc.model.model import Model, build
from softmpc.model.presets import chen2022
from softmpc.model.scene import Scene
from softmpc.rig.rigging import rig_up
from softmpc.rig.scene_table import read_rig
from softmpc.statics.equilibrium import find_equilibrium

STEP = 0.025
BEFORE = np.array([0.5, 0.6, 0.4, 0.5, 0.5, 0.6])
STIFFER = {"young_modulus": 1.38e6, "shear_modulus": 0.46e6}
OTHER = {"model": {"segments": 2}, "manipulator": STIFFER}
DOCUMENT = {"effects": {"gravity": [0.0, 0.0, 9.81]}}


@pytest.fixture(scope="module")
def model() -> Model:
    return build(Scene(chen2022()))


def swing(model: Model) -> dict[str, np.ndarray]:
    """Half a second of torques, and as long again in which the arm comes to rest."""
    torques = BEFORE + np.outer(np.sin(np.pi * np.arange(20) / 20) ** 2, [0.9, -0.4, 0, 0.6, 0, 0])
    t = np.append(STEP * np.arange(21), 2.5)
    return simulated_plan(model, BEFORE, t, np.vstack([torques, BEFORE]))


@pytest.fixture(scope="module")
def plan(model: Model, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_plan(tmp_path_factory.mktemp("plan"), swing(model))


def setup_of(plan: Path, controller: dict[str, Any], **track: Any) -> Setup:
    table = {
        "path": "plan", "hold": 0.2, "controller": {"horizon": 8, **controller},
        "plant": {"tolerance": 1e-7}, **track,
    }  # fmt: skip
    return set_up(Scene(chen2022()), read_tracking(table, plan.parent, DOCUMENT))


# ---------------------------------------------------------------- the file


def broken(**changes: Any) -> dict[str, Any]:
    return still_plan() | changes


BROKEN: dict[str, tuple[Callable[[], dict[str, Any]], str]] = {
    "missing": (lambda: {k: v for k, v in still_plan().items() if k != "u_after"}, "no 'u_after'"),
    "flat": (lambda: broken(u=np.zeros(6)), r"u has shape \(6,\): must be K×k"),
    "rows": (lambda: broken(u=np.zeros((5, 6))), r"u has shape .*: must be K×k, with K = 2"),
    "columns": (lambda: broken(x=np.zeros((3, 9)), samples_x=np.zeros((11, 8))), "nx = 9"),
    "tips": (lambda: broken(samples_tips=np.zeros((11, 2, 2))), "must be M×S×3"),
    "nan": (lambda: broken(u_before=np.full(6, np.nan)), "u_before has 6 values not finite"),
    "times": (lambda: broken(t=np.array([0.0, 1.0, 1.0])), "t: must be two .* increase"),
    "late": (lambda: broken(t=np.array([0.1, 0.5, 1.0])), "begin at 0"),
    "other end": (lambda: broken(t=np.array([0.0, 0.5, 2.0])), "samples_t ends at 1 s and t at 2"),
}


@pytest.mark.parametrize("name", BROKEN)
def test_broken_plans_are_named(name: str, tmp_path: Path) -> None:
    make, said = BROKEN[name]
    path = write_plan(tmp_path, make())
    with pytest.raises(SceneError, match=said) as caught:
        read_planned(path)
    assert str(path) in str(caught.value)


def test_files_that_are_none(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=r"plan .*plan.npz: no such file; `softmpc plan"):
        read_planned(tmp_path / "plan.npz")
    (tmp_path / "plan.npz").write_text("t,u\n0,1\n")
    with pytest.raises(SceneError, match="is not a saved plan"):
        read_planned(tmp_path / "plan.npz")
    with pytest.raises(SceneError, match="another version"):
        read_planned(write_plan(tmp_path, still_plan(), schema=99))


@pytest.mark.parametrize(
    ("sizes", "said"),
    [
        ({"inputs": 3}, "the plan has 3 inputs and the arm of this scene 6"),
        ({"sections": 1}, "the plan has 1 sections and the arm of this scene 2"),
        ({"states": 10}, "the plan has 10 states and the arm of this scene 34"),
    ],
)
def test_plans_of_another_arm(sizes: dict[str, int], said: str, tmp_path: Path) -> None:
    plan = write_plan(tmp_path, still_plan(**sizes))
    with pytest.raises(SceneError, match=said):
        setup_of(plan, {})


@pytest.mark.parametrize("key", ["lap_time", "laps", "smooth_start"])
def test_a_plan_has_no_laps(key: str, plan: Path) -> None:
    with pytest.raises(SceneError, match=rf"\[track\] {key}: a plan has its own times"):
        setup_of(plan, {}, **{key: 2.0})


def test_only_plans_are_fed_forward() -> None:
    point = {"path": "point", "center": [0.0, 0.0, 0.6], "controller": {"feed_forward": False}}
    with pytest.raises(SceneError, match=r"\[track.controller\] feed_forward: only a plan"):
        read_tracking(point, Path())


def test_motion_between_its_nodes(plan: Path) -> None:
    """Held torques by a loop over fine times; the tip at its samples and between them."""
    arrays, motion = swing_arrays(plan), read_planned(plan)
    t, u = arrays["t"], arrays["u"]

    def held(time: float) -> np.ndarray:
        if time < 0 or time >= t[-1]:
            return arrays["u_before"] if time < 0 else arrays["u_after"]
        return u[np.flatnonzero(t <= time)[-1]]

    for start, end in ((-0.1, -0.05), (-0.02, 0.03), (0.11, 0.137), (0.4, 0.9), (2.4, 2.7)):
        fine = start + (end - start) * (np.arange(2000) + 0.5) / 2000
        mean = np.mean([held(time) for time in fine], axis=0)
        found = motion.mean_input(np.array([start]), np.array([end]))[0]
        assert found == pytest.approx(mean, abs=2e-3)
    samples, tips = arrays["samples_t"], arrays["samples_tips"][:, -1]
    assert motion.tip(samples) == pytest.approx(tips, abs=1e-12)
    coarse = replace(motion, samples_t=samples[::5], samples_tips=arrays["samples_tips"][::5],
                     samples_x=motion.samples_x[::5], samples_p=motion.samples_p[::5])  # fmt: skip
    assert coarse.tip(samples) == pytest.approx(tips, abs=2e-6)
    assert motion.tip(np.array([3.0]))[0] == pytest.approx(tips[-1], abs=1e-12)


def guide_of(setup: Setup) -> PlanGuide:
    assert isinstance(setup.guide, PlanGuide)
    return setup.guide


def loop(setup: Setup, controller: Controller | None, duration: float) -> TrackResult:
    """A part of a run, of the setup's own controller by default."""
    return close_loop(
        controller or setup.controller, setup.plant, setup.guide, setup.start, duration=duration
    )


def swing_arrays(plan: Path) -> dict[str, np.ndarray]:
    with np.load(plan) as file:
        return {name: file[name] for name in file.files if name != "about"}


@pytest.mark.slow
def test_the_scene_that_comes_with_a_plan(model: Model, tmp_path: Path) -> None:
    """What the planner stores is read, and its scene for `softmpc track` follows it."""
    from softmpc.planning.goals import Goal, Start
    from softmpc.planning.plan_files import save_plan
    from softmpc.planning.planner import PlanSettings
    from softmpc.planning.planner import plan as find_plan
    from softmpc.planning.problem import PlanProblem
    from softmpc.statics.targets import Position

    start = start_at(model, find_equilibrium(model, model.drive.static_gain @ BEFORE))
    place = np.asarray(model.tip(start.x[: model.strains])).ravel() + [0.04, 0.03, 0.0]
    goal = Goal((Position(tuple(place.tolist())),))
    problem = PlanProblem(model, Start(start.x, start.u), (goal,), "jerk", 0.4)
    found = find_plan(problem, PlanSettings(intervals=8, most_intervals=16), executor=1)
    save_plan(found, tmp_path)
    _, scene, task = read_track_file(tmp_path / "track.toml")
    setup = set_up(scene, task)
    run = setup.run(setup.controller)
    assert run.time[-1] == pytest.approx(found.time + 1.0, abs=STEP)
    assert run.failures == 0 and run.error.max() < 1e-3
    end = np.linalg.norm(run.tip[-1] - place)
    assert end < 5e-4


# ---------------------------------------------------------------- feed-forward


def test_a_plan_is_free_of_charge(plan: Path) -> None:
    """All costs vanish at what was planned; those of a path do not."""
    setup = setup_of(plan, {})
    guide, layout, arrays = guide_of(setup), setup.ocp.model.layout, swing_arrays(plan)
    given = guide.given(0.1 + setup.ocp.nodes)
    u, x = arrays["u"][3:12] / layout.u.scale, arrays["x"][5:13] / layout.x.scale
    for costs, free in ((setup.ocp.costs, True), (ControllerSettings().costs, False)):
        objective = Objective(replace(setup.ocp, costs=costs, limits=()))
        value = ca.Function("e", objective.symbols, [objective.residuals])
        told = np.hstack([given[name] for name in objective.references])
        rows = u[:-1].T, u[1:].T, x.T, told.T, np.ones((1, len(x)))
        e = np.asarray(value.map(len(x))(*rows))
        assert bool(np.abs(e).max() < 1e-6) is free
        assert free or np.abs(e).max() > 0.1


def test_other_problems_know_nothing_of_plans(model: Model) -> None:
    plain = Objective(ControllerSettings().problem(model))
    assert plain.references == {"tip": 3}
    told = Objective(ControllerSettings().problem(model, planned=True))
    assert set(told.references.values()) == {3, 6, 8} and len(told.references) == 4
    assert told.cost.n_instructions() > plain.cost.n_instructions()
    silent = ControllerSettings(feed_forward=False).problem(model, planned=True)
    assert Objective(silent).references == {"tip": 3}


@pytest.mark.sampled
@pytest.mark.parametrize(
    ("solver", "duration"),
    [
        ("real-time", 0.6),
        ("sqp", 0.3),
        pytest.param("ipopt", 0.1, marks=pytest.mark.slow),
        ("fatrop", 0.05),
    ],
)
def test_on_its_own_arm_the_plan_is_followed(solver: str, duration: float, plan: Path) -> None:
    """Its torque comes out but for what the coarse steps of the controller get wrong."""
    setup = setup_of(plan, {"solver": solver, "stages": 3})
    assert np.array_equal(setup.start.x, guide_of(setup).motion.x[0])
    off = {}
    for name, controller in (("with", setup.controller), ("without", without_feed_forward(setup))):
        run = loop(setup, controller, duration)
        assert run.failures == 0 and run.error.max() < 1e-3
        planned = guide_of(setup).motion.mean_input(run.control_time, run.control_time + STEP)
        off[name] = np.abs(run.u - planned).max()
    assert off["with"] < 0.02 and off["without"] > 5 * off["with"]


def test_the_first_solve_begins_at_the_plan(plan: Path) -> None:
    setup = setup_of(plan, {})
    mpc, guide = setup.controller, guide_of(setup)
    mpc.prepare(guide.given(0.1 + setup.ocp.nodes), setup.start.u)
    assert mpc._asked is not None
    first = mpc._first_inputs(mpc._asked)
    assert first == pytest.approx(swing_arrays(plan)["u"][4:12], abs=1e-9)


def test_baselines_of_a_plan(plan: Path) -> None:
    setup = setup_of(plan, {})
    assert list(controllers_of(setup)) == ["real-time", *OF_PLAN] and len(OF_PLAN) == len(BASELINES)
    run = loop(setup, FeedForward(setup.ocp, setup.guide), 0.5)
    assert run.u == pytest.approx(swing_arrays(plan)["u"][:20], abs=1e-9)
    assert run.error.max() < 2e-6  # another tolerance of the same method


@pytest.fixture(scope="module")
def elsewhere(plan: Path) -> Setup:
    """On another plant than the plan's."""
    return setup_of(plan, {}, plant={"tolerance": 1e-6, "scene": OTHER})


def test_costs_of_a_loop_on_another_plant(elsewhere: Setup) -> None:
    """Planned rates are those of the plant's own segments."""
    run = loop(elsewhere, None, 0.05)
    assert set(run.costs) == {"tip", "torque", "torque rate", "strain rate"}


# ---------------------------------------------------------------- start and limits


def test_another_plant_rests_with_its_tip_at_the_start(elsewhere: Setup) -> None:
    setup = elsewhere
    plant, tip = setup.plant.model, guide_of(setup).motion.samples_tips[0, -1]
    x, u = setup.start.x, setup.start.u
    assert np.abs(u - BEFORE).max() > 0.01  # it is stiffer
    posture = find_equilibrium(plant, plant.drive.static_gain @ u)
    assert posture.tips[-1] == pytest.approx(tip, abs=1e-5)
    assert x[: plant.strains] == pytest.approx(posture.q, abs=1e-6)


@pytest.mark.slow
def test_a_plan_may_begin_in_motion(model: Model, tmp_path: Path) -> None:
    """The run begins so too, on a plant with other segments with the same rates; a rig cannot."""
    arrays, first = swing(model), 100
    cut = {name: arrays[name][first:] for name in arrays if name.startswith("samples_")}
    cut["samples_t"] = cut["samples_t"] - 0.1
    arrays |= cut | {"t": arrays["t"][4:] - 0.1, "u": arrays["u"][4:], "x": arrays["x"][4:],
                     "u_before": arrays["u"][3]}  # fmt: skip
    plan = write_plan(tmp_path, arrays)
    setup = setup_of(plan, {}, plant={"scene": OTHER})
    start, n = setup.start, setup.plant.model.strains
    assert not is_at_rest(setup.plant.model, start.x, start.u)
    planned = arrays["x"][0, model.strains : 2 * model.strains]
    assert np.abs(planned).max() > 0.05
    assert sorted(set(np.round(start.x[n : 2 * n], 12))) == sorted(set(np.round(planned, 12)))
    table = {"path": "plan", "controller": {"horizon": 4}}
    task, rig = read_tracking(table, tmp_path, DOCUMENT), read_rig({"wait": 0.5})
    with pytest.raises(SceneError, match=r"\[rig\] wait = 0.5 s: .* begins in motion"):
        rig_up(Scene(chen2022()), task, rig)
    assert rig_up(Scene(chen2022()), task, replace(rig, wait=0.0)).setup.start.u is not None


def test_limits_of_the_controller_are_checked(plan: Path, tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=r"planned torque rate: t = 0.0.* changes faster"):
        setup_of(plan, {"torque_rate": 1.0})
    setup = setup_of(plan, {"torque_rate": 1.0}, on_infeasible="project")
    found, u = setup.preflight.findings, swing_arrays(plan)["u"]
    worst = max(one.excess for one in found)
    assert worst == pytest.approx(np.abs(np.diff(u[:20], axis=0)).max() / STEP - 1.0, abs=1e-6)
    assert setup.guide.followed(np.array([0.3])) == pytest.approx(
        setup.guide.asked(np.array([0.3])), abs=0
    )
    more = swing_arrays(plan)
    more["u"] = more["u"] + np.array([1.3, 0, 0, 0, 0, 0])
    with pytest.raises(SceneError, match=r"planned torque: .* by up to 0.\d+ N·m"):
        setup_of(write_plan(tmp_path, more), {})


# ---------------------------------------------------------------- on a rig


@pytest.mark.slow
def test_a_rig_follows_a_plan(plan: Path, model: Model) -> None:
    """A stiffer, finer plant with noise: it ends within 3 mm, where open loop does not."""
    settings = {"section_tips": {"latency": 0.01}, "unit_pressures": {}, "seed": 1}
    table = {
        "path": "plan", "controller": {"horizon": 12},
        "plant": {"tolerance": 1e-6, "scene": OTHER},
    }  # fmt: skip
    task = read_tracking(table, plan.parent, DOCUMENT)
    rig = rig_up(Scene(chen2022()), task, read_rig(settings))
    result = rig.run(duration=0.8)
    assert result.summary()["worst_state"] != "fall back" and result.track.failures == 0
    assert result.track.error[-1] < 3e-3 and result.track.error.max() < 0.01
    alone = loop(rig.setup, FeedForward(rig.setup.ocp, rig.setup.guide), 0.8)
    assert alone.error[-1] > 2 * result.track.error[-1]
    held = rig.setup.guide.holding(0.25)
    planned = guide_of(rig.setup).motion.pressures(np.array([0.25]))[0]
    assert model.drive.static_gain @ held == pytest.approx(planned, rel=1e-9)
    rig.pilot.mpc.budget = 1e-9  # nothing is ever in time
    late = rig.run(duration=0.3)
    assert late.summary()["worst_state"] == "fall back" and np.all(np.isfinite(late.track.u))
