"""Runs of the benchmarks as JSON: what was measured, when, on which machine, of which commit."""

from __future__ import annotations

import json
import subprocess
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from softmpc.accuracy.machine import describe_machine, fingerprint
from softmpc.errors import InputError
from softmpc.files import replacing
from tests.benchmarks.common import ROOT

__all__ = ["DONE", "RESULTS", "Result", "Run", "last_stored", "load", "new_run", "save", "store"]

FORMAT = 1
DONE = "done"
RESULTS = Path(__file__).parent / "results"


@dataclass(frozen=True)
class Result:
    """One benchmark: status, seconds by the clock, load when it began, processor time, numbers."""

    status: str
    seconds: float
    load: float | None = None
    cpu_s: float | None = None
    numbers: dict[str, float] = field(default_factory=dict)

    @property
    def failed(self) -> bool:
        return self.status.startswith("failed")


@dataclass(frozen=True)
class Run:
    """One run of some benchmarks; `changed` where files differ from those of the commit."""

    mode: str
    date: str
    commit: str | None
    changed: bool | None
    fingerprint: str
    machine: dict[str, Any]
    benchmarks: dict[str, Result] = field(default_factory=dict)


def new_run(mode: str) -> Run:
    """A run that begins now."""
    commit = _git("rev-parse", "--short=12", "HEAD")
    changed = None if commit is None else bool(_git("status", "--porcelain", "-uno"))
    date = datetime.now(UTC).isoformat(timespec="seconds")
    return Run(mode, date, commit, changed, fingerprint(), describe_machine())


def _git(*words: str) -> str | None:
    try:
        done = subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return None
    return done.stdout.strip()


def save(run: Run, path: Path) -> None:
    """Write a run, whole or not at all."""
    text = json.dumps({"softmpc_benchmarks": FORMAT, **asdict(run)}, indent=1, allow_nan=False)
    with replacing(path) as beside:
        beside.write_text(text + "\n", encoding="utf-8")


def load(path: Path) -> Run:
    """Read a run. Raises `InputError` for a file that is missing, or is none."""
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from None
    except ValueError:
        data = None
    if not isinstance(data, dict) or data.pop("softmpc_benchmarks", None) != FORMAT:
        raise InputError(
            f"{path}: is no run of the benchmarks; those of `--store` are in {RESULTS}"
        )
    results = {name: Result(**one) for name, one in data.pop("benchmarks").items()}
    return Run(**data, benchmarks=results)


def store(run: Run, folder: Path = RESULTS) -> Path:
    """Keep a run; the file is named by its date, mode and machine."""
    date = datetime.fromisoformat(run.date).strftime("%Y%m%d-%H%M%S")
    path = folder / f"{date}-{run.mode}-{run.fingerprint}.json"
    save(run, path)
    return path


def last_stored(mode: str, folder: Path = RESULTS) -> Run | None:
    """The newest stored run of a mode."""
    runs = [load(path) for path in folder.glob("*.json")]
    return max((run for run in runs if run.mode == mode), key=lambda run: run.date, default=None)
