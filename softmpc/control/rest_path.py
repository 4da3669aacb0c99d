"""The arm at rest all along a reference: postures, inputs, and what is out of reach.

Inverse statics goes along one lap, each place from the one before. What the path asks and the arm
cannot do is replaced by the nearest place in reach. Between two nodes the posture may have to jump,
where no way along the path leads from one to the other; a `Transit` leads across.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from softmpc.control.paths import Reference
from softmpc.control.transit import Transit, find_transits
from softmpc.errors import InputError
from softmpc.model.model import Model
from softmpc.statics.equilibrium import find_equilibrium
from softmpc.statics.inverse import InverseStatics
from softmpc.statics.inverse_result import InverseResult
from softmpc.statics.targets import Position

__all__ = ["Lap", "RestPath", "along", "find_rest_path", "lap_of", "part_of"]

NODES = 80  # of a lap
IN_REACH = 1e-5  # m
JUMP = 0.1  # of a strain's scale from node to node, at least, and
FAR = 6.0  # times as far as the median step
HALVINGS = 4  # of the piece with a jump

Array = np.ndarray
Progress = Callable[[int, int], None]


@dataclass(frozen=True, eq=False)
class Lap:
    """Phases (K, increasing) to look at, and whether the path repeats after one lap."""

    phase: Array
    repeats: bool

    def within(self, phase: Array) -> Array:
        """Phases of any lap as phases of this one."""
        return np.asarray(phase % 1.0 if self.repeats else np.minimum(phase, self.phase[-1]))


def lap_of(reference: Reference, nodes: int = NODES) -> Lap:
    """What the reference runs through: one lap where all are alike, else the whole way."""
    total = float(reference.law.phase(np.array([reference.duration]))[0])
    probe = np.array([0.1, 0.37, 0.73])
    path = reference.path
    same = np.allclose(path.position(probe), path.position(probe + 1.0), atol=1e-9)
    repeats = bool(same and total >= 1.0)
    end = 1.0 if repeats else total
    return Lap(np.linspace(0.0, end, 1 + max(2, round(nodes * end))), repeats)


@dataclass(frozen=True, eq=False)
class RestPath:
    """Inverse statics at the K nodes of a lap, SI. Times are those of the reference."""

    model: Model
    reference: Reference
    lap: Lap
    targets: Array  # places asked for (K×3)
    found: tuple[InverseResult, ...]  # (K)

    # --- at the nodes --------------------------------------------------------------------------

    @cached_property
    def tips(self) -> Array:
        """Nearest places in reach (K×3), m."""
        return np.array([one.tips[-1] for one in self.found])

    @cached_property
    def distance(self) -> Array:
        """How far the places are out of reach (K), m."""
        return np.linalg.norm(self.tips - self.targets, axis=1)

    @cached_property
    def q(self) -> Array:
        """Strains (K×n)."""
        return np.array([one.q for one in self.found])

    @cached_property
    def u(self) -> Array:
        """Inputs that hold the postures (K×k): torques, or pressures where they are the input."""
        return np.array(
            [one.pressures if one.torques is None else one.torques for one in self.found]
        )

    @cached_property
    def x(self) -> Array:
        """States at rest (K×nx)."""
        z = np.array([self.model.drive_rest(u) for u in self.u]).reshape(len(self.u), -1)
        return np.hstack([self.q, np.zeros_like(self.q), z])

    @cached_property
    def jumps(self) -> Array:
        """Whether the posture jumps between a node and the next one (K-1)."""
        change = np.abs(np.diff(self.q, axis=0)) / self.model.layout.q.scale
        most = change.max(axis=1)
        return np.asarray((most > JUMP) & (most > FAR * np.median(most)))

    @property
    def middle(self) -> InverseResult:
        """The posture nearest to the middle of the path."""
        off = np.linalg.norm(self.tips - self.tips.mean(axis=0), axis=1)
        return self.found[int(np.argmin(off))]

    # --- at times ------------------------------------------------------------------------------

    @property
    def duration(self) -> float:
        return self.reference.duration

    def rest(self, t: Array) -> Array:
        """States at rest (N×nx) at times (N)."""
        return self._led(t, self._between(t, self.x), "x")

    def inputs(self, t: Array) -> Array:
        """Inputs that hold them (N×k)."""
        return self._led(t, self.held(t), "u")

    def held(self, t: Array) -> Array:
        """The same without transits: they jump."""
        return self._between(t, self.u)

    def rates(self, t: Array) -> Array:
        """Rates of the strains along the path (N×n), 1/s."""
        h, n = 1e-3 * self.reference.law.lap_time, self.model.strains
        ahead, behind = (self.rest(np.asarray(t) + s)[:, :n] for s in (h, -h))
        return np.asarray((ahead - behind) / (2 * h))

    def position(self, t: Array) -> Array:
        """The reference, or the nearest place in reach (N×3)."""
        given = self.reference.position(t)
        off = np.where(self.distance[:, None] > IN_REACH, self.tips - self.targets, 0.0)
        return self._led(t, given + self._between(t, off), "tips")

    def out_of_reach(self, t: Array) -> Array:
        """How far the reference is out of reach (N), m; 0 where it is not."""
        off = np.where(self.distance > IN_REACH, self.distance, 0.0)
        return self._between(t, off[:, None])[:, 0]

    def jump_times(self, t: Array) -> Array:
        """Those of the increasing times (N) after which the posture jumps."""
        piece, share = self._places(t)
        beyond = piece + (share >= 0.5)
        jumped = np.concatenate([[0], np.cumsum(self.jumps)])[beyond]
        wraps = np.diff(beyond) < 0
        moved = np.diff(jumped) != 0
        return np.asarray(t)[:-1][np.where(wraps, self.closing_jump, moved)]

    @cached_property
    def transits(self) -> tuple[Transit, ...]:
        """From the posture before each jump to the one after."""
        return find_transits(self)

    def in_transit(self, t: Array) -> Array:
        """Whether times (N) are in a transit."""
        found = np.zeros(np.shape(t), bool)
        for transit in self.transits:
            found |= transit.within(t)
        return found

    @cached_property
    def closing_jump(self) -> bool:
        """Whether the last posture is another than the first, where the lap repeats."""
        off = np.abs(self.q[-1] - self.q[0]) / self.model.layout.q.scale
        return bool(self.lap.repeats and off.max() > JUMP)

    def _places(self, t: Array) -> tuple[Array, Array]:
        """The piece between nodes, and the share of it that is done, at times (N)."""
        phase = self.lap.within(self.reference.law.phase(np.asarray(t, float)))
        nodes = self.lap.phase
        piece = np.clip(np.searchsorted(nodes, phase, side="right") - 1, 0, len(nodes) - 2)
        share = (phase - nodes[piece]) / np.diff(nodes)[piece]
        return piece, np.clip(share, 0.0, 1.0)

    def _led(self, t: Array, values: Array, name: str) -> Array:
        """Values at times (N×…), those of the transits where there are any."""
        for transit in self.transits:
            values = transit.instead(t, values, name)
        return np.asarray(values)

    def _between(self, t: Array, values: Array) -> Array:
        """Values of the nodes (K×…) on lines between them; across a jump, of the nearer one."""
        piece, share = self._places(t)
        share = np.where(self.jumps[piece], np.round(share), share)[:, None]
        return np.asarray((1 - share) * values[piece] + share * values[piece + 1])


def part_of(progress: Progress | None, before: int = 0, after: int = 0) -> Progress:
    """Progress of a part of the work, with so much of it before and after."""

    def report(done: int, total: int) -> None:
        if progress is not None:
            progress(before + done, before + total + after)

    return report


def find_rest_path(
    inverse: InverseStatics,
    reference: Reference,
    nodes: int = NODES,
    progress: Progress | None = None,
) -> RestPath:
    """The arm at rest along a reference; `nodes` a lap.

    Where the posture has to jump on the first lap, a second one from where that ends may have to
    jump less, and is taken then. `progress` gets how many nodes are done, and of how many.
    """
    lap = lap_of(reference, nodes)
    targets = reference.path.position(lap.phase)

    def once(start: InverseResult | None, before: int) -> RestPath:
        found = along(inverse, targets, start, part_of(progress, before))
        return RestPath(inverse.model, reference, lap, targets, tuple(found))

    first = once(None, 0)
    if not first.closing_jump:
        return _refined(inverse, first)
    second = once(first.found[-1], len(targets))
    return _refined(inverse, min(first, second, key=lambda one: one.jumps.sum() + one.closing_jump))


def _refined(inverse: InverseStatics, rest: RestPath) -> RestPath:
    """With more nodes around its jumps, so that it is known where they are."""
    nodes = list(zip(rest.lap.phase, rest.targets, rest.found, strict=True))
    for k in np.flatnonzero(rest.jumps)[::-1]:
        before, after = nodes[k], nodes[k + 1]
        more = []
        for _ in range(HALVINGS):
            phase = (before[0] + after[0]) / 2
            place = rest.reference.path.position(np.array([phase]))[0]
            sides = [inverse.solve(Position(tuple(place)), side[2]) for side in (before, after)]
            found = min(sides, key=lambda one: max(one.distance, IN_REACH))
            more.append((phase, place, found))
            steps = [float(np.linalg.norm(found.q - side[2].q)) for side in (before, after)]
            before, after = (more[-1], after) if steps[0] < steps[1] else (before, more[-1])
        nodes[k + 1 : k + 1] = sorted(more, key=lambda node: node[0])
    phases, targets, found_all = zip(*nodes, strict=True)
    lap = Lap(np.array(phases), rest.lap.repeats)
    return replace(rest, lap=lap, targets=np.array(targets), found=tuple(found_all))


def along(
    inverse: InverseStatics,
    targets: Array,
    start: InverseResult | None = None,
    progress: Progress | None = None,
) -> list[InverseResult]:
    """Inverse statics at places (K×3), each from the one before, hit or not."""
    targets = np.asarray(targets, float)
    if targets.ndim != 2 or targets.shape[1] != 3 or not np.all(np.isfinite(targets)):
        raise InputError(f"places of shape {targets.shape}: must be K×3 finite numbers in m")
    limits = inverse.program.limits
    last = start
    # Pressed at half of what is allowed is a start that needs no search.
    begin = find_equilibrium(inverse.model, 0.5 * (limits.low + limits.high))
    results = []
    for k, place in enumerate(targets):
        last = inverse.solve(Position(tuple(place)), last or (begin if begin.stable else None))
        results.append(last)
        if progress is not None:
            progress(k + 1, len(targets))
    return _nearest(inverse, targets, results)


def _nearest(
    inverse: InverseStatics, targets: Array, results: list[InverseResult]
) -> list[InverseResult]:
    """The same, without places out of reach to which the posture of another one comes nearer.

    Each place was sought from the one before; beyond a jump that is a start on the wrong side.
    """
    tips = np.array([one.tips[-1] for one in results])
    for k, place in enumerate(targets):
        off = np.linalg.norm(tips - place, axis=1)
        other = int(np.argmin(off))
        if results[k].distance <= IN_REACH or off[other] > results[k].distance - IN_REACH:
            continue
        found = inverse.solve(Position(tuple(place)), results[other])
        if found.distance < results[k].distance:
            results[k], tips[k] = found, found.tips[-1]
    return results
