"""Where the nearest posture jumps: a way from the one before to the one after.

Between both there is no way along the path. Under pressures that go straight from those of the
one to those of the other the arm is at rest within all limits, its tip in reach all along:

    u(t) = (1 - s) u₋ + s u(t)₊,   s = τ² (3 - 2τ),   τ = (t - jump) / TRANSIT
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from softmpc.statics.equilibrium import find_equilibrium

if TYPE_CHECKING:
    from softmpc.control.rest_path import RestPath

__all__ = ["TRANSIT", "Transit", "find_transits"]

TRANSIT = 0.4  # s; the arm's slowest mode takes as long
NODES = 13  # of a transit
SAMPLE = 1e-3  # s, to which a jump is known

Array = Any


@dataclass(frozen=True, eq=False)
class Transit:
    """States at rest (K×nx), inputs (K×k) and tips (K×3) at times (K) from a jump on."""

    time: Array
    x: Array
    u: Array
    tips: Array

    def within(self, t: Array) -> Array:
        """Whether times (N) are within the transit."""
        return np.asarray((t >= self.time[0]) & (t <= self.time[-1]))

    def at(self, t: Array, name: str) -> Array:
        """One of the arrays, between its nodes, at times (N)."""
        values = getattr(self, name)
        return np.stack([np.interp(t, self.time, column) for column in values.T], axis=1)

    def instead(self, t: Array, values: Array, name: str) -> Array:
        """Values (N×…) with those within the transit replaced."""
        return np.where(self.within(t)[:, None], self.at(t, name), values)


def find_transits(rest: RestPath) -> tuple[Transit, ...]:
    """A transit for each jump of a rest path, one after the other."""
    t = np.arange(0.0, rest.duration + SAMPLE / 2, SAMPLE)
    found: list[Transit] = []
    jumps = rest.jump_times(t)
    for jump, following in zip(jumps, [*jumps[1:], np.inf], strict=False):
        time = jump + np.linspace(0.0, TRANSIT, NODES)
        before = rest.held(time[:1])
        for earlier in found:
            before = earlier.instead(time[:1], before, "u")
        tau = (time - jump)[:, None] / TRANSIT
        s = tau**2 * (3 - 2 * tau)
        after = rest.held(np.minimum(time, following))  # another one takes over from there
        found.append(_at_rest(rest, time, (1 - s) * before + s * after))
    return tuple(found)


def _at_rest(rest: RestPath, time: Array, u: Array) -> Transit:
    model = rest.model
    postures = [find_equilibrium(model, model.drive.static_gain @ one) for one in u]
    still = np.zeros(model.strains)
    x = [
        np.concatenate([posture.q, still, model.drive_rest(one, posture.q)])
        for posture, one in zip(postures, u, strict=True)
    ]
    return Transit(time, np.array(x), u, np.array([posture.tips[-1] for posture in postures]))
