"""The arm at rest as a program: its limits, its optima and their derivatives."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from softmpc.errors import InputError
from softmpc.model.actuation import PressureDrive
from softmpc.model.drive_effects import Cavitation, ChamberCoupling, EndStops
from softmpc.model.effects import Gravity
from softmpc.model.model import Model, build
from softmpc.model.parameters import Manipulator
from softmpc.model.presets import chen2022
from softmpc.model.scene import Scene
from softmpc.statics import program as program_module
from softmpc.statics.equilibrium import find_equilibrium
from softmpc.statics.program import Extra, RestProgram, RestSolution, RestSolver, Rows
from softmpc.statics.rest_limits import beyond_limits, rest_limits, torques_at_rest

PAPER = chen2022()


def limited(**limits: float) -> Manipulator:
    return replace(PAPER, limits=replace(PAPER.limits, **limits))


def arm(manipulator: Manipulator = PAPER, *effects: object, **scene: object) -> Model:
    return build(Scene(manipulator, effects=(Gravity(), *effects), **scene))


def at_most_pressure(model: Model) -> RestSolution:
    """Equal pressures as high as the limits let them be."""
    program = RestProgram(model)
    equal = program.p[1:] / 1e6 - program.p[0] / 1e6
    still = np.zeros(equal.numel())
    solver = program.solver(-program.p[0] / 1e6, rows=Rows(equal, still, still))
    start = find_equilibrium(model, np.full(6, 0.1e6))
    found = solver(program.guess(start.q, start.pressures))
    assert found.solved, found.status
    return found


def test_torque_and_stroke_bound_the_pressures() -> None:
    limits = rest_limits(arm(limited(torque_max=1.0)))
    gain = 2 * np.pi * 0.535 / 0.004 / 0.0021  # 2πη/lead over A_c, at rest P A_c = F_b
    assert limits.high == pytest.approx(np.full(6, gain), rel=1e-9)
    assert limits.low == pytest.approx(np.zeros(6))
    assert torques_at_rest(arm(), np.full(6, gain)) == pytest.approx(np.ones(6))
    # x A_c = (A_d² l_0/(E A_s) + (V_1 + V_2)/K) P
    travel = (3.14e-4**2 * 0.25 / (1.2e6 * 3.93e-4) + (7.85e-5 + 7.35e-4) / 2.18e9) / 0.0021
    limits = rest_limits(arm(limited(stroke_max=0.01)))
    assert limits.high == pytest.approx(np.full(6, 0.01 / travel), rel=1e-9)
    stops = rest_limits(arm(limited(stroke_max=0.03), EndStops(start=0.02)))
    assert stops.high == pytest.approx(np.full(6, 0.01 / travel), rel=1e-9)


def test_pressure_driven_arms_have_no_torque() -> None:
    model = arm(actuation=PressureDrive())
    assert torques_at_rest(model, np.zeros(6)) is None
    assert rest_limits(model).high == pytest.approx(np.full(6, 1e6))


@pytest.mark.parametrize("effect", [ChamberCoupling(), Cavitation()])
def test_where_the_travel_is_not_linear_it_is_a_row(effect: object) -> None:
    """The pistons travel just as far as they may, by the drive's own law."""
    model = arm(limited(stroke_max=0.015), effect)
    assert rest_limits(model).high == pytest.approx(np.full(6, 1e6))
    found = at_most_pressure(model)
    u = torques_at_rest(model, found.pressures)
    travel = np.asarray(model.piston_places(model.drive.at_rest(u), found.q)).ravel()
    assert travel.max() == pytest.approx(0.015, rel=1e-6)
    assert found.pressures.max() < 0.99e6


def test_stretch_and_curvature_are_limits() -> None:
    model = arm(limited(stretch_max=0.3))
    found = at_most_pressure(model)
    assert found.q[[0, 4]].max() == pytest.approx(0.3, abs=1e-7)
    model = arm(limited(curvature_max=3.0))
    program = RestProgram(model)
    solver = program.solver((program.p[1] + program.p[2] - program.p[0]) / 1e6)
    found = solver(program.guess(*still(model)))
    bends = np.hypot(found.q[[1, 5]], found.q[[2, 6]])
    assert found.solved and bends.max() == pytest.approx(3.0, abs=1e-6)


def still(model: Model) -> tuple[np.ndarray, np.ndarray]:
    start = find_equilibrium(model, np.full(len(model.layout.p), 0.1e6))
    return start.q, start.pressures


