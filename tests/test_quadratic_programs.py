"""Dense programs against the conditions of an optimum, which need no other solver."""

from dataclasses import replace

import numpy as np
import pytest

import softmpc.control.daqp as module
from softmpc.control.condensing import Program
from softmpc.control.daqp import Daqp, QpSolution

COUNT, ROWS = 24, 30


def program(seed: int, room: float) -> Program:
    """Moves, some with slacks: rows of any sign, bounds on both sides, `room` from zero."""
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(COUNT, COUNT)) / np.sqrt(COUNT)
    H = root @ root.T + 0.01 * np.eye(COUNT)
    R = rng.normal(size=(ROWS, COUNT)) / np.sqrt(COUNT)
    slacks = np.arange(COUNT - 4, COUNT)  # nothing in the cost depends on them but their own
    H[slacks], H[:, slacks], R[:, slacks] = 0.0, 0.0, 0.0
    H[slacks, slacks] = 0.5
    R[:12, slacks] = -np.eye(4)[np.arange(12) % 4]
    low, high = np.full(COUNT, -0.5), np.full(COUNT, 0.5)
    low[slacks], high[slacks] = 0.0, np.inf
    f = rng.normal(size=COUNT)
    f[slacks] = 0.2
    high_rows = room * rng.uniform(0.2, 1.0, ROWS)
    low_rows = np.where(np.arange(ROWS) < 12, -np.inf, -room * rng.uniform(0.2, 1.0, ROWS))
    return Program(H, f, low, high, R, low_rows, high_rows)


def require_optimum(p: Program, found: QpSolution) -> None:
    """Slope zero, within all bounds, multipliers above zero at upper bounds and below at lower."""
    of_v, of_rows = found.multipliers[:COUNT], found.multipliers[COUNT:]
    assert p.H @ found.v + p.f + of_v + p.R.T @ of_rows == pytest.approx(0, abs=1e-9)
    pairs = (found.v, p.low, p.high, of_v), (p.R @ found.v, p.low_rows, p.high_rows, of_rows)
    for value, low, high, multiplier in pairs:
        assert np.all(value >= low - 1e-7) and np.all(value <= high + 1e-7)
        assert np.all(np.abs(high - value)[multiplier > 1e-9] < 1e-7)
        assert np.all(np.abs(value - low)[multiplier < -1e-9] < 1e-7)


@pytest.mark.parametrize("room", [0.05, 0.3, 10.0], ids=["tight", "some", "none active"])
@pytest.mark.parametrize("seed", range(8))
def test_answers_meet_the_conditions_of_an_optimum(seed: int, room: float) -> None:
    p, qp = program(seed, room), Daqp()
    found = qp.solve(p)
    assert found.solved
    require_optimum(p, found)
    active = np.abs(found.multipliers[COUNT:]) > 1e-9
    assert active.any() == (room < 1)
    again = qp.solve(p, multipliers=found.multipliers)
    assert again.iterations <= found.iterations
    assert again.v == pytest.approx(found.v, abs=1e-9)
    wrong = qp.solve(p, multipliers=np.random.default_rng(seed).normal(size=COUNT + ROWS))
    require_optimum(p, wrong)


@pytest.mark.parametrize("near", [-1e9, 0.01, np.inf], ids=["none", "as usual", "all"])
def test_rows_to_begin_with_do_not_change_the_answer(
    near: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    p = program(1, 0.2)
    monkeypatch.setattr(module, "NEAR", near)
    require_optimum(p, Daqp().solve(p))


def test_variables_that_stand_alone_need_no_solver() -> None:
    """Nothing couples them: at their bounds, or where the slope is zero."""
    p = replace(program(0, 10.0), H=np.diag(np.linspace(0.5, 2.0, COUNT)))
    found = Daqp().solve(
        replace(p, R=np.zeros((0, COUNT)), low_rows=np.zeros(0), high_rows=np.zeros(0))
    )
    assert found.iterations == 0
    expected = np.clip(-p.f / np.diag(p.H), p.low, p.high)
    assert np.array_equal(found.v, expected)


@pytest.mark.parametrize("part", ["H", "f", "R"])
def test_what_is_not_a_number_is_said(part: str) -> None:
    p = program(0, 0.3)
    spoilt = getattr(p, part).copy()
    spoilt.flat[3] = np.nan
    assert Daqp().solve(replace(p, **{part: spoilt})).status == "not finite"


def test_failures_have_names() -> None:
    p, qp = program(0, 0.3), Daqp()
    crossed = p.low.copy()
    crossed[2] = 1.0
    assert qp.solve(replace(p, low=crossed)).status == "infeasible"
    empty = replace(p, low_rows=np.full(ROWS, 50.0), high_rows=np.full(ROWS, 60.0))
    assert qp.solve(empty).status == "infeasible"
    nothing = replace(p, R=0 * p.R, low_rows=np.full(ROWS, 1.0), high_rows=np.full(ROWS, 2.0))
    assert qp.solve(nothing).status == "infeasible"
    indefinite = p.H.copy()
    indefinite[0, 1] = indefinite[1, 0] = 9.0
    assert qp.solve(replace(p, H=indefinite)).status == "not convex"
    indefinite[3, 3] = -1.0
    assert qp.solve(replace(p, H=indefinite)).status == "not convex"
    assert Daqp(max_iterations=1).solve(program(1, 0.05)).status == "iteration limit"
    require_optimum(p, qp.solve(p))  # none of them leaves anything behind


def test_the_cap_is_on_all_iterations_of_a_program() -> None:
    """Rows that the first answer breaks are taken up in further runs: these count too."""
    p = program(0, 0.3)
    whole = Daqp().solve(p)
    for most in range(1, whole.iterations + 1):
        found = Daqp(most).solve(p)
        assert found.status == "iteration limit" and found.iterations <= most
    enough = Daqp(whole.iterations + 1).solve(p)
    assert enough.solved and enough.iterations == whole.iterations
    # A wrong guess is not left for free either.
    wrong = np.sign(np.random.default_rng(0).normal(size=COUNT + ROWS))
    found = Daqp(3).solve(p, multipliers=wrong)
    assert found.status == "iteration limit" and found.iterations <= 3
