"""Simple controllers in C with the interface of the others: LQR, and the inverse-statics table.

The C code is in `c/baselines`; what depends on the scene are the gains, and the functions of the
table's tip. The path is told step by step, as `told` of the controllers in Python says.
"""

from __future__ import annotations

import os
from pathlib import Path

import casadi as ca
import numpy as np

from softmpc.codegen import c_text
from softmpc.codegen.demonstration import demonstration
from softmpc.codegen.directory import c_source, checked_folder, identity_of, write_folder
from softmpc.codegen.directory_readme import directory_readme
from softmpc.codegen.model_functions import Wrapped, in_rows, sources
from softmpc.codegen.monitor_data import monitor_files
from softmpc.codegen.reference import steps_of
from softmpc.control.baselines import Regulated, StaticsTable
from softmpc.control.mpc import RESTART_AFTER
from softmpc.control.tracking import Setup
from softmpc.errors import InputError, unknown_name
from softmpc.model.model import Model
from softmpc.statics.workspace_result import Workspace

__all__ = ["BASELINES", "baseline_files", "generate_baseline", "told_of"]

Baseline = Regulated | StaticsTable
BASELINES: dict[str, type[Baseline]] = {"lqr": Regulated, "table": StaticsTable}
SHARED = (
    "controller.h", "real.h", "scalar.h", "linear.h", "linear.c", "guard.h", "guard.c", "names.c",
    "baselines/memory.h", "baselines/parts.h", "baselines/baseline.c",
)  # fmt: skip


def generate_baseline(
    setup: Setup, kind: str, out: str | os.PathLike[str], title: str = "",
    workspace: Workspace | None = None,
) -> Baseline:  # fmt: skip
    """Write the controller "lqr" or "table" of a task into the folder `out`; returns it in Python.

    `workspace` is for the monitor, see `monitor_files`. Raises `InputError` for another kind, for a
    task along a plan, and where the folder holds something else.
    """
    if kind not in BASELINES:
        raise InputError(unknown_name("controller", kind, BASELINES))
    folder = checked_folder(out)
    make = BASELINES[kind]
    baseline = make(setup.ocp, setup.guide)
    texts = baseline_files(baseline, kind)
    told = {name: np.size(value) for name, value in baseline.told(0.0).items()}
    back_off = setup.task.controller.back_off
    texts |= monitor_files(baseline.ocp.model, told, back_off, workspace)
    texts |= demonstration(setup, told_of(baseline, steps_of(setup)), title)
    texts["README.md"] = directory_readme(setup.ocp.model, texts, title)
    write_folder(folder, texts)
    return baseline


def told_of(baseline: Baseline, steps: int) -> np.ndarray:
    """What it is told in each step of a run (steps×1×nr)."""
    times = baseline.ocp.step * np.arange(steps)
    return np.array([[np.concatenate([*baseline.told(t).values()])] for t in times])


def baseline_files(baseline: Baseline, kind: str) -> dict[str, str]:
    """The controller alone: its sources, sizes, constants and functions."""
    copied = (*SHARED, f"baselines/{kind}.c")
    texts = {Path(name).name: c_source(name) for name in copied}
    made = {"data.h": "", "data.c": ""}
    made["data.h"], made["data.c"] = _data(baseline)
    if kind == "table":
        made |= sources("model", [_tip(baseline.ocp.model)])
    made["sizes.h"] = _sizes(baseline, kind, identity_of(made, copied))
    return texts | made


def _tip(model: Model) -> Wrapped:
    q = ca.SX.sym("q", model.strains)
    function = in_rows("casadi_tip", {"q": q}, {"tip": model.tip(q)})
    return Wrapped("tip", function, "place of the tip (m) for strains q")


def _data(baseline: Baseline) -> tuple[str, str]:
    """data.h and data.c."""
    guard = baseline.guard
    arrays = {
        "smpc_nodes": np.zeros(1),
        "smpc_places": baseline.places,
        "smpc_gains": baseline.gains,
        "smpc_least_input": guard.low,
        "smpc_most_input": guard.high,
        "smpc_most_fall": guard.fall,
        "smpc_most_rise": guard.rise,
    }
    declared = "".join(c_text.declaration(name, value.size) for name, value in arrays.items())
    defined = "\n".join(c_text.array(name, value) for name, value in arrays.items())
    return (
        c_text.guard("data.h", f'#include "real.h"\n\n{declared}'),
        f'/* Constants of one scene. */\n#include "data.h"\n\n{defined}',
    )


def _sizes(baseline: Baseline, kind: str, identity: dict[str, str]) -> str:
    """sizes.h."""
    layout = baseline.ocp.model.layout
    told = {name: np.size(value) for name, value in baseline.told(0.0).items()}
    lines = [c_text.define(f"SMPC_{name}", text) for name, text in identity.items()]
    lines += [
        c_text.define("SMPC_CONTROLLER", kind),
        c_text.define("SMPC_STEP", float(baseline.ocp.step), "s"),
        c_text.define(
            "SMPC_REFERENCES",
            ", ".join(f"{name}[{size}]" for name, size in told.items()),
            "of each step, in this order",
        ),
        c_text.define("SMPC_N", 1, "rows of references"),
        c_text.define("SMPC_NR", sum(told.values()), "references"),
        c_text.define("SMPC_NX", len(layout.x), "states"),
        c_text.define("SMPC_INPUTS", len(layout.u)),
        c_text.define("SMPC_PLACES", len(baseline.places), "of the gains"),
        c_text.define("SMPC_MOST_FAILURES", RESTART_AFTER, "that are counted in a row"),
    ]
    if isinstance(baseline, StaticsTable):
        lines += [
            c_text.define("SMPC_PROPORTIONAL", baseline.proportional),
            c_text.define("SMPC_INTEGRAL", baseline.integral, "1/s"),
        ]
    return c_text.guard("sizes.h", "".join(lines))
