"""`softmpc choose` end to end: answers, the file it writes, refusals, errors."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from choosing_work import measured_here
from click.testing import CliRunner, Result

from softmpc import compiled
from softmpc.accuracy import choose as choosing
from softmpc.accuracy import choose_families, choose_rate, motion_cost, study
from softmpc.accuracy.bound import CALIBRATED
from softmpc.accuracy.choose_families import GOALS
from softmpc.accuracy.choose_file import clear_place
from softmpc.accuracy.motion_reference import COARSER, FINE
from softmpc.accuracy.store import Store
from softmpc.accuracy.study import read_task
from softmpc.accuracy.work import REFERENCE, Case
from softmpc.cli.main import main
from softmpc.simulation.run import simulate_file

SWING = """
title = "Swing"
[manipulator]
sections = 1
[model]
strains = ["epsilon", "kappa_y"]
[effects]
gravity = [0.0, 0.0, 9.81]
[actuation]
kind = "static"
[simulate]
duration = 0.1
table = "torques.csv"
"""
TRACK = """
title = "Line"
[model]
strains = ["epsilon", "kappa_x", "kappa_y"]
[effects]
gravity = [0.0, 0.0, 9.81]
[actuation]
kind = "static"
[track]
path = "circle"
center = [0.12, 0.0, 0.57]
diameter = 0.04
lap_time = 1.0
laps = 0.5
smooth_start = 0.2
settle = 0.2
[track.controller]
step = 0.05
horizon = 6
"""


@pytest.fixture(autouse=True, scope="module")
def _in_one_process() -> Iterator[None]:
    """Few repeats, by this process: a fresh one takes seconds to start."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SOFTMPC_COMPILE", "never")
        patch.setattr(study, "measure_alone", measured_here)
        patch.setitem(motion_cost.SPEND, True, 0.05)
        patch.setitem(choosing.MOST_TIMED, "motion", 2)
        patch.setitem(choosing.MOST_FAILED, "motion", 1)
        patch.setitem(choose_families.COUNTS, FINE, (2, 3, 4))
        patch.setitem(choose_families.COUNTS, COARSER, (1, 2, 3))
        patch.setattr(choose_rate, "LONGEST", 20)
        patch.setattr(compiled, "LARGEST", 0)  # instructions: times at a rate would be compiled
        yield


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("scene") / "swing.toml"
    path.write_text(SWING, encoding="utf-8")
    (path.parent / "torques.csv").write_text("t,T_1\n0,0\n0.02,1\n0.1,1\n", encoding="utf-8")
    return path


def softmpc(*words: object) -> Result:
    return CliRunner().invoke(main, [str(word) for word in words])


@pytest.fixture(scope="module")
def chosen(scene: Path) -> tuple[dict[str, Any], Path]:
    out = scene.parent / "out"
    words = ("choose", scene, "--tolerance", "2mm", "--rate", "20 Hz", "--workers", 1)
    result = softmpc(*words, "--out", out, "--json")
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout), out


@pytest.mark.slow
def test_the_answer_is_within_tolerance_and_rate(chosen: tuple[dict[str, Any], Path]) -> None:
    data, out = chosen
    assert json.loads((out / "choose.json").read_text(encoding="utf-8")) == data
    found = data["chosen"]
    assert data["status"] == "chosen" and data["for"] == "motion"
    assert found["bound_m"] <= data["tolerance_m"] == 0.002
    assert found["step_s"] <= 1 / data["rate_hz"] == 0.05
    own = found["error"]
    factor = data["bound"]["factor"]
    assert factor == CALIBRATED["motion"].factor
    assert found["bound_m"] == pytest.approx(own["error_m"] + factor * max(own["doubt_m"], 1e-6))
    cheaper = [c for c in data["candidates"] if c["cost"] and c["within"] and c["fast"]]
    assert found["cost"]["ratio"] <= 1.05 * min(c["cost"]["ratio"] for c in cheaper)


