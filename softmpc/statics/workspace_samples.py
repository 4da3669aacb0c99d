"""Sampled postures: what a workspace is looked for from, and what it is checked against.

IPOPT finds the nearest optimum, so it needs starts all over the workspace. Pressures at their
limits make most of its edge: corners, edges and faces of the box of pressures are favoured.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np

from softmpc.model.model import Model, build
from softmpc.model.scene import Scene
from softmpc.statics.equilibrium import Equilibrium, find_equilibrium
from softmpc.statics.rest_limits import RestLimits, beyond_limits

__all__ = [
    "SampleWork",
    "Samples",
    "Start",
    "box_samples",
    "dimension_of",
    "random_samples",
    "solve",
]

AT_LIMIT = 0.3  # how often a pressure is at its lowest, and how often at its highest
MOST_CORNERS = 512
FLAT = 1e-6  # of the largest singular value: below, a direction does not count


@dataclass(frozen=True, eq=False)
class Start:
    """Where a search begins: strains (n), pressures (m), place of the tip (3)."""

    q: Any
    pressures: Any
    tip: Any


@dataclass(frozen=True, eq=False)
class Samples:
    """Stable postures within all limits, SI: K of them, of one place on the arm."""

    pressures: np.ndarray  # (K×m)
    q: np.ndarray  # strains (K×n)
    tips: np.ndarray  # (K×3)

    def __len__(self) -> int:
        return len(self.tips)

    def starts(self, some: Iterable[int]) -> list[Start]:
        """Starts from some of them, by their numbers."""
        return [Start(self.q[i], self.pressures[i], self.tips[i]) for i in some]

    @cached_property
    def radii(self) -> np.ndarray:
        """Distances of the tips from the base (K)."""
        return np.linalg.norm(self.tips, axis=1)


def random_samples(limits: RestLimits, count: int, seed: int) -> np.ndarray:
    """Pressures (count×m): each unit at its lowest, its highest or anywhere between."""
    rng = np.random.default_rng(seed)
    kind, share = rng.uniform(size=(2, count, len(limits.low)))
    share = np.where(kind < AT_LIMIT, 0.0, np.where(kind < 2 * AT_LIMIT, 1.0, share))
    return np.asarray(limits.low + share * limits.range)


def box_samples(limits: RestLimits, count: int, seed: int) -> np.ndarray:
    """The corners of the box of pressures, its middle, and random ones up to `count`.

    Of very many corners only some are there; one or two free pressures get an even grid.
    """
    free = np.flatnonzero(limits.range > 0)
    if not len(free):
        return limits.low[None, :].copy()
    if len(free) <= 2:
        return _even(limits, free, count)
    rng = np.random.default_rng(seed)
    if 2 ** len(free) <= MOST_CORNERS:
        ends = np.array(list(product((0.0, 1.0), repeat=len(free)))).reshape(-1, len(free))
    else:
        ends = rng.integers(0, 2, (MOST_CORNERS, len(free))).astype(float)
    share = np.zeros((len(ends) + 1, len(limits.low)))
    share[:-1, free] = ends
    share[-1, free] = 0.5
    corners = limits.low + share * limits.range
    more = random_samples(limits, max(count - len(corners), 0), seed + 1)
    return np.concatenate([corners, more])


def _even(limits: RestLimits, free: np.ndarray, count: int) -> np.ndarray:
    """A grid of one or two free pressures."""
    steps = np.linspace(0.0, 1.0, round(count ** (1 / len(free))))
    share = np.zeros((len(steps) ** len(free), len(limits.low)))
    share[:, free] = np.stack(np.meshgrid(*[steps] * len(free)), -1).reshape(-1, len(free))
    return np.asarray(limits.low + share * limits.range)


def solve(model: Model, pressures: np.ndarray, section: int) -> Samples:
    """The postures under `pressures` (K×m) that are stable and within all limits."""
    kept: list[Equilibrium] = []
    for p in pressures:
        found = find_equilibrium(model, p)
        if found.stable and not beyond_limits(model, found.q, found.pressures):
            kept.append(found)
    n, m = model.strains, pressures.shape[1]
    return Samples(
        np.array([rest.pressures for rest in kept]).reshape(-1, m),
        np.array([rest.q for rest in kept]).reshape(-1, n),
        np.array([rest.tips[section - 1] for rest in kept]).reshape(-1, 3),
    )


def dimension_of(model: Model, samples: Samples, limits: RestLimits, section: int) -> int:
    """In how many directions the tip can move: the rank of its slope over the free pressures."""
    free = np.flatnonzero(limits.range > 0)
    rank = 0
    for q, p in _some(samples, 20):
        K, by_p = (np.asarray(x) for x in model.stiffness(q, p))
        rows = np.asarray(model.tip_jacobian(q))[3 * section - 3 : 3 * section]
        slope = rows @ np.linalg.solve(K, by_p[:, free] * limits.range[free])
        values = np.linalg.svd(slope, compute_uv=False)
        length = model.scene.manipulator.length
        rank = max(rank, int(np.sum(values > FLAT * max(values.max(initial=0.0), 1e-3 * length))))
    return rank


def _some(samples: Samples, count: int) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    for i in np.linspace(0, len(samples) - 1, min(count, len(samples))).astype(int):
        yield samples.q[i], samples.pressures[i]


@dataclass(frozen=True)
class SampleWork:
    """The work of a sweep: a case is some pressures (K×m), its result their postures."""

    scene: Scene
    section: int

    @cached_property
    def _model(self) -> Model:
        return build(self.scene)

    def __call__(self, pressures: Any) -> dict[str, Any]:
        found = solve(self._model, np.asarray(pressures), self.section)
        return {"pressures": found.pressures, "q": found.q, "tips": found.tips}

    @staticmethod
    def joined(results: list[dict[str, Any]], scene: Scene) -> Samples:
        """The samples of all cases."""
        sizes = {"pressures": scene.manipulator.units, "q": -1, "tips": 3}
        parts = {
            name: [np.asarray(r[name], float) for r in results if len(r[name])] for name in sizes
        }
        if not parts["tips"]:
            return Samples(*(np.zeros((0, max(size, 0))) for size in sizes.values()))
        return Samples(*(np.concatenate(parts[name]) for name in sizes))
