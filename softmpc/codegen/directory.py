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

MANIFEST = "files.txt"  # what was written
BUILT = {"run", "libsmpc.a", "libsmpc_arm.a", "codegen.json"}  # beside the folder `build`
NAMED = 3  # files of others, in an error


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
    others = _files_of_others(folder)
    if others:
        named = ", ".join(others[:NAMED]) + (", …" if len(others) > NAMED else "")
        raise InputError(
            f"{folder}: holds files that are not a controller's ({named}), and writing it replaces "
            "all that is there; give an empty folder, or move them"
        )
    return folder


def _files_of_others(folder: Path) -> list[str]:
    """Files of a folder that neither was written nor comes from building what was."""
    if not folder.is_dir():
        return []
    listed = folder / MANIFEST
    own = set(listed.read_text(encoding="utf-8").split("\n")) if listed.is_file() else set()
    found = [path.relative_to(folder) for path in folder.rglob("*") if not path.is_dir()]
    return sorted(
        path.as_posix()
        for path in found
        if path.as_posix() not in own | BUILT and (path.parts[0] != "build" or not own)
    )


def write_folder(folder: Path, texts: Mapping[str, str]) -> None:
    """All files beside the old ones, then instead of them: a crash leaves the old folder."""
    beside = folder.with_name(f".{os.getpid()}.{folder.name}")
    texts = {**texts, MANIFEST: "\n".join(sorted([*texts, MANIFEST])) + "\n"}
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
