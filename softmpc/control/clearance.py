"""The whole arm clear of obstacles: as a limit of a problem, and measured along given postures.

The arm is its envelope: around the centre line of each section a sphere of its `disc_radius`, as
in contact. Clearance is the distance between envelope and obstacle, below zero where they overlap.

A limit holds it at some places a section. Between two, h apart, the arm may come nearer to an
obstacle of radius R than at both, by about

    h²/8 (1/(R + r) + κ),

where r is the envelope's radius and κ the curvature of the arm, bent away from the obstacle.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from math import inf, isfinite
from typing import ClassVar

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from softmpc.control.limits import Limit, Rows
from softmpc.control.stage import Stage
from softmpc.errors import InputError
from softmpc.just_in_time import JustInTime
from softmpc.model.chain import State
from softmpc.model.model import Model
from softmpc.model.obstacles import OBSTACLES, Obstacle, obstacle_names
from softmpc.model.places import points_along

__all__ = ["Closest", "KeepClear", "arm_clearance"]

SCALE = 0.1  # m
MOST_PLACES = 1000


@dataclass(frozen=True)
class KeepClear(Limit):
    """The whole arm stays at least `margin` (m) away from each obstacle, at the ends of intervals.

    `places` spheres a section stand for the arm, evenly spaced in the section's rest length, the
    last at its end; with the default a sphere of 50 mm radius is less than 1 mm deep in the paper's
    arm between them, at all pressures it may have. Each obstacle and place is a row of the problem.
    `soft` counts in tenths of a metre: with 1e-3 an excess of 0.1 mm costs ½. The base does not
    move, so leave out what the arm is mounted on.
    """

    name: ClassVar[str] = "clearance"
    low: float = field(init=False)
    high: float = field(init=False)
    obstacles: tuple[Obstacle, ...]
    margin: float = 0.0
    places: int = 20

    def __post_init__(self) -> None:
        object.__setattr__(self, "obstacles", _checked(self.obstacles, "KeepClear.obstacles"))
        _check_count(self.places, "KeepClear.places")
        if not isfinite(self.margin):
            raise InputError(f"KeepClear.margin = {self.margin!r}: must be a finite number in m")
        object.__setattr__(self, "low", self.margin)
        object.__setattr__(self, "high", inf)
        super().__post_init__()

    def rows(self, stage: Stage) -> Rows:
        value = _clearances(stage.model, stage.q, self.obstacles, self.places)
        sections = range(1, len(stage.model.scene.manipulator.sections) + 1)
        names = tuple(
            f"clearance of {obstacle} to section {section} at {100 * k / self.places:.3g} %"
            for obstacle in obstacle_names(self.obstacles)
            for section in sections
            for k in range(1, self.places + 1)
        )
        return self._rows(value, np.full(len(names), SCALE), names, ("m",) * len(names))


@dataclass(frozen=True)
class Closest:
    """Where the arm is closest to each obstacle, for N postures and O obstacles (each N×O)."""

    clearance: np.ndarray  # m, below zero where arm and obstacle overlap
    section: np.ndarray  # the first is 1
    fraction: np.ndarray  # of the section's rest length, from above 0 to 1


def arm_clearance(
    model: Model, obstacles: Sequence[Obstacle], places: int = 60
) -> Callable[[ArrayLike], Closest]:
    """A function of postures q (N×n, or n for one): how close the arm is to each obstacle.

    It looks at `places` spheres a section, as `KeepClear` does; with the default the paper's arm
    is between them less than 0.1 mm nearer to a sphere of 50 mm radius. NaN stays NaN.
    """
    obstacles = _checked(obstacles, "obstacles")
    _check_count(places, "places")
    q = ca.SX.sym("q", model.strains)
    value = _clearances(model, q, obstacles, places)
    function = JustInTime(ca.Function("clearances", [q], [value], {"cse": True}))

    def closest(postures: ArrayLike) -> Closest:
        given = np.atleast_2d(np.asarray(postures, float))
        if given.ndim != 2 or given.shape[1] != model.strains or not len(given):
            raise InputError(
                f"postures of shape {np.shape(postures)}: must be N×{model.strains}, the strains q "
                "of one posture or more"
            )
        found = np.asarray(function(given.T)).T.reshape(len(given), len(obstacles), -1)
        at = found.argmin(axis=2)
        least = np.take_along_axis(found, at[..., None], axis=2)[..., 0]
        return Closest(least, at // places + 1, (at % places + 1) / places)

    return closest


def _clearances(model: Model, q: ca.SX, obstacles: tuple[Obstacle, ...], places: int) -> ca.SX:
    """Clearance (m) of each obstacle to each place, obstacle after obstacle."""
    points = points_along(model.chain, State(q), places)
    radii = [section.disc_radius for section in model.scene.manipulator.sections]
    return -ca.vertcat(
        *(
            obstacle.depth(point, radii[i // places])[0]
            for obstacle in obstacles
            for i, point in enumerate(points)
        )
    )


def _checked(obstacles: Sequence[Obstacle], label: str) -> tuple[Obstacle, ...]:
    kinds = ", ".join(kind.__name__ for kind in OBSTACLES.values())
    if isinstance(obstacles, Obstacle):
        raise InputError(f"{label} = {obstacles!r}: must be a tuple of obstacles, also for one")
    found = tuple(obstacles)
    if not found:
        raise InputError(f"{label} is empty: give at least one obstacle, such as Sphere(…)")
    for i, one in enumerate(found):
        if not isinstance(one, Obstacle):
            raise InputError(f"{label}[{i}] = {one!r}: must be an obstacle ({kinds})")
    return found


def _check_count(places: int, label: str) -> None:
    if isinstance(places, bool) or not isinstance(places, int) or not 1 <= places <= MOST_PLACES:
        raise InputError(
            f"{label} = {places!r}: must be a whole number from 1 to {MOST_PLACES}, a section"
        )
