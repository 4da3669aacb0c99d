"""Gains of a proportional-integral controller of the tip, from how the arm answers at rest.

Inverse statics makes the tip answer its own errors one to one, once the arm has settled. How fast
they may be taken out is decided by how it settles: over frequency, the loop

    L(ω) = G(ω) S H(ω) (k + k_i h / (1 - exp(-iωh)))

with G the answer of the tip (`Response`), S the inverse of G(0), and H the input held for a step h,
keeps the sensitivity |(I + L)⁻¹| below `MOST_SENSITIVE` at all places. Of all ratios k/k_i the one
with the largest k_i is taken, as Åström and Hägglund do (Advanced PID Control, 2006, section 7.3).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from softmpc.control.response import Response
from softmpc.errors import BuildError

__all__ = ["MOST_SENSITIVE", "static_inverse", "tip_gains"]

MOST_SENSITIVE = 1.7  # leaves a gain margin of 2.4 and 34 degrees of phase
WEAK = 0.02  # of the largest singular value: directions of the tip that inputs hardly move
FREQUENCIES = 120
SLOWEST = 0.3  # rad/s
RATIOS = (0.0, 0.01, 0.02, 0.04, 0.06, 0.08, 0.1, 0.13, 0.17, 0.25, 0.4)  # s, k/k_i
LEAST, MOST, FACTOR = 0.02, 100.0, 1.1  # 1/s, of k_i

Array = Any


def tip_gains(places: Sequence[Response], step: float) -> tuple[Array, float, float]:
    """S (places×k×3), k and k_i (1/s) for a controller that acts every `step` s.

    Raises `BuildError` where even the smallest gain is too much at one of the places.
    """
    inverses = np.array([static_inverse(place) for place in places])
    omega = np.geomspace(SLOWEST, np.pi / step, FREQUENCIES)
    held = np.exp(-0.5j * omega * step) * np.sinc(omega * step / (2 * np.pi))
    loops = np.array([
        [place(w) @ S for w in omega] for place, S in zip(places, inverses, strict=True)
    ]) * held[:, None, None]  # fmt: skip
    integral = step / (1 - np.exp(-1j * omega * step))
    found = [(_largest(loops, ratio + integral), ratio) for ratio in RATIOS]
    most, ratio = max(found)
    if most < LEAST:
        raise BuildError(
            "inverse-statics table: no gain keeps the tip's loop away from oscillation at all "
            "places of the path; choose a shorter step, or another controller"
        )
    return inverses, ratio * most, most


def static_inverse(place: Response) -> Array:
    """The smallest change of the inputs (scaled) that moves the tip at rest by 1 m (k×3)."""
    scale = place.model.layout.u.scale
    return scale[:, None] * np.linalg.pinv(place(0.0).real * scale, rcond=WEAK)


def _largest(loops: Array, shape: Array) -> float:
    """The largest k_i below which all are allowed; 0 where none is.

    From no gain upwards a loop becomes unstable only where its sensitivity has no bound.
    """
    allowed, gain = 0.0, LEAST
    while gain < MOST and _sensitivity(loops * (gain * shape)[:, None, None]) <= MOST_SENSITIVE:
        allowed, gain = gain, FACTOR * gain
    return allowed


def _sensitivity(loops: Array) -> float:
    """Largest singular value of (I + L)⁻¹ over places and frequencies."""
    return float(1 / np.linalg.svd(np.eye(3) + loops, compute_uv=False)[..., -1].min())
