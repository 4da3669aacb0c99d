"""The command line, end to end: answers, files, exit statuses, and one line for each error."""

from __future__ import annotations

import contextlib
import io
import json
import logging
import re
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import click
import numpy as np
import pytest
from click.testing import CliRunner, Result

from softmpc import __version__
from softmpc.cli.common import as_json, notice, progress, row, table
from softmpc.cli.main import COMMANDS, main
from softmpc.control.track_result import TrackResult
from softmpc.simulation.integrator import IntegrationError
from softmpc.simulation.result import Simulation

HANGING = """
title = "Two sections"
[effects]
gravity = [0, 0, 9.81]
"""
SWING = """
title = "Swing"
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
CIRCLE = """
title = "Small circle"
[manipulator]
sections = 1
[model]
strains = ["epsilon", "kappa_x", "kappa_y"]
[actuation]
kind = "static"
[track]
path = "circle"
center = [0.0, 0.0, 0.3]
diameter = 0.02
lap_time = 1.0
laps = 0.1
smooth_start = 0.1
settle = 0.1
[track.controller]
horizon = 4
"""
PRESSURES = "0.6,0,0,0,0.3,0.3"
Scene = Callable[[str], str]


def softmpc(*words: str) -> Result:
    return CliRunner().invoke(main, words)


def answer(*words: str, status: int = 0) -> dict[str, Any]:
    """The one JSON object on stdout."""
    result = softmpc(*words, "--json")
    assert result.exit_code == status, result.output
    assert result.stdout.count("\n") == 1
    data = json.loads(result.stdout)
    assert isinstance(data, dict)
    return data


def complaint(*words: str, status: int = 2) -> str:
    """The one line on stderr, which the JSON object repeats."""
    result = softmpc(*words)
    assert (result.exit_code, result.stdout) == (status, ""), result.output
    assert result.stderr.startswith("error: ")
    assert result.stderr.count("\n") == 1
    message = result.stderr.removeprefix("error: ").strip()
    assert answer(*words, status=status) == {"error": message}
    return message


def files(folder: Path) -> set[str]:
    return {item.name for item in folder.iterdir()}


@pytest.fixture
def scene(tmp_path: Path) -> Scene:
    def write(text: str, name: str = "scene.toml") -> str:
        (tmp_path / name).write_text(text, encoding="utf-8")
        return str(tmp_path / name)

    return write


# ---------------------------------------------------------------- help


def test_help_needs_nothing_heavy() -> None:
    code = (
        "import sys\nfrom softmpc.cli.main import main\ntry:\n    main(['--help'])\n"
        "except SystemExit as end:\n    assert end.code == 0\n"
        "heavy = {'casadi', 'numpy', 'scipy', 'matplotlib', 'control', 'tqdm'} & set(sys.modules)\n"
        "assert not heavy, heavy\n"
    )
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert all(name in done.stdout for name in COMMANDS)


def test_help_is_quick() -> None:
    took = []
    for _ in range(3):
        start = time.perf_counter()
        subprocess.run(
            [sys.executable, "-m", "softmpc.cli", "--help"], check=True, stdout=subprocess.DEVNULL
        )
        took.append(time.perf_counter() - start)
    assert min(took) < 0.5


@pytest.mark.parametrize("name", COMMANDS)
def test_help_of_each_command(name: str) -> None:
    result = softmpc(name, "--help")
    assert result.exit_code == 0
    for option in ("--json", "--out", "--verbose"):
        assert option in result.stdout


def test_version_and_no_words() -> None:
    assert softmpc("--version").stdout == f"softmpc {__version__}\n"
    nothing = softmpc()
    assert nothing.exit_code == 0
    assert nothing.stdout == softmpc("--help").stdout


# ---------------------------------------------------------------- info


def test_info(scene: Scene) -> None:
    data = answer("info", scene(HANGING))
    assert data["title"] == "Two sections"
    assert data["parameters"] == "chen2022-v1"
    assert data["state_count"] == len(data["states"]) == 34
    assert data["inputs"] == [f"T_{j}" for j in range(1, 7)]
    assert data["effects"][:2] == ["gravity", "inertia"]
    assert all(count > 0 for count in data["instructions"].values())
    assert data["drive_poles_per_s"][0] == pytest.approx([-10485, -1149, -66.9], rel=1e-3)
    assert data["static_gain_mpa_per_nm"] == pytest.approx([0.4, 0.4], rel=1e-2)
    assert data["massless"] == []


def test_info_of_a_scene_with_less(scene: Scene) -> None:
    one = "[manipulator]\nsections = 1\n"
    still = answer(
        "info", scene(one + "[effects]\ninertia = false\n[actuation]\nkind = 'pressure'")
    )
    assert not [name for name in still["states"] if name.startswith("d_")]
    assert still["inputs"] == ["P_1", "P_2", "P_3"]
    assert "drive_poles_per_s" not in still
    lumped = one + "[model]\nmass = 'lumped'\n[effects]\nrotary_inertia = false"
    assert "kappa_z_1_1" in answer("info", scene(lumped))["massless"]


def test_info_for_people(scene: Scene, tmp_path: Path) -> None:
    text = SWING.replace("static", "hydraulic")
    result = softmpc("info", scene(text), "--out", str(tmp_path / "out"))
    assert result.stdout.startswith("Swing\nparameters")
    for text in ("virtual-power", "gauss-2", "-66.86 1/s", "residual_jacobian"):
        assert text in result.stdout
    assert files(tmp_path / "out") == {"info.json"}


# ---------------------------------------------------------------- statics


def test_statics(scene: Scene) -> None:
    data = answer("statics", scene(HANGING), "--pressure", PRESSURES)
    assert data["converged"]
    assert data["stable"]
    assert np.shape(data["tips_m"]) == (2, 3)
    assert data["tips_m"][1] == pytest.approx([-0.35665, 0, 0.38729], abs=1e-4)
    assert len(data["strains"]) == len(data["strain_names"]) == 8
    assert data["pressures_mpa"] == [0.6, 0, 0, 0, 0.3, 0.3]
    assert data["piston_travel_mm"][0] == pytest.approx(15.04, abs=0.01)
    assert data["warnings"] == []
    assert "torques_nm" not in data
    first = data["segments"][0]
    assert first["length_m"] == pytest.approx(0.25 * (1 + data["strains"][0]))
    assert first["theta_deg"] == pytest.approx(46.5, abs=0.1)
    assert abs(first["phi_deg"]) == pytest.approx(180)


def test_statics_by_torque(scene: Scene) -> None:
    path = scene(HANGING)
    by_torque = answer("statics", path, "--torque", "2.5,0,0,0,0,0")
    assert by_torque["torques_nm"] == [2.5, 0, 0, 0, 0, 0]
    assert by_torque["pressures_mpa"][0] == pytest.approx(1.0, rel=1e-3)
    assert by_torque["warnings"] == []  # 1.0004 MPa is rounding of the gain, not wrong input


def test_statics_warns(scene: Scene) -> None:
    pushed = answer(
        "statics", scene("[load]\ntip_force = [0, 0, -200]"), "--pressure", "0,0,0,0,0,0"
    )
    assert not pushed["stable"]
    assert "not stable" in pushed["warnings"][0]
    strong = scene("[hydraulics]\nefficiency = 1.0\n[limits]\nstroke_max = 0.01")
    said = answer("statics", strong, "--torque", "2.5,0,0,0,0,0")["warnings"]
    assert "outside its limits" in said[0]
    assert "beyond its stroke" in said[1]


@pytest.mark.parametrize(
    ("text", "pressures"),
    [
        ("[manipulator]\nsections = 1\nsection_angles_deg = [0, 90, 180, 270]", "0.4,0,0.1,0"),
        ("[model]\nsegments = 2\nstrains = ['epsilon', 'kappa_y']", "0.4,0,0,0,0,0"),
    ],
)
def test_statics_of_other_arms(scene: Scene, text: str, pressures: str) -> None:
    data = answer("statics", scene(text), "--pressure", pressures)
    assert data["converged"]
    assert max(abs(segment["tau_deg"]) for segment in data["segments"]) < 1e-9


def test_statics_files(scene: Scene, tmp_path: Path) -> None:
    out = tmp_path / "new" / "out"
    result = softmpc("statics", scene(HANGING), "--pressure", PRESSURES, "--out", str(out))
    assert "tip of section 2 (m)" in result.stdout
    assert "-0.00000" not in result.stdout
    assert files(out) == {"statics.json", "statics.csv", "statics.npz", "posture.png"}
    assert json.loads((out / "statics.json").read_text())["converged"]
    lines = (out / "statics.csv").read_text().splitlines()
    assert lines[:2] == ["name,value,unit", "status,converged,"]
    assert len({line.count(",") for line in lines}) == 1
    with np.load(out / "statics.npz") as arrays:
        assert arrays["rotations"].shape == (2, 3, 3)


def test_statics_without_solution(scene: Scene, tmp_path: Path) -> None:
    path, out = scene("[load]\ntip_force = [0, 0, -50000]"), tmp_path / "out"
    words = ("statics", path, "--pressure", "0,0,0,0,0,0", "--out", str(out))
    data = answer(*words, status=3)
    assert not data["converged"]
    assert "status,outside the model's range" in (out / "statics.csv").read_text()
    result = softmpc(*words)
    assert result.exit_code == 3
    assert result.stderr == "error: the statics did not converge: outside the model's range\n"


# ---------------------------------------------------------------- simulate and compare


def test_simulate(scene: Scene, tmp_path: Path) -> None:
    out = tmp_path / "out"
    data = answer("simulate", scene(SWING), "--out", str(out))
    assert data["status"] == "finished"
    assert data["duration_s"] == pytest.approx(0.3)
    assert data["realtime_factor"] == pytest.approx(0.3 / data["wall_s"])
    assert np.shape(data["final_tips_m"]) == (1, 3)
    curves = {"tips.png", "strains.png", "pressures_torques.png"}
    pictures = curves | {"motion.png", "simulation.gif"}
    assert files(out) == pictures | {"simulate.json", "simulation.csv", "simulation.npz"}
    assert Simulation.load(out / "simulation.npz").title == "Swing"


def test_simulate_tells_how_it_comes_to_rest(scene: Scene) -> None:
    path = scene(SWING.replace("duration = 0.3", "duration = 2.0"))
    data = answer("simulate", path)
    assert 0 < data["settling_s"] < 1
    assert 0 <= data["overshoot"] < 1
    said = softmpc("simulate", path).stdout
    assert f"within 2 % of its way  {data['settling_s']:.2f} s after the input" in said
    assert f"{100 * data['overshoot']:.1f} %" in said


def test_simulate_tells_that_it_has_not_come_to_rest(scene: Scene) -> None:
    said = softmpc("simulate", scene(SWING.replace("at = 0.0", "at = 0.2"))).stdout
    assert re.search(r"^not at rest +within 0\.1 s after the last input$", said, re.MULTILINE)
    assert "overshoot" not in said
    still = softmpc("simulate", scene(SWING.replace("torque = 1.0", "torque = 0.0"))).stdout
    assert "at rest" not in still  # there is no way to come to rest from


def test_simulate_warns_of_inputs_that_come_too_late(scene: Scene) -> None:
    result = softmpc("simulate", scene(SWING.replace("at = 0.0", "at = 0.5")), "--json")
    assert result.exit_code == 0
    (warning,) = json.loads(result.stdout)["warnings"]
    assert (warning["kind"], warning["time"], warning["limit"]) == ("late_input", 0.5, 0.3)
    assert (
        "warning: the motion ends at t = 0.3 s, before these inputs begin: unit 1 at t = 0.5"
        in (result.stderr)
    )


@pytest.mark.parametrize("error", ["ctrl-c", "casadi"])
def test_ctrl_c_while_drawing_keeps_the_motion(
    scene: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: str
) -> None:
    raised = KeyboardInterrupt() if error == "ctrl-c" else caused_by_ctrl_c()
    monkeypatch.setattr("softmpc.view.motion.motion_figure", fail_with(raised))
    out = tmp_path / "out"
    result = softmpc("simulate", scene(SWING), "--out", str(out))
    assert result.exit_code == 130
    said = f"interrupted while drawing; the motion itself is complete, in {out / 'simulation.csv'}"
    assert result.stderr.strip() == f"error: {said}"
    assert "final tip of section 1" in result.stdout
    assert files(out) == {"simulation.csv", "simulation.npz", "simulate.json"}
    assert json.loads((out / "simulate.json").read_text())["status"] == "finished"
    monkeypatch.setattr("softmpc.view.motion.motion_figure", fail_with(ValueError("a bug")))
    assert softmpc("simulate", scene(SWING), "--out", str(out)).exit_code == 1


def test_simulate_audit(scene: Scene, tmp_path: Path) -> None:
    out = tmp_path / "out"
    words = ("simulate", scene(SWING), "--audit", "--no-animate")
    data = answer(*words, "--out", str(out))["audit"]
    assert data["closure"] < 1e-4
    assert data["missing"] == []
    assert {"energy.png", "energy.csv"} <= files(out)
    header, *rows = (out / "energy.csv").read_text().splitlines()
    assert header.startswith("t [s],")
    assert header.endswith("error [J]")
    last = dict(zip(header.split(","), map(float, rows[-1].split(",")), strict=True))
    assert last["drive_work [J]"] == data["work_j"]["drive"]
    said = softmpc(*words).stdout
    assert "energy balance closes" in said
    lawless = scene(SWING.replace("[model]", '[model]\nelasticity = "strain"'))
    assert "no energy balance" in softmpc("simulate", lawless, "--audit").stdout


@pytest.mark.slow
def test_simulate_audit_of_an_arm_that_jumps(scene: Scene, tmp_path: Path) -> None:
    bare = "[effects]\ninertia = false\nenvironment_damping = false\nmaterial_damping = false\n"
    out = tmp_path / "out"
    words = ("simulate", scene(SWING + bare), "--audit", "--no-animate", "--out", str(out))
    data = answer(*words)["audit"]
    assert data["closure"] is None
    assert "without inertia and damping" in data["missing"][0]
    assert {"simulate.json", "energy.png", "energy.csv"} <= files(out)
    assert "no energy balance" in softmpc(*words).stdout


def test_simulate_shorter_and_still(scene: Scene, tmp_path: Path) -> None:
    out = tmp_path / "out"
    words = ("simulate", scene(SWING), "--duration", "0.1", "--no-animate", "--out", str(out))
    result = softmpc(*words)
    assert result.exit_code == 0, result.output
    assert "0.1 s in" in result.stdout
    assert "simulation.gif" not in files(out)
    assert Simulation.load(out / "simulation.npz").duration_s == pytest.approx(0.1)


@pytest.mark.sampled
@pytest.mark.parametrize(
    ("ending", "status"), [("interrupted", 130), ("stopped: IDAS gave up, after t = 0.1 s", 3)]
)
def test_simulate_that_ends_early(
    scene: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ending: str, status: int
) -> None:
    from softmpc.simulation import run

    whole = run.simulate_file

    def cut(*given: Any, **more: Any) -> Simulation:
        return replace(whole(*given, **more), status=ending)

    monkeypatch.setattr(run, "simulate_file", cut)
    words = ("simulate", scene(SWING), "--json", "--no-animate", "--out", str(tmp_path / "out"))
    result = softmpc(*words)
    assert result.exit_code == status
    assert json.loads(result.stdout)["status"] == ending
    assert result.stderr.startswith(f"error: {ending}")
    assert result.stderr.count("t = ") == 1
    assert {"simulation.csv", "tips.png"} <= files(tmp_path / "out")


def test_compare(tmp_path: Path) -> None:
    head = "t [s],x_1 [m],y_1 [m],z_1 [m],x_2 [m],y_2 [m],z_2 [m]\n"
    first, second = tmp_path / "a.csv", tmp_path / "b.csv"
    first.write_text(head + "0,0,0,0,0,0,0\n1,0,0,0,0,0,0\n")
    second.write_text(head + "0,0,0,0,0,0,0\n1,0.03,0.04,0,0,0,0.02\n")
    words = ("compare", str(first), str(second), "--out", str(tmp_path / "out"))
    data = answer(*words)
    assert data["largest_by_section_m"] == pytest.approx([0.05, 0.02])
    assert data["largest_sectional_m"] == pytest.approx(0.05)
    assert data["largest_cumulative_m"] == pytest.approx(0.07)
    assert files(tmp_path / "out") == {"compare.json", "compare.csv", "compare.png"}
    assert "largest ERR_2       0.020000 m" in softmpc(*words).stdout


def test_compare_simulations(scene: Scene, tmp_path: Path) -> None:
    softmpc("simulate", scene(SWING), "--out", str(tmp_path / "a"), "--no-animate")
    same = [str(tmp_path / "a" / "simulation.csv")] * 2
    assert answer("compare", *same)["largest_cumulative_m"] == 0


# ---------------------------------------------------------------- track


def test_track(scene: Scene, tmp_path: Path) -> None:
    out = tmp_path / "out"
    data = answer("track", scene(CIRCLE), "--out", str(out))
    wanted = {"rms_error_mm", "max_error_mm", "steps", "failures", "step_ms_median", "step_ms_p95"}
    assert wanted <= data.keys()
    assert data["failures"] == 0
    assert data["rms_error_mm"] < 0.5
    pictures = {"track.png", "tips.png", "strains.png", "control.png", "track.gif"}
    assert files(out) == pictures | {"track.json", "track.npz", "track.csv", "steps.csv"}


def tracked(**changes: Any) -> TrackResult:
    """A run of two steps of a one-section arm, made up."""
    time, zeros = np.linspace(0, 0.05, 51), np.zeros((51, 3))
    run = TrackResult(
        title="Made up", status="finished", settle=1.0, time=time, tips=np.zeros((51, 1, 3)),
        reference=zeros, q=zeros, dq=zeros, p=zeros, control_time=np.array([0.0, 0.025]),
        u=np.zeros((2, 3)), step_ms=np.array([9.0, 11.0]), iterations=np.array([4, 5]),
        statuses=["solved", "solved"], names=(("a", "b", "c"),) * 3,
    )  # fmt: skip
    return replace(run, **changes)


@pytest.mark.parametrize(
    ("changes", "status", "said"),
    [
        ({}, 0, ""),
        ({"statuses": ["solved", "no convergence"]}, 3, "1 of 2 steps of the controller failed"),
        ({"status": "plant stopped: squeezed"}, 3, "plant stopped: squeezed at t = 0.05 s"),
        ({"status": "interrupted"}, 130, "interrupted at t = 0.05 s"),
    ],
)
def test_track_tells_how_it_ended(
    scene: Scene,
    monkeypatch: pytest.MonkeyPatch,
    changes: dict[str, Any],
    status: int,
    said: str,
) -> None:
    monkeypatch.setattr("softmpc.control.tracking.track_file", lambda *_: tracked(**changes))
    result = softmpc("track", scene(CIRCLE), "--json")
    assert result.exit_code == status
    assert json.loads(result.stdout)["rms_error_mm"] is None  # nothing after the settling time
    assert said in result.stderr


def test_track_keeps_what_was_done(
    scene: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out, run = tmp_path / "out", tracked(status="interrupted")
    monkeypatch.setattr("softmpc.control.tracking.track_file", lambda *_: run)
    assert softmpc("track", scene(CIRCLE), "--out", str(out)).exit_code == 130
    assert {"track.npz", "track.json", "track.png"} <= files(out)
    assert "track.gif" not in files(out)  # who interrupts does not want to wait


def test_track_for_people(scene: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    run = tracked(settle=0.01, clearance_m=0.02)
    monkeypatch.setattr("softmpc.control.tracking.track_file", lambda *_: run)
    lines = softmpc("track", scene(CIRCLE)).stdout.splitlines()
    assert lines[0] == "Made up"
    assert "RMS tip error           0 mm after 0.01 s" in lines
    assert "clearance of the path   20 mm to the edge of the workspace" in lines
    assert "steps                   2, 0 failed" in lines


# ---------------------------------------------------------------- wrong input

AT_REST = ("statics", "--pressure", "0,0,0,0,0,0")


@pytest.mark.parametrize(
    ("text", "words", "message"),
    [
        ("[manipulator", ("info",), "not valid TOML"),
        ("[model]\nsegmentz = 2", ("info",), "did you mean 'segments'"),
        ("[manipulator]\nsection_length = -0.1", ("info",), "section_length = -0.1 m: must be"),
        ("[manipulator]\nsection_length = nan", AT_REST, "section_length = nan m: must be"),
        ("[effects]\ngravity = [0, 1]", AT_REST, "must be a list of 3 values"),
        ("[manipulator]\nsections = 3\nyoung_modulus = [1e6, 1e6]", AT_REST, "(2 values)"),
        ("", ("statics",), "give either --pressure or --torque; see softmpc statics --help"),
        ("", (*AT_REST, "--torque", "0,0,0,0,0,0"), "give either --pressure or --torque"),
        ("", ("statics", "--pressure", "0,0,0"), "3 values given, this arm has 6 units"),
        ("", ("statics", "--torque", "0"), "1 values given, this arm has 6 units"),
        ("", ("statics", "--pressure", "0,x,0,0,0,0"), "'x' (value 2) is not a number"),
        ("", ("statics", "--pressure", "0,0,nan,0,0,0"), "nan (value 3) is not a finite number"),
        ("", ("statics", "--torque", "inf,0,0,0,0,0"), "inf (value 1) is not a finite number"),
        ("", ("statics", "--pressure", "0,1.2,0,0,0,0"), "unit 2 = 1.2 MPa: must be between"),
        ("", ("statics", "--pressure", "-0.1,0,0,0,0,0"), "unit 1 = -0.1 MPa: must be between 0"),
        ("", ("statics", "--torque", "0,0,0,0,0,3"), "unit 6 = 3 N·m: must be between 0 and 2.5"),
        (
            "[actuation]\nkind = 'pressure'",
            ("statics", "--torque", "0,0,0,0,0,0"),
            "takes pressures, not torques",
        ),
        ("", ("simulate",), "has no table [simulate]: it says how long to simulate"),
        ("[simulate]", ("simulate",), "duration: is missing"),
        (SWING, ("simulate", "--duration", "-1"), "duration = -1.0 s: must be above 0"),
        (SWING, ("simulate", "--duration", "soon"), "'soon' is not a valid float"),
        (SWING.replace("unit = 1", "unit = 4"), ("simulate",), "unit = 4: must be a whole number"),
        (SWING.replace("= 1.0", "= 9.0"), ("simulate",), "9 N·m: must be between 0 and 2.5 N·m"),
        ("", ("track",), "[track] is missing"),
        (CIRCLE.replace("horizon", "horizont"), ("track",), "did you mean 'horizon'"),
        ("", ("info", "--bad"), "No such option"),
    ],
)  # fmt: skip
def test_wrong_input(scene: Scene, text: str, words: tuple[str, ...], message: str) -> None:
    command, *options = words
    assert message in complaint(command, scene(text), *options)


def test_missing_files(tmp_path: Path) -> None:
    (tmp_path / "swing.toml").write_text(SWING)
    said = complaint("simulate", str(tmp_path / "swung.toml"))
    assert "no such file; did you mean 'swing.toml'?" in said
    assert "cannot be read" in complaint("info", str(tmp_path))
    assert "no such file" in complaint("compare", str(tmp_path / "a.csv"), str(tmp_path / "b.csv"))


def test_missing_words() -> None:
    assert complaint("info") == "Missing argument 'SCENE'; see softmpc info --help"
    assert "did you mean 'statics'?" in complaint("statik")


def test_folder_that_cannot_be_made(scene: Scene, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    assert "is a file; give a folder" in complaint(
        "info", scene(""), "--out", str(tmp_path / "file")
    )


def test_scene_that_cannot_run(scene: Scene) -> None:
    friction = SWING.replace("static", "hydraulic") + "[hydraulics]\nfriction = 100.0"
    assert "Coulomb friction" in complaint("simulate", scene(friction))


# ---------------------------------------------------------------- other ends


def fail_with(error: BaseException) -> Callable[..., Any]:
    def fail(*given: Any, **more: Any) -> Any:
        raise error

    return fail


def caused_by_ctrl_c() -> SystemError:
    error = SystemError("returned a result with an exception set")
    error.__cause__ = KeyboardInterrupt()
    return error


@pytest.mark.parametrize(
    ("error", "status", "said"),
    [
        (IntegrationError("no rest to start from"), 3, "no rest to start from"),
        (KeyboardInterrupt(), 130, "interrupted"),
        (caused_by_ctrl_c(), 130, "interrupted"),
        (RuntimeError("... KeyboardInterruptException"), 130, "interrupted"),
    ],
)
def test_errors_on_the_way(
    scene: Scene, monkeypatch: pytest.MonkeyPatch, error: BaseException, status: int, said: str
) -> None:
    monkeypatch.setattr("softmpc.simulation.run.simulate_file", fail_with(error))
    assert answer("simulate", scene(SWING), status=status) == {"error": said}
    assert softmpc("simulate", scene(SWING)).stderr.strip() == f"error: {said}"


def test_a_bug_shows_its_traceback(scene: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("softmpc.simulation.run.simulate_file", fail_with(ValueError("a bug")))
    result = softmpc("simulate", scene(SWING), "--json")
    assert result.exit_code == 1
    assert json.loads(result.stdout) == {"error": "unexpected ValueError: a bug"}
    assert "Traceback" in result.stderr


def test_nothing_half_written(
    scene: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out, path = tmp_path / "out", scene(HANGING)
    words = ("statics", path, "--pressure", PRESSURES, "--out", str(out))
    softmpc(*words)
    before = {name: (out / name).read_bytes() for name in files(out)}

    def crash(self: Any, target: Path) -> None:
        target.write_bytes(b"half")
        raise OSError("disk full")

    monkeypatch.setattr("matplotlib.figure.Figure.savefig", crash)
    result = softmpc(*words)
    assert result.exit_code == 2
    assert "posture.png: cannot be written: disk full" in result.stderr
    assert files(out) == before.keys()
    assert (out / "posture.png").read_bytes() == before["posture.png"]


def test_libraries_that_print_do_not_spoil_the_answer(
    scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    def chatty(*_: Any) -> TrackResult:
        print("banner of a solver")
        return tracked()

    monkeypatch.setattr("softmpc.control.tracking.track_file", chatty)
    result = softmpc("track", scene(CIRCLE), "--json")
    assert json.loads(result.stdout)["steps"] == 2
    assert "banner" in result.stderr


def test_verbose(scene: Scene) -> None:
    words = ("statics", scene(HANGING), "--pressure", PRESSURES)
    assert softmpc(*words).stderr == ""
    result = softmpc(*words, "-v", "--json")
    assert "INFO softmpc.cli.common: reading" in result.stderr
    assert json.loads(result.stdout)["converged"]
    logging.getLogger("softmpc").handlers.clear()


def test_from_a_shell(scene: Scene) -> None:
    command = [sys.executable, "-W", "error", "-m", "softmpc.cli", "statics", scene(HANGING)]
    good = subprocess.run(
        [*command, "--pressure", PRESSURES, "--json"], capture_output=True, text=True, check=False
    )
    assert (good.returncode, good.stderr) == (0, "")
    assert json.loads(good.stdout)["converged"]
    bad = subprocess.run([*command, "--pressure", "9"], capture_output=True, text=True, check=False)
    assert (bad.returncode, bad.stdout) == (2, "")
    assert bad.stderr == "error: --pressure: 1 values given, this arm has 6 units\n"


# ---------------------------------------------------------------- helpers


class Screen(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_progress_is_on_stderr(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    screen = Screen()
    monkeypatch.setattr(sys, "stderr", screen)
    with progress("moving") as report:
        for done in range(1, 5):
            report(done, 4)
    assert "moving: 100%" in screen.getvalue()
    assert "4/4" in screen.getvalue()
    assert capsys.readouterr().out == ""


def test_progress_is_gone_after_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    screen = Screen()
    monkeypatch.setattr(sys, "stderr", screen)
    with contextlib.suppress(click.Abort), progress("moving") as report:
        report(1, 4)
        raise click.Abort
    assert screen.getvalue().endswith("\r")


def test_a_notice_stands_on_a_line_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    screen = Screen()
    monkeypatch.setattr(sys, "stderr", screen)
    with progress("moving") as report:
        report(1, 4)
        notice("WARNING: too fast")
    before, after = screen.getvalue().split("WARNING: too fast\n")
    assert before.endswith(" \r") and "moving:" in before  # wiped, and drawn again below
    assert "moving:  25%" in after


def test_json_of_what_json_does_not_know() -> None:
    data = {"a": np.float64("nan"), "b": np.array([1.0, np.inf]), "c": (True, None), "d": Path("x")}
    wanted = {"a": None, "b": [1.0, None], "c": [True, None], "d": "x"}
    assert json.loads(as_json(data)) == wanted


def test_columns_for_people() -> None:
    assert table([("a", 1), ("long name", "x")]) == "a          1\nlong name  x"
    assert row([-1e-9, 1.5]) == "  0.00000    1.50000"
