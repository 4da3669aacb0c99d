"""The filter is right about its errors: Monte Carlo, in small. `tests.benchmarks.estimation` in
large."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from consistency import Laboratory, Truth, line

from softmpc.simulation.idas import Idas


@pytest.fixture(scope="module")
def lab() -> Laboratory:
    return Laboratory()


def test_the_truth_is_another_integrator(lab: Laboratory) -> None:
    """Against IDAS from a state in motion; the filter's own step is a thousand times farther."""
    process, idas = lab.process, Idas(lab.model, 1e-10)
    u = lab.start.u + 0.3
    x = idas.advance(lab.start.x, u, 0.1)[-1]
    s = np.concatenate([x, np.zeros(process.size - process.nx)]) / process.scale
    there = idas.advance(x, u, 0.01)[-1] / process.scale[: process.nx]
    off = np.abs(Truth(process).advance(s, u, 0.01)[: process.nx] - there).max()
    own = np.abs(process.advance(s, u, 0.01)[0][: process.nx] - there).max()
    assert off < 1e-7 and 1e-5 < own < 1e-3


def test_a_few_runs_repeat(lab: Laboratory) -> None:
    first, second = (lab.matched(2, 8, seed=5) for _ in range(2))
    assert first.whole == second.whole and first.by_sensor == second.by_sensor
    assert first.whole[0] != first.whole[1]


@pytest.mark.slow
def test_errors_and_innovations_are_in_their_bands(lab: Laboratory) -> None:
    found, size = lab.matched(50, 80), lab.process.size
    whole = line("NEES", found.whole, size)
    assert 0.95 < whole.mean < 1.05 and whole.within > 0.8  # errors of one run last: few are apart
    for squares in found.by_sensor:
        nis = line("NIS", squares, 6)
        assert 0.95 < nis.mean < 1.05 and nis.within > 0.88
    assert found.refused == 0


@pytest.mark.slow
def test_a_wrong_noise_shows(lab: Laboratory) -> None:
    """Sensors 40 % worse than the filter believes: out of all bands."""
    worse = Laboratory()
    worse.sensors = tuple(replace(one, noise=1.4 * one.noise) for one in lab.sensors)
    found = worse.matched(20, 40)
    assert line("NEES", found.whole, lab.process.size).mean > 1.15
    assert all(line("NIS", squares, 6).within < 0.3 for squares in found.by_sensor)


@pytest.mark.slow
def test_with_mismatch_the_tip_is_known_still(lab: Laboratory) -> None:
    """Strains of segments that the plant does not have are not; what is measured is."""
    found = lab.mismatched(3, 60)
    assert max(found.tips) < 1.5 and found.refused == 0  # mm
    assert line("NEES", found.state, lab.process.nx).mean > 5
    for squares in found.by_sensor:
        assert 0.8 < line("NIS", squares, 6).mean < 1.6
