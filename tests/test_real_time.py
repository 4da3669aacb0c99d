"""Real-time iteration: its matrices against CasADi's, its optimum against that of IPOPT."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from softmpc.control.condensing import Condensing, Program
from softmpc.control.costs import (
    RestAtEnd,
    StrainRate,
    TipDirection,
    TipPosition,
    Torque,
    TorqueRate,
)
from softmpc.control.daqp import Daqp
from softmpc.control.ipopt import Ipopt
from softmpc.control.limits import PressureLimit, StrainLimit, TipBox, TorqueLimit, TorqueRateLimit
from softmpc.control.linearisation import Linearisation
from softmpc.control.ocp import Ocp, tracking_problem
from softmpc.control.real_time import RealTime
from softmpc.control.trajectory import Moment, Trajectory
from softmpc.control.transcription import Transcription
from softmpc.errors import InputError
from softmpc.model.actuation import PressureDrive
from softmpc.model.effects import Gravity, MaterialDamping
from softmpc.model.model import Model, build
from softmpc.model.presets import chen2022
from softmpc.model.scene import Scene
from softmpc.statics.equilibrium import find_equilibrium, pressures_from_torques

TORQUE = np.full(6, 0.8)
MOVE = np.array([0.004, 0.002, 0.0])


@pytest.fixture(scope="module")
def model() -> Model:
    return build(Scene(chen2022()))


def everything(model: Model) -> Ocp:
    """Every cost and every kind of limit, on a grid that is not uniform."""
    scale = len(model.layout.x)
    costs = (
        TipPosition(), TipDirection(), Torque(), TorqueRate(), StrainRate(),
        RestAtEnd(factor=0.1 * np.eye(scale)),
    )  # fmt: skip
    top = 1e6 if model.scene.actuation.input == "pressure" else 2.5
    limits = (
        TorqueLimit(0, top), TorqueRateLimit(-0.2 * top, 0.2 * top),
        PressureLimit(0, 1e6, soft=1e-3), StrainLimit(-0.2, 0.9), TipBox(0.0, 0.7, soft=1e-2),
    )  # fmt: skip
    return Ocp(model, 4, 0.02, costs, limits, grid=(1, 1, 2, 3))


def moment_at(t: Transcription, model: Model) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Parameters of a move from rest, a guess near it, and the state."""
    u = TORQUE if model.scene.actuation.input == "torque" else np.full(6, 0.3e6)
    pressures = pressures_from_torques(model, u) if len(model.drive.A) else u
    posture = find_equilibrium(model, pressures)
    z = model.drive.at_rest(u) if len(model.drive.A) else np.zeros(0)
    x = np.concatenate([posture.q, np.zeros(model.strains), z])
    given = {
        "tip": np.tile(posture.tips[-1] + MOVE, (t.N, 1)),
        "axis": np.tile([0.0, 0.0, 1.0], (t.N, 1)),
        "rest": np.tile(x, (t.N, 1)),
    }
    p = t.parameters(x, u, given)
    guess = t.resting(x, u) + 0.02 * np.random.default_rng(3).normal(size=t.N * t.nw)
    return p, guess, x


