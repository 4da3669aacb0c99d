"""The drive's effects in whole scenes: the arm that acts back, simulation, control, statics."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from arms import PAPER, model_of, numbers
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp

from softmpc.control.closed_loop import start_at
from softmpc.control.mpc import Mpc
from softmpc.control.ocp import tracking_problem
from softmpc.control.transcription import Transcription
from softmpc.errors import BuildError
from softmpc.model.actuation import FrictionDrive, HydraulicDrive
from softmpc.model.drive_effects import (
    DRIVE_EFFECTS,
    Cavitation,
    ChamberCoupling,
    EndStops,
    RotorInertia,
    TubeInertance,
    TurbulentLoss,
)
from softmpc.model.effects import Effect, Inertia
from softmpc.model.model import Model
from softmpc.model.scene import default_effects
from softmpc.simulation.inputs import Curve, InputProfile
from softmpc.simulation.methods import integrator_for
from softmpc.simulation.run import simulate, start_state
from softmpc.statics.equilibrium import find_equilibrium, pressures_from_torques

ALL = tuple(kind() for kind in DRIVE_EFFECTS)


def model(*effects: Effect, friction: float = 0.0, **slots: Any) -> Model:
    arm = replace(PAPER, hydraulics=replace(PAPER.hydraulics, friction=friction))
    drive = FrictionDrive() if friction else HydraulicDrive()
    return model_of(arm, **{"effects": (*default_effects(), *effects), "actuation": drive} | slots)


def steps(times: list[float], values: list[float], units: tuple[int, ...] = (1, 5, 6)) -> Any:
    """Torques of some units over time, linear between knots."""
    still = Curve(np.zeros(1), np.zeros(1))
    given = Curve(np.array(times), np.array(values))
    return InputProfile([given if j in units else still for j in range(1, 7)])


# --------------------------------------------------------------------------- two-way coupling


def test_the_compliance_of_34_is_that_of_a_light_arm_under_equal_pressures() -> None:
    """Then ε = A_d P/(E A_s), so A_d l_0 dε/dP is the constant of (34): the poles are the same."""
    light = tuple(replace(section, mass=1e-6) for section in PAPER.sections)
    slots = {"strains": ("epsilon",), "effects": (Inertia(), ChamberCoupling())}
    coupled = model_of(replace(PAPER, sections=light), **slots)
    x, u = ca.MX.sym("x", len(coupled.layout.x)), ca.MX.sym("u", 6)
    A = ca.Function("A", [x, u], [ca.jacobian(coupled.x_dot(x, u), x)])
    found = np.linalg.eigvals(np.asarray(A(0, 0)))
    for pole in np.linalg.eigvals(model().drive.A[::6, ::6]):
        assert np.sum(np.abs(found - pole) < 1e-3 * abs(pole)) == 2, "one a section"


def test_coupled_arm_settles_in_the_posture_of_its_statics() -> None:
    torques = [0.0, 0.0, 1.0, 1.0]
    done = simulate(model(ChamberCoupling()), steps([0, 0.1, 0.6, 5], torques), 5.0)
    assert done.status == "finished"
    plain = model()
    u = np.array([1.0, 0, 0, 0, 1.0, 1.0])
    rest = find_equilibrium(plain, pressures_from_torques(plain, u))
    assert_allclose(done.tips[-1, -1], numbers(plain.tip(rest.q)), atol=2e-4)


# --------------------------------------------------------------------------------- simulation


@pytest.mark.slow
def test_simulation_with_everything_is_that_of_scipy() -> None:
    """Friction, inertance, turbulence, cavities, stops, back-driving and coupling at once."""
    m = model(*ALL, friction=30.0)
    profile = steps([0, 0.02, 0.02, 0.2, 0.2], [0, 0, 1.0, 1.0, 0.0])
    done = simulate(m, profile, 0.3, sample_time=0.02, tip_tolerance=1e-6)
    assert done.status == "finished"
    scale, x = m.layout.x.scale, start_state(m, profile)
    jacobian = m.x_dot.jacobian()
    states = [x]
    for first, last in ((0, 0.02), (0.02, 0.2), (0.2, 0.3)):
        u, _ = profile.over(first, last)

        def rate(t: float, y: Any, u: Any = u) -> Any:
            return numbers(m.x_dot(y * scale, u)) / scale

        def slope(t: float, y: Any, u: Any = u) -> Any:
            return np.asarray(jacobian(y * scale, u, 0)[0]) * scale / scale[:, None]

        times = np.arange(round(50 * first) + 1, round(50 * last) + 1) / 50
        options: dict[str, Any] = {"method": "Radau", "jac": slope, "rtol": 1e-6, "atol": 1e-8}
        moved = solve_ivp(rate, (first, last), states[-1] / scale, t_eval=times, **options)
        assert moved.success, moved.message
        states += list((moved.y * scale[:, None]).T)
    tips = np.array([numbers(m.tip(x[: m.strains])) for x in states])
    assert np.abs(tips[-1] - tips[0]).max() > 0.02
    assert_allclose(done.tips[:, -1], tips, atol=1e-4)


@pytest.mark.sampled
@pytest.mark.parametrize("friction", [50.0, 500.0])
def test_sharp_friction_lets_go_and_turns(friction: float) -> None:
    """A piston that sticks within 1 µm/s, is torn loose by a step and reversed by another.

    Hard because its friction turns within microseconds. A thousand times rounder friction ends
    close to it.
    """
    arm = replace(PAPER, limits=replace(PAPER.limits, torque_min=-3.0))
    profile = steps([0, 0.05, 0.05, 0.2, 0.2], [0, 0, 0.8, 0.8, -0.8], (1,))
    tips = []
    for velocity in (1e-3, 1e-4, 1e-6):
        h = replace(arm.hydraulics, friction=friction, friction_velocity=velocity)
        effects = (*default_effects(), Cavitation())
        m = model_of(replace(arm, hydraulics=h), effects=effects, actuation=FrictionDrive())
        done = simulate(m, profile, 0.3)
        assert done.status == "finished"
        tips.append(done.tips[-1, -1])
    assert np.linalg.norm(tips[1] - tips[2]) < 2e-4
    assert np.linalg.norm(tips[0] - tips[2]) < 2e-3


@pytest.mark.slow
def test_turbulence_damps_what_inertance_lets_swing() -> None:
    """A step with inertance alone overshoots by about 70 %, with turbulence by far less."""
    profile = steps([0, 0.05, 0.05], [0, 0, 1.0])
    peaks = []
    for effects in ((TubeInertance(),), (TubeInertance(), TurbulentLoss())):
        done = simulate(model(*effects), profile, 0.6)
        peaks.append(done.p.max() / pressures_from_torques(model(), np.ones(6))[0])
    damping = 0.0971  # of the mode, test_drive_effects
    overshoot = np.exp(-np.pi * damping / np.sqrt(1 - damping**2))
    assert peaks[0] == pytest.approx(1 + overshoot, abs=0.02)
    assert 1 < peaks[1] < 1.5


@pytest.mark.parametrize("strains", [("kappa_x", "kappa_y"), ("epsilon", "kappa_x", "kappa_y")])
def test_coupling_without_some_strains(strains: tuple[str, ...]) -> None:
    m = model(ChamberCoupling(), TurbulentLoss(), strains=strains, effects=None)
    assert m.drive_jacobian.sparsity_out(2).nnz() == 0, "left out: the scene names no effects"
    effects = (*default_effects(strains), ChamberCoupling(), TurbulentLoss())
    m = model(strains=strains, effects=effects)
    assert m.drive_jacobian.sparsity_out(2).nnz() > 0
    done = simulate(m, steps([0, 0.05, 0.3], [0, 0, 0.3]), 0.3)
    assert done.status == "finished"


def test_quasi_static_arm_with_coupling() -> None:
    """Without inertia the rates are still the arm's: damping and water share the flow."""
    effects = tuple(
        e for e in default_effects() if "inertia" not in e.name and e.name != "coriolis"
    )
    m = model(effects=(*effects, ChamberCoupling()))
    assert m.order == 1
    done = simulate(m, steps([0, 0.05, 0.3], [0, 0, 0.6]), 1.0)
    assert done.status == "finished"
    rest = find_equilibrium(m, pressures_from_torques(m, [0.6, 0, 0, 0, 0.6, 0.6]))
    assert np.linalg.norm(done.tips[-1, -1] - numbers(m.tip(rest.q))) < 0.02


