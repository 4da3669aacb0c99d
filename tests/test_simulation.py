"""Open-loop simulation: breakpoints, energy, statics, failures on the way, files."""

from __future__ import annotations

import csv
import signal
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from arms import PAPER, model_of
from scipy.interpolate import CubicSpline

from softmpc.errors import InputError
from softmpc.model.actuation import PressureDrive
from softmpc.model.effects import (
    EnvironmentDamping,
    Gravity,
    MaterialDamping,
    TipLoad,
)
from softmpc.simulation.compare import compare, read_tips
from softmpc.simulation.following import Following
from softmpc.simulation.idas import Idas
from softmpc.simulation.inputs import InputProfile, Ramp, Step
from softmpc.simulation.integrator import IntegrationError
from softmpc.simulation.methods import integrator_for
from softmpc.simulation.result import Simulation
from softmpc.simulation.run import simulate, simulate_file, start_state
from softmpc.simulation.runge_kutta import RadauIIA
from softmpc.statics.equilibrium import find_equilibrium, pressures_from_torques

EXAMPLES = Path(__file__).parent.parent / "examples"
MODEL = model_of()
BENT = InputProfile.of(6, [Step(unit, 0.0, 1.5) for unit in (1, 5, 6)])
DAMPED: tuple[Any, ...] = (Gravity(), EnvironmentDamping(), MaterialDamping())
TORQUES = np.array([1.5, 0.2, 0.5, 0.0, 1.5, 1.2])


@cache
def example(name: str) -> Simulation:
    return simulate_file(EXAMPLES / f"{name}.toml")


# --- runs ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "numbers",
    [
        {"method": "idas", "tolerance": 1e-9},
        {"tip_tolerance": 1e-8},
        {"method": "gauss", "step": 1e-3},
    ],
)
def test_breakpoints_are_hit(numbers: dict[str, Any]) -> None:
    """Between samples as well; the reference is cut there by hand."""
    moves = [Step(1, 0.0123, 1.5), Ramp(4, 0.02, 0.0471, 30.0), Step(5, 0.05, 1.0)]
    profile = InputProfile.of(6, moves)
    run = simulate(MODEL, profile, 0.1, sample_time=0.03, **numbers)
    assert run.time.tolist() == [0.0, 0.03, 0.06, 0.09, 0.1]
    x, plant = start_state(MODEL, profile), Idas(MODEL, 1e-10)
    for a, b in ((0, 0.0123), (0.0123, 0.02), (0.02, 0.0471), (0.0471, 0.05), (0.05, 0.1)):
        x = plant.advance(x, profile(a), b - a, u_end=profile.before(b))[-1]
    scale = MODEL.layout.x.scale
    np.testing.assert_allclose(run.x[-1] / scale, x / scale, atol=2e-7)
    np.testing.assert_allclose(run.u, profile(run.time))
    np.testing.assert_allclose(run.p[-1], x[-12:-6])


def test_result_is_complete() -> None:
    seen: list[tuple[float, float]] = []
    run = simulate(
        MODEL, BENT, 0.6, sample_time=0.002, progress=lambda *a: seen.append(a), title="bend"
    )
    assert run.finished
    assert run.title == "bend"
    assert (run.q.shape, run.z.shape, run.p.shape) == ((301, 8), (301, 18), (301, 6))
    assert (run.tips.shape, run.tip_speeds.shape) == ((301, 2, 3), (301, 2))
    assert seen[-1] == (0.6, 0.6)
    assert [t for t, _ in seen] == sorted(t for t, _ in seen)
    np.testing.assert_allclose(run.tips[-1].T, np.asarray(MODEL.frames(run.q[-1])[0]))
    velocity = CubicSpline(run.time, run.tips).derivative()(run.time)
    np.testing.assert_allclose(run.tip_speeds[9:], np.linalg.norm(velocity, axis=2)[9:], atol=1e-4)
    summary = run.summary()
    assert summary["realtime_factor"] == pytest.approx(0.6 / summary["wall_s"])
    assert set(summary["final_energy_j"]) == {"kinetic", "gravity", "elastic"}


def test_energy_audit_closes() -> None:
    run = simulate(MODEL, BENT, 0.4, sample_time=5e-4, method="idas", tolerance=1e-10)
    stored = sum(run.energies.values())
    powers = MODEL.powers.map(len(run.time)).call({"q": run.q.T, "dq": run.dq.T, "p": run.p.T})
    put_in = CubicSpline(run.time, sum(np.asarray(p).ravel() for p in powers.values()))
    work = put_in.antiderivative()(run.time)
    turned_over = np.abs(work).max()
    assert turned_over > 0.1
    np.testing.assert_allclose(stored - stored[0], work, atol=1e-6 * turned_over)


