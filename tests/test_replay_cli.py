"""`softmpc replay`: what it prints and writes, its exit status, and which scene it takes."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import codegen_small as small
import numpy as np
import pytest
from click.testing import CliRunner

from softmpc.cli.main import main
from softmpc.codegen.flight_log import read_log
from softmpc.codegen.flight_recorder import record
from softmpc.codegen.flight_writer import FlightWriter
from softmpc.codegen.replay import Comparison
from softmpc.codegen.replay_setup import check_problem, players_of, scene_of
from softmpc.control.costs import StrainRate
from softmpc.control.mpc import Mpc
from softmpc.control.tracking import read_track_file, set_up
from softmpc.control.transcription import Transcription
from softmpc.errors import InputError
from softmpc.model.model import build
from softmpc.view.replay import replay_figure

SCENE = """
title = "Short line"
[track]
path = "line"
start = [0.0, 0.0, 0.5]
end = [0.01, 0.0, 0.51]
lap_time = 0.6
laps = 0.5
smooth_start = 0.1
settle = 0.05
[track.controller]
horizon = 4
[track.plant]
tolerance = 1e-5
"""


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A folder with a scene and a log of it; what the path clears does not matter here."""
    folder = tmp_path_factory.mktemp("command")
    (folder / "scene.toml").write_text(SCENE, encoding="utf-8")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("softmpc.control.tracking.find_clearance", lambda *given: given[2](6, 6))
        _, scene, task = read_track_file(folder / "scene.toml")
        setup = set_up(scene, task)
        with record(setup.controller, folder / "flight.log", "scene.toml") as recorded:
            setup.run(recorded)
        yield folder


def softmpc(*words: object) -> Any:
    return CliRunner().invoke(main, ["replay", *map(str, words)])


@pytest.mark.slow
def test_the_command(place: Path, tmp_path: Path) -> None:
    done = softmpc(place / "flight.log", "--json", "--out", tmp_path / "out")
    assert done.exit_code == 0, done.output
    data = json.loads(done.stdout)
    assert data["agrees"] and data["steps"] == 14 and data["title"] == "Short line"
    (replay,) = data["replays"]
    assert (replay["by"], replay["same_bits"], replay["largest_difference"]) == ("python", 14, 0.0)
    made = {path.name for path in (tmp_path / "out").iterdir()}
    assert made == {"replay.json", "replay.png", "replay.csv", "steps.bin"}
    lines = (tmp_path / "out" / "replay.csv").read_text(encoding="utf-8").splitlines()
    assert lines[0] == "step,status,python difference,python status"
    assert lines[1] == "0,solved,0.0,solved" and len(lines) == 15


@pytest.mark.slow
def test_the_command_finds_what_differs_and_what_is_damaged(place: Path) -> None:
    log = read_log(place / "flight.log")
    with FlightWriter(place / "other.log", log.header) as writer:
        writer.reset()
        for step in log.steps:
            odd = step.number == 7
            writer.step(replace(step, u=step.u + 1e-3 * odd, status=1 if odd else step.status))
    data = (place / "other.log").read_bytes()
    (place / "other.log").write_bytes(data[:-100])
    done = softmpc(place / "other.log")
    assert done.exit_code == 4
    lines = done.stdout.splitlines()
    assert lines[-1] == (
        "python, step 7: iteration cap, input from solution in the log, "
        "solved, input from solution now"
    )
    assert lines[-2].split() == ["python", "same", "13", "0", "12", "0.001", "0", "step", "7", "1"]
    assert any(line.startswith("damage      at byte ") for line in lines)
    assert "error: python: not what" in done.stderr and "13 steps before it are read" in done.stderr
    assert softmpc(place / "other.log", "--tolerance", "0.01").exit_code == 4  # the status


@pytest.mark.slow
def test_the_wrong_scene_is_refused(place: Path) -> None:
    log = read_log(place / "flight.log")
    assert scene_of(log) == place / "scene.toml"
    _, scene, task = read_track_file(place / "scene.toml")
    settings, model = task.controller, build(scene)
    for change, message in (
        ({}, ""),
        (
            {"horizon": 3},
            "its controller has 4 intervals; that of scene.toml has 3: give the scene",
        ),
        ({"costs": (*settings.costs[:-1], StrainRate(0.2))}, "is of another problem ("),
        ({"blocks": (1, 1, 2)}, "is of another problem ("),
        ({"torque_rate": 50.0}, "is of another problem ("),
    ):
        other = replace(settings, **change)
        t = Transcription(other.problem(model))
        mpc = Mpc(t, other.make_solver(t))
        if not message:
            check_problem(log, "scene.toml", mpc)
            continue
        with pytest.raises(InputError, match=re.escape(message)):
            check_problem(log, "scene.toml", mpc)


