"""Closed loops end to end: small ones here, the README's figure eight as a slow test."""

import json
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from softmpc.control.closed_loop import close_loop, start_at
from softmpc.control.mpc import Mpc
from softmpc.control.ocp import tracking_problem
from softmpc.control.paths import Line, Reference, TimeLaw
from softmpc.control.track_result import TrackResult
from softmpc.control.tracking import read_tracking, track_file
from softmpc.control.transcription import Transcription
from softmpc.errors import InputError, SceneError
from softmpc.model.model import build
from softmpc.model.presets import chen2022
from softmpc.model.scene import Scene
from softmpc.simulation.columns import read_columns
from softmpc.simulation.idas import Idas
from softmpc.simulation.integrator import IntegrationError
from softmpc.statics.inverse import InverseStatics
from softmpc.statics.targets import Position

EXAMPLES = Path(__file__).parents[1] / "examples"

SHORT = """
title = "Short line"
[effects]
gravity = [0, 0, 9.81]
[track]
path = "line"
start = [0.0, 0.0, 0.6]
end = [0.01, 0.005, 0.6]
lap_time = 0.6
laps = 0.5
smooth_start = 0.2
settle = 0.1
[track.controller]
horizon = 8
[track.plant]
tolerance = 1e-8
"""


@pytest.fixture(scope="module")
def short(tmp_path_factory) -> TrackResult:
    file = tmp_path_factory.mktemp("short") / "line.toml"
    file.write_text(SHORT)
    return track_file(file)


def test_short_line_is_tracked(short: TrackResult) -> None:
    summary = short.summary()
    assert summary["status"] == "finished"
    assert summary["failures"] == 0
    assert summary["steps"] == 16
    assert summary["rms_error_mm"] < 0.1
    assert summary["clearance_mm"] > 50
    assert summary["step_ms_median"] <= summary["step_ms_p95"]
    assert short.title == "Short line"


def test_errors_are_sampled_every_millisecond_without_alignment(short: TrackResult) -> None:
    assert np.diff(short.time) == pytest.approx(1e-3)
    reference = Reference(Line((0, 0, 0.6), (0.01, 0.005, 0.6)), TimeLaw(0.6, 0.5, 0.2))
    assert short.reference == pytest.approx(reference.position(short.time))
    assert short.error == pytest.approx(np.linalg.norm(short.tips[:, -1] - short.reference, axis=1))


def test_deviations_are_those_of_the_run(short: TrackResult) -> None:
    """Against the samples and inputs of the record, with the table's own deviations."""
    ends = slice(25, None, 25)  # of the steps
    torque = 2.5  # N·m, the scale
    moves = np.diff(np.vstack([short.u_start, short.u]), axis=0)
    model = build(Scene(chen2022()))
    rows = {
        "tip": (short.tip - short.reference)[ends] / 1e-3,
        "torque": short.u / torque / 3,
        "torque rate": moves / torque / 0.1,
        "strain rate": short.dq[ends] / model.layout.dq.scale / 0.3,
    }
    squares = {name: (row**2).sum(axis=1) for name, row in rows.items()}
    rms = {name: np.sqrt(each.mean()) for name, each in squares.items()}
    assert short.deviations == pytest.approx(rms, rel=1e-9)
    assert short.cost == pytest.approx(sum(each.sum() for each in squares.values()) / 2)
    assert short.summary()["deviations"] == short.deviations


def test_files_hold_the_run(short: TrackResult, tmp_path) -> None:
    short.save(tmp_path)
    again = TrackResult.load(tmp_path / "track.npz")
    assert again.summary() == short.summary()
    assert np.array_equal(again.q, short.q)
    columns = read_columns(tmp_path / "track.csv")
    assert columns["z_2"] == pytest.approx(short.tips[:, 1, 2])
    assert read_columns(tmp_path / "steps.csv")["T_1"] == pytest.approx(short.u[:, 0])
    assert sorted(p.name for p in tmp_path.iterdir()) == ["steps.csv", "track.csv", "track.npz"]
    with pytest.raises(InputError, match="not a saved"):
        TrackResult.load(tmp_path / "track.csv")


@pytest.fixture(scope="module")
def loop():
    model = build(Scene(chen2022()))
    posture = InverseStatics(model).solve(Position((0, 0, 0.6))).posture
    mpc = Mpc(Transcription(tracking_problem(model, 5, 0.025)))
    return mpc, Idas(model, 1e-7), start_at(model, posture)


REFERENCE = Reference(Line((0, 0, 0.6), (0.01, 0, 0.6)), TimeLaw(1.0, 1.0))


def test_interrupted_run_keeps_what_was_done(loop) -> None:
    def stop(done: int, total: int) -> None:
        if done == 3:
            raise KeyboardInterrupt

    result = close_loop(*loop[:2], REFERENCE, loop[2], progress=stop)
    assert result.status == "interrupted"
    assert len(result.u) == 3
    assert result.time[-1] == pytest.approx(0.075)


