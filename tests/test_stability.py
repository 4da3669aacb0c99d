"""Short horizons come to rest from anywhere: a sample here, 200 starts as a slow test."""

import numpy as np
import pytest

from tests.benchmarks.stability import NEAR, NEVER, Bench, Case


@pytest.fixture(scope="module")
def bench() -> Bench:
    return Bench(mode="never")


@pytest.mark.sampled
@pytest.mark.parametrize("horizon, terminal, starts", [(5, False, 4), (5, True, 4), (10, True, 4)])
def test_sample_comes_to_rest(bench: Bench, horizon: int, terminal: bool, starts: int) -> None:
    for number in range(starts):
        found = bench(Case(number, horizon, terminal))
        assert found["rested"] != NEVER and found["rested"] < 1.5
        assert found["error"] < NEAR and found["failed"] == 0


def test_starts_are_spread_and_repeat(bench: Bench) -> None:
    """Half of them move; all are far from the target and from each other."""
    n, scale = bench.model.strains, bench.model.layout.dq.scale
    starts = [bench.start(number)[0] for number in range(8)]
    moving = [bool(np.abs(x[n : 2 * n] / scale).max() > 0.01) for x in starts]
    assert moving == [False, True] * 4
    tips = np.array([bench.tip(x) for x in starts])
    assert np.linalg.norm(tips - bench.tip(bench.target.x), axis=1).max() > 0.2
    assert np.linalg.norm(np.diff(tips, axis=0), axis=1).min() > 0.05
    assert np.array_equal(bench.start(3)[0], Bench(mode="never").start(3)[0])


def test_same_start_same_run_bit_for_bit(bench: Bench) -> None:
    case = Case(1, 5, True)
    first = bench(case)
    assert bench(case) == first


@pytest.mark.slow
@pytest.mark.parametrize("terminal", [False, True])
def test_two_hundred_starts_come_to_rest(terminal: bool) -> None:
    bench = Bench()
    lost = [i for i in range(200) if bench(Case(i, 5, terminal))["rested"] == NEVER]
    assert lost == []
