"""Warnings where a motion leaves the range of (34): the numbers by closed forms."""

from __future__ import annotations

from dataclasses import replace
from math import pi
from typing import Any

import numpy as np
import pytest
from arms import PAPER, model_of
from scipy.linalg import expm

from softmpc.model.actuation import PressureDrive, SlowDrive, StaticDrive
from softmpc.model.drive_effects import (
    Cavitation,
    ChamberCoupling,
    EndStops,
    TubeInertance,
    TurbulentLoss,
)
from softmpc.model.effects import Effect
from softmpc.model.model import Model
from softmpc.model.scene import default_effects
from softmpc.simulation.inputs import InputProfile, Ramp, Step
from softmpc.simulation.run import simulate
from softmpc.simulation.validity import (
    MotionWarning,
    late_inputs,
    motion_warnings,
    reynolds_numbers,
)


def model(*effects: Effect, **slots: Any) -> Model:
    return model_of(effects=(*default_effects(), *effects), **slots)


def step(m: Model, torque: float, unit: int, times: Any) -> tuple[Any, Any]:
    """States and inputs of the linear drive after a step on one unit from rest, exactly."""
    u = np.zeros(6)
    u[unit - 1] = torque
    rest = m.drive.at_rest(u)
    z = np.array([rest - expm(m.drive.A * t) @ rest for t in times])
    return z, np.tile(u, (len(times), 1))


def ramp(m: Model, slope: float, times: Any) -> tuple[Any, Any]:
    """The same after the start of a ramp has faded: z moves with the torque."""
    direction = np.full(6, slope)
    rate = m.drive.at_rest(direction)
    lag = np.linalg.solve(m.drive.A, rate)
    return np.array([rate * t + lag for t in times]), np.outer(times, direction)


def kinds(found: list[MotionWarning]) -> dict[str, MotionWarning]:
    assert len({w.kind for w in found}) == len(found)
    return {w.kind: w for w in found}


def test_a_step_is_far_from_laminar() -> None:
    """1.5 N·m on unit 4: Re of 5·10^5, at 3 ms, when the cylinder is full and the unit is not."""
    m, times = model(), np.linspace(0, 0.02, 401)
    z, u = step(m, 1.5, 4, times)
    found = kinds(motion_warnings(m, times, z, u))
    warning = found["turbulence"]
    assert warning.effect == "turbulent_loss" and warning.where == "unit 4"
    assert 5e5 < warning.value < 6e5 and warning.limit == 2300
    assert 0.001 < warning.time < 0.005
    flow = pi * 0.004**4 / (128 * 1.01e-3 * 1.61) * (z[:, 15] - z[:, 9]).max()
    assert warning.value == pytest.approx(4 * 1000 * flow / (pi * 0.004 * 1.01e-3))
    assert "Re reached 5.5·10^5 at t = 0.00275 s, unit 4: add the effect turb" in warning.text
    assert found["inertance"].effect == "tube_inertance"


def test_the_slow_ramp_passes_the_limit_too() -> None:
    """0.75 N·m/s: the unit takes up C_1 dP/dt, Re = 4947."""
    m, times = model(), np.linspace(0.1, 1, 10)
    z, u = ramp(m, 0.75, times)
    gain = 0.535 * 2 * pi / 0.004 / 0.0021
    compliance = (3.14e-4) ** 2 * 0.25 / (1.2e6 * 3.93e-4) + 7.85e-5 / 2.18e9
    expected = 4 * 1000 * compliance * gain * 0.75 / (pi * 0.004 * 1.01e-3)
    found = kinds(motion_warnings(m, times, z, u))
    assert found["turbulence"].value == pytest.approx(expected, rel=1e-6)
    assert expected == pytest.approx(4947, abs=1)
    assert set(found) == {"turbulence"}
    slower = ramp(m, 0.3, times)
    assert motion_warnings(m, times, *slower) == []


def test_with_the_effects_there_is_nothing_to_add() -> None:
    m, times = model(TurbulentLoss(), TubeInertance()), np.array([0.0, 0.01])
    z = np.zeros((2, 24))
    per_flow = 4 * 1000 / (pi * 0.004 * 1.01e-3)
    z[1, 20] = -9e4 / per_flow
    assert reynolds_numbers(m, z)[1, 2] == pytest.approx(9e4)
    assert motion_warnings(m, times, z, np.zeros((2, 6))) == []
    z[1, 20] *= 2
    assert kinds(motion_warnings(m, times, z, np.zeros((2, 6))))["smooth_tube"].effect is None


@pytest.mark.parametrize(
    "lowest, kind, cure", [(-120e3, "vapour", "cavitation"), (-50e3, "suction", None)]
)
def test_low_pressure(lowest: float, kind: str, cure: str | None) -> None:
    times, u = np.array([0.0, 0.5]), np.zeros((2, 6))
    z = np.zeros((2, 18))
    z[1, [7, 13]] = lowest
    found = kinds(motion_warnings(model(), times, z, u))
    assert set(found) == {kind, "stroke"}, "a piston that pulled is behind its end"
    assert (found[kind].value, found[kind].time, found[kind].effect) == (lowest, 0.5, cure)
    assert found[kind].where in ("P_a_2", "P_c_2")
    assert "suction" not in kinds(motion_warnings(model(), times, 0.04 * z, u))
    with_it = kinds(motion_warnings(model(Cavitation(), EndStops()), times, z, u))
    assert with_it == {}


