"""Closed loops on a rig with random faults: what comes out, and how soon the loop is back.

    python -m tests.benchmarks.faults [--runs 200] [--workers 2] [--json FILE]

Each run has a seed, and one to three faults of random kinds, times and sizes in the second and
third second of a circle on a plant that is stiffer, finer and loaded. After the last fault has
ended the loop has 2 s to come back: to a state of supervision in which the MPC runs, with the tip
within 5 mm of the path (three times what it is without faults), and to stay there.
"""

from __future__ import annotations

import json
import sys
from collections import Counter, defaultdict
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from tests.benchmarks.common import arguments, key

BACK, NEAR = 2.0, 5e-3  # s, m
LAST = 3.0  # s, when the last fault has ended
DURATION = 6.0
SCENE: dict[str, Any] = {
    "schema": 1,
    "effects": {"gravity": [0.0, 0.0, 9.81]},
    "track": {
        "path": "circle", "center": [0.12, 0.0, 0.57], "diameter": 0.08, "laps": 1.5,
        "controller": {"torque_rate": 20.0, "back_off": 0.05},
        "plant": {
            "tolerance": 1e-6,
            "scene": {
                "model": {"segments": 2}, "effects": {"payload": {"mass": 0.2}},
                "manipulator": {"young_modulus": 1.38e6, "shear_modulus": 0.46e6},
            },
        },
    },
    "rig": {
        "section_tips": {"latency": 0.010}, "unit_pressures": {},
        "faults": [{"kind": "payload_dropped", "start": 0.0, "duration": 0.0}],  # both plants
    },
}  # fmt: skip


def random_faults(random: np.random.Generator) -> list[dict[str, Any]]:
    """One to three faults as tables of a scene file."""
    kinds = ("nan", "frozen", "absent", "spike", "stuck", "scaled", "jitter", "payload_dropped",
             "solver_cap", "budget_overrun")  # fmt: skip
    found = []
    for kind in random.choice(kinds, size=int(random.integers(1, 4)), replace=False):
        start = float(random.uniform(1.0, 2.5))
        fault: dict[str, Any] = {
            "kind": str(kind), "start": start,
            "duration": float(random.uniform(0.02, LAST - start)),
        }  # fmt: skip
        if kind in ("nan", "frozen", "absent", "spike"):
            fault["sensor"] = str(random.choice(("section_tips", "unit_pressures")))
        if kind == "spike":
            size = 0.3 if fault["sensor"] == "section_tips" else 5e5
            fault["size"] = float(random.uniform(-size, size))
        if kind in ("stuck", "scaled"):
            fault["units"] = sorted(random.choice(6, size=2, replace=False) + 1)
        if kind == "scaled":
            fault["factor"] = float(random.uniform(0.0, 1.5))
        if kind == "jitter":
            fault["most"] = float(random.uniform(0.001, 0.02))
        found.append(fault)
    return [{k: int(v) if isinstance(v, np.integer) else v for k, v in one.items()}
            | ({"units": [int(u) for u in one["units"]]} if "units" in one else {})
            for one in found]  # fmt: skip


@dataclass(frozen=True)
class Run:
    """One run of the rig, by its seed."""

    duration: float = DURATION

    @cached_property
    def _rig(self) -> Any:
        from softmpc.control.track_scene import read_tracking
        from softmpc.model.scene_file import scene_from_dict
        from softmpc.rig.rigging import rig_up
        from softmpc.rig.scene_table import read_rig

        scene = scene_from_dict(SCENE)
        return rig_up(scene, read_tracking(SCENE["track"], Path(), SCENE), read_rig(SCENE["rig"]))

    def __call__(self, seed: int) -> dict[str, Any]:
        from softmpc.rig.scene_table import read_rig

        random, rig = np.random.default_rng(abs(seed)), self._rig
        tables = random_faults(random) if seed >= 0 else []
        faults = read_rig({"faults": tables}).faults
        rig.machine.faults, rig.machine.seed = faults, abs(seed)
        try:
            result = rig.run(duration=self.duration)
        except Exception as error:
            return {"seed": seed, "faults": tables, "error": f"{type(error).__name__}: {error}"}
        return {"seed": seed, "faults": tables, "error": "", **_looked_at(rig, result, tables)}


