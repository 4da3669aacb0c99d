"""`softmpc calibrate` end to end: answers, files, the picture, errors, Ctrl-C."""

from __future__ import annotations

import csv
import json
import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner, Result

from softmpc.cli.main import main
from softmpc.model.scene_file import load_scene
from softmpc.study.residuals import Predictions

SCENE = """
title = "One section"
[manipulator]
sections = 1
[actuation]
kind = "static"
[simulate]
duration = 0.5
"""
DATA = """
title = "two radii"
[[parameter]]
path = "sections.bending_radius"
low = 0.01
high = 0.1
log = true
[[parameter]]
path = "sections.mass"
low = 0.1
high = 1.0
prior = { mean = 0.5, sd = 0.1 }
[[summary]]
name = "radius at 1 MPa"
quantity = "radius"
equals = 0.139
sigma = 0.002
pressures_mpa = [1, 0, 0]
without = ["gravity"]
[[summary]]
name = "angle at 1 MPa"
quantity = "bending_angle"
equals = 160
sigma = 1
pressures_mpa = [1, 0, 0]
without = ["gravity"]
fit = false
"""


def softmpc(*words: object) -> Result:
    return CliRunner().invoke(main, [str(word) for word in words])


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp("calibrate")
    for name, text in (("scene.toml", SCENE), ("data.toml", DATA)):
        (folder / name).write_text(text, encoding="utf-8")
    return folder / "scene.toml", folder / "data.toml"


@pytest.fixture(scope="module")
def answered(files: tuple[Path, Path]) -> tuple[Result, dict[str, Any], Path]:
    out = files[0].parent / "out"
    result = softmpc("calibrate", *files, "--json", "--out", out)
    return result, json.loads(result.stdout), out


def test_json(answered: tuple[Result, dict[str, Any], Path]) -> None:
    result, data, _ = answered
    assert result.exit_code == 0
    assert data["status"] == "converged" and data["title"] == "two radii"
    radius, mass = data["parameters"]
    assert radius["path"] == "sections.bending_radius" and radius["unit"] == "m"
    assert radius["low95"] < radius["estimate"] < radius["high95"]
    assert (radius["source"], mass["source"]) == ("data", "prior")
    assert mass["prior"] == [0.5, 0.1] and mass["estimate"] == pytest.approx(0.5, abs=1e-3)
    assert [r["fitted"] for r in data["residuals"]] == [True, False]
    assert len(data["undetermined"]) == 1 and "sections.mass" in data["undetermined"][0]
    assert data["probability"] is None  # no redundancy


def test_text(files: tuple[Path, Path]) -> None:
    result = softmpc("calibrate", *files, "--starts", "2", "--workers", "1")
    assert result.exit_code == 0
    for words in ("two radii", "2 of 2 ended here", "sections.bending_radius", "angle at 1 MPa",
                  "The data alone cannot see", "95 % interval"):  # fmt: skip
        assert words in result.stdout


def test_files(answered: tuple[Result, dict[str, Any], Path]) -> None:
    _, data, out = answered
    names = {"calibrate.json", "calibrated.toml", "calibration.npz", "calibration.png",
             "parameters.csv", "residuals.csv"}  # fmt: skip
    assert {path.name for path in out.iterdir()} == names
    assert json.loads((out / "calibrate.json").read_text()) == data
    rows = list(csv.DictReader((out / "parameters.csv").read_text(encoding="utf-8").splitlines()))
    assert [row["path"] for row in rows] == [p["path"] for p in data["parameters"]]
    assert float(rows[0]["estimate"]) == data["parameters"][0]["estimate"]
    with np.load(out / "calibration.npz") as arrays:
        assert arrays["jacobian"].shape == (2, 2)
        assert arrays["paths"].tolist() == ["sections.bending_radius", "sections.mass"]
        np.testing.assert_allclose(arrays["correlation"], np.eye(2), atol=1e-6)
    text = (out / "calibrated.toml").read_text(encoding="utf-8")
    assert "# fitted: sections.bending_radius = " in text
    assert "not determined by the data alone" in text
    assert 'title = "One section"' in text and "[simulate]" in text
    section = load_scene(out / "calibrated.toml").manipulator.sections[0]
    assert section.bending_radius == data["parameters"][0]["estimate"]


def test_picture_is_large_enough(answered: tuple[Result, dict[str, Any], Path]) -> None:
    from matplotlib.image import imread

    picture = imread(answered[2] / "calibration.png")
    assert picture.shape[1] == 1500 and picture.shape[0] > 500
    assert picture.std() > 0.05  # not blank


def test_wrong_input(files: tuple[Path, Path], tmp_path: Path) -> None:
    result = softmpc("calibrate", files[0], tmp_path / "none.toml", "--json")
    assert result.exit_code == 2 and "no such file" in json.loads(result.stdout)["error"]
    wrong = tmp_path / "wrong.toml"
    wrong.write_text(DATA.replace("sections.mass", "sections.mess"), encoding="utf-8")
    result = softmpc("calibrate", files[0], wrong)
    assert result.exit_code == 2 and "did you mean 'sections.mass'" in result.stderr
    result = softmpc("calibrate", files[0], files[1], "--starts", "0")
    assert result.exit_code == 2 and "--starts" in result.stderr


def test_what_cannot_be_built_at_the_start(files: tuple[Path, Path], tmp_path: Path) -> None:
    """Friction that the scene's drive does not have."""
    scene, data = tmp_path / "scene.toml", tmp_path / "data.toml"
    scene.write_text(SCENE.replace('"static"', '"hydraulic"'), encoding="utf-8")
    free = '[[parameter]]\npath = "hydraulics.friction"\nstart = 10\nhigh = 100\n'
    data.write_text(DATA + free, encoding="utf-8")
    result = softmpc("calibrate", scene, data)
    assert result.exit_code == 2 and "hydraulic-friction" in result.stderr


def test_interrupt(
    files: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Ctrl-C while arms are computed: 130, the best so far, all files whole."""
    beside = Predictions._beside

    def interrupted(self: Predictions, *given: Any) -> Any:
        if self.arms == 8:
            signal.raise_signal(signal.SIGINT)
        return beside(self, *given)

    monkeypatch.setattr(Predictions, "_beside", interrupted)
    result = softmpc("calibrate", *files, "--json", "--out", tmp_path)
    assert result.exit_code == 130 and "interrupted; the best so far" in result.stderr
    data = json.loads(result.stdout)
    assert data["status"] == "interrupted"
    assert data["parameters"][0]["estimate"] != data["parameters"][0]["start"]
    assert load_scene(tmp_path / "calibrated.toml").manipulator.sections[0].mass > 0
    assert not [path.name for path in tmp_path.iterdir() if path.name.startswith(".")]
