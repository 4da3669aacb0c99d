"""Files written whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

from softmpc.errors import InputError

__all__ = ["write_whole"]


def write_whole(path: str | os.PathLike[str], write: Callable[[Path], None]) -> Path:
    """Let `write` fill a file beside `path`, then rename: a crash leaves the last good one."""
    path = Path(path)
    beside = path.with_name(f".{os.getpid()}.{path.name}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write(beside)
        beside.replace(path)
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror or error}") from None
    finally:
        beside.unlink(missing_ok=True)
    return path
