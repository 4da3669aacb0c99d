"""Compiled CasADi functions where a C compiler is found, the functions as they are elsewhere.

CasADi writes the C code, the compiler of the machine builds it once, and a cache keeps it under
the hash of all that it depends on. SOFTMPC_COMPILE is the default of `mode`, CC names the
compiler, SOFTMPC_CACHE the folder. Imports CasADi only when a function is compiled.
"""

from __future__ import annotations

import hashlib
import io
import logging
import os
import re
from contextlib import redirect_stderr, suppress
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from softmpc import library_cache
from softmpc.compiler import CompileError, Compiler, compiler, why_none
from softmpc.errors import BuildError, InputError, unknown_name

if TYPE_CHECKING:
    import casadi as ca

__all__ = [
    "LARGEST",
    "MODES",
    "c_code",
    "compiled",
    "compiler",
    "default_mode",
    "instructions",
    "kept",
]

LOG = logging.getLogger(__name__)
MODES = ("auto", "never", "require")
# Compile time grows with the code, some 50 µs an instruction, so this many make a user wait for
# some 5 s, once, and pay after tens of thousands of calls (`python -m tests.benchmarks.compiling`).
LARGEST = 100_000
_HEADERS = {"math.h", "stdio.h", "stdarg.h", "stdlib.h", "string.h"}  # every C compiler has them


class _NotCompiled(BuildError):
    """Why a function is not compiled; `level` is that of the log line."""

    def __init__(self, reason: str, level: int = logging.WARNING) -> None:
        super().__init__(reason)
        self.level = level


def compiled(function: ca.Function, mode: str = "auto") -> ca.Function:
    """The function as machine code: same name, inputs, outputs, sparsities, and same numbers.

    `mode`: "auto" compiles where that is possible and returns the function itself where it is not,
    with one line in the log; "never" returns the function itself; "require" compiles whatever its
    size, or raises. Instead of "auto" SOFTMPC_COMPILE decides, if set.

    Compile what is called, last of all: a compiled function cannot be differentiated, cannot be
    compiled as a part of another, and when pickled it refers to a file of this machine's cache.
    Functions that it calls are written once each, however often they are called.

    Raises `InputError` for an unknown mode and `BuildError` where "require" cannot be met.
    """
    mode = default_mode() if mode == "auto" else _checked(mode, "mode")
    if mode == "never" or function.class_name() == "External":
        return function
    try:
        return _compiled(function, None if mode == "require" else LARGEST)
    except _NotCompiled as reason:
        if mode == "require":
            raise
        _tell_once(str(reason), reason.level)
        return function


@cache
def _tell_once(reason: str, level: int) -> None:
    """Say what it costs, which `python -m tests.benchmarks.compiling` measures."""
    LOG.log(level, "%s; CasADi's virtual machine does the work, 6 to 16 times slower", reason)


def default_mode() -> str:
    """The mode that SOFTMPC_COMPILE sets, "auto" where it is not set."""
    return _checked(os.environ.get("SOFTMPC_COMPILE") or "auto", "SOFTMPC_COMPILE")


def _checked(mode: str, what: str) -> str:
    if mode not in MODES:
        raise InputError(unknown_name(what, mode, MODES))
    return mode


def instructions(function: ca.Function) -> int:
    """Instructions of a function and of all that it calls, each counted once, as in its C code."""
    return sum(
        f.n_instructions()
        for f in _all_of(function)
        if f.class_name() in ("SXFunction", "MXFunction")
    )


def _all_of(function: ca.Function) -> list[ca.Function]:
    """The function and all that it calls, at any depth, once each."""
    found: dict[int, ca.Function] = {}
    waiting = [function]
    while waiting:
        one = waiting.pop()
        if hash(one) not in found:
            found[hash(one)] = one
            waiting += one.find_functions()
            if one.class_name().endswith("Map"):  # CasADi 3.7 does not look into these
                waiting.append(one.info()["f"])
    return [*found.values()]


def c_code(function: ca.Function) -> str:
    """C code of a function, which needs nothing but the C library.

    Raises `BuildError` if CasADi cannot write all of it; CasADi itself only warns, and goes on.
    """
    import casadi as ca

    inside = [f.name() for f in _all_of(function) if f.class_name() == "External"]
    if inside:
        raise _no_code(function, f"it calls compiled ones ({', '.join(inside)}); compile last")
    generator = ca.CodeGenerator("softmpc_local.c")  # prefixes all names but the function's own
    try:
        with redirect_stderr(io.StringIO()):  # the warning; the code holds the same as #error
            generator.add(function)
            code = str(generator.dump())
    except RuntimeError as error:
        raise _no_code(function, str(error).splitlines()[-1]) from None
    holes = re.findall(r"^\s*#error (.+)$", code, re.MULTILINE)
    if holes:
        raise _no_code(function, holes[0])
    others = sorted(set(re.findall(r"^\s*#include [<\"](.+)[>\"]", code, re.MULTILINE)) - _HEADERS)
    if others:
        raise _no_code(function, f"it needs other libraries: {', '.join(others)}")
    return code


def _no_code(function: ca.Function, reason: str) -> _NotCompiled:
    return _NotCompiled(f"no C code for function {function.name()!r} ({reason})", logging.INFO)


def _compiled(function: ca.Function, largest: int | None) -> ca.Function:
    """The compiled function, from the cache or new. Raises `_NotCompiled`."""
    found = compiler()
    if found is None:
        advice = "install gcc or clang, or name one in the variable CC"
        raise _NotCompiled(f"no C compiler ({why_none()}): {advice}")
    size = instructions(function)
    if largest is not None and size > largest:
        raise _NotCompiled(
            f"function {function.name()!r} has {size:,} instructions, and more than {largest:,} "
            "are compiled only where the mode is 'require'", logging.INFO,
        )  # fmt: skip
    code = c_code(function)
    key = _key(code, found)
    library = library_cache.find(function.name(), key)
    if library:
        with suppress(RuntimeError):
            return _load(function, library)
        LOG.warning("%s cannot be loaded and will be built again", library)
    return _built(function, code, key, found)


def kept(function: ca.Function) -> ca.Function | None:
    """The compiled function if the cache has it already, else None."""
    found = compiler()
    with suppress(BuildError, RuntimeError):
        library = found and library_cache.find(function.name(), _key(c_code(function), found))
        return _load(function, library) if library else None
    return None


def _built(function: ca.Function, code: str, key: str, found: Compiler) -> ca.Function:
    """Compile, keep and load."""
    failed = f"function {function.name()!r} is not compiled"
    try:
        with library_cache.workshop() as folder:
            source, library = folder / "function.c", folder / "function.built"
            source.write_text(code, encoding="utf-8")
            LOG.info("compiling %r with %s", function.name(), found)
            found.build(source, library)
            return _load(function, library_cache.publish(library, function.name(), key))
    except CompileError as error:
        raise _NotCompiled(f"{failed}: {error}") from None
    except OSError as error:
        raise _NotCompiled(f"{failed}: its library cannot be kept ({error})") from None
    except RuntimeError as error:
        last = str(error).splitlines()[-1]
        raise _NotCompiled(f"{failed}: its library cannot be loaded ({last})") from None


def _key(code: str, found: Compiler) -> str:
    """Hash of all that decides what the library does."""
    import casadi as ca

    parts = (ca.CasadiMeta.version(), *found.identity)
    whole = "\0".join((*parts, code))
    return hashlib.sha256(whole.encode()).hexdigest()[:32]


def _load(function: ca.Function, library: Path) -> ca.Function:
    import casadi as ca

    return ca.external(function.name(), str(library))
