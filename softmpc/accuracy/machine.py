"""What a machine is, for numbers that depend on it."""

from __future__ import annotations

import hashlib
import os
import platform
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

from softmpc.compiler import compiler
from softmpc.sweeps import usable_cores

__all__ = ["describe_machine", "fingerprint"]

PACKAGES = ("casadi", "numpy", "scipy", "daqp")


@cache
def _fixed() -> dict[str, Any]:
    found = compiler()
    return {
        "processor": _processor(),
        "cores": usable_cores(),
        "memory_gib": _memory_gib(),
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        "compiler": None if found is None else str(found),
        **{name: version(name) for name in ("softmpc", *PACKAGES)},
    }


def describe_machine() -> dict[str, Any]:
    """Processor, cores, memory, system, compiler and versions, and how busy it is now."""
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else None
    return {**_fixed(), "load": load}


def fingerprint() -> str:
    """The same on the same machine with the same programs: times can be compared."""
    told = repr(sorted(_fixed().items()))
    return hashlib.sha256(told.encode()).hexdigest()[:12]


def _processor() -> str:
    """Its name, of Linux by the kernel."""
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8")
    except OSError:
        return platform.processor() or "unknown"
    lines = [line for line in text.splitlines() if line.startswith("model name")]
    return lines[0].partition(":")[2].strip() if lines else platform.processor() or "unknown"


def _memory_gib() -> float | None:
    try:
        return round(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30, 1)
    except (AttributeError, ValueError, OSError):  # Windows
        return None
