"""What `tests.benchmarks.peer_mpc` gives to do-mpc is our problem."""

from __future__ import annotations

import importlib.util

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

from softmpc.simulation.idas import Idas
from tests.benchmarks.same_problem import STEP, Ours, Problem, Theirs, one_interval

installed = importlib.util.find_spec("do_mpc") is not None


@pytest.fixture(scope="module")
def problem() -> Problem:
    return Problem(intervals=3)


def test_costs_written_anew_are_ours(problem):
    t, rng = problem.t, np.random.default_rng(0)
    x = problem.start.x + 0.05 * rng.normal(size=t.nx) * t.x_scale
    u, before, tip = rng.uniform(0, 2, t.inputs), rng.uniform(0, 2, t.inputs), rng.normal(size=3)
    change = (u - before) / t.u_scale / 0.1
    state, effort = problem.costs(ca.DM(x), ca.DM(u), ca.DM(tip))
    ours = t.objective.cost(before / t.u_scale, u / t.u_scale, x / t.x_scale, tip, 1.0)[0]
    assert_allclose(float(state + effort) + 0.5 * change @ change, float(ours), rtol=1e-12)


@pytest.mark.slow
def test_the_step_for_do_mpc_follows_the_arm():
    """Its equations, solved by Newton iterations, give what a fine integrator gives."""
    problem = Problem(intervals=1, stages=5)
    t, x = problem.t, problem.start.x
    u = problem.start.u + 0.05
    a = ca.MX.sym("a", t.na)
    step = one_interval(t)
    solve = ca.rootfinder("solve", "newton", {"x": a, "g": step(x, u, a)[0]})
    after = np.asarray(step(x, u, solve(np.zeros(t.na), []))[1]).ravel()
    exact = Idas(problem.model, 1e-10).advance(x, u, STEP, 1)[-1]
    moved, off = (exact - x) / t.x_scale, (after - exact) / t.x_scale
    assert np.abs(off).max() < 0.01 * np.abs(moved).max()


@pytest.mark.sampled
@pytest.mark.skipif(not installed, reason="do-mpc is not installed")
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("kind", ["our step", "tuned"])
def test_do_mpc_finds_the_same_cost(problem, kind):
    x = problem.start.x.copy()
    x[: problem.model.strains] += 0.01 * problem.t.x_scale[: problem.model.strains]
    state = x, problem.start.u, 0.5
    ours, theirs = Ours(problem, "sqp").cost(*state), Theirs(problem, kind).cost(*state)
    assert_allclose(theirs, ours, rtol=1e-5)
