"""Effects of the hydraulics beyond (36), against an actuator written anew with other states."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations
from math import pi
from typing import Any

import control
import numpy as np
import pytest
from arms import MIXED, PAPER, States, differences, largest, model_of, numbers
from numpy.testing import assert_allclose
from oracles.actuator import Actuator
from scipy.integrate import solve_ivp

from softmpc.errors import SceneError
from softmpc.model.actuation import (
    Actuation,
    FrictionDrive,
    HydraulicDrive,
    PressureDrive,
    SlowDrive,
    StaticDrive,
)
from softmpc.model.drive_effects import (
    DRIVE_EFFECTS,
    BackDriving,
    Cavitation,
    ChamberCoupling,
    DriveEffect,
    EndStops,
    RotorInertia,
    TubeInertance,
    TurbulentLoss,
)
from softmpc.model.effects import Effect
from softmpc.model.hydraulics import reflected_mass, state_space, tube_inertance, unit_matrices
from softmpc.model.model import Model
from softmpc.model.parameters import Hydraulics, Manipulator
from softmpc.model.scene import Scene, default_effects
from softmpc.model.scene_file import scene_from_dict, scene_to_dict

DRIVE = Hydraulics()
STROKE = 0.02  # m; less than the 25 mm of 1 MPa
# What the oracle calls each of them.
SAME: dict[type[Effect], dict[str, Any]] = {
    TubeInertance: {"inertance": True},
    TurbulentLoss: {"blasius": 0.3164},
    RotorInertia: {"rotor": 1e-4},
    Cavitation: {"cavity": (-99e3, 1e3)},
    EndStops: {"stops": (1e7, 1e-4, 0.0, STROKE)},
    BackDriving: {"back": (0.13, 1e-3, 1e-2)},
}
ONE_WAY = tuple(SAME)
each = pytest.mark.parametrize("kind", DRIVE_EFFECTS, ids=lambda kind: kind.name)


def arm_with(arm: Manipulator = PAPER, stroke: float = STROKE, **changes: float) -> Manipulator:
    return replace(
        arm,
        hydraulics=replace(arm.hydraulics, **changes),
        limits=replace(arm.limits, stroke_max=stroke),
    )


def model(
    *effects: Effect,
    friction: float = 0.0,
    arm: Manipulator = PAPER,
    stroke: float = STROKE,
    **slots: Any,
) -> Model:
    kind = FrictionDrive() if friction else HydraulicDrive()
    wanted = {"effects": (*default_effects(), *effects), "actuation": kind} | slots
    return model_of(arm_with(arm, stroke, friction=friction), **wanted)


def oracle(*effects: Effect, friction: float = 0.0, **changes: Any) -> Actuator:
    for effect in effects:
        changes |= SAME[type(effect)]
    return Actuator(friction=friction, **changes)


def unit_states(m: Model, rows: Any) -> Any:
    """Drive states of which unit 1 has (ẋ, P_a, P_c[, Q]) and the others rest."""
    z = np.zeros((len(m.layout.z) // 6, 6))
    z[:, 0] = rows[: len(z)]
    return z.ravel()


def rates(m: Model, v: float, p_a: float, p_c: float, flow: float, torque: float) -> Any:
    u = np.zeros(6)
    u[0] = torque
    dz = numbers(m.drive_rate(unit_states(m, (v, p_a, p_c, flow)), u, 0, 0))
    return dz.reshape(-1, 6)[:, 0]


# --------------------------------------------------------------------- against the other writing


COMBINED = [
    *((kind,) for kind in ONE_WAY),
    *combinations(ONE_WAY, 2),
    ONE_WAY,
]


@pytest.mark.parametrize("kinds", COMBINED, ids=lambda ks: "+".join(k.name for k in ks))
@pytest.mark.parametrize("friction", [0.0, 40.0])
def test_rates_are_those_of_the_other_writing(
    kinds: tuple[type[DriveEffect], ...], friction: float
) -> None:
    effects = [kind() for kind in kinds]
    m, other = model(*effects, friction=friction), oracle(*effects, friction=friction)
    random = np.random.default_rng(len(kinds))
    size = np.array([5e2, 1e9, 1e13, 1e-2])
    for _ in range(12):
        v, flow = random.normal(size=2) * (3e-3, 5e-5)
        p_a, p_c = random.uniform(-1.0e5, 1e6, 2)
        torque = random.uniform(-0.5, 2.5)
        found = rates(m, v, p_a, p_c, flow, torque)
        wanted = other.rates(v, p_a, p_c, flow, torque)
        if kinds == (TurbulentLoss,) or (TurbulentLoss in kinds and TubeInertance not in kinds):
            tolerance = 4e-4  # the flow is explicit, with one Newton step
        else:
            tolerance = 2e-7
        for j, value in enumerate(found):
            floor = 1e-9 * size[j]
            assert value == pytest.approx(wanted[j], rel=tolerance, abs=floor), (j, v, p_a, p_c)


def run(m: Model, torque: float, times: Any, start: Any = (0, 0, 0, 0)) -> Any:
    """(ẋ, P_a, P_c[, Q], x) of unit 1 over time, by SciPy on the model's own functions."""
    u = np.zeros(6)
    u[0] = torque
    scale = m.layout.z.scale
    rate, slope = m.drive_rate, m.drive_jacobian
    done = solve_ivp(
        lambda t, y: numbers(rate(y * scale, u, 0, 0)) / scale,
        (0, times[-1]),
        unit_states(m, start) / scale,
        "Radau",
        times,
        jac=lambda t, y: np.asarray(slope(y * scale, u, 0, 0)[0]) * scale / scale[:, None],
        rtol=1e-7,
        atol=1e-9,
    )
    assert done.success, done.message
    z = done.y * scale[:, None]
    places = np.array([numbers(m.piston_places(column, 0))[0] for column in z.T])
    return np.vstack([z[::6], places[None, :]])


