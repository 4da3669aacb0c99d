"""Compiling a generated directory to a shared library.

What CasADi wrote is long and the same in many controllers of one arm: its objects are kept in the
cache of compiled functions, under the hash of all that they depend on.
"""

from __future__ import annotations

import hashlib
import os
import re
import shutil
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from softmpc import library_cache
from softmpc.compiler import SUFFIX, CompileError, Compiler, compiler, run, why_none
from softmpc.errors import BuildError

__all__ = ["build_library", "require_compiler", "sources_of"]

STRAIGHT = ("-O1",)  # long lines of arithmetic: -O2 takes twice as long and makes them no faster
LOOPS = ("-O3", "-funroll-loops")  # what is written by hand: loops along rows
ALWAYS = ("-std=c99", "-ffp-contract=off", "-fPIC")
SINGLE = ("-DSMPC_FLOAT", "-fsingle-precision-constant")
SECONDS = 300.0  # then the compiler counts as hanging


def sources_of(folder: Path) -> list[Path]:
    """The C files of a controller; programs are in folders below."""
    return sorted(folder.glob("*.c"))


def require_compiler() -> Compiler:
    """The C compiler of this machine. Raises `BuildError` where there is none."""
    found = compiler()
    if found is None:
        raise BuildError(
            f"no C compiler ({why_none()}): install gcc or clang, or name one in the variable CC"
        )
    return found


def build_library(folder: Path, flags: Sequence[str] = (), single: bool = False) -> Path:
    """Compile the controller of a folder to a shared library in its folder `build`.

    There is one for each set of flags; it is built anew when a file is newer. Raises `BuildError`
    where there is no compiler, or where it fails.
    """
    found, sources = require_compiler(), sources_of(folder)
    if not sources:
        raise BuildError(f"{folder}: holds no C files; `softmpc codegen` writes them")
    every = [
        *(f for f in found.flags if not f.startswith("-O")),
        *ALWAYS,
        *(SINGLE if single else ()),
        *flags,
    ]
    key = hashlib.sha256(" ".join([*found.identity, *every]).encode()).hexdigest()[:8]
    library = folder / "build" / f"controller_{'float' if single else 'double'}_{key}{SUFFIX}"
    newest = max(path.stat().st_mtime_ns for path in folder.rglob("*.[ch]"))
    if library.is_file() and library.stat().st_mtime_ns > newest:
        return library
    objects = library.parent / f"objects_{key}"
    objects.mkdir(parents=True, exist_ok=True)
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        built = list(pool.map(lambda path: _object(found, path, objects, every), sources))
    beside = library.with_name(f".{os.getpid()}{library.name}")
    _run(found, folder, [*every, "-shared", *map(str, built), "-o", str(beside), "-lm"])
    beside.replace(library)
    return library


def _object(found: Compiler, source: Path, objects: Path, flags: Sequence[str]) -> Path:
    """The object of one file, from the cache where CasADi wrote it."""
    target = objects / f"{source.stem}.o"
    long = source.name.startswith(("model_", "arm_"))
    asked = [flag for flag in flags if flag.startswith("-O")]  # goes last, so that it holds
    how = [*flags, *(STRAIGHT if long else LOOPS), *asked]
    command = [*how, "-c", str(source), "-o", str(target)]
    if not long:
        _run(found, source.parent, command)
        return target
    key = _key(found, source, how)
    kept = library_cache.find(source.stem, key)
    if kept is None:
        _run(found, source.parent, command)
        with library_cache.workshop() as workshop:
            shutil.copyfile(target, workshop / target.name)
            library_cache.publish(workshop / target.name, source.stem, key)
    else:
        shutil.copyfile(kept, target)
    return target


def _key(found: Compiler, source: Path, command: Sequence[str]) -> str:
    """Hash of the source, of what it includes, and of how it is compiled."""
    digest = hashlib.sha256(" ".join([*found.identity, *command]).encode())
    for path in _included(source, []):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:32]


def _included(path: Path, known: list[Path]) -> list[Path]:
    """A file and all of the folder that it includes."""
    if path in known or not path.is_file():
        return known
    known.append(path)
    for name in re.findall(r'^#include "(.+)"', path.read_text(encoding="utf-8"), re.MULTILINE):
        _included(path.parent / name, known)
    return known


def _run(found: Compiler, folder: Path, arguments: Sequence[str]) -> None:
    try:
        run((*found.command, *arguments), SECONDS, scratch=folder)
    except CompileError as error:
        raise BuildError(f"{folder}: {error}") from None