@pytest.mark.slow
def test_the_chosen_file_gives_the_evidence_again(
    scene: Path, chosen: tuple[dict[str, Any], Path]
) -> None:
    """Run as it is written, against the reference that was kept."""
    data, out = chosen
    text = (out / "chosen.toml").read_text(encoding="utf-8")
    assert text.startswith("# Chosen by: softmpc choose swing.toml --tolerance 2mm --rate 20Hz")
    motion = simulate_file(out / "chosen.toml")
    assert motion.title == "Swing, within 2 mm at 20 Hz"
    fine = Store(out / "choose.jsonl", read_task(scene))[Case("motion", REFERENCE, "fine").key]
    gaps = np.linalg.norm(motion.tips - np.array(fine["tips"]), axis=2)
    assert gaps.max() == pytest.approx(data["chosen"]["error"]["error_m"], rel=1e-6)


@pytest.mark.slow
def test_the_same_command_measures_nothing_again(
    scene: Path, chosen: tuple[dict[str, Any], Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    out = chosen[1]

    def fail(*_: Any) -> None:
        raise AssertionError("was measured already")

    for name in ("reference", "error", "cost"):
        monkeypatch.setattr(GOALS["motion"], name, fail, raising=False)
    words = ("choose", scene, "--tolerance", "2mm", "--rate", "20Hz", "--workers", 1)
    result = softmpc(*words, "--out", out)
    assert result.exit_code == 0, result.output
    for said in ("candidate", "beyond the tolerance", "Bound: below"):
        assert said in result.stdout
    rows = [line for line in result.stdout.splitlines() if line.endswith("  chosen")]
    assert [row.startswith(chosen[0]["chosen"]["name"] + "  ") for row in rows] == [True]


@pytest.mark.slow
def test_refused_with_reasons(
    scene: Path, chosen: tuple[dict[str, Any], Path], tmp_path: Path
) -> None:
    """Times and errors that were kept serve another tolerance and rate; no old answer stays."""
    out = shutil.copytree(chosen[1], tmp_path / "out")
    words = ("choose", scene, "--tolerance", "2mm", "--rate", "100kHz", "--workers", 1)
    result = softmpc(*words, "--out", out)
    assert result.exit_code == 3
    assert "leaves 0.01 ms" in result.stdout and "try:" in result.stdout
    assert "the fastest candidate" in result.stdout
    assert result.stderr.splitlines()[-1].startswith("error: no candidate will do")
    assert not (out / "chosen.toml").exists()


def test_an_answer_takes_the_place_of_answers_alone(scene: Path, tmp_path: Path) -> None:
    """Neither of the scene that is asked about, nor of a scene of the user."""
    own = tmp_path / "chosen.toml"
    own.write_text(SWING, encoding="utf-8")
    (tmp_path / "torques.csv").write_bytes((scene.parent / "torques.csv").read_bytes())
    result = softmpc("choose", own, "--tolerance", "2mm", "--out", tmp_path)
    assert result.exit_code == 2 and "would be replaced by what is chosen" in result.stderr
    clear_place(tmp_path)
    assert own.read_text(encoding="utf-8") == SWING
    own.write_text("# Chosen by: softmpc choose\n" + SWING, encoding="utf-8")
    clear_place(tmp_path)
    assert not own.exists()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--tolerance", "5"), "a number with its unit"),
        (("--rate", "40Hz"), "Missing option '--tolerance'"),
        (("--tolerance", "5mm", "--rate", "fast"), "rate 'fast': must be a number with its unit"),
        (("--tolerance", "5mm", "--for", "flight"), "'flight' is not one of"),
        (("--tolerance", "5mm", "--for", "loop"), "[track]"),
    ],
)
def test_wrong_input(scene: Path, words: tuple[str, ...], said: str) -> None:
    result = softmpc("choose", scene, *words)
    assert result.exit_code == 2
    assert said in result.stderr
    assert len(result.stderr.splitlines()) == 1


@pytest.mark.slow
def test_a_controller_is_chosen_and_tracks_as_said(tmp_path: Path) -> None:
    path = tmp_path / "line.toml"
    path.write_text(TRACK, encoding="utf-8")
    words = ("choose", path, "--tolerance", "40mm", "--rate", "20Hz", "--workers", 1)
    result = softmpc(*words, "--out", tmp_path / "out", "--json")
    assert result.exit_code == 0, result.output
    found = json.loads(result.stdout)["chosen"]
    run = softmpc("track", tmp_path / "out" / "chosen.toml", "--json")
    told = json.loads(run.stdout)
    assert told["max_error_mm"] == pytest.approx(1e3 * found["error"]["error_m"], rel=1e-6)
    assert found["bound_m"] <= 0.04
