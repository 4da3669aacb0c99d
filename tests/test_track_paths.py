"""Closed loops along whole paths: errors, torques and what happens where the path is out of reach.

A lap or less here; two laps, and real-time iteration beside the converged problem, as slow tests.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from softmpc.control.controller_table import ControllerSettings
from softmpc.control.paths import Line, Reference, TimeLaw
from softmpc.control.rest_path import RestPath, find_rest_path
from softmpc.control.track_result import WINDOW, TrackResult
from softmpc.control.tracking import set_up
from softmpc.control.transit import TRANSIT
from softmpc.model.model import Model, build
from softmpc.model.presets import chen2022
from softmpc.model.scene import Scene
from softmpc.statics.equilibrium import find_equilibrium
from softmpc.statics.inverse import InverseStatics
from softmpc.statics.targets import Position
from tests.benchmarks.tracking import PATHS, run, task_of

FULL = 2.5  # N·m


@pytest.fixture(scope="module", autouse=True)
def _no_clearance() -> Iterator[None]:
    """It takes as long as a run, and is not what these tests are about."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("softmpc.control.tracking.find_clearance", lambda *_: None)
        yield


def loop(name: str, laps: float = 1.0, **settings: object) -> TrackResult:
    """The closed loop along a path of the benchmark, less of its laps."""
    path, law = PATHS[name]
    task = replace(
        task_of(name),
        reference=Reference(path, TimeLaw(law.lap_time, laps)),
        controller=ControllerSettings(**settings),  # type: ignore[arg-type]
    )
    setup = set_up(Scene(chen2022()), task)
    return setup.run(setup.controller)


def rms(error: np.ndarray) -> float:
    return float(np.sqrt(np.mean(error**2)))


def stays_within_its_limits(result: TrackResult) -> None:
    assert result.status == "finished" and result.failures == 0
    assert np.all(np.isfinite(result.u)) and result.u.min() >= 0 and result.u.max() <= FULL
    assert result.rest_variation is not None
    assert result.variation <= 2 * result.rest_variation


@pytest.mark.slow
def test_circle_inside_is_tracked() -> None:
    result = loop("circle", 0.5)
    assert result.failures == 0 and result.jumps is not None and len(result.jumps) == 0
    assert rms(result.error[result.time >= 1.0]) <= 5e-5
    stays_within_its_limits(result)


@pytest.fixture(scope="module")
def edge() -> TrackResult:
    return loop("edge")


def test_edge_is_followed_without_chattering(edge: TrackResult) -> None:
    stays_within_its_limits(edge)
    assert edge.out_of_reach is not None and edge.out_of_reach.max() > 0.015
    saturated = (edge.u > FULL - 0.01).any(axis=1)
    assert 0.025 * saturated.sum() > 1.0  # s
    assert edge.reachable_error[edge.counted].max() <= 2e-3


def test_what_is_followed_is_the_nearest_place(edge: TrackResult) -> None:
    """As inverse statics finds it without the path, from its own starts."""
    inverse = InverseStatics(build(Scene(chen2022())))
    for moment in (2200, 3950, 4400):
        place = edge.reference[moment]
        alone = inverse.solve(Position(tuple(place)))
        assert np.linalg.norm(edge.target[moment] - place) <= alone.distance + 1e-4
        assert np.linalg.norm(edge.tip[moment] - alone.tips[-1]) <= 2e-3


@pytest.fixture(scope="module")
def across() -> TrackResult:
    """Through the void around the axis: the nearest place jumps."""
    return loop("across", 0.5)


@pytest.mark.slow
def test_jumps_are_crossed(across: TrackResult) -> None:
    stays_within_its_limits(across)
    assert across.jumps is not None and len(across.jumps) == 1
    assert across.reachable_error[across.counted].max() <= 2e-3


