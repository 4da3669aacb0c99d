"""A workspace put to the test: postures it has not seen, its own points again, and its inside."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from softmpc.model.model import Model
from softmpc.statics.equilibrium import find_equilibrium
from softmpc.statics.inverse import InverseStatics
from softmpc.statics.rest_limits import rest_limits
from softmpc.statics.targets import Position
from softmpc.statics.workspace_rays import RaySearch
from softmpc.statics.workspace_result import Surface, Workspace
from softmpc.statics.workspace_samples import Start, random_samples, solve

__all__ = ["WorkspaceCheck", "check_workspace"]

# Of the arm's length outside the surfaces between their nodes: worth a search of its own.
CLEARLY = 2e-4
NEIGHBOURS = 40  # places of the edge next to a ray, of which starts are taken
DRAWS = 1000  # of places, before a shell counts as too thin for any
STARTS = 12  # of them, at different limits


@dataclass(frozen=True, eq=False)
class WorkspaceCheck:
    """What a check found, m.

    `outside` is the farthest that a sampled place is beyond what a search along its own ray finds,
    started from the edge and not from the sample (where there is no shell: beyond the extents);
    `by_grid` the same against the surfaces as they are between their nodes. `off` is the farthest
    that a point of the edge is from where forward statics, begun anew, holds the tip;
    `unreachable` counts points off by more than 0.01 mm, not stable, or beyond the pressures.
    """

    samples: int
    searched: int  # samples that needed a search
    outside: float
    worst: np.ndarray | None  # the sampled place it is about (3)
    by_grid: float
    points: int
    off: float
    unreachable: int
    filled: float  # share of random places between the surfaces that are in reach; NaN if not asked


def check_workspace(
    model: Model, space: Workspace, count: int = 1000, seed: int = 1, inside: int = 0
) -> WorkspaceCheck:
    """Check against `count` random admissible pressures; half of them favour the limits.

    `inside` places between the surfaces are sought by inverse statics.
    """
    limits = rest_limits(model, space.held)
    rng = np.random.default_rng(seed)
    even = limits.low + rng.uniform(size=(count // 2, len(limits.low))) * limits.range
    edgy = random_samples(limits, count - count // 2, seed + 1)
    seen = solve(model, np.concatenate([even, edgy]), space.section)
    away = space.distance_outside(seen.tips)
    if space.shell is None:
        low, high = space.extents.T
        outside = np.linalg.norm(seen.tips - np.clip(seen.tips, low, high), axis=1)
        searched = 0
    else:
        outside = np.zeros(len(seen))
        rays = _Rays(model, space)
        suspects = np.flatnonzero(away > CLEARLY * model.scene.manipulator.length)
        searched = len(suspects)
        for k in suspects:
            outside[k] = rays.outside(seen.tips[k])
    worst = int(np.argmax(outside)) if len(outside) else None
    return WorkspaceCheck(
        samples=len(seen),
        searched=searched,
        outside=float(outside.max(initial=0.0)),
        worst=None if worst is None else seen.tips[worst],
        by_grid=float(away.max(initial=0.0)),
        **_points_again(model, space),
        filled=_filled(model, space, inside, rng),
    )


def _filled(model: Model, space: Workspace, count: int, rng: np.random.Generator) -> float:
    """Share of places, even in volume, that inverse statics reaches by a stable posture."""
    if space.shell is None or not count:
        return float("nan")
    inverse, last = InverseStatics(model, held=space.held), None
    found: list[bool] = []
    own = space.points @ space.frame
    low, high = own.min(axis=0), own.max(axis=0)
    for _ in range(DRAWS):
        drawn = rng.uniform(low, high, (count, 3))
        drawn[:, 1] *= not space.shell.flat
        places = drawn @ space.frame.T
        for place in places[space.shell.outside(places) == 0][: count - len(found)]:
            last = inverse.solve(Position(tuple(place), section=space.section), last)
            found.append(last.solved and last.stable)
        if len(found) == count:
            break
    return float(np.mean(found)) if found else float("nan")


def _points_again(model: Model, space: Workspace) -> dict[str, Any]:
    """Every point of the edge from its pressures alone."""
    limits = rest_limits(model, space.held)
    off, unreachable, points = 0.0, 0, 0
    for surface in (space.outer, space.inner):
        if surface is None or space.shell is None:
            continue
        directions = space.shell.directions()
        for i, j in np.argwhere(surface.flags > 0):
            p, points = surface.pressures[i, j], points + 1
            rest = find_equilibrium(model, p)
            tip, expected = rest.tips[space.section - 1], surface.radii[i, j] * directions[i, j]
            away = float(np.linalg.norm(tip - expected))
            within = np.all(p >= limits.low) and np.all(p <= limits.high)
            off = max(off, away)
            unreachable += not (rest.stable and within and away <= 1.1e-5)
    return {"points": points, "off": off, "unreachable": unreachable}


class _Rays:
    """Searches along any ray, started from the edge of a workspace."""

    def __init__(self, model: Model, space: Workspace) -> None:
        flat = space.dimension < 3
        self.search = RaySearch(model, space.section, space.held, space.frame, flat)
        self.space = space
        self._sides = {1: _Side(space.outer), -1: _Side(space.inner)}

    def outside(self, tip: np.ndarray) -> float:
        """How far a place is beyond what is found along its ray, or beyond the rim of rays."""
        radius = float(np.linalg.norm(tip))
        direction = tip / radius
        gaps = []
        for sense, side in self._sides.items():
            place = self.search.along(direction, sense, side.starts(direction))
            if place is None:
                return self._beyond_rim(tip)
            gaps.append(sense * (radius - float(np.linalg.norm(place.tip))))
        return max(*gaps, 0.0)

    def _beyond_rim(self, tip: np.ndarray) -> float:
        own = self.space.frame.T @ tip
        azimuth = float(np.arctan2(own[1], own[0]))
        polar = float(np.arctan2(np.hypot(own[0], own[1]), own[2]))
        direction, gap = tip / np.linalg.norm(tip), 0.0
        starts = [start for side in self._sides.values() for start in side.starts(direction)]
        for sense in (1, -1):
            rim = self.search.rim(azimuth, sense, starts)
            if rim is None:
                return float("inf")
            own = self.space.frame.T @ rim.tip
            reached = float(np.arctan2(np.hypot(own[0], own[1]), own[2]))
            gap = max(gap, sense * (polar - reached))
        return gap * float(np.linalg.norm(tip))


class _Side:
    """The places of one surface in rows."""

    def __init__(self, surface: Surface | None) -> None:
        assert surface is not None
        good = surface.flags > 0
        self.q, self.pressures, self.tips = (
            surface.q[good], surface.pressures[good], surface.tips[good],
        )  # fmt: skip
        self.rays = self.tips / np.maximum(np.linalg.norm(self.tips, axis=1), 1e-12)[:, None]

    def starts(self, direction: np.ndarray) -> list[Start]:
        """The nearest places that differ in which pressures are at a limit."""
        order = np.argsort(-(self.rays @ direction))[:NEIGHBOURS]
        top = self.pressures.max(axis=0)
        seen: set[bytes] = set()
        chosen: list[Start] = []
        for k in order:
            kind = self.pressures[k] / np.maximum(top, 1e-300)
            pattern = ((kind > 1e-3).astype(int) + (kind > 0.999)).tobytes()
            if pattern not in seen and len(chosen) < STARTS:
                seen.add(pattern)
                chosen.append(Start(self.q[k], self.pressures[k], self.tips[k]))
        return chosen
