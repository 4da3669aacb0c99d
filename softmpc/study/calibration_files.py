"""Calibration data in a TOML file, which may point to CSV files beside it.

title = "bench, 3 May"
estimate_sigma = false

[[parameter]]                        # any number of the scene, by its path
path = "sections.bending_radius"
low = 0.02                           # optional: start, low, high, scale, log = true
high = 0.04
prior = { mean = 0.03, sd = 0.003 }

[[tie]]
path = "sections.shear_modulus"
to = "sections.young_modulus"
factor = 0.3333

[[pose]]                             # at rest: pressures_mpa or torques_nm, one a unit
pressures_mpa = [0.6, 0, 0, 0, 0, 0]
tips_m = { x_2 = -0.1, z_2 = 0.4 }
sigma_m = 0.001

[[poses]]                            # many: columns P_1, … (MPa) or T_1, … (N·m), x_1, …
table = "poses.csv"
sigma_m = 0.001

[[motion]]                           # columns t, T_1, …, and t, x_1, …, P_1, …
inputs = "torques.csv"
measured = "tips.csv"
sigma_m = 0.001
sigma_mpa = 0.005

[[summary]]                          # equals, below or above
quantity = "radius"
equals = 0.139
sigma = 0.002
pressures_mpa = [0, 1, 1, 0, 0, 0]
without = ["gravity"]
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from softmpc.errors import SceneError, errors_in
from softmpc.model.model import build
from softmpc.model.scene import Scene
from softmpc.model.scene_file import read_document, read_toml
from softmpc.model.tables import Table
from softmpc.simulation.settings import STARTS, read_settings
from softmpc.study.calibrate import CalibrationProblem
from softmpc.study.free_parameters import FreeParameter, Tie
from softmpc.study.measured_files import read_inputs, read_measured, read_poses
from softmpc.study.observations import MotionRecord, Observation, StaticPose
from softmpc.study.summary_values import QUANTITIES, MotionCase, SummaryValue

__all__ = ["load_calibration"]

TABLES = ("parameter", "tie", "pose", "poses", "motion", "summary")
MPA = 1e6


def load_calibration(path: str | os.PathLike[str], scene: Scene) -> CalibrationProblem:
    """The problem that a data file poses for a scene.

    Raises `InputError` for a file that is missing or wrong, saying where and what is allowed.
    """
    path = Path(path)
    document = read_toml(path, "TOML")
    with errors_in(path):
        top = Table(document, "the data file")
        rows = {name: _rows(top, name) for name in TABLES}
        title = top.string("title", path.stem)
        estimate = top.boolean("estimate_sigma", False)
        top.finish()
        folder = path.parent
        observations: list[Observation] = [_pose(row, scene) for row in rows["pose"]]
        observations += [pose for row in rows["poses"] for pose in _poses(row, scene, folder)]
        observations += [_motion(row, scene, folder) for row in rows["motion"]]
        cases: dict[str, MotionCase] = {}
        observations += [_summary(row, scene, folder, cases) for row in rows["summary"]]
        parameters = [_parameter(row) for row in rows["parameter"]]
        ties = [_tie(row) for row in rows["tie"]]
        return CalibrationProblem(
            scene, tuple(parameters), tuple(observations), tuple(ties), estimate, title
        )


def _rows(top: Table, key: str) -> list[Table]:
    value = top.raw(key, [])
    if not isinstance(value, list):
        raise top.error(key, value, f"tables, each headed [[{key}]]")
    return [Table(row, f"[[{key}]] {number}") for number, row in enumerate(value, 1)]


def _parameter(row: Table) -> FreeParameter:
    path = row.string("path")
    names = ("start", "low", "high", "scale")
    numbers: dict[str, Any] = {name: row.number(name) for name in names if name in row}
    if "prior" in row:
        table = Table(row.raw("prior"), f"{row.where} prior")
        numbers["prior"] = (table.number("mean"), table.number("sd", low=0.0, low_open=True))
        table.finish()
    free = FreeParameter(path, log=row.boolean("log", False), **numbers)
    row.string("source", "")  # for people
    row.finish()
    return free


def _tie(row: Table) -> Tie:
    tie = Tie(row.string("path"), row.string("to"), row.number("factor", 1.0))
    row.finish()
    return tie


def _common(row: Table, name: str) -> dict[str, Any]:
    row.string("source", "")
    without = row.raw("without", [])
    if not isinstance(without, list) or not all(isinstance(one, str) for one in without):
        raise row.error("without", without, "a list of effects")
    return {
        "without": tuple(without),
        "name": row.string("name", name),
        "counts": row.boolean("fit", True),
    }


def _inputs(row: Table) -> dict[str, Any]:
    """Pressures in Pa, or torques."""
    given: dict[str, Any] = {}
    if "pressures_mpa" in row:
        given["pressures"] = [MPA * p for p in row.vector("pressures_mpa", unit="MPa")]
    if "torques_nm" in row:
        given["torques"] = list(row.vector("torques_nm", unit="N·m"))
    return given


def _pose(row: Table, scene: Scene) -> StaticPose:
    number = row.where.split()[-1]
    about = _common(row, f"pose {number}") | _inputs(row)
    tips = _numbers(row, "tips_m")
    sigma: Any = row.raw("sigma_m")
    sigma = _numbers(row, "sigma_m") if isinstance(sigma, dict) else _sigma(row, "sigma_m", "m")
    row.finish()
    pose = StaticPose(tips=tips, sigma=sigma, **about)
    with errors_in(row.where):
        pose.check(scene)
    return pose


def _numbers(row: Table, key: str) -> dict[str, float]:
    table = Table(row.raw(key), f"{row.where} {key}")
    return {name: table.number(name, unit="m") for name in row.raw(key)}


def _sigma(row: Table, key: str, unit: str) -> float:
    return row.number(key, unit=unit, low=0.0, low_open=True, high=1e6)


def _poses(row: Table, scene: Scene, folder: Path) -> list[StaticPose]:
    about = _common(row, "")
    path, sigma = folder / row.string("table"), _sigma(row, "sigma_m", "m")
    row.finish()
    return read_poses(path, scene, sigma, about)


def _motion(row: Table, scene: Scene, folder: Path) -> MotionRecord:
    number = row.where.split()[-1]
    about = _common(row, f"motion {number}")
    inputs, measured = folder / row.string("inputs"), row.string("measured")
    hold, start = row.boolean("hold", False), row.string("start", "rest", ("rest", "straight"))
    sigmas = {
        kind: _sigma(row, key, unit)
        for kind, key, unit in (("tips", "sigma_m", "m"), ("pressures", "sigma_mpa", "MPa"))
        if key in row
    }
    row.finish()
    profile, path = read_inputs(inputs, scene, hold), folder / measured
    time, columns = read_measured(path, scene)
    record = MotionRecord(profile, time, columns, sigmas, start, **about)
    with errors_in(path):
        record.check(scene)
        profile.check(build(scene))
    return record


def _summary(row: Table, scene: Scene, folder: Path, cases: dict[str, MotionCase]) -> SummaryValue:
    quantity = row.string("quantity", allowed=QUANTITIES)
    about = _common(row, "") | _inputs(row)
    words = {"equals": "=", "below": "<", "above": ">"}
    given = [word for word in words if word in row]
    if len(given) != 1:
        raise SceneError(f"{row.where} give one of equals, below or above")
    for key in ("section", "unit"):
        if key in row:
            about[key] = row.integer(key, low=1)
    unit = QUANTITIES[quantity].unit
    if "motion" in row:
        about["motion"] = _case(folder / row.string("motion"), scene, cases)
    value = SummaryValue(
        quantity=quantity,
        value=row.number(given[0], unit=unit),
        sigma=_sigma(row, "sigma", unit),
        sense=words[given[0]],
        **about,
    )
    row.finish()
    with errors_in(row.where):
        value.check(scene)
    return value


def _case(path: Path, scene: Scene, cases: dict[str, MotionCase]) -> MotionCase:
    """What [simulate] of a scene file asks for, done by the arm that is calibrated."""
    key = str(path)
    if key not in cases:
        document = read_document(path)
        with errors_in(path):
            settings = read_settings(document, build(scene), path.parent)
            if not isinstance(settings.start, str):
                raise SceneError(
                    f"[simulate] start: a motion to calibrate by starts at {' or '.join(STARTS)}, "
                    "for the state of a file is that of one arm"
                )
        numbers = (settings.duration, settings.sample_time, settings.start)
        cases[key] = MotionCase(path.stem, settings.profile, *numbers)
    return cases[key]
