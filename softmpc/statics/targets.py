"""What the tip of a section shall do at rest: be at a place, point along an axis, be turned so.

A full pose is a position and an orientation.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any, ClassVar

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from softmpc.errors import InputError

__all__ = ["Direction", "Orientation", "Position", "Target", "as_targets"]

ORTHONORMAL = 1e-3  # largest error of R Rᵀ that counts as rounding
AXES = "xyz"


@dataclass(frozen=True)
class Target(ABC):
    """One wish for the tip of a section, counted from 1 at the base; None is the last one.

    Values travel apart from the kind: targets of one `kind` share one program.
    """

    section: int | None = field(default=None, kw_only=True)

    name: ClassVar[str]
    turns: ClassVar[bool] = True  # whether what it misses is an angle, else a distance

    @property
    def kind(self) -> tuple[Any, ...]:
        """What the program depends on."""
        return (type(self), self.section)

    @property
    @abstractmethod
    def values(self) -> np.ndarray:
        """What the program takes as parameters: the features that are wanted (k)."""

    @abstractmethod
    def features(self, tip: Any, rotation: Any) -> Any:
        """What of a tip's place (3) and orientation (3×3) must have these values (k)."""

    def seen(self, tips: np.ndarray, rotations: np.ndarray) -> np.ndarray:
        """Features (N×k) of N postures, section tips (N×S×3, N×S×3×3)."""
        i = self.index(tips.shape[1])
        return np.array([self.features(tips[n, i], rotations[n, i]) for n in range(len(tips))])

    def error(self, tips: np.ndarray, rotations: np.ndarray) -> float:
        """Distance (m) or angle (rad) of one posture, section tips (S×3, S×3×3)."""
        off = float(np.linalg.norm(self.seen(tips[None], rotations[None])[0] - self.values))
        return 2 * math.asin(min(off / 2, 1.0)) if self.turns else off

    @abstractmethod
    def moves(self) -> tuple[list[str], np.ndarray]:
        """Ways to move the target (x, y, z in m, turns in rad), and how values change by each."""

    def check(self, sections: int) -> None:
        """Raise `InputError` where the arm has no such section."""
        if self.section is not None and not 1 <= self.section <= sections:
            raise InputError(
                f"target of section {self.section}: this arm has the sections 1 to {sections}"
            )

    def index(self, sections: int) -> int:
        """Place of its section among the tips."""
        return sections - 1 if self.section is None else self.section - 1


@dataclass(frozen=True)
class Position(Target):
    """The tip's place (m, base frame); a coordinate that is None is free."""

    place: tuple[float | None, ...]

    name: ClassVar[str] = "position"
    turns: ClassVar[bool] = False

    def __post_init__(self) -> None:
        given = list(self.place)
        if len(given) != 3 or all(x is None for x in given):
            raise InputError(
                f"Position.place = {given}: must be three numbers in m, or None where free"
            )
        fixed = _finite("Position.place", [x for x in given if x is not None], "m")
        numbers = iter(fixed.tolist())
        place = tuple(None if x is None else next(numbers) for x in given)
        object.__setattr__(self, "place", place)

    @property
    def _fixed(self) -> list[int]:
        return [i for i, x in enumerate(self.place) if x is not None]

    @property
    def kind(self) -> tuple[Any, ...]:
        return (*super().kind, *self._fixed)

    @property
    def values(self) -> np.ndarray:
        return np.array([self.place[i] for i in self._fixed], float)

    def features(self, tip: Any, rotation: Any) -> Any:
        return tip[self._fixed]

    def moves(self) -> tuple[list[str], np.ndarray]:
        return [AXES[i] for i in self._fixed], np.eye(len(self._fixed))


@dataclass(frozen=True)
class Direction(Target):
    """The direction in which the tip's axis points (base frame); its length does not matter."""

    axis: tuple[float, ...]

    name: ClassVar[str] = "direction"

    def __post_init__(self) -> None:
        axis = _finite("Direction.axis", self.axis, "").ravel()
        size = float(np.linalg.norm(axis))
        if len(axis) != 3 or size == 0:
            raise InputError(
                f"Direction.axis = {axis.tolist()}: must be three numbers, not all of them zero"
            )
        object.__setattr__(self, "axis", tuple((axis / size).tolist()))

    @property
    def values(self) -> np.ndarray:
        return np.array(self.axis)

    def features(self, tip: Any, rotation: Any) -> Any:
        return rotation[:, 2]

    def moves(self) -> tuple[list[str], np.ndarray]:
        return [f"turn_{axis}" for axis in AXES], _turned(self.values)


@dataclass(frozen=True)
class Orientation(Target):
    """The whole orientation of the tip: a rotation matrix (3×3) whose columns are its axes."""

    rotation: tuple[tuple[float, ...], ...]

    name: ClassVar[str] = "orientation"

    def __post_init__(self) -> None:
        R = _finite("Orientation.rotation", self.rotation, "")
        if R.shape != (3, 3) or np.abs(R @ R.T - np.eye(3)).max() > ORTHONORMAL:
            raise InputError(
                f"Orientation.rotation = {R.tolist()}: must be a 3×3 matrix whose columns are "
                "orthonormal"
            )
        if np.linalg.det(R) < 0:
            raise InputError(
                f"Orientation.rotation = {R.tolist()} has the determinant -1, so it is a mirror "
                "image: turn one axis round"
            )
        U, _, V = np.linalg.svd(R)  # the nearest rotation
        object.__setattr__(self, "rotation", tuple(map(tuple, (U @ V).tolist())))

    @property
    def values(self) -> np.ndarray:
        return np.asarray(self.features(None, np.array(self.rotation)))

    def features(self, tip: Any, rotation: Any) -> Any:
        columns = [rotation[:, k] for k in range(3)]
        stacked = (
            np.concatenate(columns) if isinstance(rotation, np.ndarray) else ca.vertcat(*columns)
        )
        return stacked / math.sqrt(2)  # so that their distance is 2 sin(angle/2), as of directions

    def moves(self) -> tuple[list[str], np.ndarray]:
        turns = np.vstack([_turned(column) for column in np.transpose(self.rotation)])
        return [f"turn_{axis}" for axis in AXES], turns / math.sqrt(2)


def as_targets(targets: Target | Iterable[Target], sections: int) -> tuple[Target, ...]:
    """One target or several as a tuple. Raises `InputError` for anything else."""
    several = isinstance(targets, Iterable) and not isinstance(targets, Target)
    given: tuple[Any, ...] = tuple(targets) if several else (targets,)  # type: ignore[arg-type]
    for target in given:
        if not isinstance(target, Target):
            raise InputError(
                f"target {target!r}: must be a Position, a Direction or an Orientation, "
                "for instance Position((0.1, 0, 0.5))"
            )
        target.check(sections)
    if not given:
        raise InputError("no target is given: give a Position, a Direction or an Orientation")
    return given


def _finite(name: str, values: ArrayLike, unit: str) -> np.ndarray:
    try:
        numbers = np.asarray(values, float)
    except (TypeError, ValueError):
        raise InputError(f"{name} = {values!r}: must be numbers") from None
    if not np.all(np.isfinite(numbers)):
        raise InputError(f"{name} = {numbers.tolist()} {unit}".rstrip() + ": must be finite")
    return numbers


def _turned(v: np.ndarray) -> np.ndarray:
    """∂(turned v)/∂(turn about x, y, z): a small turn w makes it v + w × v."""
    x, y, z = v
    return np.array([[0, z, -y], [-z, 0, x], [y, -x, 0]])
