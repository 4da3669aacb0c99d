"""Terminal cost: against the cost of the simulated closed loop, and the controller against LQR."""

from dataclasses import replace

import numpy as np
import pytest

from softmpc.control.closed_loop import start_at
from softmpc.control.costs import RestAtEnd, StrainRate, TipPosition, Torque, TorqueRate
from softmpc.control.mpc import Mpc
from softmpc.control.ocp import Ocp, tracking_problem
from softmpc.control.real_time import RealTime
from softmpc.control.terminal import regulator, terminal_cost
from softmpc.control.trajectory import Moment
from softmpc.control.transcription import Transcription
from softmpc.errors import BuildError, InputError
from softmpc.model.model import Model, build
from softmpc.model.presets import chen2022
from softmpc.model.scene import Scene
from softmpc.simulation.runge_kutta import RadauIIA
from softmpc.statics.equilibrium import find_equilibrium, pressures_from_torques

TORQUE = np.array([0.9, 0.5, 0.7, 0.8, 0.6, 0.4])
STEP = 0.025


@pytest.fixture(scope="module")
def model() -> Model:
    return build(Scene(chen2022()))


@pytest.fixture(scope="module")
def rest(model: Model) -> tuple[np.ndarray, np.ndarray]:
    posture = find_equilibrium(model, pressures_from_torques(model, TORQUE))
    start = start_at(model, posture)
    return start.x, start.u


def differences(function, at: np.ndarray, sizes: np.ndarray) -> np.ndarray:
    """Jacobian by central differences, in units of `sizes`."""
    columns = []
    for i, size in enumerate(sizes):
        h = np.zeros(len(at))
        h[i] = 1e-4 * size
        columns.append((function(at + h) - function(at - h)) / 2e-4)
    return np.array(columns).T


def simulated_loop(model: Model, x: np.ndarray, u: np.ndarray):
    """One step of the arm and its costs, linearised by simulating it; nothing is shared.

    Returns A, B and a function of (x⁺ - rest, u - rest, u_before - rest) that gives the cost.
    """
    arm = RadauIIA(model, stages=2, step=STEP)
    scale, torque = model.layout.x.scale, model.layout.u.scale

    def after(both: np.ndarray) -> np.ndarray:
        state, held = np.split(both, [len(x)])
        return arm.advance(state, held, STEP)[-1] / scale

    J = differences(after, np.append(x, u), np.append(scale, torque))
    tips = differences(lambda q: np.asarray(model.tip(q)).ravel(), x[:8], scale[:8])

    def cost(x_off: np.ndarray, u_off: np.ndarray, before: np.ndarray) -> float:
        parts = tips @ x_off[:8] / 1e-3, u_off / 3.0, (u_off - before) / 0.1, x_off[8:16] / 0.3
        return 0.5 * sum(float(part @ part) for part in parts)

    return J[:, : len(x)], J[:, len(x) :], cost


def test_cost_to_go_is_the_cost_of_the_closed_loop(model: Model, rest) -> None:
    x, u = rest
    found = terminal_cost(tracking_problem(model, 5, STEP), x, u).regulator
    assert 0.5 < found.radius < 1
    A, B, cost = simulated_loop(model, x, u)
    rng = np.random.default_rng(4)
    for _ in range(3):
        start = rng.normal(size=len(x) + len(u))
        x_off, before = np.split(start, [len(x)])
        paid = 0.0
        for _ in range(3000):
            held = -found.K @ np.append(x_off, before)
            x_off = A @ x_off + B @ held
            paid += cost(x_off, held, before)
            before = held
        assert np.abs(x_off).max() < 1e-6
        assert paid == pytest.approx(0.5 * start @ found.P @ start, rel=1e-6)
        assert paid == pytest.approx(0.5 * np.sum((found.factor @ start) ** 2), rel=1e-6)


def test_no_other_gain_costs_less(model: Model, rest) -> None:
    x, u = rest
    found = terminal_cost(tracking_problem(model, 5, STEP), x, u).regulator
    rng = np.random.default_rng(5)
    start = rng.normal(size=found.A.shape[0])
    best = 0.5 * start @ found.P @ start
    for _ in range(5):
        K = found.K * (1 + 0.05 * rng.normal(size=found.K.shape))
        at, paid = start, 0.0
        for _ in range(1500):
            v = -K @ at
            paid += 0.5 * np.sum((found.C @ at + found.D @ v) ** 2)
            at = found.A @ at + found.B @ v
        assert paid > best * (1 - 1e-9)


