"""One benchmark in a process of its own: its numbers, or why there are none.

    python -m tests.benchmarks.running MODULE quick|full FILE

writes the answer of a module to a file; `measured` is what calls it.
"""

from __future__ import annotations

import importlib
import json
import math
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from tests.benchmarks import THREADS
from tests.benchmarks.common import ROOT, LeftOut
from tests.benchmarks.stored import DONE, Result

__all__ = ["measured"]

LIMIT_S = {"quick": 1200.0, "full": 4 * 3600.0}  # then a benchmark counts as hanging
DIGITS = 6


def measured(module: str, mode: str, more: Mapping[str, str] | None = None) -> Result:
    """The result of a module; `more` variables for its process.

    It starts with one BLAS thread and the modes of compiling that users have. What it prints is
    shown only where it fails. Interrupted, it ends its process and those it started.
    """
    variables = {**os.environ, **dict.fromkeys(THREADS, "1"), **(more or {})}
    variables.pop("SOFTMPC_COMPILE", None)
    load = round(os.getloadavg()[0], 2) if hasattr(os, "getloadavg") else None
    began = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        answer, said = Path(folder) / "answer.json", Path(folder) / "said.txt"
        command = [sys.executable, "-m", __name__, module, mode, str(answer)]
        with said.open("w", encoding="utf-8") as file:
            code = _waited(command, variables, file, LIMIT_S[mode])
        took = round(time.perf_counter() - began, 1)
        if code is None:
            return Result(f"failed: took longer than {LIMIT_S[mode]:g} s", took, load)
        if code or not answer.exists():
            lines = said.read_text(encoding="utf-8", errors="replace").strip().splitlines()
            return Result(f"failed: {lines[-1] if lines else f'ended with {code}'}", took, load)
        status, cpu, numbers = json.loads(answer.read_text(encoding="utf-8"))
    return Result(status, took, load, cpu, numbers)


def _waited(command: list[str], variables: dict[str, str], file: Any, limit: float) -> int | None:
    """The exit status; None where it took too long."""
    process = subprocess.Popen(
        command, cwd=ROOT, env=variables, stdin=subprocess.DEVNULL, stdout=file,
        stderr=subprocess.STDOUT, start_new_session=True,
    )  # fmt: skip
    try:
        return process.wait(limit)
    except subprocess.TimeoutExpired:
        return None
    finally:
        _end(process)


def _end(process: subprocess.Popen[bytes]) -> None:
    """End a process, and what it started, where that still runs."""
    with suppress(ProcessLookupError, PermissionError):
        if hasattr(os, "killpg"):
            os.killpg(process.pid, signal.SIGKILL)
        else:
            process.kill()
    process.wait()


def _plain(found: Mapping[str, Any]) -> dict[str, float]:
    """Numbers as they are stored. Raises `ValueError` for what is no finite number."""
    broken = [name for name, value in found.items() if not math.isfinite(value)]
    if broken or not found:
        raise ValueError(f"not finite: {', '.join(broken)}" if broken else "no numbers at all")
    return {
        name: int(value) if float(value).is_integer() else float(f"{value:.{DIGITS}g}")
        for name, value in found.items()
    }


def main(module: str, mode: str, file: str) -> None:
    """Write status and numbers of a module; what fails ends this process with a message."""
    status, numbers = DONE, {}
    try:
        numbers = _plain(importlib.import_module(module).numbers(mode == "quick"))
    except LeftOut as reason:
        status = f"left out: {reason}"
    cpu = round(sum(os.times()[:4]), 1)
    Path(file).write_text(json.dumps([status, cpu, numbers], allow_nan=False), encoding="utf-8")


if __name__ == "__main__":
    main(*sys.argv[1:])
