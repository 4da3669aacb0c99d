"""A plan tracked on a plant that is not the model: with its torque fed forward, and without.

    python -m tests.benchmarks.plan_tracking [--smooth | --least time|effort|jerk | --plan PLAN.npz]

The plan is one of the paper's arm (one segment a section), whose tip goes 15 cm to the side and
rests there. Rows differ in plant and controller:

    matched   the plant is the model, the state known; "open loop" is the plan's torque alone
    stiffer   the plant is 15 % stiffer and has 3 segments a section, the state is known
    rig       the same plant; a camera (100 Hz, 0.5 mm noise, 10 ms late), sensors of pressure
              (5 kPa), and an estimator of the disturbance

"soft" is a tip_deviation of 20 mm instead of 1 mm. Errors of the tip from the planned one, mm: RMS
and largest over the plan, at its end, mean over the second for which the end is held, and RMS over
its last half. "variation" is the total variation of the torques, N·m.

By default plans of least jerk, effort and time are followed on the rig, the latter two with
`back_off` and a limited torque rate, from a posture of greatest margin; "open loop" is on the
stiffer plant, and "10 ms" a controller with steps of that length, 30 ahead, instead of 20 of 25 ms.
The others have one plan and all rows: with `--smooth` its torques are those that a
converged controller of the matched model gave along a smooth line, held for 25 ms each and
simulated anew; with `--least` it is the planner's, in 0.6 s where that is not the least, at the
arm's own limits; with `--plan` that of a file, and `--scene` is the scene file that it was made
with.
"""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from tests.benchmarks.common import arguments, key

STIFFER = {"young_modulus": 1.38e6, "shear_modulus": 0.46e6}
PLANT: dict[str, Any] = {"model": {"segments": 3}, "manipulator": STIFFER}
RIG: dict[str, Any] = {
    "seed": 1,
    "section_tips": {"rate": 100.0, "latency": 0.010, "noise": 5e-4},
    "unit_pressures": {"rate": 100.0, "noise": 5e3},
}
SCENE: dict[str, Any] = {"schema": 1, "effects": {"gravity": [0.0, 0.0, 9.81]}}
START, WAY, SWING, REST = (0.05, 0.0, 0.58), (0.14, 0.06, -0.02), 0.4, 0.2  # m, m, s, s
DURATION = SWING + REST
HOLD = 1.0  # s
SOFT = {"tip_deviation": 0.02}
PLAIN = {"feed_forward": False}
CASES: dict[str, dict[str, Any]] = {
    "matched, open loop": {"open": True, "plant": {}},
    "matched, without": {"controller": PLAIN, "plant": {}},
    "matched, with": {"plant": {}},
    "matched, soft, without": {"controller": PLAIN | SOFT, "plant": {}},
    "matched, soft, with": {"controller": SOFT, "plant": {}},
    "stiffer, open loop": {"open": True},
    "stiffer, without": {"controller": PLAIN},
    "stiffer, with": {},
    "stiffer, soft, without": {"controller": PLAIN | SOFT},
    "stiffer, soft, with": {"controller": SOFT},
    "rig, without": {"controller": PLAIN, "rig": RIG},
    "rig, with": {"rig": RIG},
    "rig, soft, without": {"controller": PLAIN | SOFT, "rig": RIG},
    "rig, soft, with": {"controller": SOFT, "rig": RIG},
}
ROOMY: dict[str, dict[str, Any]] = {
    "jerk": {"duration": DURATION},
    "effort": {"duration": DURATION, "back_off": 0.2, "rate": 10.0},
    "time": {"back_off": 0.2, "rate": 2.5},
}
FAST: dict[str, Any] = {"step": 0.010, "horizon": 30}
FOLLOWED: dict[str, dict[str, Any]] = {
    **{name: CASES[name] for name in CASES if name.startswith(("matched, soft", "rig"))},
    "rig, 10 ms, without": {"controller": PLAIN | FAST, "rig": RIG},
    "rig, 10 ms, with": {"controller": FAST, "rig": RIG},
    "stiffer, open loop": CASES["stiffer, open loop"],
}
QUICK = ("stiffer, open loop", "stiffer, without", "stiffer, with")
TITLES = "   RMS     max  at the end  hold mean  held RMS  variation  failed"


