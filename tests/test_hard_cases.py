"""Hard cases of the motion, each with the reason why it is hard.

Checked against IDAS at a tight tolerance (another method), statics, symmetries, or closed forms.
"""

from __future__ import annotations

from dataclasses import fields, replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

from softmpc import (
    GaussMass,
    Gravity,
    Manipulator,
    Model,
    NewtonEuler,
    PaperArc,
    PressureDrive,
    Scene,
    SoftmpcError,
    TipLoad,
    VirtualPower,
    build,
    chen2022,
    find_equilibrium,
    simulate,
)
from softmpc.model.actuation import FrictionDrive
from softmpc.model.drive_effects import ChamberCoupling
from softmpc.model.parameters import Hydraulics, Section
from softmpc.simulation.inputs import InputProfile, Ramp, Step
from softmpc.simulation.integrator import IntegrationError
from softmpc.simulation.result import Simulation
from softmpc.simulation.run import start_state
from softmpc.simulation.runge_kutta import RadauIIA

PAPER = chen2022()
BEND = InputProfile.of(6, [Step(1, 0.1, 1.5), Step(5, 0.3, 0.8)])
NOTHING = InputProfile.of(6)


def arm(**values: Any) -> Manipulator:
    return replace(PAPER, sections=tuple(replace(s, **values) for s in PAPER.sections))


def with_effects(*more: Any, **changes: Any) -> Scene:
    scene = Scene(PAPER, **changes)
    return scene.with_(effects=(*scene.effects, *more))


def gravity(*vector: float) -> Scene:
    scene = Scene(PAPER)
    others = tuple(e for e in scene.effects if not isinstance(e, Gravity))
    return scene.with_(effects=(Gravity(tuple(map(float, vector))), *others))  # type: ignore[arg-type]


@cache
def paper() -> Model:
    return build(Scene(PAPER))


def apart(a: Simulation, b: Simulation) -> float:
    """Largest distance of section tips, m."""
    assert a.finished and b.finished
    return float(np.linalg.norm(a.tips - b.tips, axis=2).max())


def agrees_with_idas(
    model: Model, profile: InputProfile, duration: float, within: float
) -> Simulation:
    ours = simulate(model, profile, duration)
    assert apart(ours, simulate(model, profile, duration, method="idas", tolerance=1e-9)) < within
    return ours


# --- geometry ------------------------------------------------------------------------------------


@pytest.mark.sampled
@pytest.mark.parametrize("kinematics", [None, PaperArc()])
def test_almost_straight(kinematics: Any) -> None:
    """0/0 in every formula with angles; a threshold or a clamp would show as a jump.

    The answer to a small curvature is linear in it: tip over curvature is the same for all. Stages
    are solved to rounding of the whole arm (1e-15 m), which for the smallest is one iteration.
    """
    model = build(Scene(PAPER, **({} if kinematics is None else {"kinematics": kinematics})))
    start = start_state(model, NOTHING, "straight")
    straight = simulate(model, NOTHING, 0.4, start=start, step=0.01)
    assert np.abs(straight.tips[:, :, :2]).max() == 0.0
    answers = []
    for kappa in (1e-300, 1e-200, 1e-100, 1e-30, 1e-15, 1e-9, 1e-6, 1e-3):
        bent = start.copy()
        bent[model.layout.x.names.index("kappa_y_1_1")] = kappa
        motion = simulate(model, NOTHING, 0.4, start=bent, step=0.01)
        assert motion.finished
        np.testing.assert_allclose(motion.tips[..., 2], straight.tips[..., 2], atol=1e-8)
        answers.append(motion.tips[..., 0] / kappa)
    for answer in answers[:5]:
        np.testing.assert_allclose(answer, answers[-1], atol=0.01)  # of 0.1 m for 1/m
    for answer in answers[5:-1]:
        np.testing.assert_allclose(answer, answers[-1], rtol=1e-4, atol=1e-6)


