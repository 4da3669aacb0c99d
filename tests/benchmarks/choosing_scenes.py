"""Scenes for the bound of `softmpc choose`: made of seeds, some to calibrate with, others to judge.

Arms of one to three sections, of other sizes, masses and stiffnesses than the paper's; steps and
ramps on any units; circles, figure eights and lines at any side of the arm.
"""

from __future__ import annotations

from math import cos, pi, sin
from typing import Any

import numpy as np

__all__ = [
    "CALIBRATING", "JUDGING", "SCENES", "TOLERANCES", "loop_scene", "motion_scene", "rest_scene",
]  # fmt: skip

# First seeds and numbers of scenes of each family; the two sets have none in common.
CALIBRATING = {"rest": (3000, 19), "motion": (1000, 29), "loop": (2000, 19)}
JUDGING = {"motion": (100, 12), "loop": (200, 8)}
GRAVITY = {"gravity": [0.0, 0.0, 9.81]}
LENGTH, MASS, YOUNG = 0.5, 1.12, 1.2e6  # m, kg, Pa of the paper's whole arm
TOLERANCES = (2.0, 30.0)  # mm


def rest_scene(seed: int) -> tuple[dict[str, Any], float]:
    """An arm that hangs, stands or lies, and a tolerance (m) for it."""
    draw = np.random.default_rng(seed)
    sections = 1 + seed % 3
    down = draw.normal(size=3)
    document = {
        "title": f"rest {seed}, {_counted(sections)}",
        "manipulator": _arm(draw, sections, draw.uniform(0.6, 1.3)),
        "effects": {"gravity": [_rounded(value) for value in 9.81 * down / np.linalg.norm(down)]},
    }
    return document, _tolerance(draw)


def motion_scene(seed: int) -> tuple[dict[str, Any], float]:
    """An arm moved by steps and ramps for 1.2 s, and a tolerance (m) for it."""
    draw = np.random.default_rng(seed)
    sections = 1 + seed % 3
    moves: dict[str, Any] = {"steps": [], "ramps": []}
    units = draw.choice(3 * sections, size=min(3, 1 + sections), replace=False)
    for unit in units:
        at, torque = _rounded(draw.uniform(0.0, 0.5)), draw.uniform(0.5, 1.8)
        if draw.random() < 0.6:
            moves["steps"].append({"unit": int(unit) + 1, "at": at, "torque": _rounded(torque)})
        else:
            span = _rounded(draw.uniform(0.2, 0.6))
            ramp = {"unit": int(unit) + 1, "from": at, "to": at + span}
            moves["ramps"].append(ramp | {"slope": _rounded(torque / span)})
    document = {
        "title": f"motion {seed}, {_counted(sections)}",
        "manipulator": _arm(draw, sections, draw.uniform(0.6, 1.3)),
        "effects": GRAVITY,
        "simulate": {"duration": 1.2, "sample_time": 0.01, **moves},
    }
    return document, _tolerance(draw)


def loop_scene(seed: int) -> tuple[dict[str, Any], float]:
    """A path to track in 1.5 to 2.5 s, and a tolerance (m) for it."""
    draw = np.random.default_rng(seed)
    sections = 2 + (seed % 4 == 3)
    size = draw.uniform(0.8, 1.2)
    arm = _arm(draw, sections, size, soft=False)
    side, span = draw.uniform(0, 2 * pi), size * draw.uniform(0.03, 0.07)
    x, y, z = size * 0.12 * cos(side), size * 0.12 * sin(side), size * 0.57
    center = [_rounded(value) for value in (x, y, z)]
    kind = ("circle", "figure-eight", "line")[int(draw.integers(3))]
    path: dict[str, Any] = {"path": kind, "center": center}
    if kind == "circle":
        path["diameter"] = _rounded(span)
    elif kind == "figure-eight":
        path |= {"width": _rounded(span), "height": _rounded(span / 2)}
    else:
        start = [_rounded(x - span / 2), _rounded(y), _rounded(z)]
        path = {"path": kind, "start": start, "end": [_rounded(x + span / 2), *start[1:]]}
    lap = {"lap_time": _rounded(draw.uniform(1.5, 2.5)), "laps": 1, "smooth_start": 0.4}
    controller = {"step": 0.025, "horizon": int(draw.integers(10, 17))}
    document = {
        "title": f"{kind} {seed}, {_counted(sections)}",
        "manipulator": arm,
        "effects": GRAVITY,
        "track": path | lap | {"settle": 0.4, "controller": controller},
    }
    return document, _tolerance(draw)


def _arm(
    draw: np.random.Generator, sections: int, size: float, soft: bool = True
) -> dict[str, Any]:
    """An arm of so many sections that is `size` times as long as the paper's, all in all."""
    uneven = draw.uniform(0.8, 1.2, sections)
    lengths = size * LENGTH * (uneven / uneven.sum() if sections > 1 else np.array([0.5]))
    density = MASS / LENGTH * (draw.uniform(0.8, 1.3) if soft else draw.uniform(0.8, 1.1))
    young = YOUNG * (draw.uniform(0.8, 1.5) if soft else draw.uniform(0.95, 1.1))
    return {
        "preset": "chen2022-v1",
        "sections": sections,
        "section_length": [_rounded(value) for value in lengths],
        "section_mass": [_rounded(density * value) for value in lengths],
        "young_modulus": round(young, -3),
        "shear_modulus": round(young / 3, -3),
    }


def _tolerance(draw: np.random.Generator) -> float:
    low, high = np.log(TOLERANCES)
    return 1e-3 * float(f"{np.exp(draw.uniform(low, high)):.2g}")


def _rounded(value: float) -> float:
    return round(float(value), 4)


def _counted(sections: int) -> str:
    return "1 section" if sections == 1 else f"{sections} sections"


SCENES = {"rest": rest_scene, "motion": motion_scene, "loop": loop_scene}
