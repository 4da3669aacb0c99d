"""Windows of a motion, and the same moment in another model: where an accuracy note looks."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from softmpc.model.model import Model
from softmpc.simulation.inputs import Curve, InputProfile
from softmpc.simulation.result import Simulation

__all__ = ["Window", "choose_windows", "divided", "later", "mapped_state"]

PIECES = 10  # of a run


@dataclass(frozen=True)
class Window:
    """Samples `first` to `last` of a motion, both included; times in s."""

    first: int
    last: int
    start: float
    end: float

    @property
    def whole(self) -> bool:
        """Whether it begins where the motion does."""
        return self.first == 0


def choose_windows(
    motion: Simulation, length: float, count: int = 1, *, to_the_end: bool = False
) -> list[Window]:
    """Up to `count` windows of `length` s with the fastest motion, which do not overlap.

    The measure is the integral of the squared speeds of all section tips, less what it would be at
    the speed at the start: a window that starts calm sees most of what builds up in it. The only
    window is the whole motion where that is no longer. One of them is the end, if `to_the_end`.
    """
    time = motion.time
    energy = np.sum(motion.tip_speeds**2, axis=1)
    if time[-1] - time[0] <= length * (1 + 1e-9):
        return [Window(0, len(time) - 1, float(time[0]), float(time[-1]))]
    free = np.ones(len(time), bool)
    chosen: list[Window] = []
    for number in range(count):
        last = to_the_end and number == 0
        best = _last(time, length) if last else _liveliest(time, energy, free, length)
        if best is None:
            break
        chosen.append(best)
        free[best.first : best.last + 1] = False
    return sorted(chosen, key=lambda window: window.start)


def _last(time: np.ndarray, length: float) -> Window:
    first = int(np.searchsorted(time, time[-1] - length * (1 + 1e-9)))
    return Window(first, len(time) - 1, float(time[first]), float(time[-1]))


def _liveliest(
    time: np.ndarray, energy: np.ndarray, free: np.ndarray, length: float
) -> Window | None:
    lasts = np.searchsorted(time, time + length * (1 + 1e-9), side="right") - 1
    full = time[lasts] - time >= length * (1 - 1e-6)
    pairs = [(i, int(lasts[i])) for i in np.flatnonzero(full) if free[i : lasts[i] + 1].all()]
    if not pairs:
        return None
    steps = np.concatenate([[0.0], np.cumsum(np.diff(time) * (energy[1:] + energy[:-1]) / 2)])
    first, last = max(
        pairs, key=lambda pair: steps[pair[1]] - steps[pair[0]] - length * energy[pair[0]]
    )
    return Window(int(first), last, float(time[first]), float(time[last]))


def later(profile: InputProfile, start: float) -> InputProfile:
    """The same inputs with the time counted from `start` (s)."""
    return InputProfile(tuple(Curve(c.times - start, c.values) for c in profile.curves))


@dataclass(frozen=True, eq=False)
class DividedProfile(InputProfile):
    """Inputs of a run that is cut at more times (s) than where they bend."""

    cuts: np.ndarray

    @property
    def breakpoints(self) -> np.ndarray:
        return np.union1d(super().breakpoints, self.cuts)


def divided(profile: InputProfile, sample_time: float, duration: float) -> DividedProfile:
    """The same inputs for a run in pieces, between which it can be given up; cuts are samples."""
    samples = int(duration / sample_time + 1e-6)
    cuts = sample_time * np.arange(samples)[:: max(1, -(-samples // PIECES))][1:]
    return DividedProfile(profile.curves, cuts)


def mapped_state(x: np.ndarray, model: Model, other: Model, rest: np.ndarray) -> np.ndarray:
    """A state x (nx) of `model` as a state of `other`, whose own state at `rest` fills the gaps.

    Strains and their rates are those of the same part of the section, or their mean over it: where
    segments are divided the arm keeps its shape. Drive states go by name. What only `other` has (a
    strain, a drive state) is as at rest.
    """
    mapped = rest.copy()
    own = {name: i for i, name in enumerate(model.layout.x.names)}
    shares = _shares(model.scene.segments, other.scene.segments)
    for i, name in enumerate(other.layout.x.names):
        if i >= 2 * other.strains:
            mapped[i] = x[own[name]] if name in own else rest[i]
            continue
        kind, _, segment = name.rpartition("_")
        parts = [(share, f"{kind}_{j}") for j, share in shares[int(segment) - 1].items()]
        if all(part in own for _, part in parts):
            mapped[i] = sum(share * x[own[part]] for share, part in parts)
    return mapped


def _shares(own: int, other: int) -> list[dict[int, float]]:
    """Of each of `other` segments: shares of the `own` ones (1, 2, …) that it covers."""
    ends = np.arange(other + 1) * own  # in units of 1/(own·other) of a section
    found = []
    for start, end in pairwise(ends.tolist()):
        covered = {
            j: min(end, (j + 1) * other) - max(start, j * other)
            for j in range(start // other, -(-end // other))
        }
        found.append({j + 1: length / own for j, length in covered.items()})
    return found
