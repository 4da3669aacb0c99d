"""Errors and costs of motions, against other integrators, other meshes and `ablate`."""

from __future__ import annotations

import json
import math
import os
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from arms import PAPER, arm

from softmpc.accuracy.configuration import Configuration, Task
from softmpc.accuracy.family import Numbers
from softmpc.accuracy.motion import Motion
from softmpc.accuracy.motion_axes import changes_of
from softmpc.accuracy.motion_integrator import steps_between
from softmpc.accuracy.motion_reference import BEST, limit, weights
from softmpc.accuracy.motion_task import model_of, moved, settings_of
from softmpc.accuracy.motion_variants import DERIVATIVES, model_with
from softmpc.control.track_scene import read_tracking
from softmpc.errors import InputError, SceneError
from softmpc.model.actuation import StaticDrive
from softmpc.model.counting import executed
from softmpc.model.effects import Gravity
from softmpc.model.scene import Scene, default_effects
from softmpc.model.scene_file import scene_from_dict, scene_to_dict
from softmpc.simulation.integrator import IntegrationError
from softmpc.study.ablate import Baseline
from softmpc.study.measure import Cost, Runner, motion_of
from softmpc.study.variants import additions, variants

MOTION = Motion()
# One section out of plane: both bendings, twist and stretch take part.
EFFECTS = (Gravity((1.0, 0.0, 9.0)), *(e for e in default_effects() if e.name != "gravity"))
SCENE = Scene(arm(PAPER.sections[0]), effects=EFFECTS, actuation=StaticDrive())
MOVING = {
    "duration": 0.4,
    "sample_time": 0.02,
    "tip_tolerance": 1e-7,
    "steps": [{"unit": 1, "at": 0.1, "torque": 1.0}],
    "ramps": [{"unit": 2, "from": 0.1, "to": 0.3, "slope": 4.0}],
}
SHORT = {**scene_to_dict(SCENE), "simulate": MOVING}
PRINTED = {"model.formulation": "newton-euler", "model.mass": "lumped"}
LIMIT = (2, 3, 4)  # segments a section, in place of the many of a study


def task_of(document: dict, **changes: object) -> Task:
    """A quick study of a scene file with some tables in place of its own."""
    return Task({**document, **changes}, quick=True)


TASK = task_of(SHORT)


@pytest.fixture(scope="module")
def references() -> dict[str, Numbers]:
    """References of the short motion as a study keeps them, of few segments."""
    found = {
        "fine": limit(TASK, LIMIT, 60.0),
        "coarser": limit(TASK, (1, 2, 3), 60.0),
        **{name: MOTION.reference(TASK, name) for name in MOTION.references(TASK)[2:]},
    }
    return json.loads(json.dumps(found))


def of_segments(count: int, **changes: object) -> Configuration:
    return Configuration("x", "x", BEST | {"model.segments": count, **changes})


# ---------------------------------------------------------------- errors


@pytest.mark.slow
def test_an_error_agrees_with_another_integrator_and_other_meshes(references) -> None:
    """IDAS on 3 and 6 segments, extrapolated by Richardson, in place of Radau on 2, 3 and 4."""
    runs = []
    for count in (3, 6):
        document = of_segments(count).document(TASK)
        model = model_of(document)
        settings = settings_of(TASK, document, model)
        numbers = {"method": "idas", "tolerance": 1e-10, "tip_tolerance": None}
        runs.append(motion_of(model, replace(settings, **numbers)).tips)
    truth = (4 * runs[1] - runs[0]) / 3
    found = MOTION.error(TASK, of_segments(1), references)
    own = model_of(of_segments(1).document(TASK))
    tips = motion_of(own, settings_of(TASK, of_segments(1).document(TASK), own)).tips
    gaps = np.linalg.norm(tips - truth, axis=2)
    assert found["error_m"] > 20 * found["doubt_m"] > 0
    assert found["error_m"] == pytest.approx(gaps.max(), abs=found["doubt_m"])
    assert found["rms_m"] == pytest.approx(np.sqrt((gaps[:, -1] ** 2).mean()), abs=found["doubt_m"])
    assert found["by_section_m"] == pytest.approx(gaps.max(axis=0), abs=found["doubt_m"])


@pytest.mark.slow
def test_errors_fall_with_the_square_of_the_segments(references) -> None:
    errors = [MOTION.error(TASK, of_segments(n), references)["error_m"] for n in (1, 2, 3)]
    assert math.log(errors[1] / errors[2]) / math.log(3 / 2) == pytest.approx(2.0, abs=0.2)
    assert errors[0] > 3 * errors[1]
    lumped = MOTION.error(TASK, of_segments(3, **{"model.mass": "lumped"}), references)
    assert lumped["error_m"] > 5 * errors[2]


