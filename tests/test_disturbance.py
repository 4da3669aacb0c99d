"""Unknown forces and offsets: the same in all solvers, in the estimator's steps and at rest."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from scipy.optimize import root

from softmpc import InputError, Scene, build, chen2022
from softmpc.control.closed_loop import Start, start_at
from softmpc.control.linearisation import Linearisation
from softmpc.control.mpc import Mpc
from softmpc.control.ocp import tracking_problem
from softmpc.control.solvers import make_solver
from softmpc.control.trajectory import Moment, Trajectory
from softmpc.control.transcription import Transcription
from softmpc.estimation.process import Process, ProcessNoise
from softmpc.model.disturbance import Disturbance
from softmpc.model.model import Model
from softmpc.simulation.idas import Idas
from softmpc.statics.equilibrium import find_equilibrium

N, STEP = 6, 0.025


@pytest.fixture(scope="module")
def model() -> Model:
    return build(Scene(chen2022()))


@pytest.fixture(scope="module")
def disturbance(model: Model) -> Disturbance:
    return Disturbance.of(model.scene)


@pytest.fixture(scope="module")
def start(model: Model) -> Start:
    return start_at(model, find_equilibrium(model, [3e5, 1e5, 0, 2e5, 0, 4e5]))


@pytest.fixture(scope="module")
def d(disturbance: Disturbance) -> np.ndarray:
    return 0.05 * np.random.default_rng(1).normal(size=len(disturbance))


@pytest.fixture(scope="module")
def transcription(model: Model, disturbance: Disturbance) -> Transcription:
    return Transcription(replace(tracking_problem(model, N, STEP), disturbance=disturbance))


def given(model: Model, start: Start, d: np.ndarray) -> dict[str, np.ndarray]:
    tip = np.asarray(model.tip(start.x[: model.strains])).ravel() + [0.01, 0, 0]
    return {"tip": np.tile(tip, (N, 1)), "disturbance": np.tile(d, (N, 1))}


def test_default_forces_are_on_strains_that_are_there() -> None:
    found = Disturbance.of(Scene(chen2022(), strains=("epsilon", "kappa_y")), inputs=False)
    assert found.names == tuple(
        f"force on {one}_{s}" for s in (1, 2) for one in ("epsilon", "kappa_y")
    )


def test_names_and_shapes(model: Model, disturbance: Disturbance) -> None:
    assert len(disturbance) == 12 and disturbance.names[1] == "force on kappa_x_1"
    assert disturbance.names[-1] == "offset of T_6"
    finer = Disturbance.of(Scene(chen2022(), segments=2))
    assert finer.F.shape == (16, 12) and (finer.F[:, 0] > 0).sum() == 2  # both segments
    assert len(Disturbance.of(model.scene, ("kappa_x",), inputs=False)) == 2
    with pytest.raises(InputError, match="curl"):
        Disturbance.of(model.scene, ("curl",))


def test_defects_for_another_state_now(
    transcription: Transcription, model: Model, start: Start, d: np.ndarray
) -> None:
    """Those of the first interval are worked out anew, and know of the disturbance too."""
    t, linearisation = transcription, Linearisation(transcription, "never")
    p = t.parameters(start.x, start.u, given(model, start, d))
    at = Trajectory.of(t, t.resting(start.x, start.u))
    before = linearisation.measure(Moment.of(t, p), at)
    p[: t.nx] += 0.01
    found = linearisation.from_another_state(before, Moment.of(t, p), at)
    rows = ca.Function("g", [t.program.w, t.program.p], [t.program.g])(at.w, p)
    whole = np.asarray(rows).reshape(N, -1)[:, : found.defects.shape[1]]
    assert np.abs(found.defects - before.defects).max() > 1e-3
    assert np.allclose(found.defects, whole)


@pytest.mark.sampled
@pytest.mark.parametrize("name", ["ipopt", "fatrop"])
def test_solvers_agree(
    name: str, transcription: Transcription, model: Model, start: Start, d: np.ndarray
) -> None:
    parameters = transcription.parameters(start.x, start.u, given(model, start, d))
    guess = transcription.resting(start.x, start.u)
    ours, other = (
        make_solver(kind, transcription).solve(parameters, guess) for kind in ("sqp", name)
    )
    assert ours.solved and other.solved
    assert np.isclose(ours.cost, other.cost, rtol=1e-4)
    u, v = (transcription.split(found.w)[0] for found in (ours, other))
    assert np.abs(u - v).max() < 1e-4


def test_a_plan_is_what_the_estimator_expects(
    transcription: Transcription,
    model: Model,
    disturbance: Disturbance,
    start: Start,
    d: np.ndarray,
) -> None:
    """Two codes for one step: the transcription's equations and the estimator's function."""
    parameters = transcription.parameters(start.x, start.u, given(model, start, d))
    solution = make_solver("sqp", transcription).solve(
        parameters, transcription.resting(start.x, start.u)
    )
    u, _, x = transcription.split(solution.w)
    process = Process(model, disturbance, ProcessNoise(), "never")
    s, a = np.concatenate([start.x / model.layout.x.scale, d]), None
    for k in range(N):
        s, _, a = process.advance(s, u[k], STEP, a)
        assert np.abs(s[: process.nx] - x[k] / model.layout.x.scale).max() < 1e-5


def test_slopes_against_differences(
    model: Model, disturbance: Disturbance, start: Start, d: np.ndarray
) -> None:
    process = Process(model, disturbance, ProcessNoise(), "never")
    s = np.concatenate([start.x / model.layout.x.scale, d])
    s[8:16] = 0.05
    a = process.advance(s, start.u, 0.01)[2]
    _, slope, _ = process.advance(s, start.u, 0.01, a)
    for i in range(process.size):
        e = 1e-5 * np.eye(process.size)[i]
        above, below = (process.advance(s + x, start.u, 0.01, a)[0] for x in (e, -e))
        assert np.abs((above - below) / 2e-5 - slope[:, i]).max() < 1e-6


@pytest.mark.sampled
@pytest.mark.parametrize("segments", [1, 2])
def test_a_step_against_idas(segments: int) -> None:
    """Without a disturbance, from a state in motion: third order in the step."""
    model = build(Scene(chen2022(), segments=segments))
    process = Process(model, Disturbance.of(model.scene), ProcessNoise(), "never")
    start = start_at(model, find_equilibrium(model, [3e5, 1e5, 0, 2e5, 0, 4e5]))
    plant, u = Idas(model, 1e-10), start.u + 0.3
    x = plant.advance(start.x, u, 0.1)[-1]
    errors = []
    for length in (0.005, 0.01):
        s = np.concatenate([x / model.layout.x.scale, np.zeros(12)])
        found = process.advance(s, u, length)[0][: process.nx]
        errors.append(np.abs(found - plant.advance(x, u, length)[-1] / model.layout.x.scale).max())
    assert errors[1] < 5e-4 and errors[0] < errors[1] / 4


def test_at_rest_it_is_a_force_and_an_offset(
    model: Model, disturbance: Disturbance, start: Start, d: np.ndarray
) -> None:
    """The arm under constant input settles where SciPy finds N - τ = F d."""
    process = Process(model, disturbance, ProcessNoise(), "never")
    s, a = np.concatenate([start.x / model.layout.x.scale, d]), None
    for _ in range(600):
        s, _, a = process.advance(s, start.u, 0.02, a)
    p = model.drive.static_gain @ (start.u + disturbance.G @ d)
    force = disturbance.F @ d
    rest = root(lambda q: np.asarray(model.balance(q, p)).ravel() - force, start.x[:8], tol=1e-12)
    assert np.abs(s[:8] - rest.x / model.layout.q.scale).max() < 1e-5


def test_mpc_rejects_a_disturbance_it_is_told_of(
    transcription: Transcription, model: Model, disturbance: Disturbance, start: Start
) -> None:
    """Steps on a plant with the disturbance: told of it the tip stays, not told it does not."""
    d = np.zeros(12)
    d[1] = 0.05
    process = Process(model, disturbance, ProcessNoise(), "never")
    far = {}
    for told in (True, False):
        mpc = Mpc(transcription, make_solver("real-time", transcription))
        references = given(model, start, d if told else 0 * d)
        s, u, a = np.concatenate([start.x / model.layout.x.scale, d]), start.u, None
        for _ in range(60):
            step = mpc.step(s[:34] * model.layout.x.scale, u, references)
            assert step.solved
            u = step.u
            s, _, a = process.advance(s, u, STEP, a)
        tip = np.asarray(model.tip(s[:8] * model.layout.q.scale)).ravel()
        far[told] = 1e3 * float(np.linalg.norm(tip - references["tip"][0]))
    assert far[True] < 0.005 and far[False] > 0.05


def test_a_rollout_knows_of_it(
    transcription: Transcription, model: Model, start: Start, d: np.ndarray
) -> None:
    mpc = Mpc(transcription, make_solver("real-time", transcription))
    parameters = transcription.parameters(start.x, start.u, given(model, start, d))
    moment = Moment.of(transcription, parameters)
    w = mpc._rollout(moment, transcription.resting(start.x, start.u))
    assert w is not None
    program = transcription.program

    g = np.asarray(ca.Function("g", [program.w, program.p], [program.g])(w, parameters)).ravel()
    defects = g.reshape(N, -1)[:, : transcription.na + transcription.nx]
    assert np.abs(defects).max() < 1e-3  # 0.04 without it
