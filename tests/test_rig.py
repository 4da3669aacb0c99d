"""Closed loops on a rig: what goes in wrong never comes out wrong, and the loop comes back."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from softmpc import build
from softmpc.cli.main import main
from softmpc.control.tracking import Tracking, read_track_file
from softmpc.errors import BuildError, InputError, SceneError
from softmpc.model.scene import Scene
from softmpc.rig.faults import FAULTS, Absent, BudgetOverrun, Fault, NotANumber, SolverCap, Stuck
from softmpc.rig.result import RigResult
from softmpc.rig.rigging import Rig, read_rig_file, rig_up
from softmpc.rig.scene_table import RigSettings, read_rig
from softmpc.rig.supervision import State
from softmpc.simulation.integrator import IntegrationError
from softmpc.view.rig import rig_figure

SCENE = """
schema = 1
[effects]
gravity = [0.0, 0.0, 9.81]
[track]
path = "circle"
center = [0.12, 0.0, 0.57]
diameter = 0.06
lap_time = 4.0
laps = 0.5
settle = 0.5
[track.controller]
horizon = 10
torque_rate = 15.0
back_off = 0.05
[track.plant]
tolerance = 1e-6
scene = {effects = {payload = {mass = 0.1}}}
[rig]
wait = 0.25
seed = 2
[rig.section_tips]
latency = 0.010
[rig.unit_pressures]
[rig.supervision]
blind_after = 0.15
"""


@pytest.fixture(scope="module")
def scene_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("rig") / "rig.toml"
    path.write_text(SCENE)
    return path


@pytest.fixture(scope="module")
def task(scene_file: Path) -> tuple[Scene, Tracking, RigSettings]:
    _, scene, tracking = read_track_file(scene_file)
    settings = read_rig_file(scene_file)
    assert settings is not None
    return scene, tracking, settings


@pytest.fixture(scope="module")
def rig(task: tuple[Scene, Tracking, RigSettings]) -> Rig:
    return rig_up(*task)


def run(rig: Rig, *faults: Fault, duration: float = 1.5) -> RigResult:
    machine = rig.machine
    machine.faults = faults
    changed = replace(rig, settings=replace(rig.settings, faults=faults))
    return changed.run(duration=duration)


def check_inputs(rig: Rig, result: RigResult) -> None:
    """Finite, within the limits of torque and torque rate."""
    u, guard = result.track.u, rig.pilot.mpc.guard
    assert np.all(np.isfinite(u))
    assert np.all(u >= guard.low) and np.all(u <= guard.high)
    start = result.track.u_start
    assert start is not None
    change = np.diff(np.vstack([start, u]), axis=0)
    assert np.all(change >= guard.fall - 1e-12) and np.all(change <= guard.rise + 1e-12)


@pytest.fixture(scope="module")
def usual(rig: Rig) -> RigResult:
    return run(rig, duration=2.5)


def test_without_faults(rig: Rig, usual: RigResult) -> None:
    summary = usual.summary()
    check_inputs(rig, usual)
    assert summary["worst_state"] == "normal" and not usual.transitions
    assert summary["rms_error_mm"] < 2.0 and summary["rms_estimate_mm"] < 2.0
    assert 0.6 < summary["nis"]["section_tips"] < 1.6
    assert summary["back_off_used"]["pressure"] < 1.0


def test_same_seed_same_run(rig: Rig, usual: RigResult) -> None:
    again = run(rig, duration=2.5)
    assert np.array_equal(usual.track.u, again.track.u)
    assert np.array_equal(usual.strains, again.strains)


def test_files(usual: RigResult, tmp_path: Path) -> None:
    paths = usual.save(tmp_path)
    assert [path.name for path in paths][-2:] == ["rig.npz", "estimate.csv"]
    again = RigResult.load(tmp_path)
    for name in ("strains", "d", "nis", "state"):
        assert np.array_equal(getattr(usual, name), getattr(again, name))
    assert again.names == usual.names and again.summary() == usual.summary()
    for content in (b"", b"PK\x03\x04 and no more"):
        (tmp_path / "rig.npz").write_bytes(content)
        with pytest.raises(InputError, match=r"rig\.npz"):
            RigResult.load(tmp_path)
    with pytest.raises(InputError, match="no such file"):
        RigResult.load(tmp_path / "nowhere")


@pytest.mark.sampled
@pytest.mark.parametrize("kind", sorted(FAULTS))
def test_every_fault(kind: str, rig: Rig, task: tuple[Scene, Tracking, RigSettings]) -> None:
    fault = FAULTS[kind](0.5, 0.3)
    if kind == "payload_dropped":
        own = rig_up(*task[:2], replace(task[2], faults=(fault,)))
        result = own.run(duration=1.5)
    else:
        result = run(rig, fault)
    check_inputs(rig, result)
    assert result.track.status == "finished" and len(result.state) == 60
    assert result.state[-1] <= State.DEGRADED  # back within 0.7 s
    assert result.faults == ((str(fault), 0.5, 0.8),)


def test_blind_it_falls_back_and_comes_back(rig: Rig) -> None:
    result = run(rig, Absent(0.5, 0.4), duration=2.0)
    check_inputs(rig, result)
    words = [line.split("s  ", 1)[1] for line in result.transitions]
    assert words[0].startswith("normal → degraded: no section_tips")
    assert words[1].startswith("degraded → fall back: no section_tips for")
    assert "recovered" in words[-1] and result.state[-1] == State.NORMAL
    held = result.track.u[result.state == State.FALL_BACK]
    assert len(held) > 5 and np.abs(np.diff(held, axis=0))[-1].max() < 1e-9  # it stands still


def test_blind_for_long_it_stops(rig: Rig) -> None:
    result = run(rig, Absent(0.5, 60.0), duration=4.0)
    check_inputs(rig, result)
    assert result.state[-1] == State.SAFE_STOP
    assert np.abs(result.track.u[-1]).max() < 1e-9  # torques are down


def test_all_at_once(rig: Rig) -> None:
    faults = (
        NotANumber(0.3, 0.4), NotANumber(0.3, 0.4, sensor="unit_pressures"), SolverCap(0.4, 0.3),
        BudgetOverrun(0.5, 0.3), Stuck(0.5, 0.2, units=(1, 4)),
    )  # fmt: skip
    result = run(rig, *faults, duration=2.0)
    check_inputs(rig, result)
    assert result.state[-1] <= State.DEGRADED


@pytest.mark.parametrize("after", [0.1, 0.6])
def test_a_plant_that_stops(rig: Rig, monkeypatch: pytest.MonkeyPatch, after: float) -> None:
    """While the arm waits at rest (0.25 s), and later: what was until then is there."""
    plant = rig.machine.plants[""]
    advance = plant.advance

    def until(*arguments: Any) -> Any:
        if rig.machine.tick >= 1000 * (after - 0.25):
            raise IntegrationError("cannot go on")
        return advance(*arguments)

    monkeypatch.setattr(plant, "advance", until)
    result = run(rig)
    assert result.track.status == "plant stopped: cannot go on"
    assert len(result.state) == (0 if after < 0.25 else 14)
    assert len(result.track.time) == 1 + 25 * len(result.state)
    assert result.summary()["steps"] == len(result.state)


def test_interrupted_while_it_waits(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    def stop(*_: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(rig.pilot, "listen", stop)
    result = run(rig)
    assert result.track.status == "interrupted" and len(result.state) == 0


# ---------------------------------------------------------------- the table


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ({"camera": {}}, "camera"),
        ({"section_tips": {"rate": 130.0}}, "7.692 ms"),
        ({"section_tips": {"noise": -1.0}}, "noise"),
        ({"section_tips": {"latencey": 0.01}}, "latency"),
        ({"section_tips": {"sections": [3]}, "seed": 1}, "from 1 to 2"),
        ({"estimator": {"forces": ["curl"]}}, "curl"),
        ({"estimator": {"noise": {"force": 1.0}}}, "forces"),
        ({"estimator": {"noise": {"forces": -1.0}}}, r"noise\].* forces = -1.0"),
        ({"estimator": {"spread": {"strains": -0.1}}}, r"spread\].* strains = -0.1"),
        ({"section_tips": {"latency": 4e-4}}, "latency = 0.0004 s: must be a whole number of mil"),
        ({"supervision": {"blind_after": 0.0}}, "blind_after"),
        ({"command_delay": -0.1}, "command_delay"),
        ({"command_delay": 0.0125}, r"\[rig\].* command_delay = 0.0125 s: must be a whole"),
        ({"faults": [{"kind": "boom", "start": 0.0, "duration": 1.0}]}, "boom"),
        ({"faults": [{"kind": "nan", "start": 0.0}]}, "duration"),
        ({"faults": [{"kind": "nan", "start": 0.0, "duration": 1.0, "sensor": "eye"}]}, "eye"),
        ({"faults": [{"kind": "spike", "start": 0.0, "duration": 1.0, "sise": 1.0}]}, "size"),
        ({"faults": {"kind": "nan"}}, "faults"),
    ],
)
def test_wrong_tables(
    table: dict[str, Any], said: str, task: tuple[Scene, Tracking, RigSettings]
) -> None:
    with pytest.raises((SceneError, InputError), match=said):
        _used(table, task[0])


def _used(table: dict[str, Any], scene: Scene) -> None:
    for sensor in read_rig(table).sensors:
        sensor.reading(build(scene))


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        (Stuck(9.0, 1.0, units=(7,)), "units"),
        (
            NotANumber(9.0, 1.0, sensor="piston_speed"),
            "no sensor 'piston_speed', only section_tips",
        ),
        (SolverCap(9.0, 1.0), "real-time or sqp"),
    ],
)
def test_faults_of_what_is_not_there_are_refused_before_the_run(
    fault: Fault, said: str, task: tuple[Scene, Tracking, RigSettings]
) -> None:
    scene, tracking, settings = task
    converged = replace(tracking, controller=replace(tracking.controller, solver="ipopt"))
    with pytest.raises(InputError, match=rf"^\[rig\]: fault.*{said}"):
        rig_up(scene, converged, replace(settings, faults=(fault,)), _too_late)


def test_what_is_wrong_with_the_plant_is_said_to_be(
    task: tuple[Scene, Tracking, RigSettings],
) -> None:
    scene, tracking, settings = task
    arm = scene.manipulator
    rough = scene.with_(manipulator=replace(arm, hydraulics=replace(arm.hydraulics, friction=9.0)))
    wrong = replace(tracking, plant=replace(tracking.plant, scene=rough))
    with pytest.raises(BuildError, match=r"^\[track.plant\] scene: hydraulics.friction"):
        rig_up(scene, wrong, settings, _too_late)


def test_a_fault_after_the_end_of_the_run_is_said(
    task: tuple[Scene, Tracking, RigSettings], caplog: pytest.LogCaptureFixture
) -> None:
    scene, tracking, settings = task
    converged = replace(tracking, controller=replace(tracking.controller, solver="fatrop"))
    with pytest.raises(InputError):  # before the path is looked at
        rig_up(scene, converged, replace(settings, faults=(Stuck(9.0, 1.0), SolverCap(1.0, 1.0))))
    assert caplog.messages == ["fault stuck from 9 s for 1 s: the run ends at 2.5 s"]


def _too_late(done: int, total: int) -> None:
    raise AssertionError(f"the path is looked at, {done} of {total}")


def test_planar_arms_need_no_choice_of_forces(task: tuple[Scene, Tracking, RigSettings]) -> None:
    planar = replace(task[0], strains=("epsilon", "kappa_y"))
    names = read_rig({}).disturbance(planar).names
    assert "force on kappa_y_2" in names and not any("kappa_x" in name for name in names)


def test_faults_do_not_stretch_the_picture(usual: RigResult) -> None:
    """One that lasts longer than the run, one after its end, two at once."""
    faults = (("stuck", 1.0, 3600.0), ("nan", 1.0, 1.5), ("spike", 90.0, 91.0))
    made = rig_figure(replace(usual, faults=faults))
    assert all(axes.get_xlim()[1] < 1.1 * usual.track.time[-1] for axes in made.axes)
    last = made.axes[-1]
    assert [text.get_text() for text in last.get_legend().get_texts()] == ["1: stuck", "2: nan"]
    made.canvas.draw()
    one, two = (text.get_window_extent() for text in last.texts)
    assert not one.overlaps(two)


def test_picture_of_a_run_without_disturbance(usual: RigResult) -> None:
    """No panel for what there is not; innovations of a sensor without noise do not fill theirs."""
    none = np.zeros((len(usual.state), 0))
    names = usual.names[0], ()
    nis = np.where(usual.innovation_sensor == 1, 1e-20, usual.nis)
    made = rig_figure(replace(usual, names=names, d=none, d_spread=none, nis=nis))
    assert [axes.get_title(loc="left").split(",")[0] for axes in made.axes] == [
        "tip", "innovations", "supervision"
    ]  # fmt: skip
    assert made.axes[1].get_ylim()[0] >= 1e-3


@pytest.mark.slow
def test_a_payload_that_is_not_there(task: tuple[Scene, Tracking, RigSettings]) -> None:
    scene, tracking, settings = task
    bare = replace(tracking, plant=replace(tracking.plant, scene=None))
    dropped = (FAULTS["payload_dropped"](1.0, 1.0),)
    with pytest.raises(SceneError, match="payload"):
        rig_up(scene, bare, replace(settings, faults=dropped))


# ---------------------------------------------------------------- the command


@pytest.mark.slow
def test_command(scene_file: Path, tmp_path: Path) -> None:
    text = scene_file.read_text().replace("laps = 0.5", "laps = 0.2").replace("settle = 0.5", "")
    text = text.replace("[track]\n", "[track]\nsettle = 0.1\n")
    short = tmp_path / "short.toml"
    short.write_text(text)
    out = tmp_path / "out"
    found = CliRunner().invoke(main, ["track", str(short), "--json", "--out", str(out)])
    assert found.exit_code == 0, found.output
    data = json.loads(found.stdout)
    assert data["worst_state"] == "normal" and "back_off_used" in data
    names = {path.name for path in out.iterdir()}
    assert {"rig.png", "estimate.png", "rig.npz", "estimate.csv", "track.png"} <= names
    found = CliRunner().invoke(main, ["track", str(short), "--compare"])
    assert found.exit_code == 2 and "--ideal" in found.stderr
