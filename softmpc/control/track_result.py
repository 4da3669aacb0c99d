"""The record of a closed-loop run."""

from __future__ import annotations

import os
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from softmpc.files import write_whole

__all__ = ["TrackResult"]

RESULT_SCHEMA = 1


@dataclass(frozen=True)
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
        return [
            write_whole(folder / "track.npz", self._write_npz),
            write_whole(folder / "track.csv", partial(_write_csv, self._samples())),
            write_whole(folder / "steps.csv", partial(_write_csv, self._steps())),
        ]

    def _write_npz(self, path: Path) -> None:
        arrays = {k: v for k, v in vars(self).items() if isinstance(v, np.ndarray)}
        with open(path, "wb") as file:
            np.savez_compressed(
                file,
                schema=RESULT_SCHEMA,
                title=self.title,
                status=self.status,
                settle=self.settle,
                statuses=np.array(self.statuses),
                clearance_m=np.nan if self.clearance_m is None else self.clearance_m,
                **{f"names_{k}": np.array(v) for k, v in zip("qup", self.names, strict=True)},
                **arrays,
            )

    def _samples(self) -> dict[str, np.ndarray]:
        columns = {"t": self.time}
        for s in range(self.tips.shape[1]):
            columns |= {f"{axis}_{s + 1}": self.tips[:, s, i] for i, axis in enumerate("xyz")}
        columns |= {f"{axis}_reference": self.reference[:, i] for i, axis in enumerate("xyz")}
        columns["error"] = self.error
        for names, values in ((self.names[0], self.q), (self.names[2], self.p)):
            columns |= {name: values[:, i] for i, name in enumerate(names)}
        return columns

    def _steps(self) -> dict[str, np.ndarray]:
        columns = {"t": self.control_time, "step_ms": self.step_ms, "iterations": self.iterations}
        columns |= {name: self.u[:, i] for i, name in enumerate(self.names[1])}
        solved = np.array([status == "solved" for status in self.statuses], dtype=float)
        return columns | {"solved": solved}


def _write_csv(columns: dict[str, np.ndarray], path: Path) -> None:
    table = np.column_stack([np.asarray(c, float) for c in columns.values()])
    np.savetxt(path, table, "%.9g", ",", header=",".join(columns), comments="")
