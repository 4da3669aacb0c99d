"""The edge of a workspace: rims of its half-planes, then radii between them.

Each step is a list of independent searches. What neighbours found, and samples that lie outside,
are starts of the next round, until a round finds nothing better: one search alone may end in a
local optimum, its neighbours seldom all do.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from softmpc.statics.rest_limits import RestLimits
from softmpc.statics.workspace_rays import Place
from softmpc.statics.workspace_result import BEYOND, CONFIRMED, MISSING, Surface
from softmpc.statics.workspace_samples import Samples
from softmpc.statics.workspace_shell import Shell
from softmpc.statics.workspace_work import along, nearest, rim

__all__ = ["Edge", "EdgeSearch"]

ROUNDS = 4  # of searches from neighbours, at most
BETTER = 1e-6  # m: what counts as progress
AT_BASE = 1e-3  # of the length: nearer to the base, all rays begin there
AT_LIMIT = 1e-4  # of a range: nearer to a limit, a pressure is at it
OUTSIDE = 2  # samples that become starts of a node, at most
Run = Callable[[str, Sequence[Any], float], list[Any]]
Key = tuple[int, int, int]  # azimuth, node, sense


@dataclass(frozen=True, eq=False)
class Edge:
    """Rims (A×2, rad) and surfaces of a workspace, None where it has no shell."""

    rims: np.ndarray
    outer: Surface | None = None
    inner: Surface | None = None


@dataclass(eq=False)
class EdgeSearch:
    """Finds an edge; `run(name, cases, share)` does a step, `share` of all the work."""

    run: Run
    samples: Samples
    frame: np.ndarray
    azimuths: np.ndarray
    nodes: np.ndarray
    flat: bool
    length: float
    limits: RestLimits

    def edge(self) -> Edge:
        """Rims, nodes, and nodes again from their neighbours."""
        self.ends = self._rims()
        self.rims = np.array([[self._polar(end) for end in pair] for pair in self.ends])
        self.directions = self._shell(self._empty(), self._empty()).directions()
        self.found: dict[Key, Place] = {}
        self.changed: set[Key] = set()
        self._nodes()
        for turn in range(ROUNDS):
            if not self._again(turn):
                break
        outer, inner = self._surface(1), self._surface(-1)
        whole = self._shell(outer.radii, inner.radii)
        return Edge(self.rims, outer, inner) if len(whole.known) else Edge(self.rims)

    # --- rims ----------------------------------------------------------------------------------

    def _rims(self) -> list[list[Place | float | None]]:
        """Both ends of each half-plane: a place, None, or 0 and π where the axis is in reach."""
        axis = self.frame[:, 2]
        cases = [nearest(), along(axis, 1), along(-axis, 1)]
        self.base, *poles = (Place.of(found) for found in self.run("axis", cases, 0.02))
        base = self.base
        self.at_base = base is not None and np.linalg.norm(base.tip) < AT_BASE * self.length
        ends: list[list[Any]] = [[0.0, np.pi] for _ in self.azimuths]
        wanted = [
            (i, end)
            for i in range(len(self.azimuths))
            for end in (0, 1)
            if poles[end] is None and not self.at_base
        ]
        for i, end in wanted:
            ends[i][end] = None
        for turn in range(2):
            cases = [
                rim(self.azimuths[i], 2 * end - 1, self._beside(ends, i, end) if turn else ())
                for i, end in wanted
            ]
            answers = self.run(f"rims_{turn}", cases, 0.05)
            before = [list(pair) for pair in ends]
            for (i, end), answer in zip(wanted, answers, strict=True):
                ends[i][end] = self._wider(before[i][end], Place.of(answer), 2 * end - 1)
        return ends

    def _beside(self, ends: list[list[Any]], i: int, end: int) -> list[Any]:
        """Rims of the half-planes beside one, as starts."""
        count = len(ends)
        places = [ends[(i + k) % count][end] for k in (-2, -1, 1, 2)]
        return [place.plain() for place in places if isinstance(place, Place)]

    def _wider(self, one: Place | None, two: Place | None, sense: int) -> Place | None:
        if one is None or two is None:
            return one or two
        return two if sense * self._polar(two) > sense * self._polar(one) else one

    def _polar(self, end: Place | float | None) -> float:
        """Polar angle of a rim, NaN where there is none."""
        if end is None:
            return float("nan")
        if not isinstance(end, Place):
            return end
        x, y, z = self.frame.T @ end.tip
        return float(np.arctan2(np.hypot(x, y), z))

    # --- nodes ---------------------------------------------------------------------------------

    def _nodes(self) -> None:
        """The first search of all nodes; rims are there already, and poles are searched once."""
        keys = self._keys()
        cases = [along(self.directions[i, j], sense) for i, j, sense in keys]
        for key, answer in zip(keys, self.run("nodes", cases, 0.4), strict=True):
            self._take(key, Place.of(answer))
        for i, pair in enumerate(self.ends):
            for j, end in ((0, pair[0]), (len(self.nodes) - 1, pair[1])):
                if isinstance(end, Place):
                    self.found.update({(i, j, 1): end, (i, j, -1): end})

    def _again(self, turn: int) -> bool:
        """Nodes whose neighbours know something new, from there; whether any got better."""
        changed = set(self.found) if not turn else self.changed
        starts: dict[Key, list[Place]] = {}
        for key in self._keys():
            beside = [
                self.found[n] for n in self._neighbours(key) if n in changed and n in self.found
            ]
            if places := self._unlike(key, beside):
                starts[key] = places
        for key, places in self._outside().items():
            starts[key] = starts.get(key, []) + places
        cases = [
            along(self.directions[i, j], sense, [place.plain() for place in starts[i, j, sense]])
            for i, j, sense in starts
        ]
        share = 0.25 if turn == 0 else 0.12 / ROUNDS
        answers = self.run(f"again_{turn}", cases, share)
        self.changed = {
            key
            for key, answer in zip(starts, answers, strict=True)
            if self._take(key, Place.of(answer))
        }
        return bool(self.changed)

    def _unlike(self, key: Key, places: list[Place]) -> list[Place]:
        """Those that lead elsewhere: at the same limits, a search would end where it did before."""
        known = self.found.get(key)
        seen = {self._pattern(known)} if known else set()
        chosen = []
        for place in places:
            if (pattern := self._pattern(place)) not in seen:
                seen.add(pattern)
                chosen.append(place)
        return chosen

    def _pattern(self, place: Place) -> tuple[int, ...]:
        """Which pressures are at their lowest (-1), at their highest (1) or between."""
        share = (place.pressures - self.limits.low) / np.maximum(self.limits.range, 1e-300)
        return tuple((np.where(share > 1 - AT_LIMIT, 1, 0) - (share < AT_LIMIT)).tolist())

    def _keys(self) -> list[Key]:
        """All nodes to search: rims are known already, and of a pole one node stands for all."""
        senses = (1,) if self.at_base else (1, -1)
        keys = [
            (i, j, sense)
            for i in np.flatnonzero(np.isfinite(self.rims).all(axis=1)).tolist()
            for j in range(len(self.nodes))
            for sense in senses
        ]
        return [key for key in keys if not self._is_rim(key) and self._owner(key) == key]

    def _is_rim(self, key: Key) -> bool:
        i, j, _ = key
        end = {0: 0, len(self.nodes) - 1: 1}.get(j)
        return end is not None and isinstance(self.ends[i][end], Place)

    def _at_pole(self, key: Key) -> bool:
        i, j, _ = key
        last = len(self.nodes) - 1
        return bool((j == 0 and self.rims[i, 0] == 0) or (j == last and self.rims[i, 1] == np.pi))

    def _owner(self, key: Key) -> Key:
        """The node that is searched for this one: a pole is one place for all azimuths."""
        return (0, key[1], key[2]) if self._at_pole(key) else key

    def _neighbours(self, key: Key) -> list[Key]:
        i, j, sense = key
        count = len(self.azimuths)
        around = [((i - 1) % count, j), ((i + 1) % count, j), (i, j - 1), (i, j + 1)]
        if self._at_pole(key):
            around = [(k, 1 if j == 0 else j - 1) for k in range(0, count, max(count // 6, 1))]
        own = [(a, b, sense) for a, b in around if 0 <= b < len(self.nodes)]
        return [self._owner(n) for n in own]

    def _take(self, key: Key, place: Place | None) -> bool:
        """Keep a place if it is better than what is known."""
        if place is None:
            return False
        before = self.found.get(key)
        gain = float("inf")
        if before is not None:
            gain = key[2] * float(np.linalg.norm(place.tip) - np.linalg.norm(before.tip))
        if gain > 0:
            self.found[key] = place
        return bool(gain > BETTER)

    def _outside(self) -> dict[Key, list[Place]]:
        """Samples outside what is known, by the node that is nearest."""
        radii = {sense: self._surface(sense).radii for sense in (1, -1)}
        shell = self._shell(radii[1], radii[-1])
        if not len(shell.known):
            return {}
        tips = self.samples.tips
        away = shell.outside(tips)
        rays = tips / np.maximum(self.samples.radii, 1e-12)[:, None]
        starts: dict[Key, list[Place]] = {}
        searched, flat = set(self._keys()), self.directions.reshape(-1, 3)
        for k in np.argsort(-away)[: int(np.sum(away > 1e-4))]:
            i, j = divmod(int(np.nanargmax(flat @ rays[k])), len(self.nodes))
            beyond = self.samples.radii[k] > (radii[1][i, j] + radii[-1][i, j]) / 2
            key = self._owner((i, j, 1 if beyond else -1))
            if key in searched and len(starts.setdefault(key, [])) < OUTSIDE:
                starts[key].append(
                    Place(self.samples.pressures[k], self.samples.q[k], tips[k], 0.0)
                )
        return {key: places for key, places in starts.items() if places}

    def _known(self, key: Key) -> Place | None:
        at_base = self.at_base and key[2] < 0 and np.isfinite(self.rims[key[0]]).all()
        return self.base if at_base else self.found.get(self._owner(key))

    # --- what came of it -----------------------------------------------------------------------

    def _empty(self) -> np.ndarray:
        return np.full((len(self.azimuths), len(self.nodes)), np.nan)

    def _shell(self, outer: np.ndarray, inner: np.ndarray) -> Shell:
        return Shell(self.frame, self.azimuths, self.rims, self.nodes, outer, inner, self.flat)

    def _surface(self, sense: int) -> Surface:
        """The places of one side in arrays."""
        A, M = len(self.azimuths), len(self.nodes)
        m, n = self.samples.pressures.shape[1], self.samples.q.shape[1]
        made = Surface(
            self._empty(), np.full((A, M, 3), np.nan), np.full((A, M, m), np.nan),
            np.full((A, M, n), np.nan), self._empty(), np.full((A, M), MISSING),
        )  # fmt: skip
        for i in range(A):
            for j in range(M):
                place = self._known((i, j, sense))
                if place is None:
                    continue
                made.radii[i, j] = np.linalg.norm(place.tip)
                made.tips[i, j], made.q[i, j] = place.tip, place.q
                made.pressures[i, j] = place.pressures
                made.smallest_stiffness[i, j] = place.smallest_stiffness
                made.flags[i, j] = CONFIRMED if place.best else BEYOND
        return made
