"""How far does the tip scatter, if wall areas are known to 5 % only? On all cores of this machine.

python examples/monte_carlo.py
"""

from dataclasses import replace

import numpy as np

from softmpc import Scene, build, chen2022, find_equilibrium
from softmpc.sweeps import sweep

PRESSURES = [0.6e6, 0, 0, 0, 0.3e6, 0.3e6]


def tip(factors):
    """Tip (m) of the arm whose sections have `factors` times the printed wall area."""
    arm = chen2022()
    sections = zip(arm.sections, factors, strict=True)
    thick = tuple(replace(one, wall_area=factor * one.wall_area) for one, factor in sections)
    return find_equilibrium(build(Scene(replace(arm, sections=thick))), PRESSURES).tips[-1]


if __name__ == "__main__":  # each worker imports this file, and must not start a sweep of its own
    factors = np.random.default_rng(1).normal(1.0, 0.05, size=(24, 2))
    tips = np.array(sweep(tip, factors.tolist(), keep="monte_carlo.jsonl"))
    print("mean", (1e3 * tips.mean(axis=0)).round(1) + 0.0, "mm")
    print("standard deviation", (1e3 * tips.std(axis=0)).round(2) + 0.0, "mm")
