"""The record of a closed-loop run."""

from __future__ import annotations

import json
import os
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from softmpc.errors import InputError
from softmpc.files import replacing
from softmpc.simulation.columns import write_columns

__all__ = ["TrackResult"]

RESULT_SCHEMA = 1
ARRAYS = (
    "time", "tips", "reference", "q", "dq", "p", "control_time", "u", "step_ms", "iterations",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class TrackResult:
    """A closed-loop run, SI; K samples (every millisecond), N controller steps, S sections."""

    title: str
    status: str  # "finished", "interrupted" or "plant stopped: …"
    settle: float  # s; errors before it do not count
    time: np.ndarray  # (K)
    tips: np.ndarray  # section tips (K×S×3)
    reference: np.ndarray  # of the arm's tip (K×3)
    q: np.ndarray  # strains (K×n)
    dq: np.ndarray
    p: np.ndarray  # unit pressures (K×m), Pa
    control_time: np.ndarray  # (N)
    u: np.ndarray  # inputs (N×k)
    step_ms: np.ndarray  # time the controller took (N)
    iterations: np.ndarray  # of its solver (N)
    statuses: list[str]  # of its steps (N)
    names: tuple[tuple[str, ...], ...]  # of q, u and p
    clearance_m: float | None = None  # smallest distance of the path to the workspace's edge

    @property
    def tip(self) -> np.ndarray:
        """Tip of the arm (K×3)."""
        return self.tips[:, -1]

    @property
    def error(self) -> np.ndarray:
        """Distance of the tip from its reference (K), m; never aligned in time."""
        return np.linalg.norm(self.tip - self.reference, axis=1)

    @property
    def failures(self) -> int:
        """Number of controller steps whose solve failed."""
        return sum(status != "solved" for status in self.statuses)

    def summary(self) -> dict[str, Any]:
        """The run in numbers people use: mm, ms."""
        settled = 1e3 * self.error[self.time >= self.settle]
        took = self.step_ms
        return {
            "status": self.status,
            "duration_s": float(self.time[-1]),
            "settle_s": self.settle,
            "rms_error_mm": float(np.sqrt(np.mean(settled**2))) if len(settled) else None,
            "max_error_mm": float(settled.max()) if len(settled) else None,
            "steps": len(self.statuses),
            "failures": self.failures,
            "step_ms_median": float(np.median(took)) if len(took) else None,
            "step_ms_p95": float(np.percentile(took, 95)) if len(took) else None,
            "iterations_median": float(np.median(self.iterations)) if len(took) else None,
            "clearance_mm": None if self.clearance_m is None else 1e3 * self.clearance_m,
        }

    def save(self, directory: str | os.PathLike[str]) -> list[Path]:
        """Write track.npz (everything), track.csv (samples) and steps.csv (controller)."""
        folder = Path(directory)
        paths = [folder / name for name in ("track.npz", "track.csv", "steps.csv")]
        with replacing(paths[0]) as beside, open(beside, "wb") as file:
            np.savez_compressed(file, allow_pickle=False, **self._content())
        write_columns(paths[1], self._samples())
        write_columns(paths[2], self._steps())
        return paths

    def _content(self) -> dict[str, Any]:
        about = {"schema": RESULT_SCHEMA, "title": self.title, "status": self.status}
        about |= {"settle": self.settle, "statuses": self.statuses, "names": self.names}
        about |= {"clearance_m": self.clearance_m}
        return {"about": json.dumps(about), **{name: getattr(self, name) for name in ARRAYS}}

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> TrackResult:
        """Read a track.npz; raises `InputError` for a file that is none."""
        try:
            with np.load(path, allow_pickle=False) as file:
                about = json.loads(str(file["about"]))
                arrays = {name: file[name] for name in ARRAYS}
        except FileNotFoundError:
            raise InputError(f"{path}: no such file") from None
        except (OSError, ValueError, KeyError, zipfile.BadZipFile) as error:
            raise InputError(f"{path}: is not a saved closed-loop run: {error}") from None
        if about.pop("schema", None) != RESULT_SCHEMA:
            raise InputError(f"{path}: is of another version; {RESULT_SCHEMA} is known here")
        about["names"] = tuple(tuple(names) for names in about["names"])
        return cls(**about, **arrays)

    def _samples(self) -> dict[str, np.ndarray]:
        columns = {"t [s]": self.time}
        for s in range(self.tips.shape[1]):
            columns |= {f"{axis}_{s + 1} [m]": self.tips[:, s, i] for i, axis in enumerate("xyz")}
        columns |= {f"{axis}_reference [m]": self.reference[:, i] for i, axis in enumerate("xyz")}
        columns["error [m]"] = self.error
        columns |= dict(zip(self.names[0], self.q.T, strict=True))
        return columns | {f"{n} [Pa]": p for n, p in zip(self.names[2], self.p.T, strict=True)}

    def _steps(self) -> dict[str, np.ndarray]:
        columns = {"t [s]": self.control_time, "step [ms]": self.step_ms}
        columns |= {"iterations": self.iterations}
        columns |= dict(zip(self.names[1], self.u.T, strict=True))
        return columns | {"solved": np.array([int(s == "solved") for s in self.statuses])}
