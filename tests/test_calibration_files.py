"""Data files of a calibration: what they may say, and what is said where they are wrong."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from softmpc import PressureDrive, Scene, chen2022, load_scene
from softmpc.errors import InputError
from softmpc.study.calibrate import CalibrationProblem
from softmpc.study.calibration_files import load_calibration
from softmpc.study.observations import MotionRecord, StaticPose
from softmpc.study.summary_values import SummaryValue

EXAMPLES = Path(__file__).parents[1] / "examples"
SCENE = Scene(chen2022())
PARAMETER = '[[parameter]]\npath = "sections.mass"\nlow = 0.1\nhigh = 2.0\n'
POSE = "[[pose]]\npressures_mpa = [1, 0, 0, 0, 0, 0]\ntips_m = { x_2 = 0.1 }\nsigma_m = 0.001\n"
RADIUS = '[[summary]]\nquantity = "radius"\nequals = 0.1\nsigma = 0.01\n'
AT = "pressures_mpa = [1, 0, 0, 0, 0, 0]\n"


def problem(tmp_path: Path, text: str, scene: Scene = SCENE, **files: str) -> CalibrationProblem:
    for name, content in files.items():
        (tmp_path / f"{name}.csv").write_text(content, encoding="utf-8")
    path = tmp_path / "data.toml"
    path.write_text(text, encoding="utf-8")
    return load_calibration(path, scene)


def test_all_that_a_file_may_say(tmp_path: Path) -> None:
    text = f"""
