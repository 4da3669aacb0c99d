"""A directory of C with the controller of a scene: what is always the same, and what is not.

c/        C99 that every controller shares, copied as it is
sizes.h   sizes, sample time, tolerances, hash of the scene and version
data.*    constants of the problem
model.*   functions of the arm, its costs and its limits, written by CasADi
"""

from __future__ import annotations

import hashlib
import os
import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path

import softmpc
from softmpc.codegen import recorder_files
from softmpc.codegen.condition import Conditioning, conditioning
from softmpc.codegen.data import ControllerData
from softmpc.codegen.model_functions import controller_functions, sources
from softmpc.codegen.sizes import sizes_header
from softmpc.control.closed_loop import Start
from softmpc.control.mpc import Mpc
from softmpc.control.real_time import RealTime
from softmpc.control.tracking import Setup, read_track_file, ready, set_up
from softmpc.errors import BuildError, InputError, errors_in

__all__ = ["Generated", "generate", "generate_controller", "generate_file"]

ITERATIONS = 1000  # of the quadratic program in a step, as in Python
CORE = (
    "controller.h", "memory.h", "parts.h", "real.h", "sparse.h", "linear.h", "ldp.h", "guard.h",
    "linear.c", "sparse.c", "dynamics.c", "spread.c", "terms.c", "condense.c", "program.c",
    "quadratic.c", "ldp.c", "daqp_sources.c", "merit.c", "rollout.c", "real_time.c", "nmpc.c",
    "guard.c", "plan.c", "names.c",
)  # fmt: skip
DAQP = (
    "daqp.c", "auxiliary.c", "factorization.c", "daqp.h", "auxiliary.h", "factorization.h",
    "types.h", "constants.h", "LICENSE", "VERSION",
)  # fmt: skip

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Generated:
    """What was written: the folder, its files, the identity of the controller, and its condition."""

    folder: Path
    files: tuple[str, ...]
    identity: dict[str, str]
    conditioning: Conditioning
    sizes: dict[str, int] = field(default_factory=dict)


def generate_file(
    path: str | os.PathLike[str], out: str | os.PathLike[str], progress: Progress | None = None,
    iterations: int = ITERATIONS,
) -> Generated:  # fmt: skip
    """The controller of a scene file's table [track]."""
    _, scene, task = read_track_file(path)
    with errors_in(path):
        setup = ready(lambda report: set_up(scene, task, progress=report), progress)
        return generate(setup, out, iterations=iterations)


def generate(
    setup: Setup, out: str | os.PathLike[str], *, iterations: int = ITERATIONS,
    max_rows: int | None = None,
) -> Generated:  # fmt: skip
    """Write the controller of a tracking task into the folder `out`, see `generate_controller`."""
    start = _controller_start(setup)
    return generate_controller(
        setup.controller, out, start=start, iterations=iterations, max_rows=max_rows
    )


def generate_controller(
    mpc: Mpc, out: str | os.PathLike[str], *, start: Start, iterations: int = ITERATIONS,
    max_rows: int | None = None, more: Mapping[str, str] | None = None,
) -> Generated:  # fmt: skip
    """Write a controller into the folder `out`.

    `start` is a state of rest of its model, from which it is judged whether float is enough.
    `iterations` is the most that the quadratic program takes in a step, `max_rows` how many rows of
    limits may be near or active at once (all of them by default), `more` are files beside. Raises
    `BuildError` for a solver other than real-time iteration, `InputError` where the folder holds
    something else.
    """
    if not 1 <= iterations <= 1_000_000:
        raise InputError(f"iterations = {iterations}: must be between 1 and 1,000,000")
    solver = _real_time(mpc)
    data = ControllerData(solver, 1_000_000 if max_rows is None else max_rows)
    texts = sources("model", controller_functions(solver.linearisation))
    texts["data.h"], texts["data.c"] = data.text()
    identity = _identity(texts)
    worst = conditioning(solver, [(start.x, start.u)])
    texts["sizes.h"] = sizes_header(data, identity, iterations, worst)
    texts |= {**recorder_files.files(mpc), **(more or {})}
    folder = _folder(Path(out))
    _write(folder, texts)
    return Generated(folder, tuple(sorted(texts)), identity, worst, data.sizes)


def _real_time(mpc: Mpc) -> RealTime:
    solver = mpc.solver
    if not isinstance(solver, RealTime) or not solver.splits:
        raise BuildError(
            f"codegen: the solver is {type(solver).__name__}; C code is made of real-time iteration: "
            'set solver = "real-time" in [track.controller]'
        )
    return solver


def _controller_start(setup: Setup) -> Start:
    """The start as a state of the controller's model."""
    to_state = setup.guide.to_state
    if to_state is None:
        return setup.start
    return Start(to_state(setup.start.x, setup.start.u), setup.start.u)


def _identity(texts: Mapping[str, str]) -> dict[str, str]:
    """Version and a hash of everything that decides what the controller does."""
    digest = hashlib.sha256()
    for name in sorted(texts):
        digest.update(f"{name}\0{texts[name]}\0".encode())
    for name in CORE:
        digest.update(_core(name).encode())
    return {"VERSION": softmpc.__version__, "SCENE_HASH": digest.hexdigest()[:16]}


def _core(name: str) -> str:
    return files("softmpc.codegen").joinpath("c", name).read_text(encoding="utf-8")


def _folder(out: Path) -> Path:
    """An empty folder, or one that this has written before."""
    if out.exists() and not out.is_dir():
        raise InputError(f"{out}: is a file; give a folder")
    if out.is_dir() and any(out.iterdir()) and not (out / "controller.h").is_file():
        raise InputError(f"{out}: holds files that are not a controller's; give an empty folder")
    return out


def _write(folder: Path, texts: Mapping[str, str]) -> None:
    """All files beside the old ones, then instead of them: a crash leaves the old folder."""
    beside = folder.with_name(f".{os.getpid()}.{folder.name}")
    try:
        shutil.rmtree(beside, ignore_errors=True)
        (beside / "daqp").mkdir(parents=True)
        for name in CORE:
            (beside / name).write_text(_core(name), encoding="utf-8")
        for name in DAQP:
            (beside / "daqp" / name).write_text(_core(f"daqp/{name}"), encoding="utf-8")
        for name, text in texts.items():
            (beside / name).write_text(text, encoding="utf-8")
        if folder.exists():
            shutil.rmtree(folder)
        beside.rename(folder)
    except OSError as error:
        raise InputError(f"{folder}: cannot be written: {error.strerror or error}") from None
    finally:
        shutil.rmtree(beside, ignore_errors=True)
