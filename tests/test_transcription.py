"""The nonlinear program against plain differentiation, SciPy and an independent shooting."""

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from softmpc.control.costs import StrainRate, TipPosition, Torque, TorqueRate
from softmpc.control.discretise import held_input
from softmpc.control.ipopt import Ipopt
from softmpc.control.limits import (
    PressureLimit,
    StrainLimit,
    StrokeLimit,
    TorqueLimit,
    TorqueRateLimit,
)
from softmpc.control.ocp import Ocp, tracking_problem
from softmpc.control.stage import Stage
from softmpc.control.transcription import Transcription
from softmpc.errors import BuildError, InputError
from softmpc.model.actuation import PressureDrive, StaticDrive
from softmpc.model.effects import EnvironmentDamping, Gravity, Inertia, MaterialDamping
from softmpc.model.model import Model, build
from softmpc.model.presets import chen2022
from softmpc.model.scene import Scene
from softmpc.simulation.tableau import radau_iia
from softmpc.statics.equilibrium import find_equilibrium, pressures_from_torques

TORQUE = np.full(6, 0.8)


@pytest.fixture(scope="module")
def model() -> Model:
    return build(Scene(chen2022()))


def at_rest(model: Model, torque: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """State and tip of the arm at rest."""
    posture = find_equilibrium(model, pressures_from_torques(model, torque))
    drive = model.drive
    z = -np.linalg.solve(drive.A, drive.B @ torque) if len(drive.A) else np.zeros(0)
    return np.concatenate([posture.q, np.zeros(model.strains), z]), posture.tips[-1]


def random_point(t: Transcription, model: Model) -> tuple[np.ndarray, np.ndarray]:
    x, tip = at_rest(model, TORQUE)
    rng = np.random.default_rng(3)
    p = t.parameters(x, TORQUE, np.tile(tip + [0.004, 0.002, 0], (t.N, 1)))
    return t.resting(x, TORQUE) + 0.05 * rng.normal(size=t.N * t.nw), p


@pytest.mark.parametrize("stages", [1, 2, 3])
def test_tableau_integrates_polynomials_of_its_order(stages: int) -> None:
    t = radau_iia(stages)
    for k in range(1, 2 * stages):
        assert t.b @ t.c ** (k - 1) == pytest.approx(1 / k, abs=1e-14)
    for k in range(1, stages + 1):
        assert t.A @ t.c ** (k - 1) == pytest.approx(t.c**k / k, abs=1e-14)
    assert t.c[-1] == pytest.approx(1)


def test_held_input_against_scipy(model: Model) -> None:
    drive, z, u = model.drive, np.zeros(18), TORQUE
    phi, gamma = held_input(drive.A, drive.B, 0.025)
    z[6:12] = 2e5
    solved = solve_ivp(
        lambda _, y: drive.A @ y + drive.B @ u, (0, 0.025), z, "Radau", rtol=1e-10, atol=1e-8
    )
    assert phi @ z + gamma @ u == pytest.approx(solved.y[:, -1], rel=1e-7, abs=1e-7)
    assert np.count_nonzero(phi) == 6 * 9  # units stay apart


EVERY_LIMIT = (
    TorqueLimit(0, 2.5),
    TorqueRateLimit(-0.4, 0.4),
    PressureLimit(0, 1e6),
    StrainLimit(-0.2, 0.8),
)  # StrokeLimit needs the drive's states and has a test of its own


@pytest.mark.sampled
@pytest.mark.parametrize("drive", [None, StaticDrive(), PressureDrive()])
def test_derivatives_are_those_of_the_program(drive) -> None:
    scene = Scene(chen2022()) if drive is None else Scene(chen2022(), actuation=drive)
    model = build(scene)
    costs = (TipPosition(), Torque(), TorqueRate(), StrainRate())
    t = Transcription(Ocp(model, 3, 0.02, costs, EVERY_LIMIT))
    program = t.program
    rng = np.random.default_rng(0)
    w, p = rng.uniform(0.2, 0.5, program.w.shape[0]), rng.uniform(0.2, 0.5, program.p.shape[0])
    _g, J = program.gauss_newton["jac_g"](w, p)
    plain = ca.Function("J", [program.w, program.p], [ca.jacobian(program.g, program.w)])(w, p)
    assert np.asarray(J) == pytest.approx(np.asarray(plain), rel=1e-9, abs=1e-9)
    _f, slope = program.gauss_newton["grad_f"](w, p)
    plain = ca.Function("s", [program.w, program.p], [ca.gradient(program.f, program.w)])(w, p)
    assert np.asarray(slope) == pytest.approx(np.asarray(plain), rel=1e-9, abs=1e-9)
    assert len(program.names) == program.w.shape[0]
    assert len(program.names_g) == program.g.shape[0]
    assert len(program.bounds[0]) == len(program.names)
    assert len(program.bounds_g[0]) == len(program.names_g)


def test_gauss_newton_is_the_hessian_where_residuals_are_linear(model: Model) -> None:
    """Without the tip, every cost is linear least squares: JᵀJ is the whole Hessian."""
    costs = (Torque(), TorqueRate(), StrainRate())
    t = Transcription(Ocp(model, 3, 0.02, costs, ()))
    program = t.program
    w, p = random_point(t, model)
    plain = ca.Function("H", [program.w, program.p], [ca.hessian(program.f, program.w)[0]])(w, p)
    H = program.gauss_newton["hess_lag"](w, p, 1.0, 0.0)
    assert H.sparsity().is_triu()
    assert np.asarray(H) == pytest.approx(np.triu(np.asarray(plain)), rel=1e-10, abs=1e-9)


@pytest.mark.slow
def test_one_interval_agrees_with_scipy_at_third_order(model: Model) -> None:
    """Solve the stage equations, compare with a tight integration of x_dot: error ~ h⁴."""
    x0, _ = at_rest(model, TORQUE)
    u = TORQUE + np.array([0.3, 0, 0, 0, 0.2, 0])
    errors = []
    for step in (0.02, 0.01):
        t = Transcription(tracking_problem(model, 1, step))
        a = ca.MX.sym("a", t.na)
        defects, after = _split(t, t.interval(x0 / t.x_scale, t.decisions(u), a)[0])
        solve = ca.rootfinder("s", "newton", {"x": a, "g": defects})
        end = ca.Function("end", [a], [after])(solve(np.zeros(t.na), []))
        exact = solve_ivp(
            lambda _, x: np.asarray(model.x_dot(x, u)).ravel(),
            (0, step), x0, "Radau", rtol=1e-10, atol=1e-10 * model.layout.x.scale,
        ).y[:, -1]  # fmt: skip
        error = (np.asarray(end).ravel() * t.x_scale - exact) / t.x_scale
        errors.append(np.abs(error[: model.strains]).max())
        assert error[2 * model.strains :] == pytest.approx(0, abs=1e-7)  # the drive is exact
    assert errors[1] < errors[0] / 5


def _split(t: Transcription, rows: ca.MX) -> tuple[ca.MX, ca.MX]:
    return rows[: t.na], rows[t.na :]


@pytest.mark.slow
def test_both_hessians_find_the_same_optimum(model: Model) -> None:
    x, tip = at_rest(model, TORQUE)
    t = Transcription(tracking_problem(model, 5, 0.025))
    p = t.parameters(x, TORQUE, np.tile(tip + [0.003, 0.001, 0], (5, 1)))
    found = [
        Ipopt(t, hessian, tolerance=1e-8).solve(p, t.resting(x, TORQUE))
        for hessian in ("gauss-newton", "exact")
    ]
    assert all(s.solved for s in found)
    assert found[0].cost == pytest.approx(found[1].cost, rel=1e-6)
    assert t.split(found[0].w)[0] == pytest.approx(t.split(found[1].w)[0], abs=1e-3)
    assert max(s.violation for s in found) < 1e-6


@pytest.mark.slow
def test_optimum_is_stationary_for_an_independent_shooting() -> None:
    """The same cost through SciPy's integrator: its gradient vanishes at the solution."""
    strains = ("epsilon", "kappa_y")
    model = build(Scene(chen2022(), strains=strains, actuation=PressureDrive()))
    posture = find_equilibrium(model, np.full(6, 3e5))
    x0, u0 = np.concatenate([posture.q, np.zeros(4)]), np.full(6, 3e5)
    target = posture.tips[-1] + [0.002, 0, 0.001]
    costs, step, N = (TipPosition(), Torque(), TorqueRate()), 0.004, 3
    t = Transcription(Ocp(model, N, step, costs, ()), stages=3)
    solved = Ipopt(t, tolerance=1e-10).solve(
        t.parameters(x0, u0, np.tile(target, (N, 1))), t.resting(x0, u0)
    )
    u = t.split(solved.w)[0]

    def shoot(inputs: np.ndarray) -> float:
        x, before, total = x0, u0, 0.0
        for row in inputs:
            x = solve_ivp(
                lambda _, y, row=row: np.asarray(model.x_dot(y, row)).ravel(),
                (0, step), x, "DOP853", rtol=1e-11, atol=1e-12,
            ).y[:, -1]  # fmt: skip
            tip = np.asarray(model.tip(x[:4])).ravel()
            total += 0.5 * np.sum(((tip - target) / 1e-3) ** 2)
            total += 0.5 * np.sum((row / 1e6 / 3) ** 2)
            total += 0.5 * np.sum(((row - before) / 1e6 / 0.1) ** 2)
            before = row
        return total

    assert shoot(u) == pytest.approx(solved.cost, rel=1e-3)
    start = _slope(shoot, np.tile(u0, (N, 1)))
    assert np.abs(_slope(shoot, u)).max() < 0.01 * np.abs(start).max()


def _slope(f, u: np.ndarray, step: float = 1e3) -> np.ndarray:
    slope = np.zeros(u.size)
    for i in range(u.size):
        move = np.zeros(u.size)
        move[i] = step
        slope[i] = (f(u + move.reshape(u.shape)) - f(u - move.reshape(u.shape))) / 2
    return slope


def test_torque_rate_limit_binds(model: Model) -> None:
    x, tip = at_rest(model, TORQUE)
    costs = (TipPosition(), Torque())
    t = Transcription(
        Ocp(model, 4, 0.025, costs, (TorqueLimit(0, 2.5), TorqueRateLimit(-0.1, 0.1)))
    )
    p = t.parameters(x, TORQUE, np.tile(tip + [0.02, 0, 0], (4, 1)))
    solved = Ipopt(t, max_iterations=300).solve(p, t.resting(x, TORQUE))
    assert solved.solved
    change = np.diff(np.vstack([TORQUE, t.split(solved.w)[0]]), axis=0)
    assert np.abs(change).max() == pytest.approx(0.1, abs=1e-4)


def test_stroke_limit_binds_without_a_state_of_its_own(model: Model) -> None:
    """The pistons may move 0.1 mm; the tip wants to go 20 mm lower."""
    x, tip = at_rest(model, TORQUE)
    low, high = (model.drive.X @ x[16:]).min() - 1e-4, (model.drive.X @ x[16:]).max() + 1e-4
    t = Transcription(
        Ocp(model, 6, 0.025, (TipPosition(), TorqueRate()), (StrokeLimit(low, high),))
    )
    p = t.parameters(x, TORQUE, np.tile(tip + [0, 0, 0.02], (6, 1)))
    solved = Ipopt(t, max_iterations=200).solve(p, t.resting(x, TORQUE))
    assert solved.solved
    travel = t.split(solved.w)[2][:, 16:] @ model.drive.X.T
    assert travel.max() == pytest.approx(high, abs=1e-6)
    assert len(model.layout.x) == 34
    with pytest.raises(InputError, match="no pistons"):
        Transcription(
            Ocp(
                build(Scene(chen2022(), actuation=StaticDrive())),
                2,
                0.1,
                (Torque(),),
                (StrokeLimit(0, 1),),
            )
        ).row_bounds()


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda m: Ocp(m, 0, 0.025, (TipPosition(),), ()), "intervals = 0"),
        (lambda m: Ocp(m, 5, -1, (TipPosition(),), ()), "step = -1"),
        (lambda m: Ocp(m, 5, 0.025, (), ()), "costs is empty"),
        (lambda m: TipPosition(0.0), "must be above 0"),
        (lambda m: TorqueLimit(1.0, 1.0), "must be below"),
        (lambda m: StrainLimit(0, 1, "kapa").rows(Stage.of(m)), "no such strain"),
    ],
)
def test_bad_problems_are_refused(model: Model, make, message: str) -> None:
    with pytest.raises(InputError, match=message):
        make(model)