def make_plan(folder: Path, scene: Any) -> Path:
    """The swing as `plan.npz` in a folder."""
    from softmpc.control.closed_loop import close_loop, start_at
    from softmpc.control.controller_table import ControllerSettings
    from softmpc.control.guide import Guide
    from softmpc.control.mpc import Mpc
    from softmpc.control.paths import Reference, TimeLaw, TipPath
    from softmpc.control.transcription import Transcription
    from softmpc.model.model import build
    from softmpc.simulation.runge_kutta import RadauIIA
    from softmpc.statics.inverse import InverseStatics
    from softmpc.statics.targets import Position
    from tests.plans import simulated_plan, write_plan

    @dataclass(frozen=True)
    class Swing(TipPath):
        """From START to the end, with smooth acceleration; a phase of 1 is the end."""

        def position(self, phase: np.ndarray) -> np.ndarray:
            s = np.clip(phase, 0.0, 1.0)[:, None]
            return np.asarray(START) + (10 * s**3 - 15 * s**4 + 6 * s**5) * np.asarray(WAY)

    model = build(scene)
    settings = ControllerSettings(solver="sqp", horizon=20)
    transcription = Transcription(settings.problem(model))
    mpc = Mpc(transcription, settings.make_solver(transcription))
    start = start_at(model, InverseStatics(model).solve(Position(START)).posture)
    guide = Guide(Reference(Swing(), TimeLaw(SWING, 1 + REST / SWING, 0.0)))
    run = close_loop(mpc, RadauIIA(model, 1e-8), guide, start)
    after = np.linalg.solve(model.drive.static_gain, run.p[-1])
    nodes = settings.step * np.arange(len(run.u) + 1)
    return write_plan(folder, simulated_plan(model, start.u, nodes, run.u, after))


def least_plan(folder: Path, scene: Any, least: str, margin: bool = False, **more: Any) -> Path:
    """The planner's from the same start to the same end; `margin` is of the start's posture."""
    from softmpc.control.closed_loop import start_at
    from softmpc.model.model import build
    from softmpc.planning.goals import Goal, Start
    from softmpc.planning.plan_files import save_plan
    from softmpc.planning.planner import plan
    from softmpc.planning.problem import PlanProblem
    from softmpc.statics.inverse import InverseStatics
    from softmpc.statics.rest_costs import GreatestMargin
    from softmpc.statics.targets import Position

    model = build(scene)
    inverse = InverseStatics(model, GreatestMargin() if margin else None)
    start = start_at(model, inverse.solve(Position(START)).posture)
    goal = Goal((Position(tuple((np.array(START) + WAY).tolist())),))
    problem = PlanProblem(model, Start(start.x, start.u), (goal,), least=least, **more)
    save_plan(plan(problem, executor=1), folder)
    return folder / "plan.npz"


def run(case: dict[str, Any], plan: Path, data: dict[str, Any]) -> tuple[Any, float]:
    """The closed loop of a row, and the duration of its plan."""
    from softmpc.control.baselines import FeedForward
    from softmpc.control.planned import motion_of
    from softmpc.control.track_scene import read_tracking
    from softmpc.control.tracking import set_up
    from softmpc.model.scene_file import scene_from_dict
    from softmpc.rig.rigging import rig_up
    from softmpc.rig.scene_table import read_rig

    track = {
        "path": "plan", "file": plan.name, "hold": HOLD,
        "controller": case.get("controller", {}),
        "plant": {"tolerance": 1e-7, "scene": case.get("plant", PLANT)},
    }  # fmt: skip
    scene, task = scene_from_dict(data), read_tracking(track, plan.parent, data)
    motion = motion_of(task.reference)
    assert motion is not None
    if "rig" in case:
        return rig_up(scene, task, read_rig(case["rig"])).run().track, motion.duration
    setup = set_up(scene, task)
    controller = FeedForward(setup.ocp, setup.guide) if "open" in case else setup.controller
    return setup.run(controller), motion.duration


