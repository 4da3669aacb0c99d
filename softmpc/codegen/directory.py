"""The folder that a controller in C is written into: whole or not at all."""

from __future__ import annotations

import hashlib
import os
import shutil
from collections.abc import Iterable, Mapping
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path

from softmpc.errors import InputError

__all__ = ["c_source", "checked_folder", "identity_of", "write_folder"]


def c_source(name: str) -> str:
    """A file of `softmpc/codegen/c`, which is the same in all directories."""
    return files("softmpc.codegen").joinpath("c", *name.split("/")).read_text(encoding="utf-8")


def identity_of(texts: Mapping[str, str], names: Iterable[str]) -> dict[str, str]:
    """Version, and a hash of what was generated and of the sources `names` beside it."""
    digest = hashlib.sha256()
    for name in sorted(texts):
        digest.update(f"{name}\0{texts[name]}\0".encode())
    for name in names:
        digest.update(c_source(name).encode())
    return {"VERSION": version("softmpc"), "SCENE_HASH": digest.hexdigest()[:16]}


def checked_folder(out: str | os.PathLike[str]) -> Path:
    """A folder that is empty, that is not there yet, or that a controller was written into."""
    folder = Path(out)
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: is a file; give a folder")
    used = folder.is_dir() and any(folder.iterdir())
    if used and not (folder / "controller.h").is_file():
        raise InputError(f"{folder}: holds files that are not a controller's; give an empty folder")
    return folder


def write_folder(folder: Path, texts: Mapping[str, str]) -> None:
    """All files beside the old ones, then instead of them: a crash leaves the old folder."""
    beside = folder.with_name(f".{os.getpid()}.{folder.name}")
    try:
        shutil.rmtree(beside, ignore_errors=True)
        for name, text in texts.items():
            (beside / name).parent.mkdir(parents=True, exist_ok=True)
            (beside / name).write_text(text, encoding="utf-8")
        if folder.exists():
            shutil.rmtree(folder)
        beside.rename(folder)
    except OSError as error:
        raise InputError(f"{folder}: cannot be written: {error.strerror or error}") from None
    finally:
        shutil.rmtree(beside, ignore_errors=True)