@pytest.mark.sampled
@pytest.mark.parametrize("damped", [True, False])
def test_without_inertia_the_arm_follows_its_pressures(damped: bool) -> None:
    """Damped: D(q) dq = -r(q, 0, 0, P), integrated by SciPy. Undamped: always at rest."""
    effects = (Gravity(), MaterialDamping(), EnvironmentDamping()) if damped else (Gravity(),)
    model = build(Scene(chen2022(), effects=effects))
    u, n, step = TORQUE + np.array([0.3, 0, 0, 0, 0.2, 0]), model.strains, 0.02
    x0, _ = at_rest(model, TORQUE)
    t = Transcription(Ocp(model, 1, step, (TipPosition(), Torque()), ()))
    a = ca.MX.sym("a", t.na)
    defects, after = _split(t, t.interval(x0 / t.x_scale, t.decisions(u), a)[0])
    solve = ca.rootfinder("s", "newton", {"x": a, "g": defects})
    end = np.asarray(ca.Function("end", [a], [after])(solve(np.zeros(t.na), []))).ravel()
    end = end * t.x_scale

    def rates(_: float, y: np.ndarray) -> np.ndarray:
        q, z = y[:n], y[n:]
        p = model.drive.C @ z
        r = np.asarray(model.residual(q, 0, 0, p)).ravel()
        D = np.asarray(model.residual_jacobian(q, 0, 0, p)[1])
        return np.concatenate([np.linalg.solve(D, -r), model.drive.A @ z + model.drive.B @ u])

    if damped:
        y0, scale = np.delete(x0, slice(n, 2 * n)), np.delete(t.x_scale, slice(n, 2 * n))
        exact = solve_ivp(rates, (0, step), y0, "Radau", rtol=1e-9, atol=1e-9 * scale).y[:n, -1]
        assert np.abs((end[:n] - exact) / t.x_scale[:n]).max() < 2e-3
    else:
        rest = find_equilibrium(model, model.drive.C @ end[2 * n :])
        assert end[:n] == pytest.approx(rest.q, rel=1e-7, abs=1e-9)


def test_strains_without_mass_are_refused_with_advice() -> None:
    massless = build(Scene(chen2022(), effects=(Gravity(), Inertia())))
    with pytest.raises(BuildError, match="kappa_z_1_1"):
        tracking_problem(massless)
