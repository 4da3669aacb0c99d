"""Controllers that know less than the plant: `python -m tests.benchmarks.cheaper`.

The plant is the paper's arm with its hydraulics (34 states), IDAS at 1e-9; the controller has 25 ms
and N = 20. RMS of the tip error after `settle` (1 s; 0.1 s on the short line), all by real-time
iteration; times are medians of processor-bound steps on this machine, to be compared in one column.
"""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import Any

from softmpc.control.compare import row_of
from softmpc.control.tracking import read_tracking, set_up
from softmpc.errors import SceneError
from softmpc.model.scene_file import scene_from_dict
from tests.benchmarks.common import key

ARM = {"effects": {"gravity": [0.0, 0.0, 9.81]}, "actuation": {"kind": "hydraulic"}}
PATHS: dict[str, dict[str, Any]] = {
    "circle": {"path": "circle", "center": [0.12, 0.0, 0.57], "diameter": 0.08, "laps": 1},
    "fast line": {
        "path": "line", "start": [0.1, 0.0, 0.57], "end": [0.13, 0.02, 0.57],
        "lap_time": 1.2, "laps": 0.5, "smooth_start": 0.3, "settle": 0.1,
    },
    "line in a plane": {
        "path": "line", "start": [0.1, 0.0, 0.57], "end": [0.16, 0.0, 0.57],
        "lap_time": 2.0, "laps": 1, "smooth_start": 0.5,
    },
}  # fmt: skip
STATIC: dict[str, Any] = {"actuation": {"kind": "static"}}
NO_DAMPING = {"environment_damping": False, "material_damping": False}
SCENES: dict[str, dict[str, Any]] = {
    "the plant's": {},
    "slow mode": {"actuation": {"kind": "slow-mode"}},
    "static drive": STATIC,
    "no inertia": {"effects": {"inertia": False}},
    "no inertia, static drive": STATIC | {"effects": {"inertia": False}},
    "statics alone": STATIC | {"effects": {"inertia": False, **NO_DAMPING}},
    "planar": {"model": {"strains": ["epsilon", "kappa_y"]}},
    "no gravity": {"effects": {"gravity": False}},
}


def measured(path: dict[str, Any], changes: dict[str, Any]) -> dict[str, float]:
    """RMS error (mm), median of a step (ms), failures, states of the controller.

    Raises `SceneError` where such a controller cannot follow the path.
    """
    controller = {"scene": changes} if changes else {}
    task = read_tracking({**path, "controller": controller}, Path("."), ARM)
    setup = set_up(scene_from_dict(ARM), task)
    found = row_of(setup.run(setup.controller))
    return {
        "rms_mm": found["rms_error_mm"],
        "step_ms_median": found["step_ms_median"],
        "failed_count": found["failures"],
        "states_count": len(setup.ocp.model.layout.x),
    }


def numbers(quick: bool) -> dict[str, float]:
    """The fast line with five controllers in quick mode; else all. What cannot follow is no row."""
    chosen = list(SCENES)[:5] if quick else list(SCENES)
    found: dict[str, float] = {}
    for path in ("fast line",) if quick else PATHS:
        for name in chosen:
            with suppress(SceneError):
                each = measured(PATHS[path], SCENES[name])
                found |= {key(path, name, what): value for what, value in each.items()}
    return found


def cell(path: dict[str, Any], changes: dict[str, Any]) -> tuple[str, int]:
    """A cell of the table, and how many states the controller has."""
    try:
        found = measured(path, changes)
    except SceneError as error:
        return f"{str(error).split(':')[2].strip()[:24]:>24}", 0
    failed = f" ({found['failed_count']} failed)" if found["failed_count"] else ""
    text = f"{found['rms_mm']:10.4f} {found['step_ms_median']:6.1f}{failed:8}"
    return text, int(found["states_count"])


def main() -> None:
    """Print the table."""
    print(f"{'controller':26}{'states':>6}" + "".join(f"{name + ': mm, ms':>26}" for name in PATHS))
    for name, changes in SCENES.items():
        cells = [cell(path, changes) for path in PATHS.values()]
        states = max(states for _, states in cells)
        print(f"{name:26}{states:6d}" + "".join(f"{text:>26}" for text, _ in cells), flush=True)


if __name__ == "__main__":
    main()
