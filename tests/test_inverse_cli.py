"""`softmpc inverse` end to end: answers, files, pictures, exit statuses, errors."""

from __future__ import annotations

import csv
import json
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner, Result

from softmpc.cli.inverse import COSTS
from softmpc.cli.main import main
from softmpc.model.model import build
from softmpc.model.scene_file import load_scene
from softmpc.statics.equilibrium import find_equilibrium
from softmpc.statics.inverse import InverseStatics
from softmpc.statics.rest_costs import REST_COSTS
from softmpc.statics.targets import Direction, Position
from softmpc.view.inverse import batch_figure, inverse_figure

SCENE = 'title = "Two sections"\n[effects]\ngravity = [0, 0, 9.81]\n'
RUBBING = SCENE + "[actuation]\nkind = 'hydraulic-friction'\n[hydraulics]\nfriction = 30.0\n"
SINGLE = ("status", "tip_m", "distance_mm", "pressures_mpa", "torques_nm", "stable")


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("scene") / "scene.toml"
    path.write_text(SCENE, encoding="utf-8")
    return path


def softmpc(*words: object) -> Result:
    return CliRunner().invoke(main, ["inverse", *(str(word) for word in words)])


def answer(*words: object, status: int = 0) -> dict[str, Any]:
    done = softmpc(*words, "--json")
    assert done.exit_code == status, done.output
    found = json.loads(done.stdout)
    assert isinstance(found, dict)
    return found


def complaint(*words: object) -> str:
    done = softmpc(*words)
    assert (done.exit_code, done.stdout) == (2, ""), done.output
    assert done.stderr.count("\n") == 1
    return done.stderr


def lines(path: Path) -> list[str]:
    return path.read_text(encoding="utf-8").splitlines()


def load(path: Path) -> dict[str, np.ndarray]:
    with np.load(path) as arrays:
        return dict(arrays)


def test_pressures_lead_to_the_tip(scene: Path) -> None:
    found = answer(scene, "--tip", "-0.1,0.05,0.55")
    assert set(SINGLE) <= set(found)
    assert found["status"] == "solved" and found["stable"]
    model = build(load_scene(scene))
    tip = find_equilibrium(model, 1e6 * np.array(found["pressures_mpa"])).tips[-1]
    assert tip == pytest.approx([-0.1, 0.05, 0.55], abs=1e-6)
    assert found["tip_m"] == pytest.approx(tip, abs=1e-9)
    assert found["distance_mm"] < 1e-3
    per_torque = np.array(found["pressures_mpa"]) / np.array(found["torques_nm"])
    assert per_torque == pytest.approx(np.full(6, model.drive.static_gain[0, 0] / 1e6))


def test_out_of_reach(scene: Path, tmp_path: Path) -> None:
    done = softmpc(scene, "--tip", "0.1,0,0.95", "--out", tmp_path)
    assert done.exit_code == 3
    found = json.loads((tmp_path / "inverse.json").read_text(encoding="utf-8"))
    assert done.stderr == (
        "error: the target is out of reach: the nearest posture misses it by "
        f"{found['distance_mm']:.4g} mm\n"
    )
    assert found["status"] == "unreachable"
    assert found["distance_mm"] == pytest.approx(
        1e3 * np.linalg.norm(np.array(found["tip_m"]) - [0.1, 0, 0.95])
    )


def test_files(scene: Path, tmp_path: Path) -> None:
    softmpc(scene, "--tip", "0.1,0,0.55", "--direction", "0.1,0,1", "--out", tmp_path)
    assert {item.name for item in tmp_path.iterdir()} == {
        "inverse.json", "inverse.csv", "inverse.npz", "inverse.png"
    }  # fmt: skip
    rows = dict(row[:2] for row in csv.reader(lines(tmp_path / "inverse.csv")))
    arrays = load(tmp_path / "inverse.npz")
    assert rows["status"] == "solved"
    assert float(rows["P_3"]) == arrays["p"][2]
    assert float(rows["T_3"]) == arrays["torques"][2]
    assert arrays["tips"][-1] == pytest.approx([0.1, 0, 0.55], abs=1e-6)


def test_text(scene: Path) -> None:
    said = softmpc(scene, "--tip", "0.1,0,0.55", "--direction", "0.1,0,1").stdout
    for part in ("solved, stable", "torques (N·m)", "MPa by 1 mm x", "MPa by 1 deg turn_x"):
        assert part in said


def test_pressures_that_the_cost_leaves_open(tmp_path: Path) -> None:
    path = tmp_path / "inextensible.toml"
    path.write_text("[model]\nstrains = ['kappa_x', 'kappa_y']\n", encoding="utf-8")
    found = answer(path, "--tip", "0.1,0.1,0.45", "--cost", "least-strain-energy")
    assert found["pressures_by_moves_mpa"][0] == [None] * 3
    assert "least-strain-energy does not settle the pressures" in found["warnings"][0]