def test_conservative_arm_keeps_its_energy() -> None:
    frictionless = tuple(
        replace(s, linear_damping=0.0, angular_damping=0.0, viscosity=0.0) for s in PAPER.sections
    )
    model = model_of(replace(PAPER, sections=frictionless))
    run = simulate(model, InputProfile.of(6), 2.0, start="straight", method="idas", tolerance=1e-10)
    total = sum(run.energies.values())
    assert np.ptp(run.energies["kinetic"]) > 0.005
    np.testing.assert_allclose(total, total[0], atol=1e-6 * np.ptp(run.energies["kinetic"]))


def test_motion_ends_at_the_equilibrium() -> None:
    run = example("step_fig6")
    torques = [1.5, 0, 0, 0, 1.5, 1.5]
    rest = find_equilibrium(MODEL, pressures_from_torques(MODEL, torques).tolist())
    np.testing.assert_allclose(run.final_tips, rest.tips, atol=1e-5)
    np.testing.assert_allclose(run.p[-1], rest.pressures, atol=1.0)


def test_rest_stays_at_rest() -> None:
    run = simulate(MODEL, InputProfile.constant(TORQUES), 1.0)
    np.testing.assert_allclose(run.q, np.tile(run.q[0], (len(run.time), 1)), atol=1e-6)
    assert run.tip_speeds.max() < 1e-7
    assert run.p[0] == pytest.approx(pressures_from_torques(MODEL, TORQUES.tolist()))


def test_run_goes_on_from_a_state() -> None:
    whole = simulate(MODEL, BENT, 0.2, method="idas", tolerance=1e-10)
    first = simulate(MODEL, BENT, 0.1, method="idas", tolerance=1e-10)
    held = InputProfile.constant(first.u[-1])
    second = simulate(MODEL, held, 0.1, method="idas", tolerance=1e-10, start=first.x[-1])
    np.testing.assert_allclose(second.tips[-1], whole.tips[-1], atol=1e-8)


@pytest.mark.sampled
@pytest.mark.parametrize("segments", [2, 3])
def test_more_segments(segments: int) -> None:
    model = model_of(segments=segments)
    run = simulate(model, BENT, 0.1)
    assert run.finished
    assert compare(run, simulate(MODEL, BENT, 0.1)).largest_sectional < 0.03


# --- without inertia -----------------------------------------------------------------------------


def test_damped_arm_without_inertia() -> None:
    model = model_of(effects=DAMPED)
    run = simulate(model, BENT, 4.0, sample_time=0.02, tip_tolerance=1e-7)
    assert model.order == 1
    assert isinstance(integrator_for(model), RadauIIA)
    forces = np.asarray(model.residual.map(len(run.time))(run.q.T, run.dq.T, 0, run.p.T))
    np.testing.assert_allclose(forces / model.layout.r.scale[:, None], 0.0, atol=1e-5)
    np.testing.assert_allclose(run.q[-1], example("step_fig6").q[-1], atol=2e-4)
    slopes = CubicSpline(run.time, run.q).derivative()(run.time)
    np.testing.assert_allclose(run.dq[20:], slopes[20:], atol=1e-2)


def test_arm_that_follows_at_once() -> None:
    model = model_of(effects=(Gravity(),))
    run = simulate(model, BENT, 0.3, sample_time=0.002)
    assert model.order == 0
    assert isinstance(integrator_for(model), Following)
    for k in (0, 10, 150):
        rest = find_equilibrium(model, run.p[k].tolist())
        np.testing.assert_allclose(run.q[k], rest.q, atol=1e-9)
    slopes = CubicSpline(run.time, run.q).derivative()(run.time)
    np.testing.assert_allclose(run.dq[20:-5], slopes[20:-5], atol=1e-2)


def test_pressures_given_directly() -> None:
    model = model_of(effects=(Gravity(),), actuation=PressureDrive())
    run = simulate(model, InputProfile.of(6, [Ramp(1, 0.0, 1.0, 0.5e6)]), 1.0, sample_time=0.1)
    assert run.z.shape == (11, 0)
    np.testing.assert_allclose(run.p[:, 0], 0.5e6 * run.time)


# --- what goes wrong on the way ------------------------------------------------------------------


