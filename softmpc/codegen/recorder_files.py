"""The flight recorder's files of a generated directory."""

from __future__ import annotations

from importlib.resources import files as resources

from softmpc.codegen import c_text
from softmpc.codegen.problem_hash import problem_hash
from softmpc.control.mpc import Mpc

__all__ = ["files"]

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
