"""Windows of a motion, and the same moment in another model: where an accuracy note looks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softmpc.model.model import Model
from softmpc.simulation.inputs import Curve, InputProfile
from softmpc.simulation.result import Simulation

__all__ = ["Window", "choose_windows", "later", "mapped_state"]


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


def choose_windows(motion: Simulation, length: float, count: int = 1) -> list[Window]:
    """Up to `count` windows of `length` s with the fastest motion, which do not overlap.

    The measure is the integral of the squared speeds of all section tips, less what it would be at
    the speed at the start: a window that starts calm sees most of what builds up in it. The only
    window is the whole motion where that is no longer.
    """
    time = motion.time
    energy = np.sum(motion.tip_speeds**2, axis=1)
    if time[-1] - time[0] <= length * (1 + 1e-9):
        return [Window(0, len(time) - 1, float(time[0]), float(time[-1]))]
    free = np.ones(len(time), bool)
    chosen: list[Window] = []
    for _ in range(count):
        best = _liveliest(time, energy, free, length)
        if best is None:
            break
        chosen.append(best)
        free[best.first : best.last + 1] = False
    return sorted(chosen, key=lambda window: window.start)


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