@pytest.mark.sampled
@pytest.mark.parametrize(
    "scene",
    [
        Scene(chen2022()),
        pytest.param(Scene(chen2022(), actuation=PressureDrive()), marks=pytest.mark.slow),
        Scene(chen2022(), effects=(Gravity(), MaterialDamping())),
    ],
    ids=["hydraulic", "pressures", "without inertia"],
)
def test_linearisation_is_the_jacobian_of_the_program(scene: Scene) -> None:
    """Eliminating stages from CasADi's own Jacobian of the program gives the same matrices."""
    model = build(scene)
    t = Transcription(everything(model))
    p, w, _ = moment_at(t, model)
    moment, at = Moment.of(t, p), Trajectory.of(t, w)
    linearisation = Linearisation(t, "never")
    linear, measured = linearisation(moment, at), linearisation.measure(moment, at)
    program = t.program
    J = np.asarray(
        ca.Function("J", [program.w, program.p], [ca.jacobian(program.g, program.w)])(w, p)
    )
    rows = ca.Function("g", [program.w, program.p], [program.g])
    g = np.asarray(rows(w, p)).ravel()
    f = float(ca.Function("f", [program.w, program.p], [program.f])(w, p))
    height, first = len(g) // t.N, t.na + t.nx
    assert np.allclose(measured.defects.ravel(), g.reshape(t.N, height)[:, :first].ravel())
    assert np.allclose(measured.rows, g.reshape(t.N, height)[:, first:])
    assert measured.cost == pytest.approx(f, rel=1e-12)
    p[: t.nx] += 0.01  # another state now
    again = linearisation.from_another_state(measured, Moment.of(t, p), at)
    other = np.asarray(rows(w, p)).reshape(t.N, height)
    assert np.abs(other[0] - g[:height]).max() > 1e-3
    assert np.allclose(again.defects, other[:, :first])
    k = 2  # an interval in the middle, of another length than the first
    own = slice(k * t.nw, k * t.nw + t.nu + t.na)
    by = J[k * height : (k + 1) * height]
    by_u, by_a = np.split(by[:, own], [t.nu], axis=1)
    by_x = by[:, k * t.nw - t.nx : k * t.nw]
    inverse = np.linalg.inv(by_a[: t.na])
    A = by_x[t.na : first] - by_a[t.na : first] @ inverse @ by_x[: t.na]
    B = by_u[t.na : first] - by_a[t.na : first] @ inverse @ by_u[: t.na]
    assert np.allclose(linear.steps.A[k], A) and np.allclose(linear.steps.B[k], B)
    assert np.allclose(linear.L[k, :, t.nu : 2 * t.nu], by_u[first:])


def test_condensed_cost_is_the_cost_of_the_linearised_trajectory(model: Model) -> None:
    """Any moves: ½|e|² of the condensed problem, and expanded step by step."""
    t = Transcription(everything(model))
    p, w, _ = moment_at(t, model)
    linearisation = Linearisation(t, "never")
    linear = linearisation(Moment.of(t, p), Trajectory.of(t, w))
    for blocks in (np.arange(4), np.array([0, 1, 1, 1])):
        condensed = Condensing(linearisation, blocks)(linear)
        rng = np.random.default_rng(1)
        v, dx = rng.normal(size=condensed.H.shape[0]), rng.normal(size=t.nx)
        free = condensed.linear.steps.free(dx)
        step = condensed.expand(v, dx, free)
        du_before, before, e = np.zeros(t.nu), dx, []
        for k in range(t.N):
            after = (
                linear.steps.A[k] @ before + linear.steps.B[k] @ step.u[k] + linear.steps.gaps[k]
            )
            assert np.allclose(after, step.x[k])
            moved = np.concatenate([du_before, step.u[k], after])
            e.append(linear.e[k] + linear.E[k] @ moved)
            rows = linear.c[k] + linear.L[k] @ moved
            assert np.allclose(rows, condensed.limits(free)[k] + condensed.rows[k] @ v)
            du_before, before = step.u[k], after
        e.append(linear.e_end[0] + linear.E_end[0] @ moved)
        squares = float(np.sum(np.concatenate(e) ** 2))
        every, end = condensed.residuals_without(free)
        at_rest = float(np.sum(every**2) + np.sum(end**2))
        change = condensed.gradient(free) @ v + 0.5 * v @ condensed.H @ v
        assert 0.5 * at_rest + change == pytest.approx(0.5 * squares)


@pytest.mark.sampled
@pytest.mark.parametrize("grid", [(), (1, 1, 1, 2, 3, 4)])
def test_iterated_it_ends_where_ipopt_does(model: Model, grid: tuple[float, ...]) -> None:
    t = Transcription(tracking_problem(model, 6, 0.025, grid=grid))
    p, w, _ = moment_at(t, model)
    expected = Ipopt(t, tolerance=1e-9).solve(p, w)
    found = RealTime(t, iterations=40, tolerance=1e-8, mode="never").solve(p, w)
    assert expected.solved and found.solved and found.kkt < 1e-8
    assert found.cost == pytest.approx(expected.cost, rel=1e-5)
    assert t.split(found.w)[0] == pytest.approx(t.split(expected.w)[0], abs=2e-4)


