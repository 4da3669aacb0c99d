"""The steps of a horizon when its lengths change, against finite differences of their defects."""

import numpy as np
import pytest

from softmpc.control.dynamics import Dynamics
from softmpc.control.ocp import tracking_problem
from softmpc.control.trajectory import Moment, Trajectory
from softmpc.control.transcription import Transcription
from softmpc.model.effects import Gravity, MaterialDamping
from softmpc.model.model import build
from softmpc.model.presets import chen2022
from softmpc.model.scene import Scene

LENGTHS = np.array([0.02, 0.03, 0.03, 0.05])


@pytest.mark.parametrize(
    "scene",
    [Scene(chen2022()), Scene(chen2022(), effects=(Gravity(), MaterialDamping()))],
    ids=["with inertia", "without"],
)
def test_slopes_in_the_lengths(scene: Scene) -> None:
    t = Transcription(tracking_problem(build(scene), 4, 0.025), 3)
    dynamics, rng = Dynamics(t, "never"), np.random.default_rng(3)
    moment = Moment(rng.normal(size=t.nx), rng.normal(size=t.nu), np.zeros((t.N, t.nr)))
    sizes = (t.nu, t.na, t.nx)
    at = Trajectory(*(0.3 * rng.normal(size=(t.N, size)) for size in sizes))

    def steps(lengths: np.ndarray) -> np.ndarray:
        dynamics.use(lengths)
        return dynamics.defects(moment, at)

    d = 1e-7
    change = (steps(LENGTHS + d) - steps(LENGTHS - d)) / (2 * d)
    dynamics.use(LENGTHS)
    found = dynamics(moment, at, by_length=True)
    assert found.G is not None and found.by_h is not None
    r, gaps = change[:, : t.na], change[:, t.na :]
    arm = 2 * t.n
    gaps[:, :arm] -= (found.carry @ r[:, :, None])[:, :, 0]
    assert pytest.approx(gaps, rel=1e-5, abs=1e-5 * np.abs(gaps).max()) == found.G
    # a step of the stages that goes with a step of the length keeps their residuals
    moved = Trajectory(at.u, at.a - 1e-6 * found.by_h, at.x)
    dynamics.use(LENGTHS + 1e-6)
    kept = dynamics.defects(moment, moved)[:, : t.na]
    dynamics.use(LENGTHS)
    still = dynamics.defects(moment, at)[:, : t.na]
    assert np.abs(kept - still).max() < 1e-3 * 1e-6 * np.abs(r).max()
