"""What errors of a scene's numbers do to plans, against simulations and plans made anew."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.sparse.linalg import splu

from softmpc import InverseStatics, Scene, build, chen2022
from softmpc.control.trajectory import Trajectory
from softmpc.errors import InputError
from softmpc.model.effects import Gravity, Inertia, RotaryInertia
from softmpc.model.obstacles import Sphere
from softmpc.planning.attempt import Attempt, Found
from softmpc.planning.goals import Goal, Start
from softmpc.planning.guesses import find_guesses
from softmpc.planning.motion import equations
from softmpc.planning.objective import Objective
from softmpc.planning.problem import PlanProblem
from softmpc.planning.result import INFEASIBLE, SOLVED, PlanResult
from softmpc.planning.sensitivity import PlanSensitivities, default_numbers, find_sensitivities
from softmpc.planning.sensitivity_constraints import Constraints, Multipliers, hessian
from softmpc.planning.sensitivity_open_loop import open_loop
from softmpc.planning.sensitivity_scene import Numbers, Varied
from softmpc.simulation.inputs import InputProfile
from softmpc.simulation.methods import Method
from softmpc.simulation.run import states_at
from softmpc.statics.equilibrium import find_equilibrium
from softmpc.statics.targets import Position

STIFFNESS = "sections.young_modulus+sections.shear_modulus"
EFFICIENCY = "hydraulics.efficiency"
FROM, TO = (0.12, 0.0, 0.57), (-0.05, 0.10, 0.56)
INTERVALS = {"time": 10, "effort": 12, "jerk": 12}


def scene_at(scene, name, factor):
    """The scene with another stiffness, mass or efficiency, made without the package's paths."""
    arm = scene.manipulator
    if name == EFFICIENCY:
        better = replace(arm.hydraulics, efficiency=factor * arm.hydraulics.efficiency)
        return scene.with_(manipulator=replace(arm, hydraulics=better))
    fields = ["mass"] if name == "sections.mass" else ["young_modulus", "shear_modulus"]
    sections = tuple(
        replace(s, **{field: factor * getattr(s, field) for field in fields}) for s in arm.sections
    )
    return scene.with_(manipulator=replace(arm, sections=sections))


def state_at_rest(model, u):
    rest = find_equilibrium(model, model.drive.static_gain @ u)
    return np.concatenate([rest.q, np.zeros(model.strains), model.drive.at_rest(u)])


@cache
def planned(least: str, sphere: bool = False) -> tuple[Attempt, Found]:
    """A motion on one coarse mesh, from the straight guess."""
    from softmpc import load_scene

    model = build(load_scene("examples/figure_eight.toml"))
    inverse = InverseStatics(model)
    begin, end = (inverse.solve(Position(place)) for place in (FROM, TO))
    middle = tuple((begin.tips[-1] + end.tips[-1]) / 2)
    problem = PlanProblem(
        model, Start(state_at_rest(model, begin.torques), begin.torques), (Goal((Position(TO),)),),
        least, None if least == "time" else 1.2,
        obstacles=(Sphere(middle, 0.03),) if sphere else (),
    )  # fmt: skip
    attempt = Attempt(problem, (INTERVALS[least],))
    motion = attempt.from_guess(find_guesses(replace(problem, obstacles=()))[0])
    return attempt, attempt.improve(motion)


def result_of(least: str, sphere: bool = False) -> PlanResult:
    attempt, found = planned(least, sphere)
    return PlanResult(attempt.problem, SOLVED, (), found)


@cache
def sensitivities(least: str, name: str) -> PlanSensitivities:
    return find_sensitivities(result_of(least), [name])


def made_anew(least: str, sphere: bool, name: str, factor: float) -> tuple[Attempt, object]:
    """The attempt for another arm, on the same mesh, and the plan's motion rolled on it."""
    attempt, found = planned(least, sphere)
    model = build(scene_at(attempt.problem.model.scene, name, factor))
    u = attempt.problem.start.u
    problem = replace(attempt.problem, model=model, start=Start(state_at_rest(model, u), u))
    other = Attempt(problem, (INTERVALS[least],))
    return other, other.from_plan(found)