def test_a_scene_without_a_range_of_pressures_has_one_posture() -> None:
    model = arm(limited(pressure_min=0.0, pressure_max=0.0))
    limits = rest_limits(model)
    assert limits.range == pytest.approx(np.zeros(6))
    assert np.all(np.isfinite(model.layout.q.scale)) and np.all(model.layout.q.scale > 0)
    assert find_equilibrium(model, limits.low).stable


@pytest.mark.parametrize(
    "held, message",
    [
        ({7: 0.0}, "held unit 7: this arm has the units 1 to 6"),
        ({2: 1.1e6}, r"held unit 2 = 1.1 MPa: must be between 0 and 1 MPa"),
        ({2: float("nan")}, "held unit 2 = nan MPa"),
    ],
)
def test_a_held_pressure_must_be_possible(held: dict[int, float], message: str) -> None:
    with pytest.raises(InputError, match=message):
        rest_limits(arm(), held)


def test_limits_that_leave_nothing_are_wrong_input() -> None:
    with pytest.raises(InputError, match=r"unit 1: its limits .* leave nothing"):
        rest_limits(arm(limited(pressure_min=0.9e6, torque_max=1.0)))


def ray(model: Model) -> tuple[RestProgram, RestSolver]:
    """Least pressure with the tip at a place, which is the parameter."""
    program, place = RestProgram(model, held={4: 0.2e6}), ca.SX.sym("place", 3)
    miss = ca.SX.sym("miss", 3)
    rows = Rows((program.tips[-1] - place) / 0.5 - miss, np.zeros(3), np.zeros(3))
    cost = ca.sumsqr(program.p / 1e6) + 1e8 * ca.sumsqr(miss)
    extra = Extra(miss, np.full(3, -1.0), np.full(3, 1.0))
    return program, program.solver(cost, extra=extra, rows=rows, parameters=place)


@pytest.mark.parametrize("segments", [1, 2])
def test_derivative_of_an_optimum_is_that_of_optima_nearby(segments: int) -> None:
    model = arm(segments=segments)
    program, solver = ray(model)
    there = find_equilibrium(model, [0.6e6, 0.1e6, 0.2e6, 0.2e6, 0.5e6, 0.3e6])
    first = solver(program.guess(there.q, there.pressures, np.zeros(3)), there.tips[-1])
    assert first.solved and np.abs(first.extra).max() < 1e-7
    assert first.pressures[3] == 0.2e6
    slopes = solver.derivative(first)
    for axis, step in enumerate(1e-4 * np.eye(3)):
        ends = [solver(first, there.tips[-1] + side * step) for side in (1, -1)]
        values = [np.concatenate([end.q, end.pressures, end.extra]) for end in ends]
        expected = (values[0] - values[1]) / 2e-4
        n = model.strains
        for part in (slice(0, n), slice(n, n + 6)):
            size = np.abs(expected[part]).max()
            assert slopes[part, axis] == pytest.approx(expected[part], abs=1e-4 * size)


def test_long_arms_have_the_same_hessian(monkeypatch: pytest.MonkeyPatch) -> None:
    """Column by column it is the one that CasADi writes out."""
    model = arm()
    _, solver = ray(model)
    rng = np.random.default_rng(0)
    point = rng.uniform(0.1, 0.5, solver.variables.numel())
    weights = rng.normal(size=solver.rows.numel())
    written = solver._ipopt.get_function("nlp_hess_l")(point, [0.1, 0.0, 0.5], 0.7, weights)
    monkeypatch.setattr(program_module, "MOST_WRITTEN_OUT", 0)
    _, other = ray(model)
    by_column = other._ipopt.get_function("nlp_hess_l")(point, [0.1, 0.0, 0.5], 0.7, weights)
    assert np.asarray(by_column) == pytest.approx(np.asarray(written), rel=1e-9, abs=1e-9)


def test_what_is_beyond_a_limit_is_said_by_name() -> None:
    model = arm(limited(stretch_max=0.1, curvature_max=1.0, stroke_max=0.01))
    posture = find_equilibrium(model, [1.2e6, 0, 0, 0, 0, 0])
    said = beyond_limits(model, posture.q, posture.pressures)
    expected = ("pressure of unit 1", "a piston travels", "epsilon_1_1", "curvature of segment 1")
    assert [line.split(" = ")[0][: len(e)] for line, e in zip(said, expected, strict=False)] == [
        *expected
    ]
    assert beyond_limits(arm(), np.zeros(8), np.zeros(6)) == []
