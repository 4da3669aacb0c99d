"""Whether seven digits are enough for the condensed Hessian of a controller.

Rounding errors of a factorisation grow with the condition number. Scaled to a unit diagonal and
with λ added to it, that is (largest + λ) / (smallest + λ) of its eigenvalues: the smallest λ that
makes it `WORST` regularises the steps of the float build. It makes steps shorter in the directions
that cost least, by λ over their eigenvalue. Where a condition is beyond all digits of a float these
are nothing but rounding, and float is refused.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softmpc.control.real_time import DAMPING, RealTime
from softmpc.control.trajectory import Moment, Trajectory

__all__ = ["WORST", "Conditioning", "conditioning"]

WORST = 1e5  # condition that leaves float two digits
BEYOND = 1 / float(np.finfo(np.float32).eps)  # condition without regularisation that leaves none
LEAST = 1e-6  # λ: a few roundings of a float

Array = np.ndarray


@dataclass(frozen=True)
class Conditioning:
    """Condition of the scaled Hessian, λ for float, and why float is refused, if it is."""

    condition: float
    damping: float
    refused: str = ""


def conditioning(solver: RealTime, states: list[tuple[Array, Array]]) -> Conditioning:
    """The worst of several states of rest: each x and u, SI."""
    spectra = [_spectrum(solver, x, u) for x, u in states]
    condition = max(high / max(low, DAMPING) for low, high in spectra)
    needed = max((high - WORST * low) / (WORST - 1) for low, high in spectra)
    damping = max(needed, LEAST)
    if condition <= BEYOND:
        return Conditioning(condition, damping)
    return Conditioning(
        condition,
        damping,
        f"float is refused: the condensed Hessian has a condition of {condition:.1e}, and its "
        f"digits end at {BEYOND:.1e}; lower torque_deviation, raise tip_deviation, use blocks or a "
        "shorter horizon, or build with double",
    )


def _spectrum(solver: RealTime, x: Array, u: Array) -> tuple[float, float]:
    """Smallest and largest eigenvalue of the Hessian, scaled to a unit diagonal."""
    t = solver.transcription
    given = np.zeros((t.N, t.nr))
    moment = Moment(x / t.x_scale, t.decisions(u), given)
    at = Trajectory.of(t, t.resting(x, u))
    H = solver.condensing(solver.linearisation(moment, at)).H
    scale = 1 / np.sqrt(H.diagonal() + DAMPING)
    values = np.linalg.eigvalsh(H * scale[:, None] * scale)
    return float(values[0]), float(values[-1])
