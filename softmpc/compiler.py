"""The C compiler of this machine: which one, its version, its flags, its processor; and running it.

The first of `CC`, `cc`, `gcc` and `clang` that answers. Needs neither CasADi nor NumPy.
"""

from __future__ import annotations

import os
import platform
import shlex
import shutil
import signal
import subprocess
import sys
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

__all__ = ["COMPILE_SECONDS", "SUFFIX", "CompileError", "Compiler", "compiler", "run", "why_none"]

COMPILE_SECONDS = 120.0  # then the compiler counts as hanging
PROBE_SECONDS = 10.0
SUFFIX = ".dll" if sys.platform == "win32" else ".so"
CANDIDATES = ("cc", "gcc", "clang")
# -O1, since -O2 takes twice as long and makes no faster code of straight lines of arithmetic
# (`python -m tests.benchmarks.compiling --flags`). No contraction to fused multiply-add: results
# then equal those of CasADi's virtual machine to the last bit. Never -ffast-math: NaN checks die.
OPTIMISE = ("-O1", "-ffp-contract=off")
PROCESSORS = (("-march=native",), ("-mcpu=native",), ())  # the first that the compiler takes
# Symbols that nobody defines fail here, not in the middle of a simulation.
_COMPLETE = ("-Wl,-z,defs",) if sys.platform.startswith("linux") else ()
LINK = ("-shared", *(() if sys.platform == "win32" else ("-fPIC",)), *_COMPLETE)


class CompileError(Exception):
    """The compiler failed or did not end in time; the message is one line."""


@dataclass(frozen=True)
class Compiler:
    """A C compiler that works."""

    command: tuple[str, ...]  # path, and the arguments that CC gives
    version: str  # all that --version prints
    processor: str  # the macros that the processor's flag defines: its instruction sets
    flags: tuple[str, ...]

    @property
    def identity(self) -> tuple[str, ...]:
        """All that can make other code of the same source."""
        resolved = str(Path(self.command[0]).resolve())
        return (resolved, *self.command[1:], self.version, self.processor, *self.flags, *LINK)

    def build(self, source: Path, library: Path, seconds: float | None = None) -> None:
        """Compile a C file to a shared library. Raises `CompileError`."""
        files = (str(source), "-o", str(library), "-lm")
        limit = COMPILE_SECONDS if seconds is None else seconds
        run((*self.command, *self.flags, *LINK, *files), limit, scratch=library.parent)
        if not library.is_file():
            raise CompileError(f"{self.command[0]} wrote no library")

    def __str__(self) -> str:
        return f"{self.command[0]} ({self.version.partition(chr(10))[0]})"


def compiler() -> Compiler | None:
    """The compiler that `CC` names, or the one that is found on the path; None without one."""
    return _search(os.environ.get("CC", ""), os.environ.get("PATH", ""))[0]


def why_none() -> str:
    """Why `compiler` returns None, in a few words."""
    return _search(os.environ.get("CC", ""), os.environ.get("PATH", ""))[1]


@lru_cache(maxsize=8)
def _search(cc: str, path: str) -> tuple[Compiler | None, str]:
    """The compiler, and why there is none. A CC that does not work is not passed over."""
    try:
        wanted = [shlex.split(cc)] if cc.strip() else [[name] for name in CANDIDATES]
    except ValueError as error:
        return None, f"CC is {cc!r}: {error}"
    reasons = []
    for program, *arguments in wanted:
        where = shutil.which(program, path=path)
        if where is None:
            reasons.append(f"{program} is not found")
            continue
        try:
            return _probe((os.path.abspath(where), *arguments)), ""
        except CompileError as error:
            reasons.append(str(error))
    return None, ("CC is set, but " if cc.strip() else "") + ", ".join(reasons)


def _probe(command: tuple[str, ...]) -> Compiler:
    """Ask a compiler for its version and for what `native` means to it."""
    version = run((*command, "--version"), PROBE_SECONDS).strip()
    for flag in PROCESSORS:
        with suppress(CompileError):
            macros = run((*command, *flag, "-dM", "-E", "-x", "c", os.devnull), PROBE_SECONDS)
            if "#define" in macros:  # GCC and Clang alike; anything else is no such compiler
                processor = macros if flag else macros + platform.processor()
                return Compiler(command, version, processor, (*OPTIMISE, *flag))
    raise CompileError(f"{command[0]} is no C compiler like GCC or Clang")


def run(command: tuple[str, ...], seconds: float, scratch: Path | None = None) -> str:
    """Output of a command. Raises `CompileError`; leaves no process behind, whatever happens."""
    environment = os.environ | {"LC_ALL": "C"} | ({"TMPDIR": str(scratch)} if scratch else {})
    try:
        process = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
            env=environment, text=True, errors="replace", start_new_session=True,
        )  # fmt: skip
    except OSError as error:
        raise CompileError(f"{command[0]} does not start: {error.strerror}") from None
    with process:
        try:
            output, complaint = process.communicate(timeout=seconds)
        except subprocess.TimeoutExpired:
            _kill(process)
            raise CompileError(f"{command[0]} did not end within {seconds:g} s") from None
        except BaseException:  # Ctrl-C above all
            _kill(process)
            raise
    if process.returncode:
        raise CompileError(f"{command[0]} failed: {_first_error(complaint)}")
    return output


def _kill(process: subprocess.Popen[str]) -> None:
    """End a compiler and the processes that it started."""
    with suppress(OSError):
        if sys.platform == "win32":
            process.kill()
        else:
            os.killpg(process.pid, signal.SIGKILL)


def _first_error(complaint: str) -> str:
    """The line of a compiler's complaint that says most."""
    lines = [line.strip() for line in complaint.splitlines() if line.strip()]
    return next((line for line in lines if "error" in line), lines[-1] if lines else "no message")
