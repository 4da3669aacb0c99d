"""Baselines on one short line, and a cheaper controller on the same plant."""

from pathlib import Path

import numpy as np
import pytest

from softmpc.control.compare import controllers_of, row_of
from softmpc.control.tracking import read_tracking, set_up
from softmpc.model.presets import chen2022
from softmpc.model.scene import Scene

LINE = {
    "path": "line", "start": [0.1, 0.0, 0.57], "end": [0.13, 0.02, 0.57],
    "lap_time": 1.2, "laps": 0.5, "smooth_start": 0.3, "settle": 0.1,
}  # fmt: skip


@pytest.fixture(scope="module")
def rows():
    task = read_tracking({**LINE, "controller": {"horizon": 8}}, Path("."))
    setup = set_up(Scene(chen2022()), task)
    return {name: row_of(setup.run(make())) for name, make in controllers_of(setup).items()}


def test_the_controller_is_the_best_and_converged(rows) -> None:
    cost = {name: row["cost"] for name, row in rows.items()}
    assert cost["real-time"] < cost["LQR"] < cost["feed-forward"]
    assert cost["real-time"] == pytest.approx(cost["IPOPT to convergence"], rel=0.02)
    assert all(row["failures"] == 0 and np.isfinite(row["variation"]) for row in rows.values())


def test_cheaper_controller_is_better_than_feed_forward(rows) -> None:
    cheap = {"horizon": 8, "scene": {"actuation": {"kind": "slow-mode"}}}
    task = read_tracking({**LINE, "controller": cheap}, Path("."), {})
    setup = set_up(Scene(chen2022()), task)
    assert len(setup.ocp.model.layout.x) < len(setup.plant.model.layout.x)
    result = setup.run(setup.controller)
    assert result.failures == 0
    found = row_of(result)["rms_error_mm"]
    assert found < 0.5 * rows["feed-forward"]["rms_error_mm"]