MOTIONS: list[tuple[tuple[type[DriveEffect], ...], float, float]] = [
    ((TubeInertance,), 0.0, 1.5),
    ((TurbulentLoss,), 0.0, 1.5),
    ((RotorInertia,), 0.0, 1.5),
    ((Cavitation,), 0.0, -1.0),
    ((Cavitation, EndStops), 0.0, -1.0),
    ((EndStops,), 0.0, 2.5),
    ((BackDriving, RotorInertia), 0.0, 0.02),
    ((), 100.0, 1.5),
    ((TubeInertance, TurbulentLoss, RotorInertia), 50.0, 1.5),
]


@pytest.mark.sampled
@pytest.mark.parametrize(
    "kinds, friction, torque", MOTIONS, ids=["+".join(k.name for k in m[0]) for m in MOTIONS]
)
def test_motion_is_that_of_the_other_writing(
    kinds: tuple[type[DriveEffect], ...], friction: float, torque: float
) -> None:
    """A step of torque; cavities and stops close and open on the way."""
    effects = [kind() for kind in kinds]
    m, other = model(*effects, friction=friction), oracle(*effects, friction=friction)
    times = np.linspace(0, 0.25, 26)
    start = (0.0, 2e5, 2e5, 0.0)
    found = run(m, torque, times, start)
    wanted = other.run(torque, times, other.state(*start))
    place, wanted_place = found[-1], wanted[-1]
    assert_allclose(place, wanted_place, atol=2e-5 * np.abs(wanted_place).max())
    assert_allclose(found[1], wanted[1], atol=5e-4 * np.abs(wanted[1]).max())


# ------------------------------------------------------------------------------- the functions


ALL: tuple[DriveEffect, ...] = tuple(kind() for kind in DRIVE_EFFECTS)


def typical(m: Model, seed: int) -> tuple[Any, Any, Any, Any]:
    """A state of drive and arm: slow pistons, pressures, flows that are turbulent."""
    random = np.random.default_rng(seed)
    q, dq, _, p = States(m, seed).motion()
    parts = [2e-3 * random.normal(size=len(p)), p, p + 2e4 * random.normal(size=len(p))]
    if len(m.layout.z) > 3 * len(p):
        parts.append(3e-5 * random.normal(size=len(p)))
    return np.concatenate(parts), random.uniform(0.1, 2, len(p)), q, dq


@pytest.mark.parametrize("effects", [ALL, *((e,) for e in ALL)], ids=lambda es: es[-1].name)
@pytest.mark.parametrize("friction", [0.0, 40.0])
def test_jacobian_against_differences(effects: tuple[DriveEffect, ...], friction: float) -> None:
    m = model(*effects, friction=friction, arm=MIXED, segments=2)
    z, u, q, dq = typical(m, 3)
    found = [np.asarray(block) for block in m.drive_jacobian(z, u, q, dq)]
    step = 1e-4 * m.layout.z.scale
    by_z = differences(lambda x: m.drive_rate(x, u, q, dq), z, step)
    by_q = differences(lambda x: m.drive_rate(z, u, x, dq), q, 1e-3 * m.layout.q.scale)
    by_dq = differences(lambda x: m.drive_rate(z, u, q, x), dq, 1e-3 * m.layout.dq.scale)
    scales = m.layout.z.scale, m.layout.q.scale, m.layout.dq.scale
    for block, wanted, columns in zip(found, (by_z, by_q, by_dq), scales, strict=True):
        size = np.abs(by_z * scales[0]).max(axis=1)
        assert largest(block * columns, wanted * columns, size) < 2e-6


