"""The flight recorder's files of a generated directory."""

from __future__ import annotations

import re
from importlib.resources import files as resources
from pathlib import Path

from softmpc.codegen import c_text
from softmpc.codegen.problem_hash import problem_hash
from softmpc.control.mpc import Mpc
from softmpc.errors import InputError

__all__ = ["files", "hash_in"]

SOURCES = (
    "recorder.h", "recorder.c", "recorder_bytes.h", "recorder_bytes.c", "recorder_ring.c", "log.h",
    "log.c",
)  # fmt: skip


def files(mpc: Mpc, scene: str = "") -> dict[str, str]:
    """Name and text of each; `scene` is the file that `softmpc replay` shall look for."""
    own = resources("softmpc.codegen").joinpath("c")
    found = {name: own.joinpath(name).read_text(encoding="utf-8") for name in SOURCES}
    blocks = getattr(mpc.solver, "blocks", None)
    body = c_text.define("SMPC_PROBLEM_HASH", problem_hash(mpc.transcription, blocks))
    body += c_text.define("SMPC_SCENE", scene, "the file, where it is known")
    return found | {"problem.h": c_text.guard("problem.h", body)}


def hash_in(folder: Path) -> str:
    """The hash of the problem of a generated folder. Raises `InputError` where there is none."""
    try:
        text = (folder / "problem.h").read_text(encoding="utf-8")
    except OSError:
        raise InputError(
            f"{folder}: has no problem.h; `softmpc codegen` makes a controller's folder"
        ) from None
    found = re.search(r'SMPC_PROBLEM_HASH "(\w+)"', text)
    return found[1] if found else ""
