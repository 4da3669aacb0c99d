"""A plant that is not the model, seen by noisy sensors: what the loop makes of it.

    python -m tests.benchmarks.mismatch [--quick] [--json FILE]

The plant has 4 segments a section, is 15 % stiffer and carries 200 g that the controller's model
(one segment) lacks. A camera (100 Hz, 0.5 mm noise, 10 ms late) sees the tips, sensors the unit
pressures (5 kPa noise); inputs act 10 ms after the sample as well in the rows "late". For each row:
a figure eight, and a held place; "hunting" is the peak-to-peak motion of the tip about its mean
while it is held, in the direction of the most, and "deadband" the torque that friction may hide.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from tests.benchmarks.common import arguments, key

CENTER = [0.12, 0.0, 0.57]
STIFFER = {"young_modulus": 1.38e6, "shear_modulus": 0.46e6}
PLANT: dict[str, Any] = {
    "model": {"segments": 4}, "effects": {"payload": {"mass": 0.2}}, "manipulator": STIFFER,
}  # fmt: skip
RIG: dict[str, Any] = {
    "seed": 1,
    "section_tips": {"rate": 100.0, "latency": 0.010, "noise": 5e-4},
    "unit_pressures": {"rate": 100.0, "noise": 5e3},
}
RATE = 20.0  # N·m/s
FRICTION = 100.0  # N
INERT: dict[str, Any] = {"tube_inertance": True, "rotor_inertia": {}}
WET = INERT | {"turbulent_loss": {}}
# What tells the filter that its model of the drive is poor.
UNSURE: dict[str, Any] = {"estimator": {"noise": {"drive": 0.1, "rates": 0.03}}}
CASES: dict[str, dict[str, Any]] = {
    "stiffer, finer, loaded": {},
    "the same, late": {"rig": {"command_delay": 0.010}},
    "without disturbance": {"rig": {"estimator": {"forces": [], "offsets": False}}},
    "without it, more noise instead": {
        "rig": {
            "estimator": {
                "forces": [], "offsets": False, "noise": {"strains": 0.02, "rates": 0.1}
            }
        }
    },
    "friction 100 N": {
        "plant": {
            "actuation": {"kind": "hydraulic-friction"}, "hydraulics": {"friction": FRICTION}
        },
    },
    "friction, the filter told": {
        "plant": {
            "actuation": {"kind": "hydraulic-friction"}, "hydraulics": {"friction": FRICTION}
        },
        "rig": UNSURE,
    },
    "inertance, rotor, turbulence": {"plant": {"effects": WET}},
    "… the filter told": {"plant": {"effects": WET}, "rig": UNSURE},
    "… and in the model, but turbulence": {
        "plant": {"effects": WET}, "controller": {"effects": INERT}
    },
}  # fmt: skip


def merged(one: Any, other: Any) -> Any:
    """Tables of `one` with those of `other` in them."""
    if not (isinstance(one, dict) and isinstance(other, dict)):
        return other
    return {**one, **{key: merged(one.get(key), value) for key, value in other.items()}}


def document(case: dict[str, Any], hold: bool, quick: bool) -> dict[str, Any]:
    """The scene file of a row."""
    path: dict[str, Any] = {"path": "point", "center": [0.10, 0.05, 0.57], "lap_time": 6.0}
    if not hold:
        path = {"path": "figure-eight", "center": CENTER, "width": 0.08, "height": 0.04}
    path["laps"] = 1 if hold or quick else 2
    controller = {"torque_rate": RATE, "back_off": 0.05}
    if "controller" in case:
        controller["scene"] = case["controller"]
    plant = {"tolerance": 1e-7, "scene": merged(PLANT, case.get("plant", {}))}
    return {
        "schema": 1,
        "effects": {"gravity": [0.0, 0.0, 9.81]},
        "track": path | {"settle": 1.0, "controller": controller, "plant": plant},
        "rig": merged(RIG, case.get("rig", {})),
    }


def run(data: dict[str, Any]) -> tuple[Any, Any]:
    from softmpc.control.track_scene import read_tracking
    from softmpc.model.scene_file import scene_from_dict
    from softmpc.rig.rigging import rig_up
    from softmpc.rig.scene_table import read_rig

    scene = scene_from_dict(data)
    rig = rig_up(scene, read_tracking(data["track"], Path(), data), read_rig(data["rig"]))
    return rig, rig.run()


def limits_kept(rig: Any, result: Any) -> bool:
    """Whether torque and torque rate stayed within their limits."""
    guard, u = rig.pilot.mpc.guard, np.vstack([result.track.u_start, result.track.u])
    change = np.diff(u, axis=0)
    rates = np.all(change <= guard.rise + 1e-12) and np.all(change >= guard.fall - 1e-12)
    return bool(np.all(u >= guard.low) and np.all(u <= guard.high) and rates)


def hunting(result: Any) -> float:
    """Peak-to-peak motion of the tip over the last 2 s along the direction of the most, mm."""
    track = result.track
    tip = track.tip[track.time > track.time[-1] - 2.0]
    off = tip - tip.mean(axis=0)
    along = off @ np.linalg.svd(off, full_matrices=False)[2][0]
    return 1e3 * float(along.max() - along.min())


def row(case: dict[str, Any], quick: bool) -> dict[str, Any]:
    began = time.perf_counter()
    rig, eight = run(document(case, False, quick))
    held_rig, held = run(document(case, True, quick))
    summary, still = eight.summary(), held.summary()
    return {
        "rms_mm": summary["rms_error_mm"],
        "max_mm": summary["max_error_mm"],
        "offset_mm": still["offset_mm"],
        "held_rms_mm": still["rms_error_mm"],
        "hunting_mm": hunting(held),
        "limits_kept": limits_kept(rig, eight) and limits_kept(held_rig, held),
        "back_off": max(s["back_off_used"]["pressure"] for s in (summary, still)),
        "nis_tips": summary["nis"].get("section_tips"),
        "worst_state": summary["worst_state"],
        "failed_steps": summary["failures"] + still["failures"],
        "estimate_ms": summary["estimate_ms_median"],
        "step_ms": summary["step_ms_median"],
        "seconds": time.perf_counter() - began,
    }


def deadband() -> float:
    """Torque that a friction of 100 N can hide, N·m."""
    from softmpc import chen2022
    from softmpc.model.hydraulics import screw_advance

    h = chen2022().hydraulics
    return FRICTION * screw_advance(h) / h.efficiency


def numbers(quick: bool) -> dict[str, float]:
    """The first row at one lap in quick mode; else all rows, as printed."""
    kept = ("rms_mm", "max_mm", "offset_mm", "hunting_mm", "limits_kept", "failed_steps")
    found: dict[str, float] = {"deadband_nm": deadband()}
    for name in list(CASES)[: 1 if quick else None]:
        one = row(CASES[name], quick)
        found |= {key(name, what): float(one[what]) for what in kept}
        found[key(name, "estimate to step time ratio")] = one["estimate_ms"] / one["step_ms"]
    return found


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--quick", action="store_true", help="one lap")
    parser.add_argument("--only", help="rows with this in their names")
    parser.add_argument("--json", type=Path, help="write the rows to this file")
    given = parser.parse_args()
    titles = "RMS mm   max mm  offset mm  hunting mm  limits  back-off  NIS tips  state"
    print(f"{'row':36}  {titles}")
    rows = {}
    for name, case in CASES.items():
        if given.only and given.only not in name:
            continue
        rows[name] = found = row(case, given.quick)
        kept = "kept" if found["limits_kept"] else "BROKEN"
        print(
            f"{name:36}  {found['rms_mm']:6.2f}  {found['max_mm']:7.2f}  "
            f"{found['offset_mm']:9.3f}  {found['hunting_mm']:10.2f}  {kept:>6}  "
            f"{100 * found['back_off']:6.0f} %  {found['nis_tips'] or np.nan:8.2f}  "
            f"{found['worst_state']}, {found['failed_steps']} steps failed",
            flush=True,
        )
    print(f"deadband of {FRICTION:g} N: {deadband():.3f} N·m at the motor")
    if given.json:
        given.json.write_text(json.dumps(rows, indent=2))
    if not all(found["limits_kept"] for found in rows.values()):
        sys.exit(1)


if __name__ == "__main__":
    main()
