"""What benchmarks share: arguments, times, processes of their own, names of numbers."""

from __future__ import annotations

import argparse
import importlib.util
import json
import os
import re
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from statistics import median
from typing import Any

__all__ = [
    "EXAMPLES", "ROOT", "LeftOut", "answer_of", "arguments", "key", "median_seconds",
    "need_or_exit", "need_package", "seconds_of",
]  # fmt: skip

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = ROOT / "examples"


class LeftOut(Exception):
    """Why a benchmark cannot run here, and what would help."""


def need_package(module: str, package: str) -> None:
    """Raise `LeftOut` where an optional dependency is missing."""
    if importlib.util.find_spec(module) is None:
        raise LeftOut(f"{package} is not installed: pip install {package}")


def need_or_exit(module: str, package: str) -> None:
    """End this process with status 2 and one line where an optional dependency is missing."""
    try:
        need_package(module, package)
    except LeftOut as reason:
        print(reason, file=sys.stderr)
        sys.exit(2)


def arguments(text: str | None) -> argparse.ArgumentParser:
    """A parser that shows the text of a module as it is written."""
    return argparse.ArgumentParser(
        description=text, formatter_class=argparse.RawDescriptionHelpFormatter
    )


def key(*words: object) -> str:
    """One name of a number: words joined by underscores, other signs left out."""
    text = "_".join(str(word) for word in words).lower().replace("µ", "u").replace("'", "")
    return re.sub(r"[^a-z0-9]+", "_", text).strip("_")


def seconds_of(work: Callable[[], Any]) -> float:
    """Wall time of one call."""
    began = time.perf_counter()
    work()
    return time.perf_counter() - began


def median_seconds(work: Callable[[], Any], runs: int) -> float:
    """Median wall time of a call."""
    return median(seconds_of(work) for _ in range(runs))


def answer_of(
    module: str, *words: str, call: Any = None, variables: Mapping[str, str] | None = None
) -> Any:
    """What `python -m MODULE` prints as its last line (JSON), given `call` (JSON) to read.

    Raises `RuntimeError` with what it said where it fails.
    """
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-m", module, *words],
        input=json.dumps(call), capture_output=True, text=True, cwd=ROOT,
        env={**os.environ, **(variables or {})}, check=False,
    )  # fmt: skip
    if done.returncode:
        raise RuntimeError(f"{module} {' '.join(words)} failed:\n{done.stderr}")
    return json.loads(done.stdout.splitlines()[-1])
