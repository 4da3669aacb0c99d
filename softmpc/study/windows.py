"""Windows of a motion, and the same moment in another model: where an accuracy note looks."""

from __future__ import annotations

from dataclasses import dataclass

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

    Strains and their rates are copied to all parts of a divided segment, which keeps the shape of
    the arm. Drive states go by name. What only `other` has (a strain, a drive state) is as at rest.
    """
    mapped = rest.copy()
    own = {name: i for i, name in enumerate(model.layout.x.names)}
    finer = other.scene.segments // model.scene.segments
    for i, name in enumerate(other.layout.x.names):
        source = own.get(name if i >= 2 * other.strains else _coarser(name, finer))
        if source is not None:
            mapped[i] = x[source]
    return mapped


def _coarser(name: str, finer: int) -> str:
    """Name of the strain of the segment that this one is a part of: kappa_x_1_4 -> kappa_x_1_2."""
    kind, _, segment = name.rpartition("_")
    return f"{kind}_{(int(segment) - 1) // finer + 1}"