def test_other_sections_and_free_coordinates(scene: Path) -> None:
    found = answer(scene, "--tip", "1:-,0.01,0.28", "--tip", "0.02,-,0.58")
    assert found["tips_m"][0][1:] == pytest.approx([0.01, 0.28], abs=2e-6)
    assert found["tip_m"][0] == pytest.approx(0.02, abs=2e-6)
    assert found["moves"] == ["y_1", "z_1", "x", "z"]


def test_a_rotation_vector(scene: Path) -> None:
    found = answer(scene, "--rotation", "0,5,0")
    c, s = np.cos(np.radians(5)), np.sin(np.radians(5))
    wanted = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    assert np.array(found["rotation"]) == pytest.approx(wanted, abs=1e-5)


@pytest.mark.slow
def test_held_units_and_costs(scene: Path) -> None:
    found = [
        answer(scene, "--tip", "0.05,0,0.6", "--hold", "2=0.3", "--cost", cost) for cost in COSTS
    ]
    assert all(one["pressures_mpa"][1] == pytest.approx(0.3) for one in found)
    assert all("P_2 held" in one["active_limits"] for one in found)
    assert len({round(one["pressures_mpa"][0], 4) for one in found}) > 1
    assert tuple(REST_COSTS) == COSTS
    named = answer(scene, "--tip", "0.05,0,0.6", "--hold", "P_2=0.3", "--cost", COSTS[0])
    assert named["pressures_mpa"] == found[0]["pressures_mpa"]


@pytest.mark.slow
def test_friction_has_a_band(tmp_path: Path) -> None:
    path = tmp_path / "rubbing.toml"
    path.write_text(RUBBING, encoding="utf-8")
    assert answer(path, "--tip", "0,0,0.6")["torque_band_nm"] > 0
    assert "friction holds" in softmpc(path, "--tip", "0,0,0.6").stdout


# ---------------------------------------------------------------- many targets


@pytest.fixture
def targets(tmp_path: Path) -> Path:
    path = tmp_path / "targets.csv"
    path.write_text(
        "x,y,z,dx,dy,dz\n0.1,0,0.55,,,\n# a comment\n0.05,0.02,0.58,0.1,0,1\n,0.1,0.5,,,\n",
        encoding="utf-8",
    )
    return path