def test_an_arm_that_follows_at_once_needs_a_linear_drive() -> None:
    """And friction at 0 N, or inertance, leave it linear."""
    still = steps([0, 0.05, 0.05], [0, 0, 0.5])
    done = simulate(model(effects=(TubeInertance(),)), still, 0.2)
    assert done.status == "finished"
    with pytest.raises(BuildError, match=r"leave out chamber_coupling, or add.*material_damping"):
        simulate(model(effects=(ChamberCoupling(),)), still, 0.2)


# ---------------------------------------------------------------------------- control, statics


@pytest.mark.sampled
@pytest.mark.parametrize("kind", DRIVE_EFFECTS, ids=lambda kind: kind.name)
def test_control_wants_a_linear_drive(kind: Any) -> None:
    """Inertance and rotor stay linear, so that MPC keeps working."""
    problem = tracking_problem(model(kind()))
    if kind.linear:
        transcription = Transcription(problem)
        assert transcription.nx == len(problem.model.layout.x)
        rows, slopes = transcription.interval.nnz_out(0), transcription.interval.size_out(1)
        assert slopes[0] == rows
    else:
        with pytest.raises(BuildError, match=f"linear one.*leave out {kind.name}"):
            Transcription(problem)


def test_control_without_friction() -> None:
    with pytest.raises(BuildError, match="leave out friction, turbulent_loss in the model"):
        Transcription(tracking_problem(model(TurbulentLoss(), friction=10.0)))