def test_bending_through_one_and_two_half_turns() -> None:
    """Angles beyond π and 2π: where representations by angles or quaternions jump."""
    soft = build(Scene(arm(young_modulus=2.2e5, shear_modulus=0.7e5)))
    profile = InputProfile.of(
        6, [Ramp(1, 0.1, 1.1, 1.5), Ramp(5, 0.1, 1.1, 1.5), Ramp(6, 0.1, 1.1, 1.5)]
    )
    motion = agrees_with_idas(soft, profile, 3.0, 1e-4)
    strains = soft.layout.q.names
    first = (1 + motion.q[:, strains.index("epsilon_1_1")]) * 0.25
    angle = np.abs(first * motion.q[:, strains.index("kappa_y_1_1")])
    second = (1 + motion.q[:, strains.index("epsilon_2_1")]) * 0.25
    whole = angle + np.abs(second * motion.q[:, strains.index("kappa_y_2_1")])
    assert angle.max() > np.pi
    assert whole.max() > 2 * np.pi
    rest = find_equilibrium(soft, motion.p[-1])
    assert apart_from(motion.final_tips, rest.tips) < 1e-3


def apart_from(tips: np.ndarray, others: np.ndarray) -> float:
    return float(np.linalg.norm(tips - others, axis=1).max())


@pytest.mark.sampled
@pytest.mark.parametrize(
    ("sections", "segments"),
    [(1, 1), (1, 16), (2, 4), (3, 2), (4, 1), pytest.param(4, 8, marks=pytest.mark.slow),
     pytest.param(2, 16, marks=pytest.mark.slow)],
)  # fmt: skip
def test_many_segments(sections: int, segments: int) -> None:
    """Short segments are stiff: modes grow with n², step sizes must not shrink with them."""
    long = replace(
        PAPER, name="long", sections=tuple(PAPER.sections[i % 2] for i in range(sections))
    )
    units = 3 * sections
    moves = [Step(1, 0.05, 1.0), Step(units, 0.1, 0.6)]
    model = build(Scene(long, segments=segments))
    motion = simulate(model, InputProfile.of(units, moves), 1.0, sample_time=0.02)
    assert motion.finished
    torques = InputProfile.of(units, moves)(0.2)
    assert steps_of(model, torques) < 1.5 * steps_of(build(Scene(long)), torques)
    slow = simulate(model, InputProfile.of(units, moves), 4.0, sample_time=0.5)
    assert apart_from(slow.final_tips, find_equilibrium(model, slow.p[-1]).tips) < 2e-3


def steps_of(model: Model, torques: np.ndarray) -> int:
    """Steps of the first second under held torques."""
    method = RadauIIA(model)
    method.advance(start_state(model, InputProfile.of(len(torques))), torques, 1.0)
    return method.steps


# --- stiffness -----------------------------------------------------------------------------------


@pytest.mark.sampled
@pytest.mark.parametrize("mass", [1e-3, 1e-2])
def test_light_arm(mass: float) -> None:
    """A section of 1 g: modes near 1 kHz with a drag that overdamps them."""
    agrees_with_idas(build(Scene(arm(mass=mass))), BEND, 1.0, 1e-4)


@pytest.mark.sampled
@pytest.mark.parametrize("factor", [1.0, 100.0])
def test_stiff_water(factor: float) -> None:
    """Poles of the drive at -1e4 and, with water 100 times stiffer, -1e6 1/s beside 10 1/s.

    The pressures are those of the matrix exponential.
    """
    bulk = 2.18e9 * factor
    model = build(Scene(replace(PAPER, hydraulics=replace(PAPER.hydraulics, bulk_modulus=bulk))))
    motion = agrees_with_idas(model, BEND, 1.0, 1e-4)
    drive, k = model.drive, 60  # 0.5 s after the first step
    held = np.array([1.5, 0, 0, 0, 0.8, 0])
    z = motion.z[40]
    rest = drive.at_rest(held)
    exact = rest + expm(drive.A * 0.01 * (k - 40)) @ (z - rest)
    np.testing.assert_allclose(motion.z[k], exact, rtol=1e-9, atol=1e-3)