@pytest.mark.parametrize("counts", [(2, 3, 4), (6, 8, 12), (4, 8, 16)])
def test_weights_leave_neither_square_nor_fourth_power(counts) -> None:
    n = np.array(counts, float)
    assert weights(counts) @ np.array([n**0, n**-2, n**-4]).T == pytest.approx([1, 0, 0], abs=1e-12)


@pytest.mark.slow
def test_changes_agree_with_those_of_ablate(references) -> None:
    """`ablate` compares both at a tight tolerance, by its own code."""
    scene = scene_from_dict(dict(SHORT))
    settings = settings_of(TASK, dict(SHORT), model_of(dict(SHORT)))
    baseline = Baseline.of(scene, Runner(settings, repeats=1))
    left_out, added = "without environment_damping", "with water_mass"
    known = {change.name: change for change in [*variants(scene), *additions(scene)]}
    for name in (left_out, added, "elasticity strain"):
        row = baseline.row(known[name])
        mine = Configuration("effects", name, changes_of(scene, known[name]))
        found = MOTION.error(TASK, mine, references)
        assert row.errors is not None
        assert found["change_m"] == pytest.approx(row.errors.worst, abs=1e-6)
        assert row.errors.worst > 1e-4
        assert ("error_m" in found) == (name != added)


def test_the_scene_as_given_has_no_change_beside_its_error(references) -> None:
    found = MOTION.error(TASK, Configuration("as given", "as given"), references)
    assert set(found) == {"error_m", "rms_m", "by_section_m", "doubt_m"}


@pytest.mark.parametrize("method", ["radau", "idas"])
def test_integration_is_measured_against_another_method(references, method: str) -> None:
    key, loose, tight = (
        ("tip_tolerance", 1e-4, 1e-6) if method == "radau" else ("tolerance", 1e-5, 1e-8)
    )
    found = []
    for value in (loose, tight):
        changes = {"simulate.tip_tolerance": None, "simulate.method": method}
        one = Configuration("integrator", "x", changes | {f"simulate.{key}": value})
        found.append(MOTION.error(TASK, one, references))
    assert MOTION.fitted("integrator") == ("integration_m",)
    assert MOTION.fitted("drive") == ("error_m",)
    assert 1e-3 > found[0]["integration_m"] > 3 * found[1]["integration_m"] > 0
    assert found[1]["integration_doubt_m"] < 1e-9


def test_ways_to_the_jacobian_differ_in_cost_alone(references) -> None:
    errors, made = [], []
    for variant in DERIVATIVES:
        one = Configuration("derivatives", variant, variant=variant)
        errors.append(MOTION.error(TASK, one, references)["error_m"])
        made.append(executed(model_with(SCENE, variant).residual_jacobian))
    assert errors == pytest.approx([errors[0]] * 3, rel=1e-9)
    assert len(set(made)) == 3


# ---------------------------------------------------------------- what is measured


@pytest.mark.slow
def test_configurations_are_the_changed_scenes() -> None:
    """Written as keys of the file, a change is the same scene; a quick study measures less."""
    document = tomllib.loads(Path("examples/accuracy.toml").read_text())
    scene, task = scene_from_dict(dict(document)), Task(document)
    full = MOTION.configurations(task)
    by_name, checked = {one.name: one for one in full}, 0
    for change in [*variants(scene), *additions(scene)]:
        one = by_name.get(change.name)
        if one is not None and one.axis in ("strains", "effects", "effects added", "drive"):
            assert scene_from_dict(one.document(task)) == change.apply(scene), change.name
            checked += 1
    assert checked > 15
    quick = MOTION.configurations(replace(task, quick=True))
    assert quick[0].changes == full[0].changes == {}
    assert len(quick) < 50 < len(full)
    assert {one.axis for one in quick} == {one.axis for one in full}


def test_steps_fit_between_the_times_at_which_inputs_bend() -> None:
    settings = settings_of(TASK, dict(SHORT), model_of(dict(SHORT)))
    steps = steps_between(settings, 3)
    assert steps == pytest.approx([0.1 / 3, 0.1 / 6, 0.1 / 12])


def test_orders_are_given_where_motions_are_smooth() -> None:
    """Without drive states they are; hydraulics answer a jump faster than any of these steps."""
    static = {one.name: one.order for one in MOTION.configurations(TASK) if "step" in one.name}
    wet = task_of(SHORT, actuation={"kind": "hydraulic"})
    stiff = {one.name: one.order for one in MOTION.configurations(wet) if "step" in one.name}
    assert set(static.values()) == {5.0}  # in quick mode by Radau IIA alone
    assert set(stiff.values()) == {None}