def test_interrupted_run_keeps_what_was_done() -> None:
    def stop(t: float, duration: float) -> None:
        if t > 1.0:
            raise KeyboardInterrupt

    run = simulate(MODEL, BENT, 3.0, progress=stop)
    assert run.status == "interrupted"
    assert 1.0 < run.time[-1] < 3.0
    assert len(run.tips) == len(run.time)


def test_control_c_ends_between_two_calls() -> None:
    before = signal.getsignal(signal.SIGINT)
    run = simulate(MODEL, BENT, 3.0, progress=lambda t, d: signal.raise_signal(signal.SIGINT))
    assert run.status == "interrupted"
    assert run.time[-1] == 2.0
    assert signal.getsignal(signal.SIGINT) is before


def test_squeezed_arm_stops_with_what_was_done() -> None:
    crushed = (*MODEL.scene.effects, TipLoad(force=(0.0, 0.0, -3000.0)))
    model = model_of(effects=crushed)
    run = simulate(model, InputProfile.of(6), 1.0, start="straight", sample_time=1e-3)
    assert run.status.startswith("stopped: ")
    assert "after t = 0.0" in run.status
    assert 0.0 < run.time[-1] < 0.1
    assert run.q[:, 0].min() > -0.95
    with pytest.raises(IntegrationError, match="no rest to start from"):
        simulate(model, InputProfile.of(6), 1.0)


def test_failing_integrator_keeps_samples_before_the_failure(monkeypatch: Any) -> None:
    steps = Idas.advance

    def fail_late(self: Idas, x: Any, u: Any, span: float, samples: int, u_end: Any) -> np.ndarray:
        fail_late.time += span  # type: ignore[attr-defined]
        if samples > 1 or fail_late.time > 0.755:  # type: ignore[attr-defined]
            fail_late.time -= span  # type: ignore[attr-defined]
            raise IntegrationError("IDAS: too much work")
        return steps(self, x, u, span, samples, u_end)

    fail_late.time = 0.0  # type: ignore[attr-defined]
    monkeypatch.setattr(Idas, "advance", fail_late)
    run = simulate(MODEL, BENT, 1.0, method="idas", tolerance=1e-5)
    assert run.status == "stopped: IDAS: too much work, after t = 0.75 s"
    assert run.time[-1] == 0.75


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"duration": 0.0}, "duration = 0.0 s: must be above 0"),
        ({"duration": 1.0, "sample_time": float("nan")}, "sample_time = nan s"),
        ({"duration": 1.0, "start": "upright"}, "start = 'upright': must be one of rest, straight"),
        ({"duration": 1.0, "start": np.zeros(3)}, "x has 3 values"),
        ({"duration": 1.0, "tip_tolerance": 1.0}, "tip tolerance = 1.0 m"),
    ],
)
def test_wrong_runs(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        simulate(MODEL, BENT, **arguments)


# --- files ---------------------------------------------------------------------------------------


def test_npz_round_trip(tmp_path: Path) -> None:
    run = example("step_fig6")
    csv_file, npz_file = run.save(tmp_path / "new")
    assert {csv_file.name, npz_file.name} == {f.name for f in (tmp_path / "new").iterdir()}
    back = Simulation.load(npz_file)
    assert back.summary() == run.summary()
    assert (back.title, back.titles) == (run.title, run.titles)
    for name, column in run.columns().items():
        np.testing.assert_array_equal(back.columns()[name], column)


def test_csv_has_every_column_and_compares(tmp_path: Path) -> None:
    run = example("step_fig6")
    file, _ = run.save(tmp_path)
    with open(file, encoding="utf-8") as lines:
        header = next(csv.reader(lines))
    wanted = {"t [s]", "x_2 [m]", "epsilon_1_1", "kappa_y_2_1 [1/m]", "d_kappa_y_2_1 [1/m/s]"}
    assert wanted | {"T_6 [N·m]", "P_1 [Pa]", "P_a_1 [Pa]", "kinetic_energy [J]"} <= set(header)
    assert compare(run, read_tips(file)).largest_cumulative == 0.0


def test_wrong_files(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        Simulation.load(tmp_path / "none.npz")
    file = tmp_path / "bad.npz"
    file.write_text("t,x_1\n")
    with pytest.raises(InputError, match="is not a saved simulation"):
        Simulation.load(file)
    np.savez(file, about='{"schema": 99}')
    with pytest.raises(InputError, match="is of another version; 1 and 2 are known here"):
        Simulation.load(file)
    (tmp_path / "taken").write_text("")
    with pytest.raises(InputError, match="cannot be written"):
        example("step_fig6").save(tmp_path / "taken")
