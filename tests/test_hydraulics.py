"""The drive (32)-(36): its poles, its gain, its stroke, and how it sits in a model."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import casadi as ca
import control
import numpy as np
import pytest
from arms import ONE_UNIT, PAPER, SMALL, States, arm, model_of, numbers
from numpy.testing import assert_allclose
from scipy.linalg import expm

from softmpc.errors import BuildError
from softmpc.model.actuation import HydraulicDrive, PressureDrive, SlowDrive, StaticDrive
from softmpc.model.hydraulics import (
    DriveMatrices,
    cylinder_compliance,
    screw_ratio,
    slow_mode,
    state_space,
    tube_conductance,
    unit_compliance,
    unit_matrices,
)
from softmpc.model.parameters import Hydraulics, Section

SECTION, DRIVE = Section(), Hydraulics()


def drive(**changes: Any) -> DriveMatrices:
    return unit_matrices(SECTION, replace(DRIVE, **changes))


def gain(m: DriveMatrices) -> float:
    """Pressure at rest over torque, Pa/(N·m)."""
    return float(np.squeeze(m.D - m.C @ np.linalg.solve(m.A, m.B)))


# ------------------------------------------------------------------- EQUATIONS.md, section 4


def test_poles() -> None:
    poles = np.sort(np.linalg.eigvals(drive().A).real)
    assert_allclose(poles[:2], (-10485, -1149), atol=0.5)
    assert poles[2] == pytest.approx(-66.9, abs=0.05)


@pytest.mark.parametrize(
    "damping, pole", [(0.0, -80.7), (200.0, -66.9), (1000.0, -40.2), (2000.0, -27.1)]
)
def test_piston_damping_moves_the_slow_pole(damping: float, pole: float) -> None:
    poles = np.linalg.eigvals(drive(piston_damping=damping).A)
    assert poles.real.max() == pytest.approx(pole, abs=0.05)
    assert np.all(np.abs(poles.imag) < 1e-9)


def test_static_gain_with_both_readings_of_33() -> None:
    """2.5 N·m hold 1 MPa: with lead/2π at η = 0.535, while the printed reading gives 0.268 MPa."""
    assert gain(drive()) == pytest.approx(0.400e6, abs=0.0005e6)
    assert 2.5 * gain(drive()) == pytest.approx(1e6, rel=1e-3)
    assert 2.5 * gain(drive(screw="lead", efficiency=0.9)) == pytest.approx(0.268e6, rel=2e-3)
    assert screw_ratio(DRIVE) == pytest.approx(2 * np.pi * 0.535 / 0.004)
    assert screw_ratio(replace(DRIVE, screw="lead")) == pytest.approx(0.535 / 0.004)
    surplus = 2 * np.pi * 0.9 * 2.5 / 0.004 - 1e6 * DRIVE.piston_area
    assert surplus == pytest.approx(1434, abs=1), "η = 0.9 would leave this much friction"


def test_stroke() -> None:
    """The piston's place is an output, about 25 mm at 1 MPa."""
    pressure = 1e6
    x = float((drive().X @ (0.0, pressure, pressure))[0])
    assert x == pytest.approx(0.025, abs=0.0005)
    volume = (unit_compliance(SECTION, DRIVE) + cylinder_compliance(DRIVE)) * pressure
    assert x == pytest.approx(volume / DRIVE.piston_area)


def test_piston_place_is_the_integral_of_its_speed() -> None:
    """X A = (1, 0, 0) and X B = 0: no water is lost, so no state is needed for it."""
    m = drive()
    assert_allclose(m.X @ m.A, [(1, 0, 0)], atol=1e-9)
    assert_allclose(m.X @ m.B, 0, atol=1e-15)


def test_tube_conductance() -> None:
    assert tube_conductance(DRIVE) == pytest.approx(np.pi * 0.004**4 / (128 * 1.01e-3 * 1.61))


# --------------------------------------------------------------------------------- python-control


def test_state_space_of_python_control() -> None:
    system, m = state_space(SECTION, DRIVE), drive()
    assert isinstance(system, control.StateSpace)
    assert (system.input_labels, system.output_labels) == (["T"], ["P_a"])
    assert system.state_labels == ["piston_speed", "P_a", "P_c"]
    assert_allclose(np.sort(system.poles().real), np.sort(np.linalg.eigvals(m.A).real))
    assert float(np.squeeze(system.dcgain())) == pytest.approx(gain(m))


def test_step_response_settles_at_the_gain() -> None:
    """Exact discretisation over 0.3 s, many time constants of the slow pole."""
    m = drive()
    block = np.zeros((4, 4))
    block[:3, :3], block[:3, 3:] = m.A, m.B
    z = expm(0.3 * block)[:3, 3] * 1.5
    assert_allclose(z, (0, 1.5 * gain(m), 1.5 * gain(m)), atol=0.01)


# ------------------------------------------------------------------------------------- in a model


def test_drive_of_the_arm_is_ordered_by_kind_then_unit() -> None:
    m, unit = model_of(), drive()
    assert m.layout.z.names[:7] == (*(f"piston_speed_{j}" for j in range(1, 7)), "P_a_1")
    for j in range(6):
        assert_allclose(m.drive.A[j::6, j::6], unit.A)
        assert_allclose(m.drive.X[j, j::6], unit.X[0])
        assert np.count_nonzero(m.drive.A[j::6]) == np.count_nonzero(unit.A)
        assert np.count_nonzero(m.drive.B[:, j]) == 1
    assert not m.drive.D.any()


