"""Controllers in closed loop: errors against `softmpc.track`, costs, and what is asked for."""

from __future__ import annotations

import os
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import softmpc
from softmpc.accuracy.configuration import Configuration, Task, changed
from softmpc.accuracy.environment import environment
from softmpc.accuracy.loop import Loop
from softmpc.accuracy.loop_task import coarser, fine_scene, shortened, tracking
from softmpc.accuracy.work import MEASURED, Case, Measure
from softmpc.compiler import compiler
from softmpc.control import tracking as tracking_module
from softmpc.control.track_result import TrackResult
from softmpc.control.track_scene import read_tracking
from softmpc.errors import InputError, SceneError
from softmpc.model.scene_file import scene_from_dict

LOOP = Loop()
AS_GIVEN = Configuration("as given", "as given")
NO_DOUBT = {"its doubt": {"doubt_m": 0.0, "error_m": 1.0}}
CONTROLLER = "track.controller."
DOCUMENT: dict[str, Any] = {
    "title": "one section",
    "manipulator": {"sections": 1},
    "model": {"segments": 1},
    "effects": {"gravity": [0.0, 0.0, 9.81], "payload": {"mass": 0.02}},
    "actuation": {"kind": "static"},
    "track": {
        "path": "circle",
        "center": [0.03, 0.0, 0.3],
        "diameter": 0.02,
        "lap_time": 1.0,
        "laps": 0.35,
        "smooth_start": 0.3,
        "settle": 0.2,
        "controller": {"step": 0.025, "horizon": 8},
        "plant": {"tolerance": 1e-7},
    },
}
TASK = Task(DOCUMENT, quick=True)


def tracked(segments: int, **controller: Any) -> TrackResult:
    """The same by `softmpc.track`, the plant written into the scene file by hand."""
    document = changed(DOCUMENT, {f"{CONTROLLER}{key}": v for key, v in controller.items()})
    model = {"segments": segments, "formulation": "virtual-power", "mass": "gauss-2"}
    document["track"]["plant"]["scene"] = {"model": model}
    task = read_tracking(document["track"], Path(), document)
    return softmpc.track(scene_from_dict(DOCUMENT), task)


