"""Where compiled libraries are kept, and how they get there whole.

A library's name is NAME-KEY-DIGEST.so: the key says what it was made from, the digest what is in
it. So one rename publishes a library, two processes may build the same one at once, and a file
that was damaged is seen before it is loaded (loading half a library can end the process).
"""

from __future__ import annotations

import atexit
import hashlib
import logging
import os
import re
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path

from softmpc.compiler import SUFFIX

__all__ = ["clear", "find", "folder", "libraries", "publish", "workshop"]

LOG = logging.getLogger(__name__)
BUILDS, HOUR = ".build-", 3600.0
_NAME = re.compile(rf"\w{{1,40}}-[0-9a-f]{{32}}-[0-9a-f]{{32}}{re.escape(SUFFIX)}")


def folder() -> Path:
    """The folder that SOFTMPC_CACHE names, or the user's own; it may not exist yet."""
    given = os.environ.get("SOFTMPC_CACHE")
    if given:
        return Path(os.path.abspath(os.path.expanduser(given)))
    return _user_caches() / "softmpc"


def find(name: str, key: str) -> Path | None:
    """The library of this key, whole; what is damaged is removed, with a line in the log."""
    for place in (folder(), *_made):
        with suppress(OSError):
            for library in sorted(place.glob(f"{name[:40]}-{key}-*{SUFFIX}")):
                if _digest(library) == library.stem.rpartition("-")[2]:
                    return library
                LOG.warning("%s is damaged and will be built again", library)
                library.unlink()
    return None


@contextmanager
def workshop() -> Iterator[Path]:
    """A new folder to build in, on the cache's own file system, removed afterwards."""
    built = _new_folder()
    try:
        yield built
    finally:
        shutil.rmtree(built, ignore_errors=True)


def publish(built: Path, name: str, key: str) -> Path:
    """Move a library from its workshop into the cache, whole or not at all; return its place."""
    library = built.parents[1] / f"{name[:40]}-{key}-{_digest(built)}{SUFFIX}"
    os.replace(built, library)
    return library


def libraries() -> list[Path]:
    """All libraries in the folder; nothing else that may be there."""
    with suppress(OSError):
        return sorted(path for path in folder().iterdir() if _NAME.fullmatch(path.name))
    return []


def clear() -> int:
    """Remove the libraries, and what crashed builds left; return how many libraries.

    A process that has loaded a library keeps it. Raises OSError where that is not allowed.
    """
    found = libraries()
    for library in found:
        library.unlink(missing_ok=True)
    for left in folder().glob(f"{BUILDS}*"):
        with suppress(OSError):
            if time.time() - left.stat().st_mtime > HOUR:  # no build takes as long
                shutil.rmtree(left)
    return len(found)


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()[:32]


def _user_caches() -> Path:
    """The folder of the user's caches, by the system's rules."""
    home = Path(os.path.expanduser("~"))  # unlike Path.home, never raises
    if sys.platform == "darwin":
        return home / "Library" / "Caches"
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or home / "AppData" / "Local")
    given = os.environ.get("XDG_CACHE_HOME", "")
    return Path(given) if os.path.isabs(given) else home / ".cache"


def _new_folder() -> Path:
    """A folder for one build in the cache, or in this process's substitute for it."""
    place = folder()
    try:
        place.mkdir(mode=0o700, parents=True, exist_ok=True)
        return Path(tempfile.mkdtemp(prefix=BUILDS, dir=place))
    except OSError as error:
        substitute = _substitute(place, error.strerror or str(error))
        return Path(tempfile.mkdtemp(prefix=BUILDS, dir=substitute))


_made: list[Path] = []  # at most one, unless SOFTMPC_CACHE changes


@cache
def _substitute(place: Path, reason: str) -> Path:
    """A folder for this process alone, in place of one that cannot be written."""
    made = Path(tempfile.mkdtemp(prefix="softmpc-"))
    atexit.register(shutil.rmtree, made, ignore_errors=True)
    _made.append(made)
    LOG.warning(
        "%s cannot be written (%s): compiled functions are kept for this process only; "
        "SOFTMPC_CACHE names another folder", place, reason,
    )  # fmt: skip
    return made