@pytest.mark.sampled
@pytest.mark.parametrize("factor", [1.0, 100.0])
def test_steps_of_20_ms_do_not_ring(factor: float) -> None:
    """The drive inside the implicit step (the arm acts back on it), poles at -1e5 and -1e7 1/s.

    A method that is not L-stable answers a step of torque with pressures that change sign at every
    step of the integration.
    """
    bulk = 2.18e9 * factor
    stiff = replace(PAPER, hydraulics=replace(PAPER.hydraulics, bulk_modulus=bulk))
    model = build(with_effects(ChamberCoupling(), segments=1).with_(manipulator=stiff))
    assert not model.drive_is_linear
    step = InputProfile.of(6, [Step(1, 0.0, 1.5)])
    coarse = simulate(model, step, 1.0, step=0.02, sample_time=0.02)
    fine = simulate(model, step, 1.0, tip_tolerance=1e-6, sample_time=0.02)
    assert apart(coarse, fine) < 2e-3
    pressure = coarse["P_a_1"]
    np.testing.assert_allclose(pressure[:3], fine["P_a_1"][:3], rtol=0.1)  # 1.3 time constants
    np.testing.assert_allclose(pressure[4:], fine["P_a_1"][4:], rtol=2e-3)
    rises = np.diff(pressure)
    assert np.all(rises[:5] > 0) and np.all(np.abs(rises[10:]) < 0.01 * rises[0])


@pytest.mark.sampled
@pytest.mark.parametrize(("force", "velocity"), [(30.0, 1e-3), (100.0, 1e-3), (100.0, 1e-4)])
def test_friction_reverses_and_sticks(force: float, velocity: float) -> None:
    """tanh(ẋ/v) is nearly a jump: at rest it adds f/(v m_b), up to 1e6 1/s, in sliding nothing."""
    rough = replace(PAPER.hydraulics, friction=force, friction_velocity=velocity)
    model = build(Scene(replace(PAPER, hydraulics=rough), actuation=FrictionDrive()))
    moves = [Ramp(1, 0.1, 0.6, 2.0), Ramp(1, 1.2, 1.7, -1.6), Ramp(1, 1.8, 2.2, 1.2)]
    motion = agrees_with_idas(model, InputProfile.of(6, moves), 2.6, 1e-4)
    speed, time = motion["piston_speed_1"], motion.time
    assert speed[time < 0.6].max() > 10 * velocity
    assert speed[(time > 1.2) & (time < 1.7)].min() < -10 * velocity
    stuck = speed[(time > 1.1) & (time < 1.2)]
    assert 0 < stuck.max() < 3 * velocity  # held by friction, creeping as tanh lets it
    gain = model.drive.static_gain[0, 0]
    held = motion.p[np.searchsorted(time, 1.15), 0]
    width = force / PAPER.hydraulics.piston_area
    assert 0.0 < gain * 1.0 - held < width  # less than without friction, by at most what it holds


def test_torque_to_the_limit_and_back() -> None:
    """The largest steps there are; pressure must come back to where it was, and the arm with it."""
    moves = [Step(j, 0.1, 2.5) for j in (1, 5, 6)] + [Step(j, 1.0, 0.0) for j in (1, 5, 6)]
    motion = agrees_with_idas(paper(), InputProfile.of(6, moves), 5.0, 1e-4)
    assert motion.p.max() == pytest.approx(1.0e6, rel=0.01)
    assert motion.p.min() > -0.05e6
    assert apart_from(motion.final_tips, motion.tips[0]) < 1e-4


@pytest.mark.sampled
@pytest.mark.parametrize("force", [(0, 0, 10.0), (10.0, 0, 0), (0, -10.0, 0), (0, 0, -10.0)])
def test_heavy_tip_load(force: Any) -> None:
    """10 N on an arm that weighs 11 N, let go at once; up to a metre of motion."""
    model = build(with_effects(TipLoad(force=force)))
    motion = simulate(model, NOTHING, 8.0, start="straight")
    assert motion.finished
    rest = find_equilibrium(model, np.zeros(6))
    if rest.stable:
        assert apart_from(motion.final_tips, rest.tips) < 1e-3