@pytest.fixture(autouse=True)
def _no_clearance(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nobody here asks how far the path is from the edge of the workspace."""
    monkeypatch.setattr(tracking_module, "find_clearance", lambda *_: None)


@pytest.fixture(scope="module")
def as_given() -> dict[str, Any]:
    with environment(SOFTMPC_COMPILE="never"):
        return LOOP.error(TASK, AS_GIVEN, NO_DOUBT)


@pytest.mark.slow
def test_error_is_that_of_a_tracking_run(as_given: dict[str, Any]) -> None:
    run = tracked(4)
    off = np.linalg.norm(run.tips[:, -1] - run.reference, axis=1)[run.time >= 0.2]
    assert run.u_start is not None
    moves = np.abs(np.diff(np.vstack([run.u_start, run.u]), axis=0))
    assert as_given["error_m"] == pytest.approx(off.max(), rel=1e-6)
    assert as_given["rms_m"] == pytest.approx(np.sqrt(np.mean(off**2)), rel=1e-6)
    assert as_given["variation"] == pytest.approx(moves.sum(), rel=1e-6)
    assert as_given["cost"] == pytest.approx(run.cost, rel=1e-6)
    assert as_given["failures"] == run.failures


def test_own_plant_has_no_model_error(as_given: dict[str, Any]) -> None:
    own = tracked(1).summary()["max_error_mm"] / 1e3
    assert as_given["own_plant_m"] == pytest.approx(own, rel=1e-3)
    assert as_given["own_plant_m"] < 0.1 * as_given["error_m"]


@pytest.mark.slow
def test_doubt_is_the_difference_on_a_coarser_plant(as_given: dict[str, Any]) -> None:
    less = tracked(3).summary()["max_error_mm"] / 1e3
    doubt = LOOP.reference(TASK, "its doubt")
    assert doubt["error_m"] == pytest.approx(as_given["error_m"], rel=1e-6)
    assert doubt["doubt_m"] == pytest.approx(abs(as_given["error_m"] - less), rel=1e-4)


@pytest.mark.slow
def test_a_controller_that_is_far_off_has_a_doubt_of_its_own(as_given: dict[str, Any]) -> None:
    better = {"its doubt": {"doubt_m": 0.0, "error_m": as_given["error_m"] / 4}}
    less = tracked(3).summary()["max_error_mm"] / 1e3
    found = LOOP.error(TASK, AS_GIVEN, better)
    assert found["doubt_m"] == pytest.approx(abs(as_given["error_m"] - less), rel=1e-4)


@pytest.mark.slow
def test_accuracy_ends_where_the_model_does(as_given: dict[str, Any]) -> None:
    """Two segments are nearer to the plant than one."""
    finer = Configuration("", "", {f"{CONTROLLER}scene.model.segments": 2})
    two = LOOP.error(TASK, finer, NO_DOUBT)
    assert two["error_m"] < 0.5 * as_given["error_m"]


@pytest.mark.slow
def test_other_deviations_are_charged_as_those_given() -> None:
    soft = Configuration("", "", {f"{CONTROLLER}tip_deviation": 0.01})
    found = LOOP.error(TASK, soft, NO_DOUBT)
    run = tracked(4, tip_deviation=0.01)
    given = dict(run.costs) | {"tip": run.costs["tip"] * 100.0}
    assert found["cost"] == pytest.approx(sum(given.values()), rel=1e-6)


def test_plant_does_not_depend_on_the_configuration() -> None:
    """Changes of the arm are what the controller takes it for; effects of the plant stay."""
    changes = {"model.segments": 2, "model.mass": "lumped", "effects.payload": None}
    scene, task = tracking(TASK, Configuration("", "", changes))
    assert scene == scene_from_dict(DOCUMENT)
    assert task.plant.scene == fine_scene(TASK)
    assert task.plant.scene.segments == 4
    assert task.plant.scene.effects == scene.effects
    assert task.controller.scene == scene_from_dict(changed(DOCUMENT, changes))
    assert coarser(fine_scene(TASK)).segments == 3
    assert fine_scene(Task(DOCUMENT)).segments == 8
    richer = changed(DOCUMENT, {"track.plant.scene": {"effects": {"payload": {"mass": 0.05}}}})
    richer = changed(richer, {f"{CONTROLLER}scene.model.segments": 3})
    plant = fine_scene(Task(richer, quick=True))
    assert plant.segments == 6
    assert plant.effects != scene.effects


def test_long_paths_are_cut() -> None:
    """To their first seconds, on the same way; settled and at full speed before the end."""
    long = changed(DOCUMENT, {"track.laps": 5, "track.smooth_start": 1.0, "track.settle": 1.0})
    _, task = tracking(Task(long, quick=True), AS_GIVEN)
    whole = read_tracking(long["track"], Path(), long)
    assert task.reference.duration == pytest.approx(1.5)
    assert task.settle == pytest.approx(0.6)
    assert task.reference.law.smooth_start == pytest.approx(0.6)
    assert np.allclose(task.reference.position([0.0]), whole.reference.position([0.0]))
    speed = np.diff(task.reference.law.phase(np.array([1.3, 1.4])))
    assert speed == pytest.approx(0.1)  # a lap a second
    assert shortened(whole, 10.0) is whole


def test_what_cannot_be_measured() -> None:
    without = {name: part for name, part in DOCUMENT.items() if name != "track"}
    assert "add a table [track]" in LOOP.missing(Task(without))
    assert LOOP.missing(TASK) == ""
    with pytest.raises(SceneError, match="no path to follow"):
        LOOP.error(Task(without), AS_GIVEN, NO_DOUBT)
    for measure in (lambda c: LOOP.error(TASK, c, NO_DOUBT), lambda c: LOOP.cost(TASK, c)):
        with pytest.raises(SceneError, match="variant of a controller: 'in D'; did you mean"):
            measure(Configuration("", "", variant="in D"))
    many = Configuration("", "", {f"{CONTROLLER}scene.model.segments": 4})
    with pytest.raises(SceneError, match="4 segments a section and the plant of the study 4"):
        LOOP.error(TASK, many, NO_DOUBT)
    with pytest.raises(InputError, match="unknown reference: 'fine'"):
        LOOP.reference(TASK, "fine")
    assert LOOP.reference(TASK, "plant")["segments"] == 4


def test_configurations_can_be_read_and_told_apart() -> None:
    """Each is a controller, and what is the same by two names is measured once."""
    for task in (TASK, Task(DOCUMENT)):
        every = LOOP.configurations(task)
        assert every[0].changes == {} and every[0].axis == "as given"
        assert len({(one.axis, one.name) for one in every}) == len(every)
        given = tracking(task, AS_GIVEN)[1]
        for one in every:
            found = tracking(task, one)[1]
            assert (found.controller == given.controller) == (not one.changes)
        grown = next(one for one in every if "growing" in one.name)
        assert sum(grown.changes[f"{CONTROLLER}grid"]) == 8
    blocked = deepcopy(DOCUMENT)
    blocked["track"]["controller"]["blocks"] = [1, 3, 4]
    for one in LOOP.configurations(Task(blocked)):
        tracking(Task(blocked), one)


def test_what_a_step_costs(monkeypatch: pytest.MonkeyPatch) -> None:
    """Beside the scene as given, in one process; the user's cache stays as it is."""
    monkeypatch.setenv("SOFTMPC_CACHE", "as before")
    long = Configuration("", "", {f"{CONTROLLER}horizon": 32})
    found = Measure(TASK)(Case("loop", "cost", configuration=long))
    assert found["status"] == MEASURED
    assert found["ratio"] == pytest.approx(found["median_s"] / found["beside_s"])
    assert found["steps"] == 20
    assert 0 < found["median_s"] <= found["time_s"] < 10
    assert found["build_s"] > 0 and found["instructions"] > 1000
    assert "c_bytes" not in found  # in quick mode, where only a controller in C has them
    assert os.environ["SOFTMPC_CACHE"] == "as before"


@pytest.mark.slow
@pytest.mark.skipif(compiler() is None, reason="no C compiler")
def test_in_c(as_given: dict[str, Any]) -> None:
    in_c = Configuration("in C", "in C", variant="in C")
    error = Measure(TASK, {"loop": NO_DOUBT})(Case("loop", "error", configuration=in_c))
    assert error["status"] == MEASURED
    assert error["error_m"] == pytest.approx(as_given["error_m"], rel=1e-6)
    cost = Measure(TASK)(Case("loop", "cost", configuration=in_c))
    assert cost["status"] == MEASURED
    assert 0 < cost["compile_s"] < cost["build_s"]
    assert 1e5 < cost["c_bytes"] < 1e7
