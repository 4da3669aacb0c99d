"""Limits: rows of an optimal-control problem that must stay between two bounds.

A soft limit may be exceeded at a price, by one slack an interval that all its rows share: where
nothing else is possible the problem still has a solution, and where it is, the limit holds.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import ClassVar

import casadi as ca
import numpy as np

from softmpc.control.stage import Stage
from softmpc.errors import InputError
from softmpc.model.model import sparse_times

__all__ = [
    "CurvatureLimit",
    "Limit",
    "PressureLimit",
    "Rows",
    "StrainLimit",
    "StrokeLimit",
    "TipBox",
    "TipCone",
    "TorqueLimit",
    "TorqueRateLimit",
]

ROUNDED = 1e-4  # of a curvature's limit


@dataclass(frozen=True)
class Rows:
    """Rows `low ≤ value ≤ high` (SI), their names, scales and units."""

    value: ca.SX
    low: np.ndarray
    high: np.ndarray
    scale: np.ndarray
    names: tuple[str, ...]
    units: tuple[str, ...]


@dataclass(frozen=True)
class Limit(ABC):
    """A limit in every interval; `low` and `high` in SI, the same for all its rows.

    `soft` is the excess, relative to the rows' scale, whose square costs ½; None is a hard limit.
    An excess also costs its size over ten times `soft`, so that none is taken for a small gain.
    """

    name: ClassVar[str]
    of_change: ClassVar[bool] = False  # of a change within the controller's step
    low: float
    high: float
    soft: float | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        if not self.low < self.high:
            raise InputError(
                f"{type(self).__name__}: low = {self.low!r} must be below high = {self.high!r}"
            )
        if self.soft is not None and not 0 < self.soft < float("inf"):
            raise InputError(
                f"{type(self).__name__}(soft={self.soft!r}): must be above 0 and finite, the "
                "relative excess that costs ½; None makes the limit hard"
            )

    @abstractmethod
    def rows(self, stage: Stage) -> Rows:
        """The rows of this limit."""

    def _rows(
        self, value: ca.SX, scale: np.ndarray, names: tuple[str, ...], units: tuple[str, ...]
    ) -> Rows:
        ones = np.ones(value.shape[0])
        return Rows(value, self.low * ones, self.high * ones, scale, names, units)


@dataclass(frozen=True)
class TorqueLimit(Limit):
    """Motor torque in N·m (or pressure in Pa where the scene is driven by pressures)."""

    name: ClassVar[str] = "torque"

    def rows(self, stage: Stage) -> Rows:
        u = stage.model.layout.u
        return self._rows(stage.u, u.scale, u.names, u.units)


@dataclass(frozen=True)
class TorqueRateLimit(Limit):
    """Change of torque over one step of the controller, N·m."""

    name: ClassVar[str] = "torque rate"
    of_change: ClassVar[bool] = True

    def rows(self, stage: Stage) -> Rows:
        u = stage.model.layout.u
        names = tuple(f"d{n}" for n in u.names)
        return self._rows(stage.u - stage.u_before, u.scale, names, u.units)


@dataclass(frozen=True)
class PressureLimit(Limit):
    """Unit pressures at the end of each interval, Pa."""

    name: ClassVar[str] = "pressure"

    def rows(self, stage: Stage) -> Rows:
        p = stage.model.layout.p
        return self._rows(stage.pressures, p.scale, p.names, p.units)


@dataclass(frozen=True)
class StrokeLimit(Limit):
    """Travel of the pistons at the end of each interval, m; needs the hydraulic drive."""

    name: ClassVar[str] = "stroke"

    def rows(self, stage: Stage) -> Rows:
        X = stage.model.drive.X
        if len(X) == 0:
            raise InputError("StrokeLimit: this actuation has no pistons; use 'hydraulic'")
        names = tuple(f"x_piston_{j + 1}" for j in range(len(X)))
        travel = sparse_times(X, stage.z)
        scale = np.abs(X) @ stage.model.layout.z.scale
        return self._rows(travel, scale, names, ("m",) * len(names))


@dataclass(frozen=True)
class StrainLimit(Limit):
    """One kind of strain ("epsilon", "kappa_x", …) of all segments."""

    name: ClassVar[str] = "strain"
    kind: str = "epsilon"

    def rows(self, stage: Stage) -> Rows:
        q = stage.model.layout.q
        chosen = [i for i, n in enumerate(q.names) if n.startswith(self.kind + "_")]
        if not chosen:
            raise InputError(f"StrainLimit(kind={self.kind!r}): no such strain in this scene")
        names, units = (tuple(of[i] for i in chosen) for of in (q.names, q.units))
        return self._rows(stage.q[chosen], q.scale[chosen], names, units)


@dataclass(frozen=True)
class CurvatureLimit(Limit):
    """Curvature of each segment at the end of each interval, 1/m; `low` is below zero."""

    name: ClassVar[str] = "curvature"

    def rows(self, stage: Stage) -> Rows:
        q = stage.model.layout.q
        bends: dict[str, list[int]] = {}  # by the end of the name, that of a segment
        for i, name in enumerate(q.names):
            if name.startswith(("kappa_x_", "kappa_y_")):
                bends.setdefault(name[len("kappa_x_") :], []).append(i)
        scale = np.array([q.scale[which[0]] for which in bends.values()])
        rounded = (ROUNDED * self.high) ** 2  # where the arm is straight
        value = [ca.sqrt(ca.sumsqr(stage.q[which]) + rounded) for which in bends.values()]
        names = tuple(f"curvature of segment {end}" for end in bends)
        return self._rows(ca.vertcat(*value), scale, names, ("1/m",) * len(names))


@dataclass(frozen=True)
class TipBox(Limit):
    """One coordinate ("x", "y" or "z", base frame) of the tip of a section (None: the last), m."""

    name: ClassVar[str] = "tip box"
    axis: str = "z"
    section: int | None = None

    def rows(self, stage: Stage) -> Rows:
        if self.axis not in ("x", "y", "z"):
            raise InputError(f"TipBox(axis={self.axis!r}): must be 'x', 'y' or 'z'")
        scale = np.array([stage.model.scene.manipulator.length])
        place = stage.tip
        if self.section is not None:
            place = stage.model.frames(stage.q)[0][:, _index("TipBox", self.section, stage)]
        name = f"tip_{self.axis}{_of_section(self.section)}"
        return self._rows(place["xyz".index(self.axis)], scale, (name,), ("m",))


@dataclass(frozen=True)
class TipCone(Limit):
    """Angle (rad) between an axis (base frame) and the direction of a section's tip, at most
    `angle`; None is the last section."""

    name: ClassVar[str] = "tip cone"
    low: float = field(init=False)
    high: float = field(init=False)
    angle: float
    axis: tuple[float, float, float] = (0.0, 0.0, 1.0)
    section: int | None = None

    def __post_init__(self) -> None:
        if not 0 < self.angle < np.pi:
            raise InputError(f"TipCone(angle={self.angle!r}): must be between 0 and π rad")
        size = float(np.linalg.norm(self.axis))
        if len(self.axis) != 3 or not 0 < size < np.inf:
            raise InputError(
                f"TipCone(axis={self.axis!r}): must be three finite numbers, not all of them zero"
            )
        object.__setattr__(self, "axis", tuple((np.array(self.axis) / size).tolist()))
        object.__setattr__(self, "low", -np.inf)
        object.__setattr__(self, "high", float(self.angle))
        super().__post_init__()

    def rows(self, stage: Stage) -> Rows:
        index = _index("TipCone", self.section, stage)
        points = stage.model.frames(stage.q)[1][:, 3 * index + 2]
        axis = ca.DM(self.axis)
        # The arc tangent is exact at all angles; rounded where the sine has no slope.
        sine = ca.sqrt(ca.sumsqr(ca.cross(axis, points)) + (ROUNDED * self.angle) ** 2)
        angle = ca.atan2(sine, ca.dot(axis, points))
        name = f"angle of tip direction{_of_section(self.section)}"
        return self._rows(angle, np.ones(1), (name,), ("rad",))


def _index(owner: str, section: int | None, stage: Stage) -> int:
    """Place of a section, counted from 1, among the tips."""
    count = len(stage.model.scene.manipulator.sections)
    if section is not None and (isinstance(section, bool) or section not in range(1, count + 1)):
        raise InputError(f"{owner}(section={section!r}): this arm has the sections 1 to {count}")
    return count - 1 if section is None else section - 1


def _of_section(section: int | None) -> str:
    return "" if section is None else f" of section {section}"