title = "all"
estimate_sigma = true
{PARAMETER}
prior = {{ mean = 0.5, sd = 0.1 }}
log = true
start = 0.6
[[parameter]]
path = "sections[2].young_modulus"
[[tie]]
path = "sections[2].shear_modulus"
to = "sections[2].young_modulus"
factor = 0.5
[[pose]]
name = "by hand"
torques_nm = [1, 0, 0, 0, 0, 0]
tips_m = {{ x_1 = -0.1, z_2 = 0.4 }}
sigma_m = {{ x_1 = 0.001, z_2 = 0.002 }}
[[poses]]
table = "poses.csv"
sigma_m = 0.003
without = ["gravity"]
[[motion]]
inputs = "record.csv"
measured = "record.csv"
sigma_m = 0.001
sigma_mpa = 0.01
start = "straight"
{RADIUS}{AT}
section = 2
[[summary]]
quantity = "settling_time"
below = 1.0
sigma = 0.1
motion = "{EXAMPLES.as_posix()}/step_fig6.toml"
fit = false
"""
    found = problem(
        tmp_path,
        text,
        poses="P_1 [MPa],P_4,x_2 [m],y_2\n0.5,0.1,0.2,0.3\n0.4,0,,0.1\n",
        record="t [s],T_1 [N·m],z_2 [m],P_1 [MPa]\n0,0,,\n0.1,1,0.5,0.01\n0.2,,0.4,\n0.3,1,,0.3\n",
    )
    assert (found.title, found.estimate_sigma, len(found.space)) == ("all", True, 2)
    assert found.space.priors == ((0.5, 0.1), None)
    section = found.space.scene_at(found.space.start).manipulator.sections[1]
    assert (section.mass, section.shear_modulus) == (0.6, pytest.approx(0.6e6))
    by_hand, first, second, motion, radius, settling = found.observations
    assert isinstance(by_hand, StaticPose) and by_hand.names == ("by hand x_1", "by hand z_2")
    np.testing.assert_allclose(by_hand.sigmas, [0.001, 0.002])
    assert isinstance(first, StaticPose) and first.without == ("gravity",)
    np.testing.assert_allclose(first.pressures or (), [5e5, 0, 0, 1e5, 0, 0])
    assert first.values.tolist() == [0.2, 0.3]
    assert second.names == ("poses line 3 y_2",)
    assert isinstance(motion, MotionRecord)
    assert motion.names == (
        "motion 1 z_2 at 0.1 s", "motion 1 z_2 at 0.2 s",
        "motion 1 P_1 at 0.1 s", "motion 1 P_1 at 0.3 s",
    )  # fmt: skip
    np.testing.assert_allclose(motion.sigmas, [0.001, 0.001, 0.01, 0.01])
    assert motion.profile(0.05)[0] == pytest.approx(0.5)  # linear between the rows with inputs
    assert isinstance(radius, SummaryValue) and radius.section == 2
    assert isinstance(settling, SummaryValue) and settling.senses == ("<",) and not settling.counts
    assert settling.motion is not None and settling.motion.duration == 3.0


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[[parameter]\n", r"not valid TOML: .*line 1, column"),
        (PARAMETER + POSE + "[[posse]]\n", "unknown key in the data file: 'posse'; did you mean"),
        (PARAMETER, "nothing to fit to"),
        (POSE, "no free parameter"),
        (POSE + '[[parameter]]\npath = "sections.mas"\n', "did you mean 'sections.mass'"),
        (POSE + "[[parameter]]\nlow = 1\n", r"\[\[parameter\]\] 1 path: is missing"),
        (POSE + PARAMETER + "prior = 3\n", r"\[\[parameter\]\] 1 prior = 3: must be a table"),
        (POSE + PARAMETER + "prior = { mean = 0.5 }\n", "sd: is missing"),
        (PARAMETER + POSE.replace("x_2", "x_3"), "unknown coordinate: 'x_3'"),
        (PARAMETER + POSE.replace(", 0]", "]"), "must be 6 finite numbers, one a unit"),
        (PARAMETER + POSE.replace("0.001", "0.0"), "must be above 0"),
        (PARAMETER + POSE.replace("{ x_2 = 0.1 }", "{}"), "no value is measured"),
        (PARAMETER + POSE.replace("pressures_mpa", "#"), "give either pressures or torques"),
        (PARAMETER + POSE + 'without = ["drag"]\n', "unknown effect: 'drag'"),
        (PARAMETER + RADIUS, "give either pressures or torques"),
        (PARAMETER + RADIUS + AT + "below = 3\n", "give one of equals, below or above"),
        (PARAMETER + RADIUS.replace("radius", "radios") + AT, "did you mean 'radius'"),
        (PARAMETER + RADIUS + AT + "section = 5\n", "section = 5: this arm has 1 to 2"),
        (PARAMETER + RADIUS.replace("radius", "settling_time"), "settling_time needs a motion"),
        (PARAMETER + '[[motion]]\ninputs = "none.csv"\nmeasured = "n"\n', "none.csv: no such file"),
        (
            PARAMETER + POSE.replace("0.1 }", "100 }"),
            "x_2: .*is 100 m from the base.*are these metres",
        ),
        (PARAMETER + POSE.replace("0, 0]", "0, 60]"), r"60 MPa is far beyond .*, 1 MPa"),
        (PARAMETER + PARAMETER.replace("sections", "sections[2]") + POSE, "one of sections.mass"),
        (PARAMETER + '[[tie]]\npath = "sections.mass"\nto = "sections.length"\n' + POSE, "twice"),
    ],
)
def test_wrong_files(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        problem(tmp_path, text)
    assert "data.toml" in str(caught.value)


def test_no_file_at_all(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no such file; the folder .* has no TOML file"):
        load_calibration(tmp_path / "data.toml", SCENE)


POSES = PARAMETER + '[[poses]]\ntable = "table.csv"\nsigma_m = 0.001\n'
MOTION = PARAMETER + '[[motion]]\ninputs = "table.csv"\nmeasured = "table.csv"\nsigma_m = 0.001\n'


@pytest.mark.parametrize(
    ("text", "table", "message"),
    [
        (POSES, "P_1,x_9\n1,1\n", r"table.csv, line 1: unknown column: 'x_9'"),
        (POSES, "P_1,x_1,x_1\n1,1,2\n", "line 1: column 'x_1' is there twice"),
        (POSES, "P_1,x_1\n1,1\n1\n", "line 3: 1 values, the header has 2"),
        (POSES, "P_1,x_1\n1,one\n", "line 2, x_1 = 'one': must be a number, or empty"),
        (POSES, "P_1,x_1\n1,\n", "line 2: .*no value is measured"),
        (MOTION, "t,T_1,x_1\n0,0,1\n0,1,1\n", "line 3: t = 0 s follows t = 0 s"),
        (MOTION, "t,T_1,x_1\n0,0,1\n1,1,?\n", r"line 3, x_1 = '\?': must be a finite number"),
        (MOTION, "t,T_1,x_1\n0,0,1\n1,1,-100\n", "x_1: .*are these metres"),
        (MOTION, "t,x_1\n0,0\n1,1\n", "has no column of T_1"),
        (MOTION, "t,T_1,x_7\n0,0,1\n1,1,2\n", "unknown column: 'x_7'"),
        (MOTION, "t,T_1,P_1\n0,0,1\n1,1,2\n", "sigma of pressures is missing"),
        (MOTION, "t,T_1,x_1\n0,0,\n1,1,\n", "no value is measured"),
        (MOTION, "t,T_1,x_1\n0,0,1\n1,9,1\n", "torque of unit 1 at t = 1 s = 9"),
    ],
)
def test_wrong_tables(tmp_path: Path, text: str, table: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        problem(tmp_path, text, table=table)


def test_pressures_may_be_the_inputs(tmp_path: Path) -> None:
    """Where the drive takes pressures, P_1 of a motion is what is done, not what is measured."""
    scene = SCENE.with_(actuation=PressureDrive())
    table = "t,P_1,x_1\n0,0,0\n1,0.5,0.1\n"
    (motion,) = problem(tmp_path, MOTION, scene, table=table).observations
    assert isinstance(motion, MotionRecord)
    assert motion.names == ("motion 1 x_1 at 0 s", "motion 1 x_1 at 1 s")
    assert motion.profile(1.0)[0] == 5e5
    with pytest.raises(InputError, match="takes pressures, not torques"):
        problem(tmp_path, PARAMETER + POSE.replace("pressures_mpa", "torques_nm"), scene)


def test_the_file_in_the_docs(tmp_path: Path) -> None:
    shutil.copytree(EXAMPLES, tmp_path / "examples")
    page = (EXAMPLES.parent / "docs" / "calibration.md").read_text(encoding="utf-8")
    (text,) = re.findall(r"```toml data\n(.*?)```", page, re.DOTALL)
    path = tmp_path / "examples" / "calibration" / "docs.toml"
    path.write_text(text, encoding="utf-8")
    found = load_calibration(path, load_scene(path.with_name("bench_arm.toml")))
    assert len(found.observations) == 1 + 8 + 1 + 1 and len(found.ties) == 1


def test_examples_are_problems() -> None:
    folder = EXAMPLES / "calibration"
    paper = load_calibration(folder / "chen2022.toml", load_scene(folder / "paper_arm.toml"))
    assert sum(o.counts for o in paper.observations) == 6 and len(paper.observations) == 10
    bench = load_calibration(folder / "bench.toml", load_scene(folder / "bench_arm.toml"))
    assert len(bench.data.values) == 8 * 6 - 2 * 3 + 50 * 3 + 20