def _looked_at(rig: Any, result: Any, tables: list[dict[str, Any]]) -> dict[str, Any]:
    """What the acceptance asks of a run."""
    track, guard = result.track, rig.pilot.mpc.guard
    u = np.vstack([track.u_start, track.u])
    change = np.diff(u, axis=0)
    over = max(np.max(u - guard.high), np.max(guard.low - u))
    fast = max(np.max(change - guard.rise), np.max(guard.fall - change))
    ended = max((one["start"] + one["duration"] for one in tables), default=0.0)
    states = np.repeat(result.state, round(rig.pilot.mpc.ocp.step / 1e-3))
    off = np.linalg.norm(track.tip - track.target, axis=1)[1 : len(states) + 1]
    bad = (off > NEAR) | (states >= 2)
    last = (np.flatnonzero(bad)[-1] + 1) * 1e-3 if bad.any() else 0.0
    return {
        "finite": bool(np.all(np.isfinite(track.u))),
        "torque_over": float(over),
        "rate_over": float(fast),
        "status": track.status,
        "back_after": max(last - ended, 0.0),
        "largest_mm": 1e3 * float(off[1000:].max()),
        "worst_state": int(result.state.max()),
    }


def judged(found: list[dict[str, Any]]) -> dict[str, int]:
    """Runs that are not as they should be, by what is wrong."""
    good = [one for one in found if not one["error"]]
    return {
        "uncaught exceptions": len(found) - len(good),
        "runs that the plant stopped": sum(one["status"] != "finished" for one in good),
        "runs with a NaN out": sum(not one["finite"] for one in good),
        "runs with a torque limit broken": sum(one["torque_over"] > 0 for one in good),
        "runs with a rate limit broken": sum(one["rate_over"] > 1e-12 for one in good),
        f"runs not back within {BACK:g} s": sum(one["back_after"] > BACK for one in good),
    }


def swept(seeds: range, workers: int, report: Any = None) -> list[dict[str, Any]]:
    """All runs of some seeds."""
    from softmpc.sweeps import sweep

    return sweep(Run(), seeds, executor=workers, chunk=10, progress=report)


def numbers(quick: bool) -> dict[str, float]:
    """Four seeds in quick mode, else 200: how many were not as they should be, and times back."""
    found = swept(range(4 if quick else 200), 2)
    counts = {key(what, "count"): float(count) for what, count in judged(found).items()}
    back = [one["back_after"] for one in found if not one["error"]]
    return counts | {
        "runs_count": len(found),
        "back_after_s_median": float(np.median(back)),
        "back_after_s_largest": max(back),
    }


def tell(found: list[dict[str, Any]]) -> bool:
    """The table by kind of fault, and whether all is as it should be."""
    errors = [one for one in found if one["error"]]
    good = [one for one in found if not one["error"]]
    by_kind: defaultdict[str, list[dict[str, Any]]] = defaultdict(list)
    for one in good:
        for fault in one["faults"]:
            by_kind[fault["kind"]].append(one)
    print("fault            runs   back after, s: median  largest   late   safe stop  fall-back")
    for kind, runs in sorted(by_kind.items()):
        times = np.array([one["back_after"] for one in runs])
        worst = Counter(one["worst_state"] for one in runs)
        print(f"{kind:15}  {len(runs):4d}  {np.median(times):21.2f}  {times.max():7.2f}  "
              f"{int((times > BACK).sum()):5d}  {worst[3]:9d}  {worst[2]:9d}")  # fmt: skip
    checks = judged(found)
    for what, count in checks.items():
        print(f"{what:32} {count} of {len(found)}")
    for one in errors[:5]:
        print(f"seed {one['seed']}: {one['error']}")
    for one in good:
        if one["back_after"] > BACK or one["status"] != "finished":
            print(f"seed {one['seed']}: {one['status']}, back after {one['back_after']:.2f} s, "
                  f"{one['faults']}")  # fmt: skip
    return not any(checks.values())


def main() -> None:
    from softmpc.cli.common import progress

    parser = arguments(__doc__)
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--json", type=Path, help="write the runs to this file")
    given = parser.parse_args()
    usual = Run()(-1)
    print(f"without faults: largest error after 1 s {usual['largest_mm']:.2f} mm")
    seeds = range(given.first, given.first + given.runs)
    with progress("runs") as report:
        found = swept(seeds, given.workers, report)
    if given.json:
        given.json.write_text(json.dumps(found, indent=1))
    sys.exit(0 if tell(found) else 1)


if __name__ == "__main__":
    main()