@pytest.mark.slow
def test_windows_after_jumps_do_not_count(across: TrackResult) -> None:
    """From a jump on for half a second, and nothing else; errors are larger there."""
    assert across.jumps is not None
    time = across.time
    windows = np.zeros(len(time), bool)
    for jump in across.jumps:
        windows |= (time - jump >= 0) & (time - jump <= WINDOW)
    assert np.array_equal(across.counted, (time >= across.settle) & ~windows)
    assert windows.sum() == pytest.approx(WINDOW / 1e-3, abs=2)
    from_path = np.linalg.norm(across.tip - across.reference, axis=1)
    assert from_path[windows].max() > 2 * from_path[~windows].max()  # it goes round


@pytest.fixture(scope="module")
def model() -> Model:
    return build(Scene(chen2022()))


@pytest.fixture(scope="module")
def line(model: Model) -> RestPath:
    """Deeper in the void, out and back."""
    reference = Reference(Line((-0.12, 0.0, 0.42), (0.12, 0.0, 0.42)), TimeLaw(6.0, 1.0))
    return find_rest_path(InverseStatics(model, starts=6), reference, nodes=16)


def test_same_place_same_distance(line: RestPath) -> None:
    """The way back meets every place again, from the other side: the nearest is the nearest."""
    phases = np.linspace(0.0, 0.5, 9)  # the nodes
    off = [np.interp(p, line.lap.phase, line.distance) for p in (phases, 1 - phases)]
    far = np.abs(off[0] - off[1])
    assert np.median(line.distance) > 0.02 and line.jumps.sum() >= 2
    assert far.max() < 1e-4


def test_there_are_more_nodes_at_jumps(line: RestPath) -> None:
    width = np.diff(line.lap.phase)
    assert np.median(width[line.jumps]) < 0.1 * width.max()


def test_transits_are_at_rest_within_limits(line: RestPath, model: Model) -> None:
    """Forward statics of their inputs, continuous, and where the path goes on in the end."""
    transit = line.transits[0]
    assert transit.time[-1] - transit.time[0] == pytest.approx(TRANSIT)
    for t in (*transit.time[[0, 5]], line.transits[-1].time[-1]):  # no other one there
        u, x = line.inputs(np.array([t]))[0], line.rest(np.array([t]))[0]
        posture = find_equilibrium(model, model.drive.static_gain @ u)
        assert x[: model.strains] == pytest.approx(posture.q, abs=1e-5)
        assert line.position(np.array([t]))[0] == pytest.approx(posture.tips[-1], abs=2e-5)
        assert np.all(u >= -1e-9) and np.all(u <= FULL + 1e-9)
    t = np.arange(transit.time[0] - 0.1, transit.time[-1] + 0.05, 1e-3)
    assert np.abs(np.diff(line.inputs(t), axis=0)).max() < 0.02  # N·m; it jumps by 2.5 without
    assert np.abs(np.diff(line.held(t), axis=0)).max() > 1.0
    assert np.linalg.norm(np.diff(line.position(t), axis=0), axis=1).max() < 3e-3


@pytest.mark.slow
@pytest.mark.parametrize("name", ["eight", "circle", "fast", "edge", "void", "jump", "across"])
def test_whole_runs(name: str) -> None:
    result = run(name)
    stays_within_its_limits(result)
    assert result.reachable_error[result.counted].max() <= 2e-3
    if name in ("eight", "circle", "fast"):
        assert rms(result.error[result.time >= 1.0]) <= 5e-5


@pytest.mark.slow
@pytest.mark.parametrize("name", ["eight", "circle"])
def test_real_time_iteration_costs_as_the_converged_problem(name: str) -> None:
    """160 steps; at most 2 % more than SQP to convergence in every step."""
    quick, converged = (loop(name, 0.875, solver=solver) for solver in ("real-time", "sqp"))
    assert len(quick.u) == 160 and quick.failures == converged.failures == 0
    assert quick.cost is not None and converged.cost is not None
    assert quick.cost <= 1.02 * converged.cost
