"""How much each of the readings of one time counts.

One that is absurdly far from what is expected is left out. One that is only too far counts as if it
were at the edge of what is likely: its gain is as much smaller.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import sqrt

import numpy as np

from softmpc.estimation.kalman import Expected, Innovation, expected

__all__ = ["ABSURD", "Look", "weighed"]

Array = np.ndarray
ABSURD = 10.0  # times the distance of the edge


@dataclass(frozen=True, slots=True)
class Look:
    """A reading beside what was expected of it: e with slope H, noise R, and the square of the
    edge."""

    sensor: int
    stamp: int
    e: Array
    H: Array
    R: Array
    gate: float


def weighed(
    P: Array, looks: Sequence[Look]
) -> tuple[Expected | None, list[Innovation], list[float]]:
    """What is to be made of readings before covariance P; their innovations; how far each is from
    what was expected, the edge of what is likely being 1.

    None where no reading is left. Each is judged by itself, before the others have counted.
    """
    found, rows = _together(P, looks)
    squares = [found.nis(own) for own in rows]
    far = [sqrt(nis / one.gate) for nis, one in zip(squares, looks, strict=True)]
    spread = np.sqrt(found.S.diagonal())
    innovations = [
        Innovation(one.sensor, one.stamp, one.e, spread[own], nis, distance <= ABSURD)
        for one, own, nis, distance in zip(looks, rows, squares, far, strict=True)
    ]
    kept = [(one, x) for one, x in zip(looks, far, strict=True) if x <= ABSURD]
    if not kept:
        return None, innovations, far
    if len(kept) < len(looks):
        found, rows = _together(P, [one for one, _ in kept])
    if max(far) > 1.0:
        gain = found.gain.copy()
        for (_, distance), own in zip(kept, rows, strict=True):
            gain[:, own] /= max(distance, 1.0)
        found = replace(found, gain=gain)
    return found, innovations, far


def _together(P: Array, looks: Sequence[Look]) -> tuple[Expected, list[slice]]:
    """All readings as one, and the rows of each."""
    if len(looks) == 1:
        one = looks[0]
        return expected(P, one.e, one.H, one.R), [slice(0, len(one.e))]
    rows, end = [], 0
    for one in looks:
        rows.append(slice(end, end + len(one.e)))
        end += len(one.e)
    e, H, R = (np.concatenate(part) for part in zip(*((x.e, x.H, x.R) for x in looks), strict=True))
    return expected(P, e, H, R), rows