def test_a_log_without_its_scene_says_so(place: Path, tmp_path: Path) -> None:
    log = read_log(place / "flight.log")
    copied = tmp_path / "flight.log"
    copied.write_bytes((place / "flight.log").read_bytes())
    done = softmpc(copied)
    assert done.exit_code == 2 and "'scene.toml' is neither here nor beside the log" in done.stderr
    nameless = replace(log, header=replace(log.header, scene=""))
    with pytest.raises(InputError, match=r"names no scene file: give the one it was made with"):
        scene_of(nameless)


@pytest.mark.slow
def test_code_of_another_controller_is_refused(place: Path, tmp_path: Path) -> None:
    """Which would read references beyond their end."""
    words = place / "flight.log", "--with", "c", "--code"
    done = softmpc(*words, small.folder())
    assert done.exit_code == 2 and "is the controller of another problem (" in done.stderr
    done = softmpc(*words, tmp_path)
    assert done.exit_code == 2 and "has no problem.h" in done.stderr


def test_an_unknown_controller_is_refused(place: Path) -> None:
    done = softmpc(place / "flight.log", "--with", "python,pyton")
    assert done.exit_code == 2 and "unknown replay: 'pyton'; did you mean 'python'?" in done.stderr


def test_a_tolerance_that_nothing_is_beyond_is_refused(place: Path) -> None:
    done = softmpc(place / "flight.log", "--tolerance", "nan")
    assert done.exit_code == 2 and "nan is no finite number" in done.stderr


def test_one_replay_of_a_controller_named_twice(place: Path) -> None:
    assert players_of(read_log(place / "flight.log"), "c,python, c") == ("c", "python")


def test_a_folder_of_code_is_looked_at_first(place: Path, tmp_path: Path) -> None:
    """Before Python's replay, and also where Python wrote the log."""
    done = softmpc(place / "flight.log", "--code", tmp_path)
    assert done.exit_code == 2 and "has no problem.h" in done.stderr
    assert "replay by" not in done.stderr


def test_the_picture_of_what_differs() -> None:
    """Differences of all sizes, also infinite and missing ones, and other statuses; pressures."""
    difference = np.array([0, 1e-12, np.inf, np.nan, 1e-3])
    odd = compared("c", difference, 0.0, ((2, "failed", "solved"), (4, "failed", "solved")))
    same = compared("qemu", np.zeros(5), 1e-2, ())
    time, u = np.arange(5) * 0.1, np.full((5, 3), 2e5)
    made = replay_figure("Odd", time, u, {"c": u, "qemu": u}, (odd, same), torque=False)
    made.draw_without_rendering()
    above, below = made.axes
    assert above.get_ylabel() == "pressure (MPa)" and below.get_ylabel() == "difference (Pa)"
    assert np.max([line.get_ydata() for line in above.lines]) == pytest.approx(0.2)
    assert [text.get_text() for text in above.get_legend().get_texts()] == ["recorded", "c", "qemu"]
    assert [text.get_text() for text in below.get_legend().get_texts()] == [
        "c: 1 of 4 the same bits", "c: another status (2)", "qemu: 5 of 5 the same bits",
        "tolerance 0.01",
    ]  # fmt: skip
    low, high = below.get_ylim()
    shown = below.lines[0].get_ydata()
    assert shown[0] == low and 1e-3 < shown[2] <= high and np.isnan(shown[3])


def compared(name: str, difference: np.ndarray, tolerance: float, statuses: tuple) -> Comparison:
    there = np.isfinite(difference) | np.isinf(difference)
    over = tuple(np.flatnonzero(difference > tolerance))
    steps, bits = int(there.sum()), int((difference == 0).sum())
    return Comparison(name, steps, 0, False, tolerance, difference, over, statuses, bits)
