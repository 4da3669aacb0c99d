"""The oracle for least effort: its tangents, its optimality, its mesh, and a replay by CVODES."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import NamedTuple

import casadi as ca
import numpy as np
import pytest
from arms import SMALL, arm, differences, model_of, numbers
from numpy.testing import assert_allclose
from oracles.shooting import Effort, Rest, Shooter, graded, halved, least_effort
from scipy.optimize import minimize

from softmpc.model.effects import Payload
from softmpc.model.model import Model, build
from softmpc.model.scene import default_effects
from softmpc.model.scene_file import load_scene
from softmpc.statics.equilibrium import find_equilibrium, pressures_from_torques
from softmpc.statics.inverse import InverseStatics
from softmpc.statics.targets import Position

EXAMPLES = Path(__file__).parents[1] / "examples"


class Between(NamedTuple):
    """Two rests, and nodes of time fine enough: halving them changes the effort below 0.3 %."""

    model: Model
    start: Rest
    end: Rest
    times: np.ndarray


@cache
def paper_swing() -> Between:
    """The paper's arm with its full hydraulics, from one tip to another in 0.6 s."""
    model = build(load_scene(EXAMPLES / "figure_eight.toml"))
    inverse = InverseStatics(model)
    rests = [inverse.solve(Position(tip)) for tip in ((0.12, 0.0, 0.57), (-0.05, 0.10, 0.56))]
    assert all(rest.solved and rest.stable for rest in rests)
    ends = [Rest(rest.q, np.asarray(rest.torques)) for rest in rests]
    return Between(model, *ends, graded(0.6, 0.01, 2.5e-4))


@cache
def loaded_swing() -> Between:
    """One section of other sizes with four units and a load at the tip, in 0.2 s."""
    model = model_of(arm(SMALL), effects=(*default_effects(), Payload(mass=0.15)))
    ends = []
    for torques in ((1.2, 0.4, 0.3, 0.9), (0.3, 1.0, 1.3, 0.2)):
        rest = find_equilibrium(model, pressures_from_torques(model, torques))
        assert rest.stable
        ends.append(Rest(rest.q, np.array(torques)))
    return Between(model, *ends, graded(0.2, 0.004, 1e-4))


SWINGS = {"paper": paper_swing, "one section with a load": loaded_swing}


@cache
def least(name: str) -> Effort:
    return least_effort(*SWINGS[name]())


def missed(between: Between, found: Effort) -> float:
    """Largest scaled error of the end when CVODES replays it."""
    model = between.model
    x, u, piece = (
        ca.MX.sym("x", len(model.layout.x)),
        ca.MX.sym("u", len(model.layout.u)),
        ca.MX.sym("h"),
    )
    rates = {"x": x, "p": ca.vertcat(u, piece), "ode": piece * model.x_dot(x, u)}
    tight = {"abstol": 1e-11, "reltol": 1e-9, "max_num_steps": 100000}
    run = ca.integrator("run", "cvodes", rates, 0.0, 1.0, tight)
    state = found.states[0]
    for torques, length in zip(found.torques, np.diff(found.times), strict=True):
        state = numbers(run(x0=state, p=np.append(torques, length))["xf"])
    goal = Shooter(model).rest(between.end)
    return float(np.abs((state - goal) / model.layout.x.scale).max())


@pytest.mark.sampled
@pytest.mark.parametrize("name", SWINGS)
def test_it_ends_at_rest_in_another_integrator(name: str) -> None:
    between, found = SWINGS[name](), least(name)
    limits = between.model.scene.manipulator.limits
    assert found.miss < 1e-6
    assert missed(between, found) < 1e-4
    assert found.torques.min() >= limits.torque_min and found.torques.max() <= limits.torque_max
    assert np.any(found.torques == limits.torque_min)  # the limit takes part
    effort = np.sum(np.diff(found.times)[:, None] * found.torques**2)
    assert found.cost == pytest.approx(effort)


@pytest.mark.sampled
@pytest.mark.parametrize("name", SWINGS)
def test_half_as_long_pieces_cost_hardly_less(name: str) -> None:
    between, found = SWINGS[name](), least(name)
    finer = least_effort(*between[:3], halved(found.times), np.repeat(found.torques, 2, axis=0))
    assert 0.997 * found.cost < finer.cost < found.cost


def test_another_start_changes_nothing() -> None:
    found = least("one section with a load")
    guess = np.random.default_rng(3).uniform(0, 1.5, found.torques.shape)
    again = least_effort(*loaded_swing(), guess)
    assert_allclose(again.torques, found.torques, atol=1e-5)


def test_the_step_is_short_enough() -> None:
    """Half of it changes nothing but the error; of no full order, as pressures rise in 0.1 ms."""
    between, found = loaded_swing(), least("one section with a load")
    finer = least_effort(*between, found.torques, step=1.25e-3)
    assert finer.cost == pytest.approx(found.cost, rel=2e-5)
    assert missed(between, finer) < 0.6 * missed(between, found)


def test_tangents_are_those_of_differences() -> None:
    model, start, end, _ = loaded_swing()
    shooter, times = Shooter(model), np.array([0.0, 0.004, 0.009, 0.0095])
    begin, torques = shooter.rest(start), np.vstack([end.torques, start.torques, end.torques])
    _, by_torques = shooter.run(begin, torques, times)

    def ends(u: np.ndarray) -> np.ndarray:
        return shooter.run(begin, u.reshape(torques.shape), times)[0][-1] / shooter.scale

    wanted = differences(ends, torques.ravel(), np.full(torques.size, 1e-2))
    assert_allclose(by_torques, wanted, rtol=1e-7, atol=1e-9)


@pytest.mark.sampled
@pytest.mark.parametrize("band", [0.0, 0.005])
def test_another_optimiser_finds_the_same(band: float) -> None:
    """SLSQP of SciPy, on few pieces; with a band, all states may end beside their goals."""
    model, start, end, _ = loaded_swing()
    times, shooter = graded(0.15, 0.04, 5e-4, growth=2.0), Shooter(model)
    found = least_effort(model, start, end, times, band=band)
    begin, goal = shooter.rest(start), shooter.rest(end)
    lengths = np.repeat(np.diff(times), len(start.torques))

    @cache
    def run(u: bytes) -> tuple[np.ndarray, np.ndarray]:
        states, slope = shooter.run(begin, np.frombuffer(u).reshape(found.torques.shape), times)
        return (states[-1] - goal) / shooter.scale, slope

    def rows(u: np.ndarray) -> np.ndarray:
        off = run(u.tobytes())[0]
        return np.concatenate([band - off, band + off]) if band else off

    def slopes(u: np.ndarray) -> np.ndarray:
        by_u = run(u.tobytes())[1]
        return np.vstack([-by_u, by_u]) if band else by_u

    other = minimize(
        lambda u: lengths @ u**2 / found.cost,
        np.full(len(lengths), 0.7),
        jac=lambda u: 2 * lengths * u / found.cost,
        bounds=[(0.0, 2.5)] * len(lengths),
        constraints={"type": "ineq" if band else "eq", "fun": rows, "jac": slopes},
        method="SLSQP",
        options={"maxiter": 200, "ftol": 1e-9},
    )
    assert other.success and other.fun == pytest.approx(1.0, rel=1e-6)
    assert_allclose(other.x, found.torques.ravel(), atol=2e-3)
    assert found.miss == pytest.approx(band, abs=1e-6)