def test_soft_limit_is_kept_where_it_can_be_and_exceeded_where_it_must(model: Model) -> None:
    """A tip far below asks for more than full pressure; a state above the limit is no failure."""
    limits = (TorqueLimit(0, 2.5), PressureLimit(0, 0.34e6, soft=1e-4))
    t = Transcription(Ocp(model, 8, 0.025, (TipPosition(), Torque(), TorqueRate()), limits))
    _, w, x = moment_at(t, model)
    given = np.tile(find_equilibrium(model, np.zeros(6)).tips[-1] + [0, 0, 0.1], (8, 1))
    solver = RealTime(t, iterations=30, mode="never")
    found = solver.solve(t.parameters(x, TORQUE, given), w)
    pressures = t.split(found.w)[2][:, 16:] @ model.drive.C.T
    assert found.solved and pressures.max() < 0.34e6 * 1.003
    above = x.copy()
    above[16:] *= 8.0  # more than even no torque can lower within one interval
    again = solver.solve(t.parameters(above, TORQUE, given), w)
    assert again.solved
    pressures = t.split(again.w)[2][:, 16:] @ model.drive.C.T
    assert pressures[0].max() > 0.34e6 and pressures[-1].max() < 0.34e6 * 1.003


def test_feedback_uses_the_measured_state(model: Model) -> None:
    t = Transcription(tracking_problem(model, 6, 0.025))
    p, _, x = moment_at(t, model)
    moved = x + 0.005 * model.layout.x.scale
    moment = Moment.of(t, p)
    solver = RealTime(t, mode="never")
    solver.prepare(moment, t.resting(x, TORQUE))
    split = solver.feedback(moved / t.x_scale)
    solver.prepare(replace(moment, x=moved / t.x_scale), t.resting(x, TORQUE))
    whole = solver.feedback(moved / t.x_scale)
    assert np.allclose(split.w[: t.nu], whole.w[: t.nu], atol=0.005)
    assert not np.allclose(split.w[: t.nu], solver.solve(p, t.resting(x, TORQUE)).w[: t.nu])
    with pytest.raises(InputError, match="call `prepare` before"):
        solver.feedback(x / t.x_scale)


@pytest.mark.parametrize("blocks", [(1, 2), (6, 1), (0, 6), (1.5, 4.5)])
def test_blocks_must_fill_the_horizon(model: Model, blocks) -> None:
    with pytest.raises(InputError, match="blocks"):
        RealTime(Transcription(tracking_problem(model, 6, 0.025)), blocks=blocks)


def test_blocked_moves_hold_their_input(model: Model) -> None:
    t = Transcription(tracking_problem(model, 6, 0.025))
    p, _, x = moment_at(t, model)
    solver = RealTime(t, iterations=20, blocks=(1, 2, 3), mode="never")
    u = t.split(solver.solve(p, t.resting(x, TORQUE)).w)[0]
    assert np.allclose(u[1], u[2]) and np.allclose(u[3], u[5]) and not np.allclose(u[0], u[1])


def test_quadratic_programs_say_how_they_ended() -> None:
    H, f, R = np.eye(2), np.array([-3.0, -1.0]), np.array([[1.0, 1.0]])
    ok = Program(H, f, np.zeros(2), np.ones(2), R, np.array([-1.0]), np.array([1.5]))
    qp = Daqp()
    found = qp.solve(ok)
    assert found.solved and found.status == "optimal"
    assert found.v == pytest.approx([1.0, 0.5]) and found.multipliers == pytest.approx(
        [1.5, 0, 0.5]
    )
    bad = qp.solve(replace(ok, low_rows=np.array([2.5]), high_rows=np.array([3.0])))
    assert not bad.solved and bad.status == "infeasible"
    assert qp.solve(ok).v == pytest.approx([1.0, 0.5])  # a failure leaves nothing behind