@each
def test_what_holds_close_to_rest_is_in_the_matrices(kind: type[DriveEffect]) -> None:
    """A and B are the Jacobian at rest; with coupling they keep the constant compliance of (34)."""
    m = model(kind(), friction=30.0)
    by_z = np.asarray(m.drive_jacobian(0, 0, 0, 0)[0])
    rows = slice(None)
    if kind is ChamberCoupling:
        rows = np.r_[0:6, 12:18]
    assert_allclose(by_z[rows], m.drive.A[rows], rtol=1e-9, atol=1e-6)
    torque = 1e-3
    assert_allclose(numbers(m.drive_rate(0, torque, 0, 0)), m.drive.B @ np.full(6, torque))


@pytest.mark.sampled
@each
def test_absent_means_absent(kind: type[DriveEffect]) -> None:
    """No state, no instruction and no nonzero for what is not there; the arm is not touched."""
    lean, full = model(), model(kind())
    assert full.layout.z.names[:18] == lean.layout.z.names
    more = tuple(f"Q_{j}" for j in range(1, 7)) if kind is TubeInertance else ()
    assert full.layout.z.names[18:] == more
    assert set(full.layout.z.units[18:]) <= {"m³/s"}
    assert full.instructions() == lean.instructions()
    assert full.drive_is_linear == kind.linear == (full.drive_nonlinear == ())
    assert lean.drive_is_linear and lean.drive_nonlinear == ()
    assert [lean.drive_jacobian.sparsity_out(k).nnz() for k in (0, 1, 2)] == [42, 0, 0]
    acts_back = full.drive_jacobian.sparsity_out(2).nnz()
    assert (acts_back > 0) == (kind is ChamberCoupling)
    if kind is not RotorInertia:  # changes a number only
        assert full.drive_rate.n_instructions() > lean.drive_rate.n_instructions()
    twice = model(kind(), *(e for e in ALL if e.name != kind.name))
    assert twice.drive_rate.n_instructions() > full.drive_rate.n_instructions()


def test_no_friction_is_linear() -> None:
    m = model_of(arm_with(), actuation=FrictionDrive())
    assert m.drive_is_linear
    assert m.drive_rate.n_instructions() == model().drive_rate.n_instructions()
    assert_allclose(m.drive.A, model().drive.A)


@pytest.mark.parametrize("effects", [ALL, *((e,) for e in ALL)], ids=lambda es: es[-1].name)
def test_rest_is_the_linear_drives(effects: tuple[DriveEffect, ...]) -> None:
    """Pressures at rest are those of the paper's drive, whatever the effects."""
    m, u = model(*effects, friction=20.0, stroke=0.35), np.linspace(0.1, 2.4, 6)
    z = m.drive_rest(u)
    assert_allclose(m.drive.C @ z, model().drive.static_gain @ u, rtol=1e-12)
    assert_allclose(numbers(m.drive_rate(z, u, 0, 0)) / m.layout.z.scale, 0, atol=1e-9)


# ------------------------------------------------------------------------------ effect by effect


def test_inertance_makes_a_mode_in_the_band_of_the_arm() -> None:
    """565 kg of water on the spring of the unit: 1.9 Hz with ζ about 0.1."""
    unit = Actuator()
    water = DRIVE.water_density * 1.61 / (pi * 0.004**2 / 4) * 0.0021**2
    assert water == pytest.approx(565, abs=0.5)
    assert tube_inertance(DRIVE) * 0.0021**2 == pytest.approx(water)
    poles = state_space(PAPER.sections[0], DRIVE, (TubeInertance(),)).poles()
    slow = poles[np.argmin(np.abs(poles))]
    frequency, ratio = abs(slow) / (2 * pi), -slow.real / abs(slow)
    spring = 0.0021**2 / (unit.wall + 7.85e-5 / 2.18e9)
    assert frequency == pytest.approx(np.sqrt(spring / (water + 1.2)) / (2 * pi), rel=1e-2)
    assert frequency == pytest.approx(1.94, abs=0.01) and ratio == pytest.approx(0.097, abs=1e-3)
    loss = 128 * 1.01e-3 * 1.61 / (pi * 0.004**4) * 0.0021**2
    assert ratio == pytest.approx((200 + loss) / (2 * (water + 1.2) * abs(slow)), rel=2e-2)


