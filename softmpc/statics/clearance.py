"""How far places are from the edge of the workspace."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from heapq import heappop, heappush
from itertools import count, product

import numpy as np

from softmpc.statics.inverse import InverseStatics
from softmpc.statics.targets import Position
from softmpc.statics.workspace_rays import Place, RaySearch
from softmpc.statics.workspace_samples import Start

__all__ = ["Clearance", "find_clearance"]

TURNS = 8  # of one ray, at most, each towards the normal of the edge where the last one ended
SETTLED = 1e-6  # m
BEYOND = 1e-3  # m past the end of a ray, where nothing may be in reach
TRIES = 40  # rays that are turned or followed further
Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Clearance:
    """Smallest distance from some places to the edge of the workspace.

    From each place rays go out in `directions` ways. The shortest one is turned until it meets the
    edge at a right angle; then inverse statics looks 1 mm past its end, and where another posture
    reaches on, the ray goes on from there. So the place at the end is on the edge, and no ray was
    shorter. A fold of the edge between all rays would go unseen: it is a distance, no proof for
    the whole ball.
    """

    distance: float  # m
    place: np.ndarray  # where (3)
    direction: np.ndarray  # towards the edge (3)
    directions: int


@dataclass(frozen=True, eq=False)
class _Ray:
    """From a place along a direction to where the search ended."""

    place: np.ndarray
    way: np.ndarray
    end: Place
    turned: bool = False

    @property
    def distance(self) -> float:
        return float(np.linalg.norm(self.end.tip - self.place))


def find_clearance(
    inverse: InverseStatics, places: np.ndarray, progress: Progress | None = None
) -> Clearance | None:
    """How close `places` of the tip (K×3, m) come to the edge; None if one is out of reach."""
    ways = [np.array(d, float) for d in product((-1, 0, 1), repeat=3) if np.abs(d).sum() in (1, 3)]
    ways = [way / np.linalg.norm(way) for way in ways]
    search = _Search(inverse)
    last = None
    for k, place in enumerate(np.asarray(places, float)):
        last = inverse.solve(Position(tuple(place)), last)
        if not last.solved:
            return None
        start = Start(last.q, last.pressures, last.tips[-1])
        for way in ways:
            search.add(place, way, start)
        if progress is not None:
            progress(k + 1, len(places))
    shortest = search.shortest()
    if shortest is None:  # no ray leaves any place: no room at all
        return Clearance(0.0, np.asarray(places, float)[0], ways[0], len(ways))
    return Clearance(shortest.distance, shortest.place, shortest.way, len(ways))


class _Search:
    """Rays, shortest first."""

    def __init__(self, inverse: InverseStatics) -> None:
        model = inverse.model
        self.inverse = inverse
        sections = len(model.scene.manipulator.sections)
        self.rays = RaySearch(model, sections, inverse.program.limits.held)
        self._heap: list[tuple[float, int, _Ray]] = []
        self._count = count()

    def add(self, place: np.ndarray, way: np.ndarray, start: Start) -> None:
        """A ray from `place`, as far as the posture at `start` can follow it."""
        end = self.rays.along(way, 1, [start], origin=place)
        if end is not None:
            self._push(_Ray(place, way, end))

    def _push(self, ray: _Ray) -> None:
        heappush(self._heap, (ray.distance, next(self._count), ray))

    def shortest(self) -> _Ray | None:
        """The shortest ray whose end is on the edge."""
        for _ in range(TRIES):
            if not self._heap:
                return None
            _, _, ray = heappop(self._heap)
            further = self._turned(ray) if not ray.turned else self._further(ray)
            if further is None:
                return ray
            self._push(further)
        return self._heap[0][2]

    def _turned(self, ray: _Ray) -> _Ray:
        """The ray turned towards the nearest place of the edge around its end."""
        for _ in range(TURNS):
            way, end = ray.end.normal, ray.end
            if way is None:
                break
            start = Start(end.q, end.pressures, end.tip)
            reached = self.rays.along(way, 1, [start], origin=ray.place)
            if reached is None:
                break
            better = _Ray(ray.place, way, reached)
            if better.distance > ray.distance - SETTLED:
                break
            ray = better
        return replace(ray, turned=True)

    def _further(self, ray: _Ray) -> _Ray | None:
        """The ray from a posture that goes on where this one ends; None if there is none."""
        beyond = self.inverse.solve(Position(tuple(ray.end.tip + BEYOND * ray.way)))
        if not (beyond.solved and beyond.stable and beyond.on_rest_branch):
            return None
        start = Start(beyond.q, beyond.pressures, beyond.tips[-1])
        end = self.rays.along(ray.way, 1, [start], origin=ray.place)
        if end is None or np.linalg.norm(end.tip - ray.place) < ray.distance + BEYOND / 2:
            return None
        return _Ray(ray.place, ray.way, end)