def test_long_motions_are_cut_where_their_inputs_begin() -> None:
    late = {"duration": 30.0, "sample_time": 0.01, "steps": [{"unit": 1, "at": 6.0, "torque": 1.0}]}
    task = task_of(SHORT, simulate=late)
    settings = settings_of(task, dict(task.document), model_of(dict(task.document)))
    assert settings.duration == 2.0
    assert settings.profile.breakpoints == pytest.approx([0.05])
    whole = Task(task.document)
    assert settings_of(whole, dict(whole.document), model_of(dict(SHORT))).duration == 10.0


def test_a_start_from_a_file_is_carried_to_other_segments(tmp_path) -> None:
    short = settings_of(TASK, dict(SHORT), model_of(dict(SHORT)))
    motion_of(model_of(dict(SHORT)), replace(short, duration=0.2)).save(tmp_path)
    simulate = {"duration": 0.1, "start": "simulation.npz"}
    task = Task({**SHORT, "simulate": simulate}, str(tmp_path), quick=True)
    for count in (1, 2):
        document = of_segments(count).document(task)
        model = model_of(document)
        settings = settings_of(task, document, model)
        assert isinstance(settings.start, np.ndarray)
        tip = np.asarray(model.frames(settings.start[: model.strains])[0])[:, -1]
        if count == 1:
            first = tip
    assert tip == pytest.approx(first, abs=1e-12)


TRACK = {
    "path": "line",
    "start": [0.0, 0.0, 0.6],
    "end": [0.01, 0.005, 0.6],
    "lap_time": 0.6,
    "laps": 0.5,
    "smooth_start": 0.2,
    "settle": 0.1,
    "controller": {"horizon": 8},
}


@pytest.mark.slow
def test_the_torques_of_a_tracking_task_lead_along_its_path(tmp_path, monkeypatch) -> None:
    """In open loop the same model goes where it went under control; the task is run once."""
    monkeypatch.setenv("SOFTMPC_CACHE", str(tmp_path))
    document = {"actuation": {"kind": "static"}, "track": TRACK}
    task = Task(document, quick=True)
    assert MOTION.missing(task) == ""
    model = model_of(document)
    settings = settings_of(task, document, model)
    run = moved(model, settings, 60.0)
    path = read_tracking(TRACK, Path(), document).reference
    assert settings.duration == pytest.approx(0.4)
    assert np.linalg.norm(run.tips[:, -1] - path.position(run.time), axis=1).max() < 1e-3
    assert run.tips[0, -1] == pytest.approx(TRACK["start"], abs=1e-6)
    (kept,) = tmp_path.glob("inputs-*.json")
    assert len(json.loads(kept.read_text())["times"]) == 18


# ---------------------------------------------------------------- costs


@pytest.mark.slow
def test_costs_are_those_of_the_model_and_leave_no_trace() -> None:
    before = dict(os.environ)
    found = MOTION.cost(TASK, of_segments(2))
    assert dict(os.environ) == before
    model = model_of(of_segments(2).document(TASK))
    cost = Cost.of(model, 0.0)
    assert (found["instructions"], found["states"]) == (cost.instructions, cost.states)
    for name in ("time_s", "ratio", "build_s", "residual_us", "jacobian_us", "memory_mib"):
        assert found[name] > 0, name
    assert found["spread_s"] >= 0
    assert "compile_s" not in found


# ---------------------------------------------------------------- reasons


def test_scenes_without_a_motion_are_told_what_to_add() -> None:
    bare = {key: table for key, table in SHORT.items() if key != "simulate"}
    assert "add a table [simulate] or [track]" in MOTION.missing(Task(bare))
    assert MOTION.missing(TASK) == ""
    wrong = task_of(SHORT, simulate={"duration": 1.0, "steps": [{"unit": 9, "at": 0, "torque": 1}]})
    assert "unit" in MOTION.missing(wrong)
    with pytest.raises(SceneError, match=r"add a table \[simulate\]"):
        settings_of(Task(bare), bare, model_of(bare))


@pytest.mark.parametrize(
    ("configuration", "message"),
    [
        (Configuration("x", "x", variant="by hand"), "by hand.*written out"),
        (Configuration("x", "x", {"model.strains": ["epsilon", "kappa_x"]}), "not planar: kappa_y"),
        (Configuration("x", "x", PRINTED, variant="in loops"), "has one way"),
        (Configuration("x", "x", {"model.segments": 0}), "segments"),
    ],
)
def test_what_cannot_be_measured_says_why(references, configuration, message: str) -> None:
    with pytest.raises(SceneError, match=message):
        MOTION.error(TASK, configuration, references)


def test_motions_that_take_too_long_or_stop_are_errors(references, monkeypatch) -> None:
    monkeypatch.setattr("softmpc.accuracy.motion.PATIENCE", {True: 0.0})
    with pytest.raises(IntegrationError, match="took longer than 0 s"):
        MOTION.error(TASK, Configuration("x", "x"), references)
    with pytest.raises(InputError, match=r"fin.*fine"):
        MOTION.reference(TASK, "fin")