def by_slsqp(attempt, motion):
    """The least cost and its inputs by SciPy's SLSQP, in the inputs alone, for a given time."""
    mesh, count = attempt.mesh, attempt.mesh.inputs
    nx, last = mesh.of_x.size, {"motion": motion}
    objective = Objective(mesh, attempt.moment, attempt.problem.least)
    objective = replace(objective, size=objective.amount(motion))

    def at(w):
        if last.get("key") == w.tobytes():
            return last
        before = last["motion"].at
        start = Trajectory(w.reshape(attempt.t.N, -1), before.a, before.x)
        there = attempt.roll(start, motion.durations)
        D = equations(mesh, there, attempt.problem.timing)[0][:nx].tocsc()
        F = np.zeros((mesh.moves, count))
        F[:count] = np.eye(count)
        F[count : count + nx] = -splu(D[:, count : count + nx].tocsc()).solve(
            D[:, :count].toarray()
        )
        rows = attempt.conditions(there)
        J, low, high = rows.slopes @ F, np.isfinite(rows.low), np.isfinite(rows.high)
        last.update(
            key=w.tobytes(), motion=there,
            f=objective(there), df=F.T @ objective.model(there)[1],
            g=np.concatenate([(rows.value - rows.low)[low], (rows.high - rows.value)[high]]),
            dg=np.vstack([J[low], -J[high]]),
        )  # fmt: skip
        return last

    low, high = (np.tile(b[: attempt.t.nu], attempt.t.N) for b in attempt.t.variable_bounds())
    rows = {"type": "ineq", "fun": lambda w: at(w)["g"], "jac": lambda w: at(w)["dg"]}
    found = minimize(
        lambda w: at(w)["f"], motion.at.u.ravel(), jac=lambda w: at(w)["df"],
        bounds=list(zip(low, high, strict=True)), constraints=rows, method="SLSQP",
        options={"ftol": 1e-9, "maxiter": 200},
    )  # fmt: skip
    assert found.success
    there = at(found.x)["motion"]
    return objective.amount(there) * attempt.cost_unit, there.at.u * attempt.t.u_scale


def simulated_tips(model, x, t, u):
    profile = InputProfile.from_table(t, np.vstack([u, u[-1]]), hold=True)
    integrator = Method("idas", tolerance=1e-10).integrator(model)
    status, _, states = states_at(integrator, profile, x, t)
    assert status == "finished"
    tips = model.frames.map(len(states))(states[:, : model.strains].T)[0]
    return np.asarray(tips).T.reshape(len(states), -1, 3)


@pytest.mark.parametrize(
    ("name", "start"),
    [(STIFFNESS, "rest"), pytest.param(EFFICIENCY, "state", marks=pytest.mark.slow)],
)
def test_open_loop_is_what_two_simulations_of_changed_arms_show(name, start):
    coarse, found = planned("jerk")
    problem = coarse.problem
    attempt = Attempt(problem, (4 * len(found.u),))  # where transients of the drive are resolved
    motion = attempt.from_plan(found)
    t = np.append(0.0, np.cumsum(attempt.mesh.phases.lengths(motion.durations)))
    u = motion.at.u * attempt.t.u_scale
    numbers = Numbers.of(problem.model.scene, name)
    varied = Varied(attempt, numbers, start == "rest")
    one = open_loop(attempt, motion, varied, varied.steps(motion))
    tips, ends, width = [], [], 0.004
    for sign in (1, -1):
        model = build(scene_at(problem.model.scene, name, 1 + sign * width / 2))
        x = state_at_rest(model, problem.start.u) if start == "rest" else problem.start.x
        tips.append(simulated_tips(model, x, t, u))
        q = state_at_rest(model, u[-1])[: model.strains]
        ends.append(np.asarray(model.frames(q)[0]).T)
    shown = (tips[0] - tips[1]) / width
    size = np.linalg.norm(shown, axis=2).max()
    assert size > 0.05  # m: half a millimetre a per cent
    assert np.abs(one.tips - shown).max() < 0.03 * size
    assert one.drift == pytest.approx(size, rel=0.03)
    assert one.misses[0] == pytest.approx(np.linalg.norm(shown[-1, -1]), rel=0.03)
    settled = (ends[0] - ends[1]) / width
    assert np.abs(one.settled - settled).max() < 0.01 * np.abs(settled).max()


@pytest.mark.slow
def test_least_effort_is_that_of_plans_made_anew_by_slsqp():
    found, width = sensitivities("effort", STIFFNESS), 0.01
    one = found.numbers[0].replanned
    assert found.exact and found.freedom > 0 and found.flat == 0
    (up, _), (down, _) = (
        by_slsqp(*made_anew("effort", False, STIFFNESS, 1 + sign * width / 2)) for sign in (1, -1)
    )
    # Limits begin and end to hold within the half per cent: a few per cent are left.
    assert one.cost == pytest.approx((up - down) / width, rel=0.05)


