"""Where the tip of an arm can be at rest: the shell between its inner and its outer surface."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from softmpc.errors import InputError
from softmpc.statics.workspace_limits import EXTENTS, Extreme
from softmpc.statics.workspace_samples import Samples
from softmpc.statics.workspace_shell import Shell

__all__ = ["BEYOND", "CONFIRMED", "MISSING", "Surface", "Workspace"]

MISSING, CONFIRMED, BEYOND = range(3)


@dataclass(frozen=True, eq=False)
class Surface:
    """One side of a shell: the postures at its nodes, SI (A azimuths × M polar angles).

    `flags`: 0 nothing in reach on this ray; 1 a stable posture that forward statics confirmed;
    2 the same, but a search went further, to what is not stable or not where forward statics ends.
    """

    radii: np.ndarray  # distance of the tip from the base (A×M), NaN where missing
    tips: np.ndarray  # (A×M×3)
    pressures: np.ndarray  # (A×M×m)
    q: np.ndarray  # strains (A×M×n)
    smallest_stiffness: np.ndarray  # (A×M), J; positive: stable
    flags: np.ndarray  # (A×M)

    @property
    def stable(self) -> np.ndarray:
        """Whether the posture at each node is stable (A×M)."""
        return np.asarray(self.smallest_stiffness > 0)


@dataclass(frozen=True, eq=False)
class Workspace:
    """Where the tip of a section can be at rest, SI.

    The outer surface is the farthest, the inner the nearest place on each ray from the base. What
    is between is not always in reach: the set may have holes. `dimension` is 3 for a body, 2 for a
    surface, 1 for a curve, 0 for a point. A surface that is not flat, a curve, a point, and a body
    whose rims could not be confirmed have no shell (`outer` and `inner` are None); their places are
    in `samples`.
    """

    section: int
    held: dict[int, float]  # units that are stuck, and their pressure (Pa)
    dimension: int
    frame: np.ndarray  # axis of the polar angles in the last column (3×3)
    azimuths: np.ndarray  # (A), rad
    rims: np.ndarray  # smallest and largest polar angle (A×2), rad
    nodes: np.ndarray  # (M) between the rims, 0 to 1
    outer: Surface | None
    inner: Surface | None
    extremes: tuple[Extreme, ...]
    samples: Samples
    wall_s: float
    title: str = ""

    @cached_property
    def shell(self) -> Shell | None:
        """The geometry of the surfaces."""
        if self.outer is None or self.inner is None:
            return None
        flat = self.dimension < 3
        return Shell(
            self.frame, self.azimuths, self.rims, self.nodes,
            self.outer.radii, self.inner.radii, flat,
        )  # fmt: skip

    @property
    def volume(self) -> float:
        """Volume between the surfaces, m³; NaN for a body whose edge was not found."""
        return self.shell.volume[0] if self.shell else self._unknown

    @property
    def volume_error(self) -> float:
        """How much the volume changes when every second node is left out, m³."""
        return self.shell.volume[1] if self.shell else self._unknown

    @property
    def _unknown(self) -> float:
        return float("nan") if self.dimension == 3 else 0.0

    @cached_property
    def grid_error(self) -> float:
        """Farthest that a sampled place is outside the surfaces between their nodes, m.

        The samples are in reach, so this is what straight lines between the nodes cut off.
        """
        return float(self.shell.outside(self.samples.tips).max()) if self.shell else 0.0

    @property
    def extents(self) -> np.ndarray:
        """Smallest and largest x, y, z of the tip (3×2), m."""
        found = {(e.quantity, e.sense): e.value for e in self.extremes}
        return np.array([[found[axis, end] for end in ("smallest", "largest")] for axis in EXTENTS])

    @property
    def points(self) -> np.ndarray:
        """Every confirmed place of the edge (K×3), m; the samples where there is no shell."""
        if self.outer is None or self.inner is None:
            return self.samples.tips
        both = np.concatenate([self.outer.tips.reshape(-1, 3), self.inner.tips.reshape(-1, 3)])
        return both[np.isfinite(both).all(axis=1)]

    def extreme(self, quantity: str, sense: str, section: int | None = None) -> Extreme:
        """One of the extremes, of this section unless another one is named.

        Raises `InputError` for one that does not exist.
        """
        wanted = (quantity, sense, self.section if section is None else section)
        found = {(e.quantity, e.sense, e.section): e for e in self.extremes}
        if wanted not in found:
            names = ", ".join(sorted({e.quantity for e in self.extremes}))
            raise InputError(
                f"extreme {wanted}: must be the 'smallest' or 'largest' of {names}, of a section "
                f"from 1 to {max(e.section for e in self.extremes)}"
            )
        return found[wanted]

    def distance_outside(self, points: Any) -> np.ndarray:
        """About how far places (K×3, m) are outside (K), m; 0 for those between the surfaces.

        Linear between the nodes of the surfaces, so good to the grid's fineness. Where there is no
        shell, the distance to the nearest sampled place.
        """
        wanted = np.asarray(points, float).reshape(-1, 3)
        if self.shell is not None:
            return self.shell.outside(wanted)
        return np.array([np.linalg.norm(self.samples.tips - x, axis=1).min() for x in wanted])

    def contains(self, points: Any, tolerance: float = 1e-3) -> np.ndarray:
        """Whether places (K×3, m) are between the surfaces, or outside by at most `tolerance`."""
        return np.asarray(self.distance_outside(points) <= tolerance)

    def summary(self) -> dict[str, Any]:
        """The workspace in numbers people use: m, degrees, MPa."""
        from softmpc.statics.workspace_files import summary

        return summary(self)

    def titled(self, title: str) -> Workspace:
        """The same under another title."""
        return replace(self, title=title)

    def save(self, directory: str | os.PathLike[str]) -> list[Path]:
        """Write workspace.npz (all of it), workspace.csv (the surfaces) and limits.csv."""
        from softmpc.statics.workspace_files import save

        return save(self, Path(directory))

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Workspace:
        """Read a workspace.npz, or that of a folder; `InputError` for a file that is none."""
        from softmpc.statics.workspace_files import load

        return load(Path(path))