# --- buckling ------------------------------------------------------------------------------------


def upright(mass: float) -> Model:
    scene = gravity(0, 0, -9.81)
    return build(scene.with_(manipulator=arm(mass=mass), segments=2))


@pytest.mark.slow
def test_upright_near_and_past_buckling() -> None:
    """The straight arm is a rest on both sides of the buckling load, but past it no stable one.

    The load is 7.837 E I/L² for the own weight of an inextensible column; shortening under its
    weight makes the arm a little stronger or weaker, so the sides are checked 20 % away.
    """
    stiffness = PAPER.sections[0].bending_stiffness
    critical = 7.837 * stiffness / 0.5**2 / 9.81 / 2  # kg a section
    below, above = upright(0.8 * critical), upright(1.25 * critical)
    assert find_equilibrium(below, np.zeros(6)).stable
    assert not find_equilibrium(above, np.zeros(6)).stable
    pushed = start_state(below, NOTHING)
    pushed[below.layout.x.names.index("kappa_y_1_1")] += 0.05
    back = simulate(below, NOTHING, 20.0, start=pushed, sample_time=0.1)
    assert apart_from(back.final_tips, back.tips[0] * [0, 0, 1]) < 2e-3
    ends = []
    for sign in (1, -1):
        pushed = start_state(above, NOTHING)
        pushed[above.layout.x.names.index("kappa_y_1_1")] += 0.01 * sign
        fallen = simulate(above, NOTHING, 20.0, start=pushed, sample_time=0.1)
        assert fallen.finished
        assert fallen.tip_speeds[-1].max() < 1e-3
        K = np.asarray(above.stiffness(fallen.q[-1], np.zeros(6))[0])
        scale = above.layout.q.scale
        assert np.linalg.eigvalsh((K + K.T) / 2 * np.outer(scale, scale)).min() > 0
        ends.append(fallen.final_tips)
    assert abs(ends[0][-1, 0]) > 0.1
    np.testing.assert_allclose(ends[0] * [-1, 1, 1], ends[1], atol=1e-4)


@pytest.mark.slow
def test_unstable_start_is_reported() -> None:
    motion = simulate(upright(2.0), NOTHING, 0.1)
    assert motion.warnings[0].kind == "unstable_start"
    assert not [w for w in simulate(paper(), NOTHING, 0.1).warnings if w.kind == "unstable_start"]


# --- gravity -------------------------------------------------------------------------------------


def test_gravity_in_any_direction() -> None:
    """The arm is the same after a third of a turn about its axis, gravity and inputs turned too."""
    turn = np.array([[-0.5, -np.sqrt(0.75), 0], [np.sqrt(0.75), -0.5, 0], [0, 0, 1]])
    start = np.array([6.0, -3.0, 5.0])
    first = simulate(build(gravity(*start)), BEND, 1.0)
    turned = InputProfile.of(6, [Step(2, 0.1, 1.5), Step(6, 0.3, 0.8)])
    second = simulate(build(gravity(*(turn @ start))), turned, 1.0)
    assert first.finished and second.finished
    np.testing.assert_allclose(first.tips @ turn.T, second.tips, atol=2e-5)


def test_gravity_switched_on_the_way() -> None:
    """The same state under another weight: accelerations jump, places and rates do not."""
    there = simulate(paper(), BEND, 0.5)
    torques = InputProfile.constant(there.u[-1])
    aside = simulate(build(gravity(9.81, 0, 0)), torques, 0.5, start=there.x[-1])
    back = simulate(paper(), torques, 6.0, start=aside.x[-1])
    assert aside.finished and back.finished
    np.testing.assert_allclose(aside.tips[0], there.tips[-1], atol=1e-12)
    assert apart_from(back.final_tips, find_equilibrium(paper(), back.p[-1]).tips) < 1e-4


