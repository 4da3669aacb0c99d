"""A directory of C with the controller of a scene: what is always the same, and what is not.

c/        C99 that every controller shares, copied as it is
sizes.h   sizes, sample time, tolerances, hash of the scene and version
data.*    constants of the problem
model.*   functions of the arm, its costs and its limits, written by CasADi
arm/      equations of the arm, for programs of one's own
demo/     a program that runs the scene's path on its plant
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from softmpc.codegen import recorder_files
from softmpc.codegen.arm_functions import arm_files
from softmpc.codegen.condition import Conditioning, conditioning
from softmpc.codegen.data import ControllerData
from softmpc.codegen.demonstration import demonstration
from softmpc.codegen.directory import c_source, checked_folder, identity_of, write_folder
from softmpc.codegen.directory_readme import directory_readme
from softmpc.codegen.estimator_pilot import files as pilot_files
from softmpc.codegen.model_functions import controller_functions, sources
from softmpc.codegen.monitor_data import monitor_files
from softmpc.codegen.reference import references_of
from softmpc.codegen.sizes import sizes_header
from softmpc.control.closed_loop import Start
from softmpc.control.mpc import Mpc
from softmpc.control.real_time import RealTime
from softmpc.control.tracking import Setup, read_track_file, ready, set_up
from softmpc.errors import BuildError, InputError, errors_in
from softmpc.rig.rigging import read_rig_file, rig_up
from softmpc.statics.workspace_result import Workspace

__all__ = ["Generated", "generate", "generate_controller", "generate_file"]

ITERATIONS = 1000  # of the quadratic program in a step, as in Python
CORE = (
    "controller.h", "memory.h", "parts.h", "real.h", "scalar.h", "sparse.h", "linear.h", "ldp.h",
    "guard.h",
    "linear.c", "sparse.c", "dynamics.c", "spread.c", "terms.c", "condense.c", "program.c",
    "quadratic.c", "ldp.c", "daqp_sources.c", "merit.c", "rollout.c", "real_time.c", "nmpc.c",
    "guard.c", "plan.c", "names.c",
)  # fmt: skip
DAQP = (
    "daqp/daqp.c", "daqp/auxiliary.c", "daqp/factorization.c", "daqp/daqp.h", "daqp/auxiliary.h",
    "daqp/factorization.h", "daqp/types.h", "daqp/constants.h", "daqp/LICENSE", "daqp/VERSION",
)  # fmt: skip

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Generated:
    """What was written: folder, files made for the scene, identity of the controller, condition."""

    folder: Path
    files: tuple[str, ...]
    identity: dict[str, str]
    conditioning: Conditioning
    sizes: dict[str, int] = field(default_factory=dict)


def generate_file(
    path: str | os.PathLike[str], out: str | os.PathLike[str], progress: Progress | None = None, *,
    iterations: int = ITERATIONS, max_rows: int | None = None,
    workspace: str | os.PathLike[str] | None = None,
) -> Generated:  # fmt: skip
    """The controller of a scene file's table [track], see `generate`; `workspace` is a file.

    With a table [rig] its estimator and supervision are beside it, see `pilot.h`.
    """
    checked_folder(out)  # before anything takes time
    title, scene, task = read_track_file(path)
    space = None if workspace is None else Workspace.load(workspace)
    settings = read_rig_file(path)
    with errors_in(path):
        if settings is None:
            setup, beside = ready(lambda report: set_up(scene, task, progress=report), progress), {}
        else:
            rig = ready(lambda report: rig_up(scene, task, settings, report), progress)
            setup, beside = rig.setup, pilot_files(rig.pilot)
        return generate(
            setup, out, iterations=iterations, max_rows=max_rows, title=title, file=path,
            workspace=space, beside=beside,
        )  # fmt: skip


def generate(
    setup: Setup, out: str | os.PathLike[str], *, iterations: int = ITERATIONS,
    max_rows: int | None = None, title: str = "", file: str | os.PathLike[str] = "",
    demo: bool = True, workspace: Workspace | None = None, beside: Mapping[str, str] | None = None,
) -> Generated:  # fmt: skip
    """Write the controller of a tracking task into the folder `out`, see `generate_controller`.

    With `demo` there is a program that runs the task, and how to build it; `title` is its name,
    `file` that of the scene file, which flight logs will name.
    With `workspace` the monitor knows how far tip and reference are from the edge of it. `beside`
    are more files by name, such as those of a pilot.
    """
    more = arm_files(setup.ocp.model) | dict(beside or {})
    if demo:
        more |= demonstration(setup, references_of(setup), title)
    return generate_controller(
        setup.controller, out, start=_controller_start(setup), iterations=iterations,
        max_rows=max_rows, more=more, title=title, file=file,
        back_off=setup.task.controller.back_off, workspace=workspace,
    )  # fmt: skip


def generate_controller(
    mpc: Mpc, out: str | os.PathLike[str], *, start: Start, iterations: int = ITERATIONS,
    max_rows: int | None = None, more: Mapping[str, str] | None = None, title: str = "",
    file: str | os.PathLike[str] = "", back_off: float = 0.0, workspace: Workspace | None = None,
) -> Generated:  # fmt: skip
    """Write a controller into the folder `out`, with a README where `more` says how to build it.

    `start` is a state of rest of its model, from which it is judged whether float is enough.
    `iterations` is the most that the quadratic program takes in a step, `max_rows` how many rows of
    limits may be near or active at once (all of them by default), `more` are files beside.
    `back_off` and `workspace` are for the monitor, see `monitor_files`. Raises `BuildError` for a
    solver other than real-time iteration, `InputError` where the folder holds something else.
    """
    if not 1 <= iterations <= 1_000_000:
        raise InputError(f"iterations = {iterations}: must be between 1 and 1,000,000")
    solver = _real_time(mpc)
    data = ControllerData(solver, 1_000_000 if max_rows is None else max_rows)
    texts = sources("model", controller_functions(solver.linearisation))
    texts["data.h"], texts["data.c"] = data.text()
    worst = conditioning(solver, [(start.x, start.u)])
    sizes = sizes_header(data, {}, iterations, worst)
    identity = identity_of(texts | {"sizes.h": sizes}, CORE)
    texts["sizes.h"] = sizes_header(data, identity, iterations, worst)
    told = mpc.transcription.objective.references
    texts |= monitor_files(mpc.ocp.model, told, back_off, workspace)
    texts |= {**recorder_files.files(mpc, os.fspath(file)), **(more or {})}
    made = tuple(sorted(texts))
    texts |= {name: c_source(name) for name in (*CORE, *DAQP)}
    if "Makefile" in texts:
        texts["README.md"] = directory_readme(mpc.ocp.model, texts, title)
    folder = checked_folder(out)
    write_folder(folder, texts)
    return Generated(folder, made, identity, worst, data.sizes)


def _real_time(mpc: Mpc) -> RealTime:
    solver = mpc.solver
    if not isinstance(solver, RealTime) or not solver.splits:
        raise BuildError(
            f"codegen: the solver is {type(solver).__name__}; C code is made of real-time "
            'iteration: set solver = "real-time" in [track.controller]'
        )
    return solver


def _controller_start(setup: Setup) -> Start:
    """The start as a state of the controller's model."""
    to_state = setup.guide.to_state
    if to_state is None:
        return setup.start
    return Start(to_state(setup.start.x, setup.start.u), setup.start.u)
