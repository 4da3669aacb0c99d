"""`softmpc simulate` with --method, --tip-tolerance and --step against the scene's own method."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from softmpc.cli.main import main
from softmpc.simulation.run import simulate_file

SWING = """
[manipulator]
sections = 1
[model]
strains = ["epsilon", "kappa_y"]
[actuation]
kind = "static"
[simulate]
duration = 0.3
steps = [{ unit = 1, at = 0.0, torque = 1.0 }]
"""


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    path = tmp_path / "swing.toml"
    path.write_text(SWING)
    return path


def simulate(scene: Path, *words: str) -> Result:
    return CliRunner().invoke(main, ["simulate", str(scene), *words])


def test_a_step_alone_keeps_the_scenes_method(scene: Path) -> None:
    scene.write_text(SWING + 'method = "gauss-2"\nstep = 0.001\n')
    result = simulate(scene, "--step", "0.02", "--json")
    assert result.exit_code == 0, result.output
    tips = json.loads(result.stdout)["final_tips_m"]
    coarse = simulate_file(scene, method="gauss-2", step=0.02).tips[-1].tolist()
    other = simulate_file(scene, method="radau", step=0.02).tips[-1].tolist()
    assert tips == coarse != other


def test_numbers_that_the_scenes_method_does_not_take(scene: Path) -> None:
    scene.write_text(SWING + 'method = "idas"\ntolerance = 1e-9\n')
    for words in (("--step", "0.02"), ("--tip-tolerance", "1mm")):
        result = simulate(scene, *words)
        assert result.exit_code == 2
        assert "method 'idas' takes tolerance (relative)" in result.stderr
        assert "command line: " in result.stderr
    assert simulate(scene, "--method", "radau", "--step", "0.02").exit_code == 0


@pytest.mark.parametrize("step", ["1e300", "1e-300", "0", "-1", "nan", "5"])
def test_step_out_of_range(scene: Path, step: str) -> None:
    result = simulate(scene, "--step", step)
    assert (result.exit_code, result.stdout) == (2, "")
    assert "must be between 1e-06 and 1 s" in result.stderr


def test_a_scene_whose_numbers_overflow_has_no_rest(scene: Path) -> None:
    scene.write_text(SWING + "[effects]\ngravity = [0.0, 0.0, 1e300]\n")
    result = simulate(scene)
    assert result.exit_code == 3
    assert "no rest to start from: no convergence" in result.stderr