def test_plant_that_stops_ends_the_run_with_its_reason(loop) -> None:
    class Breaking(Idas):
        count = 0

        def advance(self, *args, **kwargs):
            self.count += 1
            if self.count == 3:
                raise IntegrationError("squeezed")
            return super().advance(*args, **kwargs)

    result = close_loop(loop[0], Breaking(loop[1].model, 1e-7), REFERENCE, loop[2])
    assert result.status == "plant stopped: squeezed"
    assert len(result.u) == 2
    assert np.all(np.isfinite(result.tips))


def test_rest_is_kept(loop) -> None:
    still = Reference(Line((0, 0, 0.6), (0, 0, 0.6 + 1e-12)), TimeLaw(1.0, 1.0))
    result = close_loop(*loop[:2], still, loop[2], duration=0.2)
    assert result.error.max() < 2e-5  # the effort's small pull


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("horizon = 8", "horizn = 8"), "horizn.*horizon"),
        (("horizon = 8", 'solver = "rti"'), "rti.*real-time"),
        (("horizon = 8", "grid = [2, 1]"), "grid.*begins with 1"),
        (("horizon = 8", "horizon = 8\ngrid = [1, 2]"), "grid has 2 lengths"),
        (("horizon = 8", "horizon = 8\nblocks = [1, 2]"), "blocks.*add up to the 8"),
        (("horizon = 8", 'solver = "ipopt"\nblocks = [8]'), "blocks.*'ipopt'.*real-time or sqp"),
        (("horizon = 8", "horizon = 8\ntip_box = {z = [0.6, 0.5]}"), "lower one first"),
        (("horizon = 8", "horizon = 8\nbudget = 0"), "budget"),
        (("horizon = 8", "horizon = 8\nscene = 3"), "scene"),
        (("horizon = 8", "horizon = 8\nscene = {model = {segmets = 1}}"), "segmets.*segments"),
        (("tolerance = 1e-8", 'method = "radua"'), "radua.*radau"),
        (("tolerance = 1e-8", 'method = "radau"\ntolerance = 1e-8'), "tip_tolerance"),
        (('path = "line"', 'path = "lime"'), "lime.*line"),
        (("[0.01, 0.005, 0.6]", "[0.01, 0.005]"), "end"),
        (("[0.01, 0.005, 0.6]", "[0.01, nan, 0.6]"), "end"),
        (("[0.01, 0.005, 0.6]", "[0.9, 0.005, 0.6]"), "out of reach"),
        (("lap_time = 0.6", "lap_time = -1"), "lap_time"),
        (("horizon = 8", "horizon = 0"), "horizon"),
        (("settle = 0.1", "settle = 0.5"), "settle = 0.5 s: must be below"),
        (("tolerance = 1e-8", "tolerance = 5"), "tolerance"),
        (("[track]", "[trak]"), "trak.*track"),
    ],
)
def test_bad_track_tables_say_what_is_wrong(tmp_path, change, message: str) -> None:
    file = tmp_path / "scene.toml"
    text = SHORT.replace(*change)
    if change[0] == "[track]":
        text = text.replace("[track.controller]", "[trak.controller]")
        text = text.replace("[track.plant]", "[trak.plant]")
    file.write_text(text)
    with pytest.raises(InputError, match=message):
        track_file(file)


def test_missing_track_table_is_named(tmp_path) -> None:
    file = tmp_path / "scene.toml"
    file.write_text('title = "nothing to track"\n')
    with pytest.raises(SceneError, match=r"\[track\] is missing"):
        track_file(file)


@pytest.mark.parametrize(
    "path",
    [
        {"path": "circle", "center": [0, 0, 0.6], "diameter": 0.05},
        {"path": "helix", "center": [0, 0, 0.6], "diameter": 0.05, "pitch": 0.01},
        {"path": "figure-eight", "center": [0, 0, 0.6], "width": 0.05, "height": 0.02},
    ],
)
def test_every_path_is_read(path: dict) -> None:
    task = read_tracking(path, Path("."))
    assert task.reference.path.name == path["path"]
    assert task.controller.horizon == 20


@pytest.mark.slow
def test_figure_eight_meets_its_targets(tmp_path) -> None:
    """From cold in under 120 s, RMS ≤ 0.5 mm after the first second, no failed step."""
    began = time.perf_counter()
    command = [sys.executable, "-m", "softmpc.cli", "track", str(EXAMPLES / "figure_eight.toml")]
    command += ["--json", "--out", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    wall = time.perf_counter() - began
    summary = json.loads(done.stdout)
    assert summary["rms_error_mm"] <= 0.5
    assert summary["failures"] == 0
    assert summary["clearance_mm"] > 0
    assert wall < 120