def row(case: dict[str, Any], plan: Path, data: dict[str, Any]) -> dict[str, Any]:
    result, end = run(case, plan, data)
    error, time = 1e3 * result.error, result.time
    moving, last = error[time <= end], error[time > time[-1] - 0.5]
    return {
        "rms_mm": float(np.sqrt(np.mean(moving**2))),
        "max_mm": float(moving.max()),
        "end_mm": float(moving[-1]),
        "hold_mm": float(error[time >= end].mean()),
        "held_mm": float(np.sqrt(np.mean(last**2))),
        "variation": result.variation,
        "failures": result.failures,
        "status": result.status,
    }


def describe(plan: Path) -> str:
    from softmpc.control.planned import read_planned

    motion = read_planned(plan)
    tip = motion.samples_tips[:, -1]
    way, far = np.linalg.norm(np.diff(tip, axis=0), axis=1).sum(), np.linalg.norm(tip[-1] - tip[0])
    return (
        f"plan: {motion.duration:.3f} s, tip {100 * far:.1f} cm away by a way of {100 * way:.1f} "
        f"cm, torques {motion.u.min():.2f} to {motion.u.max():.2f} N·m"
    )


def follow_all(data: dict[str, Any], only: str) -> dict[str, Any]:
    """The plans that leave room, on the rig; prints a table for each."""
    from softmpc.model.scene_file import scene_from_dict

    rows: dict[str, Any] = {}
    for least, keys in ROOMY.items():
        with TemporaryDirectory() as folder:
            plan = least_plan(Path(folder), scene_from_dict(data), least, margin=True, **keys)
            print(f"least {least}, {', '.join(f'{k} {v:g}' for k, v in keys.items())}")
            print(describe(plan))
            rows |= {f"{least}, {k}": v for k, v in follow(plan, data, only, FOLLOWED).items()}
        print()
    return rows


def follow(
    plan: Path, data: dict[str, Any], only: str, cases: dict[str, dict[str, Any]]
) -> dict[str, Any]:
    """The rows of one plan, printed."""
    print(f"{'row':24}  {TITLES}")
    rows: dict[str, Any] = {}
    for name, case in cases.items():
        if only in name:
            rows[name] = found = row(case, plan, data)
            print(
                f"{name:24}  {found['rms_mm']:6.2f}  {found['max_mm']:6.2f}  "
                f"{found['end_mm']:10.2f}  {found['hold_mm']:9.2f}  {found['held_mm']:8.2f}  "
                f"{found['variation']:9.1f}  {found['failures']:6d}",
                flush=True,
            )
    return rows


def numbers(quick: bool) -> dict[str, float]:
    """The smooth line and three rows on the stiffer plant (quick), or the planner's plans."""
    from softmpc.model.scene_file import scene_from_dict

    if quick:
        with TemporaryDirectory() as folder:
            plan = make_plan(Path(folder), scene_from_dict(SCENE))
            rows = {name: row(CASES[name], plan, SCENE) for name in QUICK}
    else:
        rows = follow_all(SCENE, "")
    return {
        key(name, what): value
        for name, each in rows.items()
        for what, value in each.items()
        if what != "status"
    }


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--smooth", action="store_true", help="a smooth line, in 0.6 s")
    parser.add_argument("--least", choices=("time", "effort", "jerk"), help="a plan of the planner")
    parser.add_argument("--plan", type=Path, help="a plan.npz")
    parser.add_argument("--scene", type=Path, help="the scene file that it was made with")
    parser.add_argument("--only", default="", help="rows with this in their names")
    parser.add_argument("--json", type=Path, help="write the rows to this file")
    given = parser.parse_args()
    from softmpc.model.scene_file import TABLES, read_document, scene_from_dict

    data = SCENE
    if given.scene:
        data = {k: v for k, v in read_document(given.scene).items() if k in TABLES}
    if given.plan or given.least or given.smooth:
        with TemporaryDirectory() as folder:
            scene, plan = scene_from_dict(data), given.plan
            if given.least:
                duration = None if given.least == "time" else DURATION
                plan = least_plan(Path(folder), scene, given.least, duration=duration)
            plan = plan or make_plan(Path(folder), scene)
            print(describe(plan))
            rows = follow(plan, data, given.only, CASES)
    else:
        rows = follow_all(data, given.only)
    if given.json:
        given.json.write_text(json.dumps(rows, indent=2))
    if any(found["status"] != "finished" for found in rows.values()):
        sys.exit(1)


if __name__ == "__main__":
    main()