def test_many_targets(scene: Path, targets: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    found = answer(scene, "--targets", targets, "--workers", 1, "--out", out)
    assert (found["targets"], found["solved"], found["unreachable"]) == (3, 3, 0)
    assert all(set(SINGLE) <= set(one) for one in found["results"])
    rows = list(csv.DictReader(lines(out / "inverse.csv")))
    assert [row["status"] for row in rows] == ["solved"] * 3
    assert "largest angle" in softmpc(scene, "--targets", targets, "--workers", 1).stdout
    assert float(rows[1]["x"]) == pytest.approx(0.05, abs=1e-6)
    arrays = load(out / "inverse.npz")
    assert arrays["p"].shape == (3, 6)
    assert arrays["p"][2, 1] == pytest.approx(1e6 * float(rows[2]["P_2_mpa"]))
    assert {item.name for item in out.iterdir()} == {
        "inverse.json", "inverse.csv", "inverse.npz", "inverse.png"
    }, "what was kept for the next time is gone"  # fmt: skip


@pytest.mark.slow
def test_a_path_with_a_place_out_of_reach(scene: Path, tmp_path: Path) -> None:
    path = tmp_path / "path.csv"
    path.write_text("0.1,0,0.55\n0.1,0.01,0.55\n0,0,0.95\n", encoding="utf-8")
    done = softmpc(scene, "--targets", path, "--path", "--workers", 2)
    assert done.exit_code == 3
    assert "error: 1 of 3 targets are not held\n" in done.stderr
    assert "unreachable            1" in done.stdout


def test_ctrl_c_keeps_what_is_done(scene: Path, tmp_path: Path) -> None:
    path, out = tmp_path / "many.csv", tmp_path / "out"
    rng = np.random.default_rng(0)
    rows = rng.uniform([-0.1, -0.1, 0.5], [0.1, 0.1, 0.6], size=(2000, 3))
    path.write_text("\n".join(",".join(map(str, row)) for row in rows), encoding="utf-8")
    command = [sys.executable, "-m", "softmpc.cli", "inverse", str(scene), "--targets", str(path)]
    running = subprocess.Popen(
        [*command, "--workers", "1", "--out", str(out)],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    kept, until = out / "inverse_targets.jsonl", time.monotonic() + 60
    while time.monotonic() < until and not (kept.is_file() and kept.read_bytes().count(b"\n") > 2):
        time.sleep(0.05)
    running.send_signal(signal.SIGINT)
    _, said = running.communicate(timeout=60)
    assert running.returncode == 130, said
    assert "the same command goes on from there" in said
    assert kept.read_text(encoding="utf-8").count("\n") > 2


# ---------------------------------------------------------------- errors


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ((), "give --tip, --direction or --rotation, or a file of --targets"),
        (("--tip", "0,0,0.5", "--targets", "t.csv"), "give --tip, --direction"),
        (("--tip", "0,0,0.5", "--path"), "--path is for a file"),
        (("--tip", "0,0.5"), "has 2 numbers, three are needed"),
        (("--tip", "0"), "'0' has 1 number, three are needed"),
        (("--tip", "120,0,570"), "the target is far out of reach: (120, 0, 570) m is 582.5 m from"),
        (("--tip", "1:-,0,1.2"), "but the arm is 0.75 m long at most"),
        (("--tip", "0,0,570"), "are these metres?"),
        (("--tip", "0,x,0.5"), "'x' (value 1) is not a number"),
        (("--tip", "0,nan,0.5"), "not a finite number"),
        (("--tip", "-,-,-"), "must be three numbers in m"),
        (("--tip", "a:0,0,0.5"), "is no section"),
        (("--tip", "3:0,0,0.5"), "has the sections 1 to 2"),
        (("--tip", "0:0,0,0.5"), "target of section 0: this arm has the sections 1 to 2"),
        (("--tip", "0,0,0.5", "--tip", "2:0,0,0.6"), "the tip of section 2 is given two"),
        (("--direction", "0,0,0"), "not all of them zero"),
        (("--direction", "0,-,1"), "is not a number"),
        (("--tip", "0,0,0.5", "--hold", "2"), "must be UNIT=MPA"),
        (("--tip", "0,0,0.5", "--hold", "9=0.1"), "held unit 9: this arm has the units 1 to 6"),
        (("--tip", "0,0,0.5", "--hold", "P_9=0.1"), "held unit 9: this arm has the units 1 to 6"),
        (("--tip", "0,0,0.5", "--hold", "T_2=0.1"), "must be UNIT=MPA, such as 2=0.3 or P_2=0.3"),
        (("--tip", "0,0,0.5", "--hold", "2=3"), "must be between 0 and 1 MPa"),
        (("--tip", "0,0,0.5", "--hold", "2=0.3", "--hold", "P_2=0.1"), "unit 2 twice, 0.3 and 0.1"),
        (("--tip", "0,0,0.5", "--cost", "most"), "least-pressure"),
        (("--targets", "missing.csv"), "No such file"),
    ],
)
def test_wrong_words(scene: Path, words: tuple[str, ...], said: str) -> None:
    assert said in complaint(scene, *words)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "has no targets"),
        ("x,y,z\n", "has no targets"),
        ("a,y,z\n0,0,0.5\n", "the header is a,y,z"),
        ("0,0\n", "line 1: has 2 values"),
        ("0\n", "line 1: has 1 value: must be"),
        ("0,0,0.5\n100,0,500\n", "target 2 of 2 is far out of reach: (100, 0, 500) m"),
        ("x,y,z\n0,0,0.5\n0,b,0.5\n", "line 3: 'b' is not a number"),
        ("0,0,inf\n", "line 1: Position.place"),
        ("x,y,z,dx,dy,dz\n,,,,,\n0,0,0.5,0,0,0\n", "line 3: Direction.axis"),
        ("0,0,0.5,0,,1\n", "line 1: dx, dy, dz are three numbers, or all empty"),
    ],
)
def test_wrong_files(scene: Path, tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "targets.csv"
    path.write_text(text, encoding="utf-8")
    assert said in complaint(scene, "--targets", path)


# ---------------------------------------------------------------- pictures


def test_pictures_show_what_was_asked(scene: Path) -> None:
    model = build(load_scene(scene))
    inverse = InverseStatics(model)
    missed = inverse.solve([Position((None, 0.1, 0.9)), Direction((0, 0, 1))])
    made = inverse_figure(model, missed, "Far away")
    assert made.get_suptitle().startswith("Far away: unreachable, ")
    names = [text.get_text() for text in made.legends[0].get_texts()]
    assert {"target", "direction asked for"} <= set(names)
    for axes, across in zip(made.axes[1:], (0, 1), strict=True):
        low, high = sorted(axes.get_ylim())
        assert low < 0.9 < high, "the target is in the picture"
        crosses = [line for line in axes.lines if line.get_marker() == "x"]
        wanted = [missed.tips[-1, 0], 0.1][across]
        assert crosses[0].get_xdata() == pytest.approx([wanted])
        assert crosses[0].get_ydata() == pytest.approx([0.9])
    many = batch_figure(model, [missed, inverse.solve(Position((0, 0, 0.6)))])
    names = [text.get_text() for text in many.legends[0].get_texts()]
    assert names == ["solved: 1", "unreachable: 1"]
