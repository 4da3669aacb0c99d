"""The pilot in C beside the one in Python: time of an estimate and of a step, and its memory.

    python -m tests.benchmarks.pilot [--scene SCENE] [--seconds 4] [--json FILE]

Both fly the same rig with the same noise, one after the other. Times are by the wall, medians and
the largest; "estimate" goes back to the oldest reading that has arrived and on to when the input
acts, "step" is all from readings to an input.
"""

from __future__ import annotations

import json
import re
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from softmpc.compiler import compiler
from softmpc.errors import InputError
from tests.benchmarks.common import EXAMPLES, LeftOut, arguments, key

KINDS = {"C, double": False, "C, float": True}  # whether numbers are single
PARTS = ("pilot", "controller", "estimator")


def measured(path: Path, seconds: float, kinds: tuple[str, ...] = tuple(KINDS)) -> dict[str, Any]:
    """Times (ms) and bytes by pilot."""
    from softmpc.codegen.compiled_pilot import CompiledPilot
    from softmpc.codegen.generate import generate_file
    from softmpc.control.tracking import read_track_file
    from softmpc.rig.rigging import read_rig_file, rig_up

    _, scene, task = read_track_file(path)
    settings = read_rig_file(path)
    assert settings is not None, f"{path} has no table [rig]"
    if seconds < task.settle:
        raise InputError(f"seconds = {seconds:g}: errors count after {task.settle:g} s; run longer")
    rig = rig_up(scene, task, settings)
    with tempfile.TemporaryDirectory() as folder:
        made = Path(folder) / "c"
        generate_file(path, made)
        found = {"Python": times(rig.run(duration=seconds))}
        for name in kinds:
            single = KINDS[name]
            if single and "#error" in (made / "sizes.h").read_text():
                continue
            pilot = CompiledPilot(made, rig.pilot, single=single)
            found[name] = times(replace(rig, pilot=pilot).run(duration=seconds)) | memory(pilot)
        sizes = (made / "estimator_sizes.h").read_text()
    knots = re.findall(r"#define SMPC_(KNOTS|MEMORY|SAMPLES) (\d+)", sizes)
    return found | {"window": {name.lower(): int(count) for name, count in knots}}


def times(result: Any) -> dict[str, float]:
    found = {}
    for name, values in (("estimate", result.estimate_ms), ("step", result.track.step_ms)):
        found |= {f"{name}_ms": float(np.median(values)), f"{name}_ms_max": float(values.max())}
    return found | {"rms_error_mm": float(result.summary()["rms_error_mm"])}


def memory(pilot: Any) -> dict[str, int]:
    """Bytes of a pilot and of its parts."""
    import ctypes

    library, names = pilot.library, ("pilot_memory", "memory", "estimator_memory")
    for name in names:
        getattr(library, f"smpc_{name}").restype = ctypes.c_ulong
    return {
        f"{part}_bytes": int(getattr(library, f"smpc_{name}")())
        for part, name in zip(PARTS, names, strict=True)
    }


def numbers(quick: bool) -> dict[str, float]:
    """One second of the figure eight, double alone, in quick mode; else 4 s of both.

    Ratios are Python's times over those in C.
    """
    if compiler() is None:
        raise LeftOut("needs a C compiler")
    extent = (1.0, ("C, double",)) if quick else (4.0,)
    rows = measured(EXAMPLES / "figure_eight_rig.toml", *extent)
    window, python = rows.pop("window"), rows["Python"]
    found = {key("readings may be late", "ms"): window["memory"]}
    for name, row in rows.items():
        kept = {what: value for what, value in row.items() if not what.endswith("_max")}
        found |= {key(name, what): value for what, value in kept.items()}
        if name != "Python":
            for what in ("estimate_ms", "step_ms"):
                found[key(name, what[:-3], "time ratio python to c")] = python[what] / row[what]
    return found


def main() -> int:
    parser = arguments(__doc__)
    parser.add_argument("--scene", default="examples/figure_eight_rig.toml")
    parser.add_argument("--seconds", type=float, default=4.0, help="of each run")
    parser.add_argument("--json", type=Path, help="where to write the numbers")
    given = parser.parse_args()
    try:
        found = measured(Path(given.scene), given.seconds)
    except InputError as error:
        parser.error(str(error))
    for line in _lines(found):
        print(line)
    if given.json:
        given.json.write_text(json.dumps(found, indent=2))
    return 0


def _lines(found: dict[str, Any]) -> list[str]:
    head = f"{'pilot':<10} {'estimate, ms':>18} {'step, ms':>18} {'RMS mm':>7}"
    lines = [head + "".join(f"{part:>12}" for part in PARTS)]
    for name, row in found.items():
        if name == "window":
            continue
        cells = [
            f"{row[f'{kind}_ms']:.3f} ({row[f'{kind}_ms_max']:.2f})"
            for kind in ("estimate", "step")
        ]
        bytes_of = [row.get(f"{part}_bytes") for part in PARTS]
        lines.append(
            f"{name:<10} {cells[0]:>18} {cells[1]:>18} {row['rms_error_mm']:>7.2f}"
            + "".join(f"{'' if one is None else f'{one / 1e3:.0f} kB':>12}" for one in bytes_of)
        )
    window = found["window"]
    lines.append(
        f"readings may be {window['memory']} ms late: {window['knots']} times are remembered, "
        f"{window['samples']} readings"
    )
    return lines


if __name__ == "__main__":
    sys.exit(main())
