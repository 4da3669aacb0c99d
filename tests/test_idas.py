"""The drive in closed form, and IDAS against another solver on the whole state-space model."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from arms import MIXED, PAPER, arm, model_of
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from softmpc.errors import BuildError, InputError
from softmpc.model.actuation import HydraulicDrive, PressureDrive, StaticDrive
from softmpc.model.effects import (
    Coriolis,
    EnvironmentDamping,
    Gravity,
    Inertia,
    MaterialDamping,
)
from softmpc.model.formulations import NewtonEuler
from softmpc.model.model import Model
from softmpc.model.parameters import Hydraulics
from softmpc.simulation.drive_motion import DriveMotion
from softmpc.simulation.idas import Idas
from softmpc.simulation.inputs import InputProfile
from softmpc.simulation.integrator import IntegrationError
from softmpc.simulation.run import start_state
from softmpc.simulation.runge_kutta import RadauIIA

MODEL = model_of()
REST = InputProfile.of(6)
TORQUES = np.array([1.5, 0.2, 0.5, 0.0, 1.5, 1.2])

# --- the drive alone -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    "changes",
    [{}, {"piston_mass": 50.0, "bulk_modulus": 2e7}, {"piston_damping": 0.0, "tube_length": 0.01}],
    ids=["paper", "oscillating", "fast tube"],
)
def test_drive_in_closed_form(changes: dict[str, float]) -> None:
    drive = HydraulicDrive().matrices(replace(MIXED, hydraulics=Hydraulics(**changes)))
    count = drive.B.shape[1]
    motion = DriveMotion(drive, np.repeat([0.05, 1e6, 1e6], count))
    rng = np.random.default_rng(3)
    z, u, slope = rng.normal(size=3 * count) * motion.scale, rng.normal(size=count), np.ones(count)
    law, times = motion.law(z, u, slope), np.array([1e-5, 1e-3, 0.02, 0.5])
    found = motion.states(law, times)
    # z, u and the slope in one linear system
    whole = np.zeros((5 * count, 5 * count))
    whole[: 3 * count] = np.hstack([drive.A, drive.B, np.zeros((3 * count, count))])
    whole[3 * count : 4 * count, 4 * count :] = np.eye(count)
    for t, row in zip(times, found, strict=True):
        exact = (expm(whole * t) @ np.concatenate([z, u, slope]))[: 3 * count]
        np.testing.assert_allclose(row / motion.scale, exact / motion.scale, atol=1e-9)
    time = ca.MX.sym("t")
    coefficients = motion.pressure_coefficients(law)
    pressure = ca.Function("pressure", [time], [motion.pressure(ca.MX(ca.DM(coefficients)), time)])
    symbolic = np.hstack([np.asarray(pressure(t)) for t in times]).T
    np.testing.assert_allclose(symbolic, motion.pressures(found, 0 * found[:, :count]), rtol=1e-9)
    assert len(coefficients) == motion.coefficients


def test_oscillating_drive_is_one() -> None:
    drive = HydraulicDrive().matrices(
        replace(PAPER, hydraulics=Hydraulics(piston_mass=50.0, bulk_modulus=2e7))
    )
    assert np.abs(DriveMotion(drive, np.repeat([0.05, 1e6, 1e6], 6)).rates.imag).max() > 1


# --- IDAS ----------------------------------------------------------------------------------------


def by_scipy(model: Model, x: np.ndarray, u0: Any, u1: Any, duration: float) -> np.ndarray:
    """State after an interval, by SciPy's Radau on the whole state-space model, drive included."""
    scale = model.layout.x.scale

    def slope(t: float, y: np.ndarray) -> np.ndarray:
        u = u0 + (u1 - u0) * t / duration
        return np.asarray(model.x_dot(y * scale, u)).ravel() / scale

    solved = solve_ivp(slope, (0.0, duration), x / scale, "Radau", rtol=1e-9, atol=1e-11)
    assert solved.success
    return np.asarray(solved.y[:, -1] * scale)


@pytest.mark.sampled
@pytest.mark.parametrize("drive", [HydraulicDrive(), StaticDrive()], ids=lambda d: d.name)
def test_against_another_solver(drive: Any) -> None:
    model = MODEL if drive == HydraulicDrive() else model_of(actuation=drive)
    x, scale = start_state(model, REST), model.layout.x.scale
    u1 = TORQUES[::-1]
    for end in (TORQUES, u1):
        found = Idas(model, 1e-9).advance(x, TORQUES, 0.08, u_end=end)[-1]
        exact = by_scipy(model, x, TORQUES, end, 0.08)
        np.testing.assert_allclose(found / scale, exact / scale, atol=2e-7)


@pytest.mark.slow
def test_printed_formulation_runs() -> None:
    model = model_of(formulation=NewtonEuler())
    x = start_state(model, REST, "straight")
    found = Idas(model).advance(x, TORQUES, 0.05)[-1]
    exact = by_scipy(model, x, TORQUES, TORQUES, 0.05)
    np.testing.assert_allclose(
        found / model.layout.x.scale, exact / model.layout.x.scale, atol=1e-6
    )


