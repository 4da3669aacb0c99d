"""The plant in C against IDAS at 1e-10: `python -m tests.benchmarks.c_plant [SCENE …]`."""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from softmpc.compiler import compiler
from softmpc.control.baselines import FeedForward
from softmpc.control.tracking import read_track_file, set_up
from softmpc.model.model import Model
from softmpc.simulation.idas import Idas
from tests.benchmarks.common import EXAMPLES, LeftOut
from tests.c_plant import CPlant, compiled_plant

NAMES = ("figure_eight", "figure_eight_rig")
SAMPLES = 25  # a step


def tips_of(model: Model, states: np.ndarray) -> np.ndarray:
    """Places of the tip (K×3) at states (K×nx)."""
    return np.asarray(model.tip.map(len(states))(states[:, : model.strains].T)).T


def run_c(plant: CPlant, x: np.ndarray, inputs: np.ndarray, step: float) -> np.ndarray:
    """States at all samples after the first (K×nx)."""
    plant.init(x)
    found = []
    for u in inputs:
        for _ in range(SAMPLES):
            assert plant.step(u, step / SAMPLES) == 0
            found.append(plant.x)
    return np.array(found)


def measured(name: str) -> dict[str, float]:
    """One line of the table."""
    _, scene, task = read_track_file(EXAMPLES / f"{name}.toml")
    setup = set_up(scene, task)
    model, step, x = setup.plant.model, setup.ocp.step, setup.start.x
    inputs = np.ascontiguousarray(setup.run(FeedForward(setup.ocp, setup.guide)).u)
    with tempfile.TemporaryDirectory() as folder:
        plant = compiled_plant(model, setup.ocp.model, Path(folder), ("-O2",))
        began = time.process_time()
        ours = run_c(plant, x, inputs, step)
        spent = time.process_time() - began
    oracle, states = Idas(model, 1e-10), [x[None]]
    for u in inputs:
        states.append(oracle.advance(states[-1][-1], u, step, SAMPLES))
    wanted = np.vstack(states)[1:]
    off = np.linalg.norm(tips_of(model, ours) - tips_of(model, wanted), axis=1).max()
    seconds = len(inputs) * step
    found = {"states_count": len(x), "motion_s": seconds, "tip_m_most": float(off)}
    return found | {"cpu_ms_a_second": 1e3 * spent / seconds}


def numbers(quick: bool) -> dict[str, float]:
    """The figure eight; in full mode on the rig, too."""
    if compiler() is None:
        raise LeftOut("needs a C compiler")
    return {
        f"{name}_{what}": value
        for name in NAMES[: 1 if quick else None]
        for what, value in measured(name).items()
    }


def main(names: list[str]) -> None:
    """Print the table."""
    print(f"{'scene':18} {'states':>6} {'motion s':>8} {'tip, most m':>12} {'CPU ms/s':>12}")
    for name in names or NAMES:
        states, seconds, off, spent = measured(name).values()
        print(f"{name:18} {states:6} {seconds:8.2f} {off:12.1e} {spent:12.1f}", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
