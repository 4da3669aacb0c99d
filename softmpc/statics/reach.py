"""How far the arm could reach at the very most: what needs no solver to be refused.

An arc's chord is at most as long as the arc, so the tip of section i is never farther from the
base than Σ λ_k (1 + ε_max) over the sections k ≤ i, with the largest stretch ε_max that the limits
allow. How far pressures get it is less; that takes a search.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from softmpc.model.scene import Scene

__all__ = ["FAR", "farthest", "too_far"]

FAR = 1.5  # times that bound: nobody means such a place, but for another unit

Array = np.ndarray


def farthest(scene: Scene, section: int | None = None) -> float:
    """Length (m) of the arm up to the tip of a section (1, 2, …; None: the last) stretched most."""
    manipulator = scene.manipulator
    stretch = manipulator.limits.stretch_max if "epsilon" in scene.strains else 0.0
    return sum(part.length for part in manipulator.sections[:section]) * (1 + stretch)


def too_far(scene: Scene, place: Any, section: int | None = None, times: float = 1.0) -> str:
    """Why a place (m; None where free) is beyond `times` that length; empty where it is not."""
    most = farthest(scene, section)
    distance = float(np.linalg.norm([x for x in place if x is not None]))
    if distance <= times * most * (1 + 1e-9):
        return ""
    said = ", ".join("-" if x is None else f"{x:g}" for x in place)
    return (
        f"({said}) m is {distance:.4g} m from the base, but the arm is {most:.4g} m long at most, "
        "stretched as far as its limits allow (stretch_max); are these metres?"
    )
