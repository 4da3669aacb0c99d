"""The record of a run on a rig: the closed loop, the estimate beside the truth, what went wrong."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from softmpc.control.track_result import TrackResult
from softmpc.estimation.kalman import gate
from softmpc.files import reading_npz, replacing
from softmpc.rig.supervision import State
from softmpc.simulation.columns import write_columns

__all__ = ["RigResult"]

SCHEMA = 1
ARRAYS = (
    "state", "estimate_ms", "strains", "strains_true", "strains_spread", "tips", "tips_spread",
    "d", "d_spread", "acting", "innovation_sensor", "innovation_time", "nis", "accepted",
)  # fmt: skip
ABOUT = ("names", "sensors", "sizes", "transitions", "faults", "back_off", "counts")


@dataclass(frozen=True, eq=False)
class RigResult:
    """A run on a rig, SI: N steps of the controller, n strains of its model, I innovations."""

    track: TrackResult
    state: np.ndarray  # of supervision (N), see `State`
    estimate_ms: np.ndarray  # time the estimator took (N)
    strains: np.ndarray  # as estimated (N×n)
    strains_true: np.ndarray  # the plant's, in the controller's model (N×n)
    strains_spread: np.ndarray  # standard deviations (N×n)
    tips: np.ndarray  # as estimated (N×S×3), m
    tips_spread: np.ndarray  # standard deviations (N×S×3), m
    d: np.ndarray  # disturbance (N×D), scaled
    d_spread: np.ndarray
    acting: np.ndarray  # inputs that acted at each sample of the plant (K×k)
    innovation_sensor: np.ndarray  # number of the sensor (I)
    innovation_time: np.ndarray  # when the reading was taken (I), s
    nis: np.ndarray  # normalised square of the innovation (I)
    accepted: np.ndarray  # whether it was used (I)
    names: tuple[tuple[str, ...], tuple[str, ...]]  # of strains and disturbance
    sensors: tuple[str, ...]
    sizes: tuple[int, ...]  # numbers in a reading of each
    transitions: tuple[str, ...]  # of supervision, a line each
    faults: tuple[tuple[str, float, float], ...]  # what, start and end (s)
    back_off: dict[str, float]  # share of the margin of each kind of limit that the plant used
    counts: dict[str, int]  # readings refused by sensor and reason, commands lost

    def summary(self) -> dict[str, Any]:
        """The run in numbers people use, those of the closed loop first."""
        settled = self.track.control_time >= self.track.settle
        off = np.linalg.norm(self.tips[:, -1] - self._tip_at_steps(), axis=1)[settled]
        worst = State(int(self.state.max(initial=0)))
        return self.track.summary() | {
            "rms_estimate_mm": 1e3 * float(np.sqrt(np.mean(off**2))) if len(off) else None,
            "estimate_ms_median": float(np.median(self.estimate_ms)) if len(self.state) else None,
            "offset_mm": self.offset_mm,
            "worst_state": str(worst),
            "steps_by_state": {str(state): int((self.state == state).sum()) for state in State},
            "transitions": list(self.transitions),
            "nis": self.nis_means,
            "back_off_used": self.back_off,
            "counts": self.counts,
            "disturbance": dict(zip(self.names[1], self._last_d(), strict=True)),
        }

    @property
    def offset_mm(self) -> float | None:
        """Mean error of the tip over the last 2 s, as a vector: what noise leaves of it."""
        track = self.track
        last = track.time > track.time[-1] - 2.0
        if not len(track.time) or track.time[-1] < 2.0:
            return None
        return 1e3 * float(np.linalg.norm((track.tip - track.target)[last].mean(axis=0)))

    @property
    def nis_means(self) -> dict[str, float]:
        """Mean normalised square of each sensor's good innovations, over their size: 1 is due."""
        found = {}
        for number, (name, size) in enumerate(zip(self.sensors, self.sizes, strict=True)):
            own = (self.innovation_sensor == number) & self.accepted
            if own.any():
                found[name] = float(self.nis[own].mean() / size)
        return found

    def gate_of(self, sensor: int, share: float = 0.05) -> float:
        """What one in 1/share good innovations of a sensor exceeds, over their size."""
        return gate(self.sizes[sensor], share) / self.sizes[sensor]

    def _last_d(self) -> list[float]:
        return [float(value) for value in self.d[-1]] if len(self.d) else [0.0] * len(self.names[1])

    def _tip_at_steps(self) -> np.ndarray:
        track = self.track
        places = np.searchsorted(track.time, track.control_time - 1e-9)
        return track.tip[np.minimum(places, len(track.time) - 1)]

    # --- files -----------------------------------------------------------------------------------

    def save(self, directory: str | os.PathLike[str]) -> list[Path]:
        """Write what `TrackResult.save` does, rig.npz (the rest) and estimate.csv."""
        folder = Path(directory)
        paths = self.track.save(folder)
        about = {"schema": SCHEMA} | {name: getattr(self, name) for name in ABOUT}
        content = {name: getattr(self, name) for name in ARRAYS}
        more = [folder / "rig.npz", folder / "estimate.csv"]
        with replacing(more[0]) as beside, open(beside, "wb") as file:
            np.savez_compressed(file, allow_pickle=False, about=json.dumps(about), **content)
        write_columns(more[1], self._columns())
        return paths + more

    @classmethod
    def load(cls, directory: str | os.PathLike[str]) -> RigResult:
        """Read what `save` wrote; raises `InputError` for a folder without it."""
        path = Path(directory) / "rig.npz"
        with reading_npz(path, "run of a rig", (SCHEMA,)) as (about, content):
            arrays = {name: content[name] for name in ARRAYS}
            about["names"] = tuple(tuple(names) for names in about["names"])
            about["faults"] = tuple(tuple(fault) for fault in about["faults"])
            for name in ("sensors", "sizes", "transitions"):
                about[name] = tuple(about[name])
        return cls(TrackResult.load(Path(directory) / "track.npz"), **arrays, **about)

    def _columns(self) -> dict[str, np.ndarray]:
        columns = {"t [s]": self.track.control_time, "state": self.state}
        for s in range(self.tips.shape[1]):
            for i, axis in enumerate("xyz"):
                columns[f"{axis}_{s + 1} [m]"] = self.tips[:, s, i]
                columns[f"{axis}_{s + 1} deviation [m]"] = self.tips_spread[:, s, i]
        for i, name in enumerate(self.names[0]):
            columns[name] = self.strains[:, i]
            columns[f"{name} true"] = self.strains_true[:, i]
            columns[f"{name} deviation"] = self.strains_spread[:, i]
        columns |= {name: self.d[:, i] for i, name in enumerate(self.names[1])}
        return columns | {"estimate [ms]": self.estimate_ms}