@pytest.mark.parametrize("inertance", [(), (TubeInertance(),)])
def test_steady_flow_is_laminar_then_blasius(inertance: tuple[Effect, ...]) -> None:
    """Along the tube, at Reynolds numbers from 1e-3 to 1e6, forward and back."""
    m, other = model(TurbulentLoss(), *inertance), Actuator(blasius=0.3164)
    for reynolds in 10.0 ** np.arange(-3.0, 6.5, 0.5):
        flow = reynolds * pi * 0.004 * 1.01e-3 / (4 * 1000)
        speed = flow / (pi * 0.004**2 / 4)
        law = 64 / reynolds if reynolds < 300 else 0.3164 * reynolds**-0.25
        if 300 < reynolds < 4000:
            law = other.loss(flow) / (1.61 / 0.004 * 500 * speed**2)
        lost = law * 1.61 / 0.004 * 1000 / 2 * speed**2
        tolerance = 0.003
        for sign in (1, -1):
            dz = rates(m, 0.0, 0.0, sign * lost, sign * flow, 0.0)
            entered = dz[1] * (other.wall + 7.85e-5 / 2.18e9)
            if inertance:
                assert dz[3] * tube_inertance(DRIVE) == pytest.approx(0, abs=tolerance * lost)
            assert entered == pytest.approx(sign * flow, rel=tolerance)


def test_flow_is_smooth_where_it_turns() -> None:
    """Odd in the pressure difference, with the laminar slope and no curvature at zero."""
    m, k = model(TurbulentLoss()), pi * 0.004**4 / (128 * 1.01e-3 * 1.61)
    give = Actuator().wall + 7.85e-5 / 2.18e9
    slopes = [
        np.asarray(m.drive_jacobian(unit_states(m, (0, 0, p)), 0, 0, 0)[0])[6, 12]
        for p in (0.0, 1e-3, -1e-3, 50.0, -50.0)
    ]
    assert_allclose(np.array(slopes[:3]) * give, k, rtol=1e-12)
    assert slopes[3] == pytest.approx(slopes[4], rel=1e-12) and slopes[3] < slopes[0]


def test_rotor_inertia_is_a_mass_on_the_piston() -> None:
    """From rest the motor's torque accelerates itself and, through the screw, the piston."""
    rotor, torque, s = RotorInertia(inertia=2e-4), 1.0, 0.004 / (2 * pi)
    found = rates(model(rotor), 0.0, 0.0, 0.0, 0.0, torque)[0]
    screw = torque - 2e-4 * found / s
    assert 1.2 * found == pytest.approx(0.535 * screw / s, rel=1e-12)
    assert reflected_mass(DRIVE, rotor) == pytest.approx(264, abs=1)


def test_water_does_not_pull() -> None:
    """Pulled with 1 N·m the drive falls to the vapour pressure and no further; a cavity opens."""
    times = np.linspace(0, 0.1, 21)
    free, real = run(model(), -1.0, times), run(model(Cavitation()), -1.0, times)
    assert free[2].min() < -3.8e5
    assert -101e3 < real[2].min() < -85e3
    assert real[2, -1] == pytest.approx(-99e3, abs=1.5e3)
    travel = np.trapezoid(real[0], times)
    assert real[-1, -1] == pytest.approx(travel, rel=2e-2), "what the piston left is the cavity"
    assert real[-1, -1] < -0.03
    pull = 0.0021 * real[2].min()
    assert pull > -213, "at most the atmosphere on the piston, N"


@pytest.mark.parametrize("torque, place", [(2.5, STROKE), (-0.05, 0.0)])
def test_end_stops_hold_the_piston(torque: float, place: float) -> None:
    """At rest beyond an end the stop carries what the pressure does not."""
    m = model(EndStops())
    z = m.drive_rest(np.full(6, torque))
    assert_allclose(numbers(m.drive_rate(z, torque, 0, 0)) / m.layout.z.scale, 0, atol=1e-5)
    x, pressure = numbers(m.piston_places(z, 0))[0], z[6]
    depth = abs(x - place)
    carried = abs(0.535 * torque * 2 * pi / 0.004 - 0.0021 * pressure)
    assert carried > 1 and depth < 3e-4
    assert carried == pytest.approx(1e7 * depth**3 / (depth**2 + 1e-8), rel=1e-6)
    assert abs(pressure) < abs(torque) * 0.4002e6