# --- time ----------------------------------------------------------------------------------------


@pytest.mark.slow
def test_ten_minutes_without_drift() -> None:
    """60,000 samples of a periodic motion: errors that add up would show against its period."""
    period, cycles = 4.0, 150
    shape = np.array([[0.2, 0, 0, 0, 0.4, 0.4], [1.2, 0, 0.3, 0, 0.1, 0.4]])
    times = np.arange(2 * cycles + 1) * period / 2
    profile = InputProfile.from_table(times, shape[np.arange(2 * cycles + 1) % 2])
    motion = simulate(paper(), profile, 600.0, sample_time=0.04)
    assert motion.finished
    each = motion.tips[:-1].reshape(cycles, 100, -1)
    assert np.abs(each[10] - each[-1]).max() < 1e-5


# --- the edge of the range -----------------------------------------------------------------------


def edges(kind: type) -> list[tuple[str, float]]:
    found = []
    for item in fields(kind):
        allowed = item.metadata.get("range")
        if allowed is not None and not item.metadata["many"]:
            low = max(allowed.low, 1e-9) if allowed.low_open else allowed.low
            found += [(item.name, low), (item.name, allowed.high)]
    return found


@pytest.mark.sampled
@pytest.mark.parametrize(("name", "value"), edges(Section))
def test_section_at_the_edge(name: str, value: float) -> None:
    """Whatever a parameter may be, a run ends with a motion, a status or a clear error."""
    check_edge(lambda: Scene(arm(**{name: value}), actuation=PressureDrive()), 1e5)


@pytest.mark.sampled
@pytest.mark.parametrize(("name", "value"), edges(Hydraulics))
def test_hydraulics_at_the_edge(name: str, value: float) -> None:
    def scene() -> Scene:
        changed = replace(PAPER.hydraulics, **{name: value})
        drive = {"actuation": FrictionDrive()} if changed.friction else {}
        return Scene(replace(PAPER, hydraulics=changed), **drive)

    check_edge(scene, 0.5)


def check_edge(scene: Any, size: float) -> None:
    try:
        motion = simulate(build(scene()), InputProfile.of(6, [Step(1, 0.1, size)]), 0.3)
    except SoftmpcError:
        return
    assert motion.status == "finished" or motion.status.startswith("stopped: ")
    for values in (motion.q, motion.dq, motion.z, motion.tips):
        assert np.all(np.isfinite(values))


# --- the end of the model ------------------------------------------------------------------------


def test_below_vapour_pressure_is_a_status() -> None:
    limits = replace(PAPER.limits, torque_min=-2.5)
    model = build(Scene(replace(PAPER, limits=limits)))
    motion = simulate(model, InputProfile.of(6, [Step(1, 0.2, -1.5)]), 1.0)
    assert motion.status.startswith("stopped: P_")
    assert "below vapour pressure; add the effect 'cavitation'" in motion.status
    assert motion.time[-1] == pytest.approx(0.2, abs=0.02)
    assert len(motion.tips) == len(motion.time) > 10


@pytest.mark.sampled
@pytest.mark.parametrize("formulation", [VirtualPower(mass=GaussMass(3)), NewtonEuler()])
def test_no_special_case_for_other_formulations(formulation: Any) -> None:
    """The printed Newton-Euler has a nonsymmetric M; the methods do not ask."""
    agrees_with_idas(build(Scene(PAPER, formulation=formulation)), BEND, 0.6, 1e-4)


@pytest.mark.parametrize(
    ("said", "raised"),
    [("Evaluation failed", IntegrationError), ("… KeyboardInterrupt …", KeyboardInterrupt)],
)
def test_what_casadi_raises(said: str, raised: type, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_: Any) -> None:
        raise RuntimeError(said)

    integrator = RadauIIA(build(Scene(PAPER)))
    monkeypatch.setattr(integrator, "_many", fails)
    with pytest.raises(raised):
        integrator.advance(np.zeros(34), np.zeros(6), 0.01)