@pytest.mark.slow
def test_mpc_holds_a_tip_with_water_and_rotors_that_swing() -> None:
    """Its model knows them: 10 mm aside in 25 steps, closer than 0.1 mm, whatever swings."""
    m = model(TubeInertance(), RotorInertia())
    mpc, plant = Mpc(Transcription(tracking_problem(m))), integrator_for(m)
    start = start_at(m, find_equilibrium(m, [0.2e6] * 6))
    target = numbers(m.tip(start.x[: m.strains])) + (0.01, 0, 0)
    x, u = start.x, start.u
    for _ in range(25):
        step = mpc.step(x, u, np.tile(target, (mpc.ocp.intervals, 1)))
        assert step.solved
        x, u = plant.advance(x, step.u, mpc.ocp.step)[-1], step.u
    assert np.linalg.norm(numbers(m.tip(x[: m.strains])) - target) < 1e-4


def test_pressures_at_an_end_stop() -> None:
    """Two fifths of the travel of 1 MPa: beyond it more torque gives no more pressure."""
    short = replace(PAPER, limits=replace(PAPER.limits, stroke_max=0.01))
    m = model_of(short, effects=(*default_effects(), EndStops()))
    found = pressures_from_torques(m, [0.5, 1.0, 1.5, 2.0, 2.5, 0.0])
    free = pressures_from_torques(model(), [0.5, 1.0, 1.5, 2.0, 2.5, 0.0])
    assert_allclose(found[[0, 5]], free[[0, 5]])
    assert np.all(found[1:5] < 0.42e6) and np.all(np.diff(found[1:5]) > 0)


def test_rotor_is_heavier_than_the_piston() -> None:
    """An assumed motor of 1e-4 kg·m² is 132 kg on the piston: the drive swings at 4 Hz."""
    poles = np.linalg.eigvals(model(RotorInertia()).drive.A[::6, ::6])
    slow = poles[np.argmin(np.abs(poles))]
    assert abs(slow) / (2 * np.pi) == pytest.approx(3.99, abs=0.01)
    assert -slow.real / abs(slow) == pytest.approx(0.199, abs=0.001)
