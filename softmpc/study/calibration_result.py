"""What a calibration found: estimates, how sure they are, what stays open, and its files."""

from __future__ import annotations

import csv
import os
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from softmpc.errors import InputError
from softmpc.files import replacing
from softmpc.model.scene import Scene
from softmpc.model.scene_file import scene_to_dict

__all__ = ["Calibration", "Estimate", "Residual"]


@dataclass(frozen=True)
class Estimate:
    """One parameter, SI. What is not known is nan, what nothing determines has inf."""

    path: str
    unit: str
    start: float
    estimate: float
    std_error: float  # nan at a bound
    low95: float
    high95: float
    bound: str  # "", "low" or "high": the estimate is there
    determined: bool  # by the data, without the prior
    prior: tuple[float, float] | None  # mean, standard deviation
    low: float
    high: float
    log: bool

    @property
    def source(self) -> str:
        """What the estimate comes from."""
        if self.determined:
            return "data"
        if self.bound:
            return "bound"
        if not np.isfinite(self.std_error):
            return "nothing: its start"
        if self.prior is None:
            return "data and priors"
        size = self.estimate / self.prior[0] if self.log else 1.0
        own = self.std_error / (self.prior[1] * size)
        return "prior" if own > 0.95 else "data and priors"


@dataclass(frozen=True)
class Residual:
    """One value: measured, shown by the calibrated arm, and their difference in sigmas."""

    name: str
    measured: float
    shown: float
    sigma: float
    residual: float
    sense: str  # "=", or a limit "<" or ">"
    fitted: bool


@dataclass(frozen=True, eq=False)
class Calibration:
    """What `calibrate` returns. `status` is "converged", "interrupted" or "no convergence: …"."""

    status: str
    title: str
    estimates: tuple[Estimate, ...]
    residuals: tuple[Residual, ...]
    chi2: float  # of the fitted values, by the sigmas as stated
    freedom: float  # degrees of freedom
    probability: float  # of a chi² at least as large, nan without redundancy
    sigma_factor: float  # how many times the stated sigmas the residuals are
    sigma_estimated: bool  # whether the standard errors use that
    correlation: np.ndarray  # P×P
    undetermined: tuple[str, ...]  # changes that the data cannot see, in words
    directions: np.ndarray  # the same as relative changes or changes over scale (D×P)
    jacobian: np.ndarray  # N×P, residuals by x
    covariance: np.ndarray  # of x, P×P
    starts: int  # how many searches
    agreeing: int  # how many of them ended at the estimate
    arms: int  # how many arms were computed
    wall_s: float
    scene: Scene  # calibrated

    @property
    def converged(self) -> bool:
        return self.status == "converged"

    @property
    def values(self) -> dict[str, float]:
        """The estimates by path."""
        return {e.path: e.estimate for e in self.estimates}

    def __getitem__(self, path: str) -> Estimate:
        """The estimate of one parameter."""
        for estimate in self.estimates:
            if estimate.path == path:
                return estimate
        known = ", ".join(e.path for e in self.estimates)
        raise InputError(f"{path!r} was not calibrated; parameters: {known}")

    @property
    def verdict(self) -> str:
        """Whether the residuals are as large as their sigmas say."""
        if not np.isfinite(self.probability):
            return "no more values than parameters: the residuals say nothing about the sigmas"
        factor = f"{self.sigma_factor:.2g} times the stated sigmas"
        if self.probability < 0.01:
            return f"residuals are too large: {factor}; the model or the sigmas are wrong"
        if self.probability > 0.99:
            return f"residuals are smaller than stated: {factor}"
        return "residuals are as large as their sigmas say"

    def largest(self, count: int = 10) -> list[Residual]:
        """The fitted values with the largest residuals."""
        fitted = [r for r in self.residuals if r.fitted]
        return sorted(fitted, key=lambda r: -abs(r.residual))[:count]

    def summary(self) -> dict[str, Any]:
        """What a program wants to know, ready for JSON."""
        keys = ["status", "title", "chi2", "freedom", "probability", "sigma_factor"]
        keys += ["sigma_estimated", "correlation", "undetermined", "starts", "agreeing"]
        summary: dict[str, Any] = {key: getattr(self, key) for key in [*keys, "arms", "wall_s"]}
        summary["verdict"] = self.verdict
        summary["parameters"] = [asdict(e) | {"source": e.source} for e in self.estimates]
        summary["residuals"] = [asdict(r) for r in self.residuals]
        return summary

    def save(
        self, directory: str | os.PathLike[str], tables: dict[str, Any] | None = None
    ) -> list[Path]:
        """Write parameters.csv, residuals.csv, calibration.npz and the calibrated scene there.

        `tables` are more tables for the scene's file, such as [simulate]. A crash leaves the last
        good files.
        """
        folder = Path(directory)
        names = ("parameters.csv", "residuals.csv", "calibration.npz", "calibrated.toml")
        paths = [folder / name for name in names]
        _write_rows(paths[0], [_cells(asdict(e)) for e in self.estimates])
        _write_rows(paths[1], [asdict(r) for r in self.residuals])
        with replacing(paths[2]) as beside, open(beside, "wb") as file:
            np.savez(file, allow_pickle=False, **self._arrays())
        self._write_scene(paths[3], tables or {})
        return paths

    def _arrays(self) -> dict[str, Any]:
        columns = ("estimate", "std_error", "low95", "high95", "start")
        arrays = {name: np.array([getattr(e, name) for e in self.estimates]) for name in columns}
        arrays["paths"] = np.array([e.path for e in self.estimates])
        arrays["residuals"] = np.array([r.residual for r in self.residuals])
        arrays["names"] = np.array([r.name for r in self.residuals])
        for name in ("correlation", "covariance", "jacobian", "directions"):
            arrays[name] = getattr(self, name)
        return arrays

    def _write_scene(self, path: Path, tables: dict[str, Any]) -> None:
        import tomli_w

        lines = [f"# Calibrated by softmpc: {self.title or 'untitled'}; {self.status}."]
        for e in self.estimates:
            about = f"# fitted: {e.path} = {e.estimate:.6g} {e.unit}".rstrip()
            at = f", at its {e.bound}er bound" if e.bound == "low" else ""
            at = ", at its upper bound" if e.bound == "high" else at
            lines.append(f"{about} ± {e.std_error:.2g}{at}" if not at else about + at)
            if not e.determined:
                lines[-1] += "; not determined by the data alone"
        document = scene_to_dict(self.scene) | tables
        text = "\n".join(lines) + "\n\n" + tomli_w.dumps(document)
        with replacing(path) as beside:
            beside.write_text(text, encoding="utf-8")


def _cells(row: dict[str, Any]) -> dict[str, Any]:
    prior = row.pop("prior") or ("", "")
    return row | {"prior_mean": prior[0], "prior_sd": prior[1]}


def _write_rows(path: Path, rows: list[dict[str, Any]]) -> None:
    with replacing(path) as beside, open(beside, "w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