@pytest.mark.slow
def test_least_jerk_and_its_inputs_are_those_of_plans_made_anew_by_slsqp():
    found, width = sensitivities("jerk", STIFFNESS), 0.01
    one = found.numbers[0].replanned
    assert found.exact and found.freedom > 0 and found.flat == 0
    assert one.within > width / 2
    (cost_up, up), (cost_down, down) = (
        by_slsqp(*made_anew("jerk", False, STIFFNESS, 1 + sign * width / 2)) for sign in (1, -1)
    )
    assert one.cost == pytest.approx((cost_up - cost_down) / width, rel=0.01)
    shown = (up - down) / width
    assert np.linalg.norm(one.u - shown) < 0.05 * np.linalg.norm(shown)


@pytest.mark.slow
def test_least_time_is_that_of_plans_made_anew(monkeypatch):
    found = find_sensitivities(result_of("time", True), ["sections.mass"])
    one = found.numbers[0].replanned
    monkeypatch.setattr("softmpc.planning.sqp.DECREASE", 1e-5)
    up, down = (
        attempt.improve(motion)
        for attempt, motion in (
            made_anew("time", True, "sections.mass", factor) for factor in (1.01, 0.99)
        )
    )
    assert up.met and down.met
    assert one.cost == pytest.approx((up.cost - down.cost) / 0.02, rel=0.05)
    assert one.durations.sum() == pytest.approx(one.cost, rel=0.15)


def test_curvature_of_the_lagrangian_is_that_of_its_gradient():
    attempt, _ = planned("jerk")
    motion, mesh = attempt.solved.motion, attempt.mesh
    here, rng = Constraints.of(attempt, motion), np.random.default_rng(1)
    m = Multipliers(rng.standard_normal(len(here.d)), rng.standard_normal(len(here.value)))
    H = hessian(attempt, motion, m)

    def gradient(there):
        held = Constraints.of(attempt, there).gradients(m).sum(axis=0)
        return held + attempt.objective.model(there)[1]

    v = np.zeros(mesh.moves)
    v[: mesh.inputs] = 1e-4 * rng.standard_normal(mesh.inputs)
    v[-1] = 1e-5
    states = slice(mesh.inputs, mesh.inputs + mesh.of_x.size)
    D = here.D[: mesh.of_x.size].tocsc()
    v[states] = -splu(D[:, states].tocsc()).solve(D @ v)
    ahead, back = attempt.roll.moved(motion, v), attempt.roll.moved(motion, -v)
    change = 0.5 * (gradient(ahead) - gradient(back))
    assert np.abs(change - H @ v).max() < 1e-3 * np.abs(change).max()
    assert abs(H - H.T).max() < 1e-9 * abs(H).max()


@pytest.mark.slow
def test_text_and_numbers():
    found = sensitivities("jerk", STIFFNESS)
    head, row, start = found.text().splitlines()[:3]
    assert head.startswith("a number 1 % higher") and "N²m²/s" in head
    one, data = found.numbers[0], found.summary()[0]
    assert f"{0.01 * one.replanned.cost:+.3g}" in row
    assert "starts at rest" in start
    assert data["miss_mm_per_percent"][0] == pytest.approx(1e3 * 0.01 * one.open_loop.misses[0])
    assert data["values"] == {
        "sections.young_modulus": one.values[0], "sections.shear_modulus": one.values[1]
    }  # fmt: skip


def test_pressures_are_in_mpa():
    empty = PlanSensitivities("rest", "jerk", "Pa²/s", True, True, 1, 0, ())
    head = empty.text().splitlines()[0]
    assert "cost, Pa²/s" in head and "input, MPa" in head


def test_defaults_are_stiffness_mass_and_payload():
    from softmpc.model.payload import Payload

    effects = (Gravity(), Inertia(), RotaryInertia(), Payload())
    assert default_numbers(Scene(chen2022(), effects=effects))[-1] == "effects.payload.mass"
    assert default_numbers(Scene(chen2022(), effects=effects[:3])) == (STIFFNESS, "sections.mass")


def test_what_makes_no_sense_is_refused():
    result = result_of("jerk")
    with pytest.raises(InputError, match="did you mean"):
        find_sensitivities(result, ["sections.young_modulu"])
    with pytest.raises(InputError, match=r"hydraulics.friction = 0: a relative change"):
        find_sensitivities(result, ["hydraulics.friction"])
    with pytest.raises(InputError, match="start = 'moving'"):
        find_sensitivities(result, start="moving")
    wrong = replace(result, status=INFEASIBLE, found=replace(result.found, met=False))
    with pytest.raises(InputError, match="'infeasible' has no optimum"):
        find_sensitivities(wrong)
    swung = result.problem.start.x.copy()
    swung[result.problem.model.strains] = 5.0
    moving = replace(result.problem, start=Start(swung, result.problem.start.u))
    with pytest.raises(InputError, match="does not start at rest"):
        find_sensitivities(replace(result, problem=moving), start="rest")