def test_tolerance_is_kept() -> None:
    x, scale = start_state(MODEL, REST), MODEL.layout.x.scale
    ends = {tol: Idas(MODEL, tol).advance(x, TORQUES, 0.3)[-1] for tol in (1e-5, 1e-7, 1e-12)}
    errors = [np.abs((ends[tol] - ends[1e-12]) / scale).max() for tol in (1e-5, 1e-7)]
    assert errors[0] < 1e-3
    assert errors[1] < 1e-5


def test_samples_lie_on_the_motion() -> None:
    plant, x = Idas(MODEL, 1e-9), start_state(MODEL, REST)
    together = plant.advance(x, TORQUES, 0.2, samples=4, u_end=TORQUES / 2)
    alone = []
    for k in range(4):
        u0, u1 = (TORQUES * (1 - s / 8) for s in (k, k + 1))
        alone.append(plant.advance(alone[-1] if alone else x, u0, 0.05, u_end=u1)[-1])
    assert together.shape == (4, 34)
    scale = MODEL.layout.x.scale
    np.testing.assert_allclose(together / scale, np.stack(alone) / scale, atol=2e-7)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((np.zeros(33), np.zeros(6), 0.1), "x has 33 values: must be 34"),
        ((np.zeros(34), np.zeros(5), 0.1), "u has 5 values: must be 6"),
        ((np.full(34, np.nan), np.zeros(6), 0.1), "finite"),
        ((np.zeros(34), np.zeros(6), 0.0), "duration = 0.0 s"),
        ((np.zeros(34), np.zeros(6), 0.1, 0), "samples = 0"),
    ],
)
def test_wrong_arguments(arguments: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        Idas(MODEL).advance(*arguments)
    with pytest.raises(InputError, match="tolerance = 0"):
        Idas(MODEL, 0)


def test_start_of_a_heavy_arm() -> None:
    """5 m long; IDAS's line search failed here, at a tolerance that others keep."""
    large = replace(
        PAPER.sections[0], length=2.5, bending_radius=0.298, disc_radius=0.323, unit_offset=0.173,
        unit_area=3.14e-2, wall_area=3.93e-2, mass=560.0, linear_damping=450.0,
    )  # fmt: skip
    other = replace(large, unit_angles=PAPER.sections[1].unit_angles)
    model = model_of(replace(PAPER, sections=(large, other)), actuation=StaticDrive())
    q = [0.28439, 0.0055644, 0.004668, -0.0076905, 0.21111, -0.039733, 0.34186, -0.00044468]
    dq = [-0.042895, 0.016817, -0.0059086, 0.025759, 0.042837, -0.060158, -0.011373, 0.013361]
    u = [0.0066292, 1.1754, 1.3663, 1.9066, 0.24901, 0.0]
    found = Idas(model, 1e-8).advance([*q, *dq], u, 0.025)[-1]
    assert found == pytest.approx(RadauIIA(model, 1e-8).advance([*q, *dq], u, 0.025)[-1], abs=1e-6)


def test_start_of_a_fast_arm(capfd: pytest.CaptureFixture[str]) -> None:
    """Half a millisecond within a swing; the line search fails at first, and says nothing."""
    effects = (Inertia(), Coriolis(), EnvironmentDamping(), MaterialDamping())
    slots: dict[str, Any] = {"effects": effects, "actuation": PressureDrive()}
    model = model_of(arm(PAPER.sections[0]), strains=("epsilon", "kappa_x", "kappa_y"), **slots)
    x, u = [0.146174, 0.0, 0.173238, 34.1643, 0.0, 43.9029], [0.00409325, 1e6, 1e6]
    found = Idas(model, 1e-9).advance(x, u, 0.000558296, 8)[-1]
    assert found == pytest.approx(RadauIIA(model, 1e-9).advance(x, u, 0.000558296)[-1], abs=1e-5)
    assert capfd.readouterr() == ("", "")


def test_what_cannot_move() -> None:
    with pytest.raises(BuildError, match=r"no mass: kappa_z.*rotary_inertia"):
        Idas(model_of(effects=(Gravity(), Inertia())))
    with pytest.raises(BuildError, match="neither"):
        Idas(model_of(effects=(Gravity(),)))
    still = replace(PAPER, sections=tuple(replace(s, angular_damping=0.0) for s in PAPER.sections))
    with pytest.raises(BuildError, match="damping in every strain"):
        Idas(model_of(still, effects=(Gravity(), EnvironmentDamping())))


def test_idas_gives_its_reason(monkeypatch: Any) -> None:
    monkeypatch.setattr("softmpc.simulation.idas.MOST_STEPS", 5)
    with pytest.raises(IntegrationError, match="IDAS: too much work"):
        Idas(MODEL).advance(np.zeros(34), TORQUES, 0.5)
