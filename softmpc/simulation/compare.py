"""Two motions side by side: the error metric of the paper."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import Any

import numpy as np

from softmpc.errors import InputError
from softmpc.simulation.columns import read_columns

__all__ = ["Comparison", "TipPath", "compare", "compare_files", "read_tips"]


@dataclass(frozen=True, eq=False)
class TipPath:
    """Section tips (K×S×3, m) at increasing times (K, s); a `Simulation` will do in its place."""

    time: np.ndarray
    tips: np.ndarray


@dataclass(frozen=True, eq=False)
class Comparison:
    """Distances of section tips (K×S, m) at times (K, s)."""

    time: np.ndarray
    errors: np.ndarray

    @property
    def largest_sectional(self) -> float:
        """max over sections and time of ERR_i, m."""
        return float(self.errors.max())

    @property
    def largest_cumulative(self) -> float:
        """max over time of Σ_i ERR_i, m."""
        return float(self.errors.sum(axis=1).max())

    def summary(self) -> dict[str, Any]:
        """What a program wants to know, ready for JSON."""
        return {
            "from_s": float(self.time[0]),
            "to_s": float(self.time[-1]),
            "samples": len(self.time),
            "largest_sectional_m": self.largest_sectional,
            "largest_cumulative_m": self.largest_cumulative,
            "largest_by_section_m": self.errors.max(axis=0).tolist(),
        }


def compare(a: Any, b: Any) -> Comparison:
    """Distance of the section tips of two motions, each a `TipPath` or `Simulation`.

    Implements Eq. (37): ERR_i = |ψ_i^a(t) - ψ_i^b(t)|. Source: paper section 4.1. Taken at the
    times of `a` that `b` covers, where `b` is interpolated linearly unless it has the same times.
    Raises `InputError` for other numbers of sections or no common time.
    """
    for path in (a, b):
        if path.tips.ndim != 3 or path.tips.shape != (len(path.time), path.tips.shape[1], 3):
            raise InputError(f"tips of shape {path.tips.shape}: must be (times, sections, 3)")
    if a.tips.shape[1] != b.tips.shape[1]:
        raise InputError(
            f"{a.tips.shape[1]} section tips against {b.tips.shape[1]}: must be as many"
        )
    slack = 1e-9 * max(1.0, abs(b.time[-1]))
    common = (a.time >= b.time[0] - slack) & (a.time <= b.time[-1] + slack)
    if not common.any():
        raise InputError(
            f"no common time: the first has {a.time[0]:g} to {a.time[-1]:g} s, "
            f"the second {b.time[0]:g} to {b.time[-1]:g} s"
        )
    time = a.time[common]
    flat = b.tips.reshape(len(b.time), -1)
    other = np.stack([np.interp(time, b.time, column) for column in flat.T], axis=1)
    gap = a.tips[common] - other.reshape(len(time), -1, 3)
    return Comparison(time, np.linalg.norm(gap, axis=2))


def compare_files(a: str | os.PathLike[str], b: str | os.PathLike[str]) -> Comparison:
    """`compare` of two CSV files, see `read_tips`."""
    return compare(read_tips(a), read_tips(b))


def read_tips(path: str | os.PathLike[str]) -> TipPath:
    """Section tips of a CSV file with columns t (s), x_1, y_1, z_1, x_2, … (m), others ignored.

    simulation.csv is such a file. Raises `InputError` where a column is missing.
    """
    columns = read_columns(path)
    sections = sum(f"x_{i}" in columns for i in range(1, len(columns)))
    names = [f"{axis}_{i + 1}" for i in range(max(sections, 1)) for axis in "xyz"]
    missing = [name for name in names if name not in columns]
    if missing:
        raise InputError(f"{path}: has no column {', '.join(missing)}")
    tips = np.stack([columns[name] for name in names], axis=1)
    return TipPath(columns["t"], tips.reshape(len(tips), -1, 3))
