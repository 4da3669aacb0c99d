"""Baselines on one short line, and cheaper controllers on the same plant."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from softmpc.control.baselines import Regulated
from softmpc.control.compare import controllers_of, row_of
from softmpc.control.tracking import Setup, read_tracking, set_up
from softmpc.errors import SceneError
from softmpc.model.presets import chen2022
from softmpc.model.scene import Scene
from softmpc.model.scene_file import scene_from_dict

LINE = {
    "path": "line", "start": [0.1, 0.0, 0.57], "end": [0.13, 0.02, 0.57],
    "lap_time": 1.2, "laps": 0.5, "smooth_start": 0.3, "settle": 0.1,
}  # fmt: skip


@pytest.fixture(scope="module")
def setup() -> Setup:
    task = read_tracking({**LINE, "controller": {"horizon": 8}}, Path("."))
    return set_up(Scene(chen2022()), task)


@pytest.fixture(scope="module")
def rows(setup: Setup):
    return {name: row_of(setup.run(make())) for name, make in controllers_of(setup).items()}


def test_the_controller_is_the_best_and_converged(rows) -> None:
    cost = {name: row["cost"] for name, row in rows.items()}
    assert cost["real-time"] < cost["LQR"] < cost["feed-forward"]
    assert cost["real-time"] == pytest.approx(cost["IPOPT to convergence"], rel=0.02)
    assert all(row["failures"] == 0 and np.isfinite(row["variation"]) for row in rows.values())


def test_baselines_say_where_they_share_no_moves(setup: Setup) -> None:
    blocked = replace(setup.task.controller, blocks=(1, 1, 2, 4))
    named = controllers_of(replace(setup, task=replace(setup.task, controller=blocked)))
    assert list(named)[-1] == "IPOPT to convergence, a move each interval"


@pytest.mark.slow
def test_the_regulator_is_no_slower_than_its_reference(setup: Setup) -> None:
    """On a ramp of the rest path its linear loop ends less than 5 ms behind: no lead helps."""
    rest, ocp, node = setup.preflight.rest, setup.ocp, 0
    baseline = Regulated(ocp, setup.guide)
    loop, layout, n = baseline._terminals[0].regulator, ocp.model.layout, ocp.model.strains
    x = (rest.x[node + 1] - rest.x[node]) / layout.x.scale  # along the path, a unit of time
    u = (rest.u[node + 1] - rest.u[node]) / layout.u.scale
    moving = x.copy()
    moving[n : 2 * n] = x[:n] * layout.q.scale / layout.dq.scale
    offset, states = moving - x, len(x)
    A, B = loop.A[:states, :states], loop.B[:states]
    assert pytest.approx(A @ x + B @ u, abs=0.02 * np.abs(x).max()) == x  # rest stays rest
    state, before, h = np.zeros(states), -u * ocp.step / 2, ocp.step
    for k in range(400):
        held = u * (k + 0.5) * h  # at the middle of the step, as it is fed forward
        off = np.concatenate([state - x * k * h - offset, before - (held - u * h)])
        before = held - loop.K @ off
        state = A @ state + B @ before
    J = np.asarray(ocp.model.tip_jacobian(rest.q[node]))[-3:] * layout.q.scale
    speed, behind = J @ x[:n], J @ (x[:n] * 400 * h - state[:n])
    assert abs(behind @ speed) / (speed @ speed) < 5e-3  # s


WITHOUT = {"inertia": False, "environment_damping": False, "material_damping": False}
CHEAPER = {  # changes of the scene, states, and how many times the full controller's error at most
    "slow mode": ({"actuation": {"kind": "slow-mode"}}, 22, 1.05),
    "no inertia, static drive": (
        {"effects": {"inertia": False}, "actuation": {"kind": "static"}},
        16,
        600,
    ),
    "statics": ({"effects": WITHOUT, "actuation": {"kind": "static"}}, 16, None),
}


@pytest.mark.sampled
@pytest.mark.parametrize("name", CHEAPER)
def test_cheaper_controllers(rows, name: str) -> None:
    """What a model leaves out costs error, but no failure; only statics are as bad as none."""
    changes, states, times = CHEAPER[name]
    document = {"effects": {"gravity": [0.0, 0.0, 9.81]}}
    assert scene_from_dict(document) == Scene(chen2022())
    controller = {"horizon": 8, "scene": changes}
    task = read_tracking({**LINE, "controller": controller}, Path("."), document)
    setup = set_up(Scene(chen2022()), task)
    assert len(setup.ocp.model.layout.x) == states
    result = setup.run(setup.controller)
    assert result.failures == 0 and result.u.min() >= 0 and result.u.max() <= 2.5
    found, full = (row["rms_error_mm"] for row in (row_of(result), rows["real-time"]))
    if times is None:
        assert found < 1.05 * rows["feed-forward"]["rms_error_mm"]
    else:
        assert found <= times * full and found < 0.2 * rows["feed-forward"]["rms_error_mm"]


def test_changes_of_a_scene_need_the_scene() -> None:
    """Without it they would change a scene file's defaults, in which the arm weighs nothing."""
    controller = {"scene": {"actuation": {"kind": "slow-mode"}}}
    with pytest.raises(SceneError, match=r"\[track.controller\] scene changes .* scene_to_dict"):
        read_tracking({**LINE, "controller": controller}, Path("."))