def test_end_stop_gives_back_what_it_takes() -> None:
    """Its force has an energy; none between the ends."""
    m = model(EndStops(start=0.005), stroke=0.02)
    free = model()
    for x, inside in ((0.0, True), (0.0149, True), (-0.0049, True), (0.0152, False)):
        p = x * 0.0021 / (Actuator().wall + 8.135e-4 / 2.18e9)
        with_, without = (rates(each, 0.0, p, p, 0.0, 1.0)[0] for each in (m, free))
        assert (with_ == pytest.approx(without, rel=1e-12)) == inside
        assert inside or with_ < without


def test_back_driving_only_when_driven_back() -> None:
    m, plain = model(BackDriving()), model()
    for v, torque in ((0.0, 1.0), (0.02, 1.0), (0.02, 0.0), (0.0, -1.0), (-0.02, -1.0)):
        assert rates(m, v, 1e5, 1e5, 0.0, torque)[0] == pytest.approx(
            rates(plain, v, 1e5, 1e5, 0.0, torque)[0], rel=1e-12
        )
    force = 1.2 * (
        rates(m, -0.01, 1e5, 1e5, 0.0, 1.0)[0] - rates(plain, -0.01, 1e5, 1e5, 0.0, 0)[0]
    )
    assert force == pytest.approx(2 * pi / 0.004 / 0.13), "the load does 1/0.13 of the motor's work"
    slope = [
        np.asarray(m.drive_jacobian(unit_states(m, (v, 0, 0)), 1.0, 0, 0)[0])[0, 0]
        for v in (0.0, -1e-9, -1e-3)
    ]
    assert slope[0] == pytest.approx(-200 / 1.2) and slope[1] == pytest.approx(slope[0], rel=1e-3)
    assert slope[2] == pytest.approx(slope[0], rel=1e-9), "smooth where it is complete"


def test_friction_holds_and_slows() -> None:
    """Below f nothing moves but creep; above it the piston goes as if pushed f less."""
    m = model(friction=100.0)
    z = m.drive_rest(np.full(6, 1.0))
    held = run(m, 1.0 + 80 / (0.535 * 2 * pi / 0.004), np.linspace(0, 0.05, 6), (0, z[6], z[12]))
    assert np.abs(held[0]).max() < 1.2e-3
    for v in (0.05, -0.05):
        lost = rates(m, v, 0, 0, 0, 0)[0] - rates(model(), v, 0, 0, 0, 0)[0]
        assert 1.2 * lost == pytest.approx(-100 * np.sign(v), rel=1e-12)


# ----------------------------------------------------------------------------- the arm acts back


def volumes(m: Model, q: Any) -> Any:
    """Volume of every unit from the arm's shape: bore times arc length at the unit's offset."""
    found, at = [], 0
    for section in m.scene.manipulator.sections:
        total = np.zeros(section.units)
        for _ in range(m.scene.segments):
            epsilon, kx, ky, _ = q[at : at + 4]
            at += 4
            for j, angle in enumerate(section.unit_angles):
                x, y = section.unit_offset * np.cos(angle), section.unit_offset * np.sin(angle)
                stretch = (1 + epsilon) * (1 + kx * y - ky * x)
                total[j] += section.unit_area * section.length / m.scene.segments * stretch
        found += total.tolist()
    return np.array(found)


@pytest.mark.parametrize("segments, arm", [(1, PAPER), (2, PAPER), (2, MIXED)])
@pytest.mark.parametrize("more", [(), (Cavitation(), TubeInertance(), TurbulentLoss())])
def test_no_water_is_lost_in_a_moving_arm(
    segments: int, arm: Manipulator, more: tuple[Effect, ...]
) -> None:
    """The piston's place moves with its speed, while arm, tube and water move as they like."""
    m = model(ChamberCoupling(), *more, segments=segments, arm=arm)
    z, u, q, dq = typical(m, 5)
    units = len(u)
    dz = numbers(m.drive_rate(z, u, q, dq))
    h = 1e-7
    later, sooner = (numbers(m.piston_places(z + s * h * dz, q + s * h * dq)) for s in (1, -1))
    assert_allclose((later - sooner) / (2 * h), z[:units], atol=1e-7)
    straight = volumes(m, np.zeros(m.strains))
    inside = volumes(m, q) - straight
    elastic = 7.85e-5 / 2.18e9 * z[units : 2 * units] + 7.35e-4 / 2.18e9 * z[2 * units : 3 * units]
    assert_allclose(numbers(m.piston_places(z, q)), (inside + elastic) / 0.0021, atol=1e-9)