def test_sections_of_different_size_have_their_own_compliance() -> None:
    m = HydraulicDrive().matrices(arm(SECTION, SMALL, ONE_UNIT))
    for j, section in enumerate((SECTION,) * 3 + (SMALL,) * 4 + (ONE_UNIT,)):
        assert_allclose(m.A[j::8, j::8], unit_matrices(section, DRIVE).A)


def test_static_drive_is_the_gain_at_frequency_zero() -> None:
    full, static = (kind.matrices(PAPER) for kind in (HydraulicDrive(), StaticDrive()))
    dc = full.D - full.C @ np.linalg.solve(full.A, full.B)
    assert_allclose(static.D, dc, atol=1e-9)
    assert_allclose(static.D, gain(drive()) * np.eye(6), rtol=1e-12, atol=1e-6)
    assert static.A.size == static.B.size == static.C.size == 0


def test_pressure_drive_passes_pressures_on() -> None:
    m = PressureDrive().matrices(PAPER)
    assert_allclose(m.D, np.eye(6))
    assert m.A.size == 0
    assert model_of(actuation=PressureDrive()).layout.u.names[0] == "P_1"


@pytest.mark.parametrize("kind", [HydraulicDrive(), StaticDrive()])
def test_friction_is_refused(kind: HydraulicDrive | StaticDrive) -> None:
    """Coulomb friction is not linear: better no answer than one without it."""
    sticky = replace(PAPER, hydraulics=replace(DRIVE, friction=50.0))
    with pytest.raises(BuildError, match=r"hydraulics\.friction = 50 N.*no Coulomb friction"):
        model_of(sticky, actuation=kind)
    assert model_of(sticky, actuation=PressureDrive()).drive.A.size == 0


def test_x_dot_joins_arm_and_drive() -> None:
    """ẋ = (dq, ddq, A z + B u), and one-way: the arm does not act back on the drive."""
    m = model_of()
    states, n = States(m), m.strains
    q, dq, _, p = states.motion()
    z = np.concatenate((np.linspace(-0.01, 0.01, 6), p, 1.1 * p))
    u = np.linspace(0.2, 2.0, 6)
    found = numbers(m.x_dot(np.concatenate((q, dq, z)), u))
    assert_allclose(found[:n], dq)
    assert_allclose(found[n : 2 * n], numbers(m.forward_dynamics(q, dq, p)), rtol=1e-10)
    dz = m.drive.A @ z + m.drive.B @ u
    assert_allclose(found[2 * n :], dz, rtol=1e-9, atol=1e-9 * np.abs(dz).max())
    pattern = np.asarray(ca.DM(m.x_dot.sparsity_jac(0, 0)))
    assert not pattern[2 * n :, : 2 * n].any()
    assert pattern[n : 2 * n, 2 * n :].any()


# ------------------------------------------------------------------------------ the slow mode


@pytest.mark.parametrize("changes", [{}, {"piston_damping": 5e3}, {"piston_damping": 2e4}])
def test_slow_mode_keeps_the_slow_pole_and_the_gain_at_rest(changes: dict[str, float]) -> None:
    """Also where the two fast modes are a complex pair, as with 20 kN·s/m."""
    full, slow = drive(**changes), slow_mode(SECTION, replace(DRIVE, **changes))
    assert slow.A.shape == (1, 1)
    assert slow.A[0, 0] == pytest.approx(np.linalg.eigvals(full.A).real.max(), rel=1e-9)
    assert gain(slow) == pytest.approx(gain(full), rel=1e-12)
    assert slow.C[0, 0] == pytest.approx(1)


def test_slow_mode_is_right_in_the_band_of_the_arm_and_not_far_beyond() -> None:
    """Up to 100 rad/s, ten times the arm's first mode, it differs by about a percent."""
    full, slow = state_space(SECTION, DRIVE), slow_mode(SECTION, DRIVE)
    reduced = control.ss(slow.A, slow.B, slow.C, slow.D)
    for frequency, least, most in ((10.0, 0, 1e-3), (100.0, 0, 0.012), (5000.0, 0.3, 100)):
        exact, near = (s(1j * frequency) for s in (full, reduced))
        assert least <= abs(near - exact) / abs(exact) <= most, frequency


def test_slow_mode_has_one_state_a_unit_and_no_pistons() -> None:
    model = model_of(PAPER, actuation=SlowDrive())
    assert model.layout.z.names == tuple(f"P_slow_{j}" for j in range(1, 7))
    assert model.drive.X.size == 0
    assert_allclose(model.drive.static_gain, model_of(PAPER).drive.static_gain, rtol=1e-12)


def test_slow_mode_of_an_oscillating_drive_is_refused() -> None:
    heavy = replace(DRIVE, piston_mass=600.0)
    with pytest.raises(BuildError, match="oscillates"):
        slow_mode(SECTION, heavy)
    with pytest.raises(BuildError, match="friction"):
        model_of(replace(PAPER, hydraulics=replace(DRIVE, friction=5.0)), actuation=SlowDrive())
