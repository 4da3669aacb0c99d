"""The path of a scene as a table in C: what the demonstration tells the controller in each step.

References that coming steps have in common are written once: on a horizon of equal intervals one
row a step. Where the rows of two steps disagree about a time, each step has all of its own.
"""

from __future__ import annotations

import numpy as np

from softmpc.codegen import c_text
from softmpc.control.closed_loop import SAMPLE
from softmpc.control.stage import DISTURBANCE
from softmpc.control.track_result import WINDOW
from softmpc.control.tracking import Setup

__all__ = ["overlapping", "reference_files", "references_of"]

Array = np.ndarray
EQUAL = 1e-12  # of the largest reference of a kind


def references_of(setup: Setup) -> Array:
    """What the scene's own controller is told in each step of the run (K×N×nr)."""
    transcription, ocp = setup.controller.transcription, setup.ocp
    none = np.zeros((ocp.intervals, transcription.objective.references.get(DISTURBANCE, 0)))
    known = {DISTURBANCE: none}
    times = ocp.step * np.arange(steps_of(setup))
    return np.array(
        [transcription.references(known | setup.guide.given(t + ocp.nodes)) for t in times]
    )


def steps_of(setup: Setup) -> int:
    """Steps of the controller in a run."""
    return round(setup.guide.duration / setup.ocp.step)


def reference_files(setup: Setup, references: Array, title: str = "") -> dict[str, str]:
    """reference.h and reference.c, by name in `demo`, for references (K×N×nr) of K steps."""
    rows, ahead = overlapping(references)
    samples = max(1, round(setup.ocp.step / SAMPLE))
    times = setup.ocp.step / samples * np.arange(1 + samples * len(references))
    others: dict[str, tuple[Array, str]] = {
        "smpc_run_asked": (setup.guide.asked(times), "double"),
        "smpc_run_counts": (_counted(setup, times), "unsigned char"),
        "smpc_run_x": (setup.start.x, "double"),
        "smpc_run_u": (setup.start.u, "double"),
    }
    sizes = [
        c_text.define("SMPC_RUN_TITLE", title),
        c_text.define("SMPC_RUN_STEPS", len(references), "steps of the controller"),
        c_text.define("SMPC_RUN_SAMPLES", samples, "of the error, in a step"),
        c_text.define("SMPC_RUN_SETTLE", float(setup.task.settle), "s, before which none counts"),
        c_text.define("SMPC_RUN_AHEAD", ahead, "rows of references from one step to the next"),
    ]
    arrays = {"smpc_run_references": (rows, "smpc_real"), **others}
    head = '#include "real.h"\n\n' + "".join(sizes) + f"\n{_ABOUT}"
    declared = "".join(c_text.declaration(n, v.size, kind) for n, (v, kind) in arrays.items())
    defined = "\n".join(c_text.array(name, *both) for name, both in arrays.items())
    return {
        "demo/reference.h": c_text.guard("reference.h", head + declared),
        "demo/reference.c": f'#include "reference.h"\n\n{defined}',
    }


def _counted(setup: Setup, times: Array) -> Array:
    """Whether the error of a sample counts, as in a `TrackResult`."""
    found = times >= setup.task.settle
    jumps = () if setup.guide.rest is None else setup.guide.rest.jump_times(times)
    for jump in jumps:
        found &= (times < jump) | (times > jump + WINDOW)
    return np.asarray(found)


_ABOUT = """/* References at coming nodes, SMPC_NR numbers a row: step k is told of SMPC_N rows
 * from row k * SMPC_RUN_AHEAD on. Places asked for at all samples (m), and whether their errors
 * count. State of the plant and input at the start. */
"""


def overlapping(references: Array) -> tuple[Array, int]:
    """Rows (R×nr) that hold windows of references (K×N×nr), and how many one step goes on."""
    steps, nodes, width = references.shape
    rows = np.vstack([references[:, 0], references[-1, 1:]])
    size = np.abs(rows).max(axis=0, initial=0.0)
    windows = np.arange(steps)[:, None] + np.arange(nodes)
    if np.all(np.abs(rows[windows] - references) <= EQUAL * size):
        return rows, 1
    return references.reshape(-1, width), nodes
