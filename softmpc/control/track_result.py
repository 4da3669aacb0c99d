"""The record of a closed-loop run."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from softmpc.files import reading_npz, replacing
from softmpc.simulation.columns import write_columns

__all__ = ["TrackResult"]

RESULT_SCHEMA = 2
READS = (1, 2)
ARRAYS = (
    "time", "tips", "reference", "q", "dq", "p", "control_time", "u", "step_ms", "iterations",
)  # fmt: skip
NEW_ARRAYS = (  # since schema 2
    "followed", "u_start", "prepare_ms", "out_of_reach", "jumps", "u_rest",
)  # fmt: skip
ABOUT = ("settle", "statuses", "names", "clearance_m", "controller", "budget_ms", "rate_limit")
WINDOW = 0.5  # s after a jump of the nearest posture in which the tip is on its way


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
    followed: np.ndarray | None = None  # what the tip is to follow, the nearest in reach (K×3)
    u_start: np.ndarray | None = None  # input before the run (k)
    prepare_ms: np.ndarray | None = None  # of step_ms, before the state was known (N)
    out_of_reach: np.ndarray | None = None  # how far the reference is, m (K)
    jumps: np.ndarray | None = None  # times at which the nearest posture jumps, s (J)
    u_rest: np.ndarray | None = None  # inputs that hold the path at rest (K×k)
    controller: str = ""
    budget_ms: float | None = None  # what a step may take
    rate_limit: float | None = None  # of the inputs, a second
    findings: tuple[str, ...] = ()  # what of the path is infeasible, a line each
    costs: dict[str, float] = field(default_factory=dict)  # the controller's, of the closed loop

    @property
    def tip(self) -> np.ndarray:
        """Tip of the arm (K×3)."""
        return self.tips[:, -1]

    @property
    def error(self) -> np.ndarray:
        """Distance of the tip from its reference (K), m; never aligned in time."""
        return np.linalg.norm(self.tip - self.reference, axis=1)

    @property
    def reachable_error(self) -> np.ndarray:
        """Distance of the tip from what it is to follow (K), m."""
        return np.linalg.norm(self.tip - self.target, axis=1)

    @property
    def target(self) -> np.ndarray:
        """What the tip is to follow (K×3): the reference, or the nearest places in reach."""
        return self.reference if self.followed is None else self.followed

    @property
    def counted(self) -> np.ndarray:
        """Whether a sample counts (K): settled, and not within 0.5 s after a jump."""
        counts = self.time >= self.settle
        for jump in () if self.jumps is None else self.jumps:
            counts &= (self.time < jump) | (self.time > jump + WINDOW)
        return np.asarray(counts)

    @property
    def failures(self) -> int:
        """Number of controller steps whose solve failed."""
        return sum(status != "solved" for status in self.statuses)

    @property
    def cost(self) -> float | None:
        """All the controller's costs of the closed loop; None where they are not known."""
        return sum(self.costs.values()) if self.costs else None

    @property
    def deviations(self) -> dict[str, float]:
        """RMS over the steps of what each cost weighs, over the deviation that costs ½."""
        steps = max(len(self.u), 1)
        return {name: float(np.sqrt(2 * cost / steps)) for name, cost in self.costs.items()}

    @property
    def variation(self) -> float:
        """Total variation of all inputs, from the one before the run on."""
        first = self.u[:1] if self.u_start is None else self.u_start[None]
        return float(np.abs(np.diff(np.vstack([first, self.u]), axis=0)).sum())

    @property
    def rest_variation(self) -> float | None:
        """That of the inputs that hold the path at rest."""
        if self.u_rest is None:
            return None
        return float(np.abs(np.diff(self.u_rest, axis=0)).sum())

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
            "step_ms_max": float(took.max()) if len(took) else None,
            "clearance_mm": None if self.clearance_m is None else 1e3 * self.clearance_m,
            "controller": self.controller,
            "budget_ms": self.budget_ms,
            "cost": self.cost,
            "deviations": self.deviations,
            "input_variation": self.variation if len(took) else None,
            "input_variation_at_rest": self.rest_variation,
            **self._of_reach(),
        }

    def _of_reach(self) -> dict[str, Any]:
        """Errors from what is in reach; None where the path itself is followed."""
        projected = self.followed is not None and not np.array_equal(self.followed, self.reference)
        off = 1e3 * self.reachable_error[self.counted] if projected else np.zeros(0)
        most = 1e3 * float(self.out_of_reach.max()) if self.out_of_reach is not None else None
        return {
            "infeasible": list(self.findings),
            "out_of_reach_mm": most,
            "jumps_s": [] if self.jumps is None else self.jumps.tolist(),
            "rms_reachable_error_mm": float(np.sqrt(np.mean(off**2))) if len(off) else None,
            "max_reachable_error_mm": float(off.max()) if len(off) else None,
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
        about |= {name: getattr(self, name) for name in (*ABOUT, "findings", "costs")}
        arrays = {name: getattr(self, name) for name in ARRAYS + NEW_ARRAYS}
        given = {name: array for name, array in arrays.items() if array is not None}
        return {"about": json.dumps(about), **given}

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> TrackResult:
        """Read a track.npz; raises `InputError` for a file that is none."""
        with reading_npz(path, "closed-loop run", READS) as (about, content):
            about["names"] = tuple(tuple(names) for names in about["names"])
            about["findings"] = tuple(about.get("findings", ()))
            arrays = {name: content[name] for name in ARRAYS}
            arrays |= {name: content[name] for name in NEW_ARRAYS if name in content}
            return cls(**about, **arrays)

    def _samples(self) -> dict[str, np.ndarray]:
        columns = {"t [s]": self.time}
        for s in range(self.tips.shape[1]):
            columns |= {f"{axis}_{s + 1} [m]": self.tips[:, s, i] for i, axis in enumerate("xyz")}
        columns |= {f"{axis}_reference [m]": self.reference[:, i] for i, axis in enumerate("xyz")}
        if self.followed is not None and not np.array_equal(self.followed, self.reference):
            columns |= {f"{a}_followed [m]": self.followed[:, i] for i, a in enumerate("xyz")}
        columns["error [m]"] = self.error
        columns |= dict(zip(self.names[0], self.q.T, strict=True))
        return columns | {f"{n} [Pa]": p for n, p in zip(self.names[2], self.p.T, strict=True)}

    def _steps(self) -> dict[str, np.ndarray]:
        columns = {"t [s]": self.control_time, "step [ms]": self.step_ms}
        if self.prepare_ms is not None:
            columns |= {"prepare [ms]": self.prepare_ms}
        columns |= {"iterations": self.iterations}
        columns |= dict(zip(self.names[1], self.u.T, strict=True))
        return columns | {"solved": np.array([int(s == "solved") for s in self.statuses])}
