"""From a flight log and a scene file to the controllers that replay it."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from softmpc.codegen.flight_log import FlightLog
from softmpc.codegen.generate import generate
from softmpc.codegen.problem_hash import problem_hash
from softmpc.codegen.recorder_files import hash_in
from softmpc.codegen.replay import Replayed, play
from softmpc.codegen.replay_c import CPlayer, through_qemu
from softmpc.codegen.replay_python import PythonPlayer
from softmpc.control.mpc import Mpc
from softmpc.control.stage import DISTURBANCE
from softmpc.control.tracking import Setup, read_track_file, ready, set_up
from softmpc.errors import InputError, errors_in, unknown_name
from softmpc.rig.rigging import read_rig_file

__all__ = ["PLAYERS", "Replay", "check_problem", "players_of", "replay_of", "scene_of"]

PLAYERS = ("python", "c", "qemu")
Progress = Callable[[int, int], None]


@dataclass(frozen=True, eq=False)
class Replay:
    """A log with the task that it was recorded in."""

    log: FlightLog
    title: str
    setup: Setup
    code: Path | None = None  # a generated folder

    @property
    def torque(self) -> bool:
        """Whether inputs are torques, not pressures."""
        return self.setup.ocp.model.scene.actuation.input == "torque"

    def by(self, name: str, progress: Progress | None = None) -> Replayed:
        """What comes out of the controller of that name.

        Raises `BuildError` where a compiler or an emulator is missing, `InputError` where the given
        folder is of another controller.
        """
        (name,) = players_of(self.log, name)
        t = self.setup.controller.transcription
        if name == "python":
            return play(self.log, PythonPlayer(self.setup.controller), progress)
        if progress is not None:
            progress(0, len(self.log.steps))
        with self._code() as folder:
            if name == "c":
                return play(self.log, CPlayer(folder, t, self.log), progress)
            return through_qemu(self.log, folder)

    @contextmanager
    def _code(self) -> Iterator[Path]:
        """The folder of the controller in C: the one given, or one that is generated now."""
        if self.code is not None:
            _check_code(self.log, self.code)
            yield self.code
            return
        with tempfile.TemporaryDirectory(prefix="softmpc-replay-") as scratch:
            folder = Path(scratch) / "controller"
            generate(self.setup, folder, demo=False)
            yield folder


def players_of(log: FlightLog, names: str | None = None) -> tuple[str, ...]:
    """Names of controllers from a list with commas.

    Without one Python, and C where it wrote the log. Raises `InputError` for an unknown one.
    """
    if names is None:
        return ("python", "c") if log.header.writer == "C" else ("python",)
    found = tuple(dict.fromkeys(name.strip() for name in names.split(",")))
    for name in found:
        if name not in PLAYERS:
            raise InputError(unknown_name("replay", name, PLAYERS))
    return found


def scene_of(log: FlightLog, scene: str | os.PathLike[str] | None = None) -> Path:
    """The scene file of a log: the one given, or the log's own, from here or beside the log."""
    if scene is not None:
        return Path(scene)
    name = log.header.scene
    if not name:
        raise InputError(
            f"{log.path}: names no scene file: give the one it was made with (--scene)"
        )
    for candidate in (Path(name), log.path.parent / name, log.path.parent / Path(name).name):
        if candidate.is_file():
            return candidate
    raise InputError(
        f"{log.path}: its scene file {name!r} is neither here nor beside the log: give it (--scene)"
    )


def replay_of(
    log: FlightLog,
    scene: str | os.PathLike[str] | None = None,
    code: str | os.PathLike[str] | None = None,
    progress: Progress | None = None,
) -> Replay:
    """Make the controller of a log from its scene file.

    `code` is a folder that `softmpc codegen` has written; without it one is made where needed.
    Raises `InputError` where the scene makes another problem than the one the log is of.
    """
    path = scene_of(log, scene)
    if code is not None:
        _check_code(log, Path(code))
    title, own, task = read_track_file(path, "project")  # the log says what it was given
    rig = read_rig_file(path) if DISTURBANCE in log.header.names else None
    disturbance = None if rig is None else rig.disturbance
    with errors_in(path):
        setup = ready(lambda report: set_up(own, task, disturbance, report), progress)
    check_problem(log, path, setup.controller)
    return Replay(log, title, setup, None if code is None else Path(code))


def _check_code(log: FlightLog, code: Path) -> None:
    """Raise `InputError` where a folder is none of the log's controller."""
    own, logged = hash_in(code), log.header.scene_hash
    if own != logged:
        raise InputError(
            f"{code}: is the controller of another problem ({own}) than {log.path} ({logged}): "
            "give the folder it was made with, or none"
        )


def check_problem(log: FlightLog, scene: str | os.PathLike[str], mpc: Mpc) -> None:
    """Raise `InputError` where a log is of another problem than `mpc`, which is of file `scene`."""
    t, h = mpc.transcription, log.header
    sizes = {"intervals": t.N, "states": t.nx, "inputs": t.inputs, "references": t.nr}
    for name, size in sizes.items():
        if getattr(h, name) != size:
            raise InputError(
                f"{log.path}: its controller has {getattr(h, name)} {name}; that of {scene} has "
                f"{size}: give the scene file it was made with (--scene)"
            )
    own = problem_hash(t, getattr(mpc.solver, "blocks", None))
    if h.scene_hash != own:
        raise InputError(
            f"{log.path}: is of another problem ({h.scene_hash}) than {scene} ({own}), though of "
            "the same sizes: give the scene file it was made with (--scene), as it was then"
        )
