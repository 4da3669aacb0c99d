"""Solvers by name: the same optimum from each, and what they say where there is none."""

import casadi as ca
import numpy as np
import pytest

from softmpc.control import fatrop
from softmpc.control.costs import TipPosition, Torque, TorqueRate
from softmpc.control.limits import PressureLimit, TorqueLimit, TorqueRateLimit
from softmpc.control.ocp import Ocp, tracking_problem
from softmpc.control.solver import Solution
from softmpc.control.solvers import SOLVERS, make_solver
from softmpc.control.transcription import Transcription
from softmpc.errors import BuildError, InputError
from softmpc.model.model import Model, build
from softmpc.model.presets import chen2022
from softmpc.model.scene import Scene
from softmpc.statics.equilibrium import find_equilibrium, pressures_from_torques

TORQUE = np.full(6, 0.8)


@pytest.fixture(scope="module")
def model() -> Model:
    return build(Scene(chen2022()))


def posed(t: Transcription, model: Model) -> tuple[np.ndarray, np.ndarray]:
    """Parameters of a move of 4 mm from rest, and the arm at rest as a guess."""
    posture = find_equilibrium(model, pressures_from_torques(model, TORQUE))
    x = np.concatenate([posture.q, np.zeros(model.strains), model.drive.at_rest(TORQUE)])
    tips = np.tile(posture.tips[-1] + [0.004, 0.002, 0.0], (t.N, 1))
    return t.parameters(x, TORQUE, tips), t.resting(x, TORQUE)


def limited(model: Model) -> Ocp:
    """Limits that the move reaches."""
    limits = (TorqueLimit(0, 0.9), TorqueRateLimit(-0.2, 0.2), PressureLimit(0, 1e6, soft=1e-3))
    return Ocp(model, 4, 0.025, (TipPosition(), Torque(), TorqueRate()), limits)


@pytest.mark.sampled
@pytest.mark.parametrize("name", ["fatrop", "sqp"])
def test_each_solver_ends_where_ipopt_does(model: Model, name: str) -> None:
    for ocp in (limited(model), tracking_problem(model, 4, 0.025, grid=(1, 1, 2, 3))):
        t = Transcription(ocp)
        p, w = posed(t, model)
        expected = make_solver("ipopt", t, tolerance=1e-9).solve(p, w)
        found = make_solver(name, t).solve(p, w)
        assert expected.solved and found.solved and found.violation < 1e-6
        assert found.cost == pytest.approx(expected.cost, rel=1e-4)
        assert t.split(found.w)[0] == pytest.approx(t.split(expected.w)[0], abs=2e-4)


def test_sqp_returns_the_multipliers_of_the_whole_program(model: Model) -> None:
    """The Lagrangian of CasADi's own program is stationary with them, active limits and all."""
    t = Transcription(limited(model))
    p, w = posed(t, model)
    found = make_solver("sqp", t, tolerance=1e-8).solve(p, w)
    program = t.program
    lagrangian = (
        program.f + ca.dot(ca.MX(found.lam_g), program.g) + ca.dot(ca.MX(found.lam_w), program.w)
    )
    slope = ca.Function("s", [program.w, program.p], [ca.gradient(lagrangian, program.w)])
    assert np.abs(found.lam_w).max() > 1  # a limit is active
    assert np.asarray(slope(found.w, p)) == pytest.approx(0, abs=1e-6)


def test_a_solve_from_the_answer_and_its_active_set_is_over_at_once(model: Model) -> None:
    t = Transcription(limited(model))
    p, w = posed(t, model)
    solver = make_solver("sqp", t)
    found = solver.solve(p, w)
    again = solver.solve(p, found.w, found)
    assert again.solved and again.iterations == 1 and found.iterations > 1


def test_infeasible_problems_are_named(model: Model) -> None:
    """Pressure far above a hard limit: no plan exists; what is wrong with the start is named."""
    limits = (TorqueLimit(0, 2.5), PressureLimit(0, 0.34e6))
    t = Transcription(Ocp(model, 4, 0.025, (TipPosition(), Torque()), limits))
    p, w = posed(t, model)
    z = slice(2 * model.strains, t.nx)
    p[z] *= 8.0
    w.reshape(t.N, -1)[:, -(z.stop - z.start) :] *= 8.0
    for name in ("real-time", "sqp"):
        found = make_solver(name, t).solve(p, w)
        assert not found.solved and found.status == "QP infeasible" and found.qp == "infeasible"
        assert found.worst.startswith("continuity of piston_speed") and found.violation > 0.1


def test_time_limits_hold(model: Model) -> None:
    t = Transcription(limited(model))
    p, w = posed(t, model)
    found = make_solver("sqp", t, tolerance=1e-12).solve(p, w, time_limit=1e-9)
    assert not found.solved and "time limit" in found.status and found.iterations == 1
    assert not make_solver("sqp", t, max_iterations=2, tolerance=1e-12).solve(p, w).solved


def test_fatrop_does_not_start_from_what_is_not_finite(model: Model) -> None:
    t = Transcription(limited(model))
    p, w = posed(t, model)
    found: Solution = make_solver("fatrop", t).solve(np.full_like(p, np.nan), w)
    assert not found.solved and found.status == "not finite" and found.worst


def test_a_missing_fatrop_is_said(model: Model, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fatrop.ca, "has_nlpsol", lambda name: False)
    with pytest.raises(BuildError, match=r"3\.7\.2 or later"):
        make_solver("fatrop", Transcription(limited(model)))


def test_names_and_options_are_checked(model: Model) -> None:
    t = Transcription(limited(model))
    assert set(SOLVERS) == {"real-time", "sqp", "ipopt", "fatrop"}
    with pytest.raises(InputError, match="did you mean 'fatrop'"):
        make_solver("fatrops", t)
    with pytest.raises(InputError, match="allowed: blocks, mode"):
        make_solver("real-time", t, tolerance=1e-3)
    with pytest.raises(InputError, match="2 or more"):
        make_solver("sqp", t, max_iterations=1)