@pytest.mark.sampled
@pytest.mark.parametrize("horizon", [1, 5])
def test_controller_near_rest_is_the_regulator(model: Model, rest, horizon: int) -> None:
    """Without active limits the change of the first input with the state is the regulator's gain,
    however short the horizon is; without the terminal cost it is not."""
    x, u = rest
    ocp = replace(tracking_problem(model, horizon, STEP), limits=())
    terminal = terminal_cost(ocp, x, u)
    given = {"tip": np.tile(np.asarray(model.tip(x[:8])).ravel(), (horizon, 1)), **terminal.given}

    def gain(problem: Ocp) -> np.ndarray:
        t = Transcription(problem)
        solver = RealTime(t, mode="never")
        around = t.resting(x, u)

        def first(state: np.ndarray) -> np.ndarray:
            solver.prepare(Moment.of(t, t.parameters(x, u, given)), around)
            return solver.feedback(state / t.x_scale).w[: t.nu]

        return differences(first, x, model.layout.x.scale)

    K = terminal.regulator.K[:, : len(x)]
    assert np.abs(gain(terminal.problem) + K).max() < 1e-6 * np.abs(K).max()
    assert np.abs(gain(ocp) + K).max() > 1e-3 * np.abs(K).max()


def test_converged_controller_moves_as_the_regulator_does(model: Model, rest) -> None:
    """From a state near rest, beyond what it does at rest, where effort pulls at the input too."""
    x, u = rest
    terminal = terminal_cost(tracking_problem(model, 4, STEP), x, u)
    given = {"tip": np.tile(np.asarray(model.tip(x[:8])).ravel(), (4, 1)), **terminal.given}
    near = x.copy()
    near[:8] += 1e-4 * model.layout.q.scale
    solver = RealTime(Transcription(terminal.problem), iterations=20, tolerance=1e-9, mode="never")
    mpc = Mpc(solver.transcription, solver)
    at_rest = mpc.step(x, u, given)
    mpc.reset()
    step = mpc.step(near, u, given)
    assert at_rest.solved and step.solved
    expected = terminal.input(near, u) - u
    assert step.u - at_rest.u == pytest.approx(expected, abs=0.02 * np.abs(expected).max())


def test_costs_that_do_not_see_a_drift_are_said(model: Model, rest) -> None:
    """Six torques, three coordinates: without effort nothing fixes what the tip leaves open."""
    ocp = tracking_problem(model, 4, STEP, costs=(TipPosition(), TorqueRate(), StrainRate()))
    with pytest.raises(BuildError, match="do not see what drifts"):
        terminal_cost(ocp, *rest)


def test_problem_has_one_terminal_cost(model: Model, rest) -> None:
    terminal = terminal_cost(tracking_problem(model, 3, STEP), *rest)
    again = terminal_cost(terminal.problem, *rest)
    ends = [cost for cost in again.problem.costs if isinstance(cost, RestAtEnd)]
    assert len(ends) == 1
    assert np.allclose(again.regulator.P, terminal.regulator.P)


def test_what_no_input_stabilises_is_said() -> None:
    C, D = np.vstack([np.eye(2), np.zeros((1, 2))]), np.array([[0.0], [0.0], [1.0]])
    with pytest.raises(BuildError, match="no input stabilises"):
        regulator(np.diag([1.1, 0.5]), np.array([[0.0], [1.0]]), C, D)
    drifting = np.diag([1.0, 0.5])  # neither moved nor seen
    with pytest.raises(BuildError, match="no input stabilises"):
        regulator(drifting, np.array([[0.0], [1.0]]), C @ np.diag([0, 1]), D)
    found = regulator(np.diag([1.1, 0.5]), np.array([[1.0], [1.0]]), C, D)
    assert found.radius < 1


def test_scalar_regulator_has_its_closed_form() -> None:
    """x⁺ = x + v, cost ½ (x² + v²): P is the golden ratio."""
    C, D = np.array([[1.0], [0.0]]), np.array([[0.0], [1.0]])
    found = regulator(np.eye(1), np.eye(1), C, D)
    golden = (1 + np.sqrt(5)) / 2
    assert found.P[0, 0] == pytest.approx(golden)
    assert found.K[0, 0] == pytest.approx(golden / (1 + golden))


def test_input_that_costs_nothing_is_said(model: Model, rest) -> None:
    ocp = tracking_problem(model, 3, STEP, costs=(TipPosition(),))
    with pytest.raises(BuildError, match="leave some input free"):
        terminal_cost(ocp, *rest)


def test_state_that_is_not_at_rest_is_said(model: Model, rest) -> None:
    x, u = rest
    ocp = tracking_problem(model, 3, STEP)
    with pytest.raises(InputError, match="not at rest"):
        terminal_cost(ocp, x, 1.1 * u)
    with pytest.raises(InputError, match="needs 34 and 6"):
        terminal_cost(ocp, x[:-1], u)
    with pytest.raises(InputError, match="34 columns"):
        _ = Transcription(replace(ocp, costs=(Torque(), RestAtEnd(factor=np.eye(3))))).nr
