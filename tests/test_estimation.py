"""The filter against textbook filters and least squares, and its bookkeeping of time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from softmpc import InputError, Scene, build, chen2022
from softmpc.control.closed_loop import Start, start_at
from softmpc.estimation.estimator import Estimate, Estimator
from softmpc.estimation.kalman import expected, gate, predicted, updated
from softmpc.estimation.process import Process, ProcessNoise, Spread
from softmpc.estimation.sensing import Sample, Sensing
from softmpc.estimation.sensors import (
    CylinderPressures,
    MotorTorque,
    PistonSpeed,
    SectionTips,
    Sensor,
    UnitPressures,
)
from softmpc.estimation.weighing import Look, weighed
from softmpc.model.actuation import PressureDrive
from softmpc.model.disturbance import Disturbance
from softmpc.model.model import Model
from softmpc.simulation.idas import Idas
from softmpc.statics.equilibrium import find_equilibrium

PRESSURES = [3e5, 1e5, 0, 2e5, 0, 4e5]
TINY = 1e-6


def start_of(model: Model) -> Start:
    return start_at(model, find_equilibrium(model, PRESSURES))


def estimator_of(model: Model, sensors: Sequence[Sensor]) -> Estimator:
    process = Process(model, Disturbance.of(model.scene), ProcessNoise(), "never")
    return Estimator(process, sensors)


@pytest.fixture(scope="module")
def model() -> Model:
    return build(Scene(chen2022()))


@pytest.fixture(scope="module")
def start(model: Model) -> Start:
    return start_of(model)


SENSORS = SectionTips(latency=0.01), UnitPressures(rate=50.0, latency=0.004)
STEPS = 16


def swing(start: Start, k: int) -> np.ndarray:
    return start.u * (1 + 0.2 * np.sin(0.6 * k + np.arange(len(start.u))))


@pytest.fixture(scope="module")
def readings(model: Model, start: Start) -> list[Sample]:
    """Of 0.4 s of motion, in the order of their times."""
    sensing, plant, x, found = Sensing(SENSORS, model, 3), Idas(model, 1e-7), start.x, []
    found += [sensing.sample(i, 0, x, start.u) for i in (0, 1)]
    for k in range(STEPS):
        u = swing(start, k)
        moved = plant.advance(x, u, 0.025, 25)
        for tick, x in enumerate(moved, 25 * k + 1):
            found += [sensing.sample(i, tick, x, u) for i in sensing.due(tick)]
    return [one for one in found if one is not None]


@pytest.fixture
def estimator(model: Model, start: Start) -> Estimator:
    found = estimator_of(model, SENSORS)
    found.reset(start.x, start.u)
    return found


def run(estimator: Estimator, start: Start, readings: Sequence[Sample]) -> list[Estimate]:
    """Estimates at each control step; readings count as they arrive."""
    found, waiting = [], list(readings)
    estimator.reset(start.x, start.u)
    for k in range(STEPS + 1):
        estimator.receive([one for one in waiting if one.arrival <= 25 * k])
        waiting = [one for one in waiting if one.arrival > 25 * k]
        found.append(estimator.estimate(25 * k))
        estimator.applied(swing(start, k), 25 * k)
    return found


def same(one: Estimate, other: Estimate) -> bool:
    return np.array_equal(one.x, other.x) and np.array_equal(one.P, other.P)


# ---------------------------------------------------------------- against other filters


class Linear:
    """A small motion of an arm without drive, discretised in closed form: Radau IIA with two
    stages is (I - 2/3 Z + Z²/6)⁻¹ (I + Z/3) of Z = h [A, B; 0, 0]."""

    def __init__(self, model: Model, process: Process, start: Start, step: float) -> None:
        n, nx = model.strains, process.nx
        x, u = ca.MX.sym("x", nx), ca.MX.sym("u", len(model.layout.u))
        rate = ca.Function("rate", [x, u], [ca.jacobian(model.x_dot(x, u), x)])
        Z = np.zeros((process.size, process.size))
        Z[:nx, :nx] = rate(start.x, start.u)
        Z[n:nx, nx:] = np.linalg.solve(np.asarray(model.M(start.x[:n])), process.disturbance.F)
        Z *= step * process.scale / process.scale[:, None]
        eye = np.eye(process.size)
        self.A = np.linalg.solve(eye - 2 / 3 * Z + Z @ Z / 6, eye + Z / 3)
        tips = ca.vec(model.frames(x[:n])[0])
        seen = ca.Function("seen", [x], [tips, ca.jacobian(tips, x)])
        y, slope = (np.asarray(one) for one in seen(start.x))
        self.H, self.y = np.zeros((6, process.size)), y.ravel()
        self.H[:, :nx] = slope * process.scale[:nx]


@pytest.fixture(scope="module")
def small() -> tuple[Model, Process, Start, Linear, list[np.ndarray]]:
    """An arm that hardly moves, and what its sensors read."""
    model = build(Scene(chen2022(), actuation=PressureDrive()))
    noise = ProcessNoise(*(5 * [TINY]))
    process = Process(model, Disturbance.of(model.scene), noise, "never")
    start = start_of(model)
    linear, random = Linear(model, process, start, 0.01), np.random.default_rng(2)
    s, read = TINY * random.standard_normal(process.size), []
    for _ in range(12):
        read.append(linear.y + linear.H @ s + TINY * random.standard_normal(6))
        s = linear.A @ s + np.sqrt(process.spread(0.01)) * random.standard_normal(process.size)
    return model, process, start, linear, read


def test_a_textbook_filter_and_least_squares(
    small: tuple[Model, Process, Start, Linear, list[np.ndarray]],
) -> None:
    """Two other ways to the same estimate: x = A x, P = A P Aᵀ + Q, K = P Hᵀ S⁻¹, P = (I - K H) P;
    and the most likely initial state and noise of all readings at once."""
    _, process, start, linear, read = small
    spread = Spread(*(5 * [TINY]))
    estimator = Estimator(process, [SectionTips(noise=TINY)], spread)
    estimator.reset(start.x, start.u)
    estimator.receive(Sample(0, 10 * k, 10 * k, y) for k, y in enumerate(read))
    found = estimator.estimate(10 * (len(read) - 1))
    A, H, Q, N = linear.A, linear.H, process.spread(0.01), process.size
    s, P = np.zeros(N), np.diag(process.variances(spread))
    for k, y in enumerate(read):
        if k:
            s, P = A @ s, A @ P @ A.T + np.diag(Q)
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + TINY**2 * np.eye(6))
        s, P = s + K @ (y - linear.y - H @ s), (np.eye(N) - K @ H) @ P
    # Unknowns: the state at first and the noise of each step, whitened.
    roots = [np.sqrt(process.variances(spread))] + [np.sqrt(Q)] * (len(read) - 1)
    T = np.zeros((N, N * len(read)))
    rows, right = [np.eye(N * len(read))], [np.zeros(N * len(read))]
    for k, y in enumerate(read):
        T = A @ T if k else T
        T[:, N * k : N * (k + 1)] += np.diag(roots[k])
        rows.append(H @ T / TINY)
        right.append((y - linear.y) / TINY)
    normal = np.linalg.inv(np.vstack(rows).T @ np.vstack(rows))
    batch = T @ normal @ np.vstack(rows).T @ np.concatenate(right)
    e = (np.concatenate([found.x, found.d]) - np.append(start.x, found.d * 0)) / process.scale
    spreads = np.sqrt(np.diag(P))
    assert np.abs(batch - s).max() < 1e-6 * TINY
    assert (np.abs(e - s) / spreads).max() < 1e-3  # the arm is not quite linear
    assert np.abs((found.P - P) / np.outer(spreads, spreads)).max() < 1e-4
    assert np.abs((T @ normal @ T.T - P) / np.outer(spreads, spreads)).max() < 1e-6


def test_covariance_stays_positive() -> None:
    """10,000 updates whose noise is 1e-8 of what was believed, and no noise of the process."""
    random, N = np.random.default_rng(0), 20
    A = np.linalg.qr(random.standard_normal((N, N)))[0]
    P, s = np.eye(N), np.zeros(N)
    for k in range(10_000):
        H = random.standard_normal((3, N))
        P = predicted(P, A, np.full(N, 1e-9 * (k % 2)))
        found = expected(P, np.zeros(3), H, np.full(3, 1e-8))
        s, P = updated(s, P, found)
        if k % 100 == 0:
            assert np.array_equal(P, P.T)
            assert np.linalg.eigvalsh(P).min() > 0
    assert np.all(np.isfinite(P)) and P.max() < 1e-3


def test_joseph_is_what_it_says() -> None:
    """Any gain: compared with the form as it is printed."""
    random = np.random.default_rng(1)
    P, H, R = np.diag(random.random(9)), random.standard_normal((2, 9)), np.array([0.3, 0.1])
    found = expected(P, random.standard_normal(2), H, R)
    found = replace(found, gain=found.gain * 0.7)
    rest = np.eye(9) - found.gain @ H
    printed = rest @ P @ rest.T + found.gain @ np.diag(R) @ found.gain.T
    assert np.allclose(updated(np.zeros(9), P, found)[1], printed, rtol=0, atol=1e-14)


# ---------------------------------------------------------------- time


def test_order_of_arrival_does_not_matter(
    estimator: Estimator, start: Start, readings: list[Sample]
) -> None:
    """Late, shuffled, all at once, or one by one with questions in between: bitwise the same."""
    end = _told_all(estimator, start, readings)
    random = np.random.default_rng(4)
    order = [readings[i] for i in random.permutation(len(readings))]
    assert same(_told_all(estimator, start, order), end)
    assert not same(run(estimator, start, readings)[-1], end)  # the last are still under way
    punctual = [replace(one, arrival=one.stamp) for one in readings]
    assert same(run(estimator, start, punctual)[-1], end)
    delays = random.integers(0, 60, len(readings))
    delayed = [
        replace(one, arrival=one.stamp + int(delay))
        for one, delay in zip(readings, delays, strict=True)
    ]
    run(estimator, start, delayed)
    estimator.receive([one for one in delayed if one.arrival > 25 * STEPS])
    assert same(estimator.estimate(25 * STEPS), end)


def _told_all(estimator: Estimator, start: Start, readings: Sequence[Sample]) -> Estimate:
    """The last estimate, all readings told before the first question."""
    estimator.reset(start.x, start.u)
    for k in range(STEPS + 1):
        estimator.applied(swing(start, k), 25 * k)
    estimator.receive(readings)
    return estimator.estimate(25 * STEPS)


def test_runs_repeat(estimator: Estimator, start: Start, readings: list[Sample]) -> None:
    first, second = (run(estimator, start, readings) for _ in range(2))
    assert all(same(a, b) for a, b in zip(first, second, strict=True))


def test_ahead_is_an_estimate_without_readings(
    estimator: Estimator, start: Start, readings: list[Sample]
) -> None:
    run(estimator, start, readings)
    later = [(25 * STEPS + 10, start.u), (25 * STEPS + 24, 0.9 * start.u)]
    ahead = estimator.ahead(25 * STEPS + 40, later)
    again = estimator.ahead(25 * STEPS + 40, later)
    for tick, u in later:
        estimator.applied(u, tick)
    # The last readings are late still: those the estimate did not have either.
    waited = estimator.estimate(25 * STEPS + 40)
    assert same(ahead, again) and same(ahead, waited)
    assert ahead.time == pytest.approx(0.44)


def test_the_first_reading_may_be_at_the_start(estimator: Estimator, start: Start) -> None:
    tips = estimator.readings[0](start.x, start.u)[0]
    estimator.receive([Sample(0, 0, 10, tips + 1e-3)])
    found = estimator.estimate(0)
    assert [one.stamp for one in estimator.innovations] == [0]
    assert estimator.innovations[0].value == pytest.approx(1e-3)  # nothing moved before it
    assert found.time == 0.0 and not np.array_equal(found.x, start.x)


def test_a_reading_when_the_input_changes_saw_the_one_before(model: Model, start: Start) -> None:
    estimator = estimator_of(model, (*SENSORS, MotorTorque()))
    estimator.reset(start.x, start.u)
    estimator.applied(2 * start.u, 20)
    for tick in (20, 21):
        estimator.receive([Sample(2, tick, tick, np.zeros(6))])
    estimator.estimate(21)
    before, after = (one.value for one in estimator.innovations)
    assert np.abs(before + start.u).max() < 1e-9
    assert np.abs(after + 2 * start.u).max() < 0.5 * np.abs(start.u).max()


def test_lost_readings_and_long_silence(
    estimator: Estimator, start: Start, readings: list[Sample]
) -> None:
    """Without readings the estimate is less sure; with some of them it lies between."""
    tips = slice(0, estimator.process.n)
    spread = []
    for kept in (readings, [one for k, one in enumerate(readings) if k % 3 == 0], []):
        P = run(estimator, start, kept)[-1].P
        spread.append(float(np.trace(P[tips, tips])))
    assert spread[0] < 0.7 * spread[1] and spread[1] < 0.5 * spread[2]
    found = estimator.estimate(120_000)  # two minutes later
    assert np.all(np.isfinite(found.P)) and np.abs(found.x[tips]).max() < 10.0
    tip = estimator.readings[0](start.x, start.u)[0]
    for tick in range(120_000, 120_200, 10):  # and it comes back
        estimator.receive([Sample(0, tick, tick, tip + 1e-9 * tick)])
        found = estimator.estimate(tick)
    assert np.abs(estimator.readings[0](found.x, start.u)[0] - tip).max() < 2e-3


def test_the_spread_at_the_start(estimator: Estimator, start: Start) -> None:
    """The tip is known to 30 mm until the first readings come, so that a loop may begin."""
    process, n = estimator.process, estimator.process.n
    for tick in (0, 25):
        found = estimator.estimate(tick)
        J = np.asarray(estimator.model.tip_jacobian(found.x[:n]))[-3:] * process.scale[:n]
        assert 0.01 < np.sqrt(np.trace(J @ found.P[:n, :n] @ J.T)) < 0.03


def test_what_is_forgotten(estimator: Estimator, start: Start, readings: list[Sample]) -> None:
    run(estimator, start, readings)
    n = len(estimator.innovations)
    estimator.receive([replace(readings[0], value=readings[0].value + 1.0)])
    assert estimator.health[0].reasons["too late"] == 1
    estimator.receive([readings[-3]] * 2)
    assert estimator.health[readings[-3].sensor].reasons["twice"] >= 1
    estimator.estimate(25 * STEPS)
    assert n <= len(estimator.innovations) <= n + 1
    with pytest.raises(InputError, match="forgotten"):
        estimator.estimate(0)


# ---------------------------------------------------------------- readings that are wrong


def test_each_reading_is_weighed_by_itself() -> None:
    """Good ones count together as they would one after the other; absurd ones not at all."""
    random = np.random.default_rng(6)
    P, R, edge = np.diag(random.random(7)), np.full(2, 0.1), gate(2, 1e-4)
    H = [random.standard_normal((2, 7)) for _ in range(2)]
    roots = [np.linalg.cholesky(h @ P @ h.T + np.diag(R)) for h in H]
    unit = [root @ np.array([np.sqrt(edge), 0.0]) for root in roots]  # at the edge

    def told(*sizes: float) -> tuple[np.ndarray, np.ndarray, list[float]]:
        looks = [Look(i, 0, size * unit[i], H[i], R, edge) for i, size in enumerate(sizes)]
        found, innovations, far = weighed(P, looks)
        assert [one.accepted for one in innovations] == [size <= 10 for size in sizes]
        return (*updated(np.zeros(7), P, found), far) if found else (np.zeros(7), P, far)

    s, after, far = told(0.5, 0.3)
    assert far == pytest.approx([0.5, 0.3])
    one, between = updated(np.zeros(7), P, expected(P, 0.5 * unit[0], H[0], R))
    e = 0.3 * unit[1] - H[1] @ one
    both, last = updated(one, between, expected(between, e, H[1], R))
    assert np.allclose(s, both) and np.allclose(after, last)
    for x, y in zip(told(0.5, 50.0)[:2], told(0.5)[:2], strict=True):
        assert np.array_equal(x, y)
    assert np.array_equal(told(11.0)[1], P)
    assert np.allclose(told(4.0)[0], told(1.0)[0])  # pulls no harder than at the edge
    assert np.trace(told(1.0)[1]) < np.trace(told(4.0)[1]) < np.trace(P)  # and tells less


@pytest.mark.parametrize(
    ("value", "reason"),
    [
        (np.full(6, np.nan), "not finite"),
        (np.zeros(5), "wrong size"),
        (np.full(6, 9.0), "after a jump"),
    ],
)
def test_bad_readings_change_nothing(
    estimator: Estimator, start: Start, readings: list[Sample], value: np.ndarray, reason: str
) -> None:
    without = [one for one in readings if (one.sensor, one.stamp) != (0, 200)]
    good = run(estimator, start, without)[-1]
    bad = [replace(one, value=value) if one not in without else one for one in readings]
    found = run(estimator, start, bad)[-1]
    assert sum(estimator.health[0].reasons.values()) == estimator.health[0].reasons[reason] == 1
    assert np.abs(found.x - good.x).max() / np.abs(good.x).max() < 1e-4  # one more stop on the way


def test_frozen_readings(estimator: Estimator, start: Start, readings: list[Sample]) -> None:
    value = next(one.value for one in readings if (one.sensor, one.stamp) == (0, 200))
    frozen = [
        replace(one, value=value) if one.sensor == 0 and one.stamp >= 200 else one
        for one in readings
    ]
    run(estimator, start, frozen)
    health = estimator.health[0]
    assert health.good <= 210 and health.reasons["frozen"] >= 15


@pytest.mark.parametrize(("share", "seconds"), [(0.05, 0.5), (0.3, 1.5)])
def test_a_jump_of_the_state_is_found_again(
    estimator: Estimator, start: Start, share: float, seconds: float
) -> None:
    """In 0.1 s tips are centimetres away, or across the room: doubted, then believed."""
    x, off, random = start.x.copy(), [], np.random.default_rng(5)
    x[[1, 5]] += share * estimator.model.layout.q.scale[[1, 5]]
    here, there = (estimator.readings[0](one, start.u)[0] for one in (start.x, x))
    for tick in range(0, 4000, 10):
        tips = here + min(max(tick - 500, 0), 100) / 100 * (there - here)
        read = tips + 5e-4 * random.standard_normal(6)
        estimator.receive([Sample(0, tick, tick, read)])
        found = estimator.estimate(tick)
        off.append(1e3 * np.abs(estimator.readings[0](found.x, start.u)[0] - tips).max())
    assert max(off[10:50]) < 1.5 and max(off[60 + round(100 * seconds) :]) < 2.0
    assert max(off[50:60]) > 300 * share and estimator.contradicted[0] in range(500, 600)


def test_sensors_of_the_drive(model: Model, start: Start) -> None:
    """What they read is what is in the state, and it counts."""
    sensors = (SectionTips(), CylinderPressures(), PistonSpeed(), MotorTorque())
    estimator = estimator_of(model, sensors)
    names = model.layout.x.names
    for reading, state in zip(estimator.readings[1:3], ("P_c", "piston_speed"), strict=True):
        y, slope = reading(start.x, start.u)
        rows = [names.index(f"{state}_{unit}") for unit in range(1, 7)]
        assert np.array_equal(y, start.x[rows]) and slope.sum() == 6
    assert np.array_equal(estimator.readings[3](start.x, start.u)[0], start.u)
    estimator.reset(start.x, start.u)
    before = np.diag(estimator.estimate(0).P)
    estimator.receive([Sample(1, 0, 0, estimator.readings[1](start.x, start.u)[0])])
    P_c = names.index("P_c_1")
    assert estimator.estimate(0).deviations(model.layout.x.scale)[P_c] < np.sqrt(before[P_c]) * 1e6
    with pytest.raises(InputError, match="has no P_c"):
        CylinderPressures().reading(build(Scene(chen2022(), actuation=PressureDrive())))


def test_wrong_input(model: Model, start: Start, estimator: Estimator) -> None:
    with pytest.raises(InputError, match="needs one sensor"):
        estimator_of(model, ())
    with pytest.raises(InputError, match="34 finite numbers"):
        estimator.reset(start.x[:-1], start.u)
    with pytest.raises(InputError, match="6 finite numbers"):
        estimator.applied(np.full(6, np.nan), 1)
