"""Inputs over time: values, corners, limits, and what is wrong with wrong ones."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from arms import model_of

from softmpc.errors import InputError, SceneError
from softmpc.model.actuation import PressureDrive
from softmpc.simulation.inputs import Curve, InputProfile, Ramp, Step, TableInput
from softmpc.simulation.settings import read_profile_table, read_settings

MODEL = model_of()
PRESSURE_MODEL = model_of(actuation=PressureDrive())
NAN = float("nan")


def test_steps_are_held() -> None:
    profile = InputProfile.of(3, [Step(1, 2.0, 1.5), Step(1, 4.0, 0.5), Step(3, 0.0, 1.0)])
    assert profile([-1.0, 0.0, 1.0, 2.0, 3.9, 4.0, 99.0])[:, 0].tolist() == (
        [0.0, 0.0, 0.0, 1.5, 1.5, 0.5, 0.5]
    )
    assert profile(2.0).tolist() == [1.5, 0.0, 1.0]
    assert profile.before(2.0).tolist() == [0.0, 0.0, 1.0]
    assert profile.before(0.0).tolist() == [0.0, 0.0, 0.0]
    assert profile.breakpoints.tolist() == [0.0, 2.0, 4.0]


def test_ramps_go_on_from_the_value_reached() -> None:
    profile = InputProfile.of(
        1, [Ramp(1, 6.0, 7.0, -1.0), Step(1, 1.0, 0.25), Ramp(1, 2.0, 4.0, 0.75)]
    )
    assert profile([0.5, 1.0, 3.0, 4.0, 5.0, 6.5, 8.0]).ravel().tolist() == pytest.approx(
        [0.0, 0.25, 1.0, 1.75, 1.75, 1.25, 0.75]
    )
    assert profile.breakpoints.tolist() == [1.0, 2.0, 4.0, 6.0, 7.0]


def test_a_step_may_begin_a_ramp_or_end_it() -> None:
    profile = InputProfile.of(1, [Ramp(1, 1.0, 2.0, 1.0), Step(1, 1.0, 0.5), Step(1, 2.0, 0.0)])
    assert profile([1.0, 1.5, 2.0]).ravel().tolist() == [0.5, 1.0, 0.0]
    assert profile.before([1.0, 2.0]).ravel().tolist() == [0.0, 1.5]


def test_ends_of_an_interval_do_not_see_the_breakpoints_there() -> None:
    profile = InputProfile.of(2, [Step(1, 0.1 + 0.2, 1.5), Ramp(2, 0.3, 1.0, 2.0)])
    for start in (0.3, 0.1 + 0.2):  # not the same number
        first, last = profile.over(start, 1.0)
        np.testing.assert_allclose([first, last], [[1.5, 0.0], [1.5, 1.4]], atol=1e-14)
    np.testing.assert_allclose(profile.over(0.0, 0.3), 0.0, atol=1e-14)


def test_tables() -> None:
    times, values = [0.0, 1.0, 2.0, 3.0], [[0.0, 1.0], [2.0, 1.0], [2.0, 1.0], [0.5, 1.0]]
    linear = InputProfile.from_table(times, values)
    hold = InputProfile.from_table(times, values, hold=True)
    t = np.array([-1.0, 0.5, 1.0, 1.5, 2.5, 9.0])
    assert linear(t)[:, 0].tolist() == [0.0, 1.0, 2.0, 2.0, 1.25, 0.5]
    assert hold(t)[:, 0].tolist() == [0.0, 0.0, 2.0, 2.0, 2.0, 0.5]
    assert linear.breakpoints.tolist() == [0.0, 1.0, 2.0, 3.0]
    assert hold.breakpoints.tolist() == [1.0, 3.0]
    assert InputProfile.constant([1.0, 2.0])([0.0, 5.0]).tolist() == [[1.0, 2.0]] * 2
    assert len(InputProfile.constant([1.0, 2.0]).breakpoints) == 0
    assert InputProfile.of(2)(1.0).tolist() == [0.0, 0.0]


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: InputProfile.of(6, [Step(9, 0.0, 1.0)]), r"unit=9.*units 1 to 6"),
        (lambda: InputProfile.of(6, [Step(0, 0.0, 1.0)]), r"units 1 to 6"),
        (lambda: Step(1, NAN, 1.0), r"at=nan.*finite"),
        (lambda: Step(1, 0.0, NAN), r"to=nan.*finite"),
        (lambda: Ramp(1, 2.0, 2.0, 1.0), r"must start before it ends"),
        (lambda: InputProfile.of(1, [Step(1, 1.0, 1.0), Step(1, 1.0, 2.0)]), "at the same time as"),
        (
            lambda: InputProfile.of(1, [Ramp(1, 1.0, 3.0, 1.0), Step(1, 2.0, 2.0)]),
            "at the same time",
        ),
        (
            lambda: InputProfile.from_table([0.0, 2.0, 1.0], np.zeros((3, 2))),
            "t = 1 s follows t = 2 s",
        ),
        (lambda: InputProfile.from_table([0.0, 1.0], np.zeros((3, 2))), r"shape \(2,\)"),
        (lambda: InputProfile.from_table([0.0, 1.0], [[0.0], [NAN]]), r"input nan at t = 1 s"),
        (lambda: Curve(np.array([np.inf]), np.zeros(1)), "finite"),
        (lambda: TableInput([], np.zeros((0, 2))).curves(), "shape"),
    ],
)
def test_wrong_profiles(make: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        make()


def test_limits_of_the_arm() -> None:
    InputProfile.of(6, [Ramp(1, 0.1, 2.6, 1.0)]).check(MODEL)
    with pytest.raises(InputError, match=r"unit 5 at t = 2 s = 2\.6 N·m: .* 0 and 2\.5 N·m"):
        InputProfile.of(6, [Step(5, 2.0, 2.6)]).check(MODEL)
    with pytest.raises(InputError, match=r"pressure of unit 2 .* 1\.5 MPa: .* 0 and 1 MPa"):
        InputProfile.of(6, [Step(2, 0.0, 1.5e6)]).check(PRESSURE_MODEL)
    with pytest.raises(InputError, match="inputs for 2 units: this arm has 6"):
        InputProfile.of(2).check(MODEL)


def settings(table: dict[str, Any], folder: Path = Path(), model: Any = MODEL) -> Any:
    return read_settings({"simulate": {"duration": 3.0} | table}, model, folder)


def test_settings() -> None:
    steps = [{"unit": 1, "at": 0.0, "torque": 1.5}]
    ramps = [{"unit": 5, "from": 2, "to": 3, "slope": 1.5}]
    read = settings({"steps": steps, "ramps": ramps, "start": "straight", "tip_tolerance": 1e-6})
    assert (read.duration, read.sample_time, read.start, read.method) == (
        3.0,
        0.01,
        "straight",
        "radau",
    )
    assert read.tip_tolerance == 1e-6
    assert read.profile(2.5).tolist() == [1.5, 0, 0, 0, 0.75, 0]


def test_settings_in_pressure() -> None:
    steps = [{"unit": 1, "at": 0.0, "pressure": 0.4}]
    ramps = [{"unit": 2, "from": 1.0, "to": 2.0, "slope": 0.5}]
    read = settings({"steps": steps, "ramps": ramps}, model=PRESSURE_MODEL)
    np.testing.assert_allclose(read.profile(3.0)[:2], [0.4e6, 0.5e6])


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"duration": -1.0}, r"\[simulate\] duration = -1 s: must be above 0"),
        ({"duration": NAN}, r"duration = nan s"),
        ({"sample_time": 0.0}, r"sample_time = 0 s"),
        ({"start": "rset"}, r"'rset'; did you mean 'rest'\?"),
        ({"method": "rk4"}, r"method.*allowed: radau, radau-2, gauss, gauss-2, idas, cvodes"),
        ({"method": "gauss"}, r"\[simulate\]: method 'gauss' keeps its step: give step in s"),
        ({"method": "idas", "step": 0.01}, r"step = 0.01: method 'idas' takes tolerance"),
        ({"tolerance": 1e-6}, r"method 'radau' takes tip_tolerance \(m, at the tip\) or step"),
        ({"step": 0.01, "tip_tolerance": 1e-6}, "leave out one of them"),
        ({"durations": 1.0}, r"'durations'; did you mean 'duration'\?"),
        ({"steps": {}}, r"steps = \{\}: must be a list of tables"),
        ({"steps": [3]}, r"steps\[0\] = 3: must be a table"),
        ({"steps": [{"unit": 9, "at": 0.0, "torque": 1.0}]}, r"steps\[0\] unit = 9: .* 1 to 6"),
        ({"steps": [{"unit": 1, "at": NAN, "torque": 1.0}]}, r"steps\[0\] at = nan s"),
        ({"steps": [{"unit": 1, "at": 0.0, "torque": NAN}]}, r"torque = nan N·m"),
        ({"steps": [{"unit": 1, "at": 0.0, "torqe": 1.0}]}, r"torque: is missing; is it 'torqe'"),
        ({"steps": [{"unit": 1, "at": 0.0, "pressure": 1.0}]}, r"takes torques, write torque = "),
        ({"steps": [{"unit": 1, "at": 1.0, "torque": 3.0}]}, r"unit 1 at t = 1 s = 3 N·m: must"),
        (
            {"steps": [{"unit": 1, "at": 1, "torque": 1, "to": 2}]},
            r"key in \[simulate\] steps\[0\]",
        ),
        (
            {"ramps": [{"unit": 1, "from": 2, "to": 1, "slope": 1}]},
            r"ramps\[0\] to = 1 s: .* above 2",
        ),
        ({"table": "torques.csv"}, r"torques.csv: no such file"),
        ({"table": "a.csv", "steps": [{"unit": 1, "at": 0, "torque": 1}]}, r"leave out steps"),
    ],
)
def test_wrong_settings(table: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        settings(table)


def test_pressure_scene_wants_pressures() -> None:
    with pytest.raises(SceneError, match="takes pressures, write pressure = … in MPa"):
        settings({"steps": [{"unit": 1, "at": 0.0, "torque": 1.0}]}, model=PRESSURE_MODEL)


def test_duration_must_be_given() -> None:
    with pytest.raises(SceneError, match="duration: is missing"):
        read_settings({"simulate": {}}, MODEL, Path())
    with pytest.raises(SceneError, match=r"has no table \[simulate\]"):
        read_settings({}, MODEL, Path())


def test_csv_table(tmp_path: Path) -> None:
    file = tmp_path / "torques.csv"
    file.write_text("t [s], T_6 [N·m], T_2\n0, 1, 0\n1.0, 1, 2\n\n", encoding="utf-8")
    profile = settings({"table": file.name}, tmp_path).profile
    assert profile(0.5).tolist() == [0, 1, 0, 0, 0, 1]
    assert settings({"table": file.name, "hold": True}, tmp_path).profile(0.5)[1] == 0
    file.write_text("t,P_1\n0,0.5\n")
    assert read_profile_table(file, PRESSURE_MODEL)(0.0)[0] == 0.5e6


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "must have a header line and at least one row"),
        ("t,T_1\n", "at least one row"),
        ("T_1\n1\n", "has no column 't'"),
        ("t,T_7\n0,1\n", r"unknown column: 'T_7'; did you mean 'T_"),
        ("t,T_1,T_1\n0,1,1\n", "'T_1' is there twice"),
        ("t,T_1\n0,nan\n", r"line 2, T_1 = 'nan': must be a finite number"),
        ("t,T_1\n0,0\n\n1,x\n", r"line 4, T_1 = 'x'"),
        ("t,T_1\n0,0\n1\n", "line 3: 1 values, the header has 2"),
        ("t,T_1\n0,0\n2,0\n1,0\n", r"line 4: t = 1 s follows t = 2 s; times must increase"),
        ("t,T_1\n0,3\n", r"torque of unit 1 at t = 0 s = 3 N·m"),
        (b"\xff\xfe\x00", "is not a CSV file"),
    ],
)
def test_wrong_csv_tables(tmp_path: Path, text: str | bytes, message: str) -> None:
    file = tmp_path / "torques.csv"
    file.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(InputError, match=message):
        settings({"table": file.name}, tmp_path)