def test_stroke() -> None:
    """25 mm at 1 MPa, in a cylinder of 20 mm; the arm's own volume counts where it acts back."""
    short = replace(PAPER, limits=replace(PAPER.limits, stroke_max=0.02))
    times, u = np.array([0.0, 3.0]), np.zeros((2, 6))
    z = np.zeros((2, 18))
    z[1, 6:] = 1e6
    warning = kinds(motion_warnings(model(manipulator=short), times, z, u))["stroke"]
    assert warning.value == pytest.approx(0.0251, abs=1e-4) and warning.effect == "end_stops"
    assert motion_warnings(model(EndStops(), manipulator=short), times, z, u) == []
    coupled = model(ChamberCoupling(), manipulator=short)
    assert motion_warnings(coupled, times, z, u) == []
    q = np.zeros((2, 8))
    q[1, 4] = 0.3
    found = kinds(motion_warnings(coupled, times, z, u, q))
    expected = (3.14e-4 * 0.25 * 0.3 + 1e6 * (7.85e-5 + 7.35e-4) / 2.18e9) / 0.0021
    assert found == {}, expected
    q[1, 4] = 0.6
    warning = kinds(motion_warnings(coupled, times, z, u, q))["stroke"]
    expected = (3.14e-4 * 0.25 * 0.6 + 1e6 * (7.85e-5 + 7.35e-4) / 2.18e9) / 0.0021
    assert warning.value == pytest.approx(expected)


def test_squeezed_segment() -> None:
    m, times = model(actuation=StaticDrive()), np.array([0.0, 1.0])
    q = np.zeros((2, 8))
    q[1, 4] = -0.7
    (warning,) = motion_warnings(m, times, np.zeros((2, 0)), np.zeros((2, 6)), q)
    assert (warning.kind, warning.where, warning.value) == ("strain", "epsilon_2_1", -0.7)
    assert motion_warnings(m, times, np.zeros((2, 0)), np.zeros((2, 6)), q / 2) == []


def test_stretched_segment() -> None:
    m, times = model(actuation=StaticDrive()), np.array([0.0, 1.0])
    q = np.zeros((2, 8))
    q[1, 4] = 70.0
    (warning,) = motion_warnings(m, times, np.zeros((2, 0)), np.zeros((2, 6)), q)
    assert (warning.kind, warning.where, warning.value) == ("strain", "epsilon_2_1", 70.0)
    assert motion_warnings(m, times, np.zeros((2, 0)), np.zeros((2, 6)), q / 100) == []


@pytest.mark.parametrize("drive", [StaticDrive(), PressureDrive(), SlowDrive()])
def test_drives_without_tubes_have_nothing_to_say(drive: Any) -> None:
    m = model(actuation=drive)
    h = len(m.layout.z)
    assert reynolds_numbers(m, np.zeros((3, h))).shape == (3, 0)
    assert motion_warnings(m, np.arange(3.0), np.ones((3, h)), np.zeros((3, 6))) == []
    assert motion_warnings(m, [], np.zeros((0, h)), np.zeros((0, 6))) == []


def test_inputs_after_the_end() -> None:
    """Only what begins then: the ramp on unit 2 is under way, that on unit 3 begins at the end."""
    moves = [Step(1, 0.5, 1.0), Step(1, 5.0, 0.0), Ramp(2, 0.5, 2.0, 1.0), Ramp(3, 1.0, 2.0, 0.5)]
    profile = InputProfile.of(6, moves)
    (warning,) = late_inputs(profile, 1.0)
    assert (warning.kind, warning.where, warning.time, warning.limit) == (
        "late_input", "unit 3", 1.0, 1.0,
    )  # fmt: skip
    assert "begin: unit 3 at t = 1 s, unit 1 at t = 5 s; take a longer" in warning.text
    assert late_inputs(profile, 6.0) == []
    many = InputProfile.of(1, [Step(1, float(at), at / 10) for at in range(1, 9)])
    assert "unit 1 at t = 6 s and 2 more; take" in late_inputs(many, 1.5)[0].text
    under_way = InputProfile.from_table([0.0, 1.0, 2.0, 3.0], [[0.0], [1.0], [3.0], [0.0]])
    assert late_inputs(under_way, 0.5) == []
    held = InputProfile.from_table([0.0, 1.0, 2.0], [[0.0], [1.0], [1.0]], hold=True)
    assert [warning.time for warning in late_inputs(held, 0.5)] == [1.0]


def test_simulate_warns_of_late_inputs() -> None:
    m = model(actuation=StaticDrive())
    motion = simulate(m, InputProfile.of(6, [Step(1, 0.5, 1.0)]), 0.05)
    assert [warning.kind for warning in motion.warnings] == ["late_input"]
