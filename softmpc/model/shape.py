"""The shape of a segment as people draw it: length, bending angle, direction and twist.

Numbers only. The direction is undefined on the straight arm, which is why nothing in the dynamics
uses it: there the Stumpff functions of `softmpc.model.kinematics` take its place.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from softmpc.errors import InputError
from softmpc.model.parameters import Section

__all__ = ["ShapeParameters", "shape_parameters"]


class ShapeParameters(NamedTuple):
    """Length l (m); bending angle θ, its direction φ from x towards y, and twist τ (rad)."""

    length: float
    theta: float
    phi: float
    tau: float


def shape_parameters(rest: Section | float, strains: Sequence[float]) -> ShapeParameters:
    """Shape of a segment with the strains (ε, kx, ky, kz).

    Implements Eq. (2): l = (1 + ε) l_0, θ = l √(kx² + ky²), φ = arctan2(-kx, ky), τ = l kz.
    φ is 0 on the straight arm. `rest` is the segment's rest length l_0 in m; a section stands for
    one segment of its whole length. Source: paper section 2.1.
    """
    values = np.asarray(strains, dtype=float).ravel()
    if values.shape != (4,) or not np.all(np.isfinite(values)) or values[0] <= -1:
        raise InputError(
            f"strains = {values.tolist()}: must be four finite numbers (ε, kx, ky, kz), ε above -1"
        )
    epsilon, kx, ky, kz = (float(x) for x in values)
    length = (1 + epsilon) * (rest.length if isinstance(rest, Section) else float(rest))
    theta = length * float(np.hypot(kx, ky))
    phi = float(np.arctan2(0.0 - kx, ky)) if theta > 0 else 0.0
    return ShapeParameters(length, theta, phi, length * kz)