@pytest.mark.parametrize("segments", [1, 3])
def test_pump_work_is_arm_work(segments: int) -> None:
    """What the screws put in is kinetic, elastic, weight's and the water's, or lost where named."""
    m = model(ChamberCoupling(), TubeInertance(), segments=segments)
    n, k = m.strains, 6
    z, u, q, dq = typical(m, 7)

    def energy(x: Any) -> float:
        q, dq, v, p_a, p_c, flow = np.split(x, [n, 2 * n, 2 * n + k, 2 * n + 2 * k, 2 * n + 3 * k])
        arm = sum(float(e) for e in m.energies(q=q, dq=dq).values())
        water = 7.85e-5 * p_a @ p_a / 2.18e9 + 7.35e-4 * p_c @ p_c / 2.18e9
        inert = 1000 * 1.61 / (pi * 0.002**2) * flow @ flow
        return arm + 0.5 * (water + inert + 1.2 * v @ v)

    x = np.concatenate([q, dq, z])
    dx = numbers(m.x_dot(x, u))
    h = 1e-9
    gained = (energy(x + h * dx) - energy(x - h * dx)) / (2 * h)
    v, p_a, _, flow = np.split(z, 4)
    lost = 200 * v @ v + 128 * 1.01e-3 * 1.61 / (pi * 0.004**4) * flow @ flow
    damped = m.powers(q=q, dq=dq, p=p_a)
    given = 0.535 * 2 * pi / 0.004 * u @ v
    damping = sum(float(damped[name]) for name in ("material_damping", "environment_damping"))
    size = max(abs(given), abs(lost), abs(damping), abs(float(damped["drive"])))
    assert abs(gained - (given - lost + damping)) < 1e-5 * size


def test_coupling_keeps_the_statics() -> None:
    """At rest nothing flows: the posture under held torques is the same."""
    m, plain = model(ChamberCoupling()), model()
    u = np.array([0.5, 0.2, 0.1, 0.3, 0.6, 0.2])
    assert_allclose(m.drive_rest(u), plain.drive_rest(u))
    assert m.balance.n_instructions() == plain.balance.n_instructions()


# --------------------------------------------------------------------------------------- scenes


@each
@pytest.mark.parametrize("drive", [StaticDrive(), PressureDrive()])
def test_drives_without_pistons_refuse(kind: type[DriveEffect], drive: Actuation) -> None:
    with pytest.raises(
        SceneError, match=f"'{kind.name}' needs the whole drive.*{drive.name}.*hydr"
    ):
        Scene(PAPER, effects=(*default_effects(), kind()), actuation=drive)


def test_slow_mode_takes_what_is_linear_and_does_not_swing() -> None:
    light = RotorInertia(inertia=1e-7)
    m = model(light, actuation=SlowDrive())
    exact = unit_matrices(PAPER.sections[0], DRIVE, (light,))
    assert m.drive.A[0, 0] == pytest.approx(np.linalg.eigvals(exact.A).real.max())
    with pytest.raises(SceneError, match="turbulent_loss"):
        model(TurbulentLoss(), actuation=SlowDrive())


def test_scene_files_know_them() -> None:
    effects = (TurbulentLoss(coefficient=0.4), EndStops(start=0.01), ChamberCoupling())
    scene = Scene(PAPER, effects=(*default_effects(), *effects), actuation=FrictionDrive())
    document = scene_to_dict(scene)
    assert document["effects"]["turbulent_loss"] == {"coefficient": 0.4}
    assert document["effects"]["chamber_coupling"] is True
    assert document["actuation"] == {"kind": "hydraulic-friction"}
    assert scene_from_dict(document) == scene
    with pytest.raises(SceneError, match=r"end_stops.*stiffness.*at least|between"):
        scene_from_dict({"effects": {"end_stops": {"stiffness": -1.0}}})


def test_frequency_response_keeps_the_gain() -> None:
    for effects in ((TubeInertance(),), (RotorInertia(),), (TubeInertance(), RotorInertia())):
        system = state_space(PAPER.sections[0], DRIVE, effects)
        plain = state_space(PAPER.sections[0], DRIVE)
        assert float(control.dcgain(system)) == pytest.approx(float(control.dcgain(plain)))
        assert len(system.poles()) == 3 + (TubeInertance() in effects)
