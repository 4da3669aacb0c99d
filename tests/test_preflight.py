"""Rest path and pre-flight: what of a path is infeasible, where and by how much."""

from dataclasses import replace

import numpy as np
import pytest

from softmpc.control.at_speed import AtSpeed
from softmpc.control.limits import TipBox, TorqueLimit, TorqueRateLimit
from softmpc.control.ocp import Ocp, tracking_problem
from softmpc.control.paths import Circle, FigureEight, Helix, Line, Reference, TimeLaw
from softmpc.control.preflight import Finding, find_preflight
from softmpc.control.response import Response
from softmpc.control.rest_path import find_rest_path, lap_of
from softmpc.model.model import Model, build
from softmpc.model.presets import chen2022
from softmpc.model.scene import Scene
from softmpc.simulation.runge_kutta import RadauIIA
from softmpc.statics.equilibrium import find_equilibrium
from softmpc.statics.inverse import InverseStatics

INSIDE = Reference(Circle((0.12, 0.0, 0.57), 0.08), TimeLaw(4.0, 2.0))
EIGHT = Reference(FigureEight((0.12, 0.0, 0.57), 0.08, 0.04), TimeLaw(4.0, 2.0))
FAST = Reference(Circle((0.12, 0.0, 0.57), 0.12), TimeLaw(1.5, 4.0))
EDGE = Reference(Circle((0.54, 0.0, 0.50), 0.08), TimeLaw(4.0, 1.0))


@pytest.fixture(scope="module")
def model() -> Model:
    return build(Scene(chen2022()))


@pytest.fixture(scope="module")
def inverse(model: Model) -> InverseStatics:
    return InverseStatics(model, starts=6)


@pytest.fixture(scope="module")
def problem(model: Model) -> Ocp:
    return tracking_problem(model)


@pytest.fixture(scope="module")
def edge(inverse: InverseStatics, problem: Ocp):
    return find_preflight(inverse, EDGE, problem, nodes=24)


def test_rest_path_holds_the_path(model: Model, inverse: InverseStatics) -> None:
    """Forward statics under its torques puts the tip on the path, between nodes as well."""
    rest = find_rest_path(inverse, INSIDE, nodes=40)
    t = np.array([0.0, 1.234, 3.3, 7.77])
    assert not rest.jumps.any() and rest.distance.max() < 1e-6
    for time, u, x in zip(t, rest.inputs(t), rest.rest(t), strict=True):
        posture = find_equilibrium(model, model.drive.static_gain @ u)
        off = posture.tips[-1] - INSIDE.position([time])[0]
        assert np.linalg.norm(off) < 3e-4  # linear between nodes 6 mm apart
        assert x[: model.strains] == pytest.approx(posture.q, abs=5e-3)
    assert rest.position(t) == pytest.approx(INSIDE.position(t), abs=1e-12)


def test_rates_are_those_of_the_postures(inverse: InverseStatics) -> None:
    rest = find_rest_path(inverse, INSIDE, nodes=40)
    rate = rest.rates(np.array([2.03]))[0]
    J = np.asarray(inverse.model.tip_jacobian(rest.rest(np.array([2.03]))[0, :8]))[-3:]
    h = 1e-4
    speed = (INSIDE.position([2.03 + h]) - INSIDE.position([2.03 - h]))[0] / (2 * h)
    assert J @ rate == pytest.approx(speed, abs=0.03 * np.linalg.norm(speed))


def test_laps(inverse: InverseStatics) -> None:
    """Only what repeats is looked at once."""
    assert lap_of(INSIDE, 10).repeats
    helix = Reference(Helix((0.1, 0, 0.55), 0.05, 0.01), TimeLaw(4.0, 2.0, 0.0))
    assert not lap_of(helix, 10).repeats
    assert lap_of(helix, 10).phase[-1] == pytest.approx(2.0)
    half = Reference(Line((0, 0, 0.6), (0.01, 0, 0.6)), TimeLaw(4.0, 0.5, 0.0))
    assert lap_of(half, 10).phase[-1] == pytest.approx(0.5)


@pytest.mark.parametrize("reference", [INSIDE, EIGHT, FAST], ids=["circle", "eight", "fast"])
def test_what_is_in_reach_is_feasible(
    inverse: InverseStatics, problem: Ocp, reference: Reference
) -> None:
    found = find_preflight(inverse, reference, problem, nodes=24)
    assert found.feasible and not found.lines
    assert found.facts["largest_input_at_rest"] < 2.5


def test_out_of_reach_is_named_with_place_time_and_amount(edge, inverse: InverseStatics) -> None:
    reach = [one for one in edge.findings if one.kind == "reach"]
    assert len(reach) == 2  # the path begins and ends outside
    worst = max(reach, key=lambda one: one.excess)
    assert worst.excess == pytest.approx(19.6, abs=0.5)
    assert worst.unit == "mm" and worst.place[0] > 0.57
    assert "pressure_max" in worst.note
    assert worst.text in edge.lines
    # A place well inside of what is reported does not get nearer from another start.
    again = InverseStatics(inverse.model).solve(_position(EDGE.position([worst.start])[0]))
    assert again.distance == pytest.approx(
        edge.rest.out_of_reach(np.array([worst.start]))[0], abs=2e-4
    )


def _position(place: np.ndarray):
    from softmpc.statics.targets import Position

    return Position(tuple(place))


def test_projection_is_the_nearest_place_and_continuous(edge) -> None:
    t = np.arange(0.0, EDGE.duration, 1e-2)
    far = np.linalg.norm(edge.rest.position(t) - EDGE.position(t), axis=1)
    assert far == pytest.approx(edge.rest.out_of_reach(t), abs=1e-3)
    steps = np.linalg.norm(np.diff(edge.rest.position(t), axis=0), axis=1)
    assert steps.max() < 2e-3 and len(edge.jumps) == 0


def test_limits_of_the_controller_are_checked(inverse: InverseStatics, problem: Ocp) -> None:
    limits = (TorqueLimit(0.0, 0.8), TorqueRateLimit(-0.004, 0.004))
    found = find_preflight(inverse, INSIDE, replace(problem, limits=limits), nodes=40)
    kinds = {one.kind for one in found.findings}
    assert kinds == {"torque", "torque rate"}
    torque = max(one.excess for one in found.findings if one.kind == "torque")
    assert torque == pytest.approx(found.facts["largest_input_at_rest"] - 0.8, abs=1e-3)
    rate = max(one.excess for one in found.findings if one.kind == "torque rate")
    assert rate == pytest.approx(found.facts["largest_input_rate_at_rest"] - 0.16, abs=0.02)


@pytest.mark.parametrize("soft", [None, 1e-3])
def test_a_path_that_leaves_the_box_of_the_tip(inverse: InverseStatics, problem: Ocp, soft) -> None:
    """A circle of 40 mm radius about x = 0.12 m against a side at x = 0.15 m: 10 mm too far."""
    within = TipBox(0.0, 0.16, axis="x", soft=soft), TipBox(0.9, 1.0, axis="z", section=1)
    kept = replace(problem, limits=(*problem.limits, *within))
    assert find_preflight(inverse, INSIDE, kept, nodes=24).feasible
    cut = replace(problem, limits=(*problem.limits, TipBox(0.0, 0.15, axis="x", soft=soft)))
    found = find_preflight(inverse, INSIDE, cut, nodes=24).findings
    assert {one.kind for one in found} == {"tip box"}
    assert max(one.excess for one in found) == pytest.approx(10.0, abs=0.02)
    for one in found:
        assert one.place[0] > 0.15 and "x from 0 to 0.15 m" in one.text


def test_too_fast_a_path_is_named(inverse: InverseStatics, problem: Ocp) -> None:
    """At 0.2 s a lap the closed loop is off by 1.3 mm RMS, see `tests.benchmarks.speeds`."""
    fast = Reference(Circle((0.12, 0.0, 0.57), 0.12), TimeLaw(0.2, 15.0))
    limits = (*problem.limits, TorqueRateLimit(-0.1, 0.1))
    found = find_preflight(inverse, fast, replace(problem, limits=limits), nodes=24)
    assert {one.kind for one in found.findings} >= {"bandwidth", "torque rate at speed"}
    off = max(one.excess for one in found.findings if one.kind == "bandwidth")
    assert 0.6 < off < 3.0
    late = [one for one in found.findings if one.kind != "torque rate"]  # that is of rest
    assert all(one.start >= 1.0 and 0.06 <= one.place[0] <= 0.18 for one in late)
    assert found.facts["lead"] > 3
    # Half as fast it is off by 0.08 mm in closed loop, and nothing is found.
    half = replace(fast, law=TimeLaw(0.4, 7.0))
    assert find_preflight(inverse, half, problem, nodes=24).feasible


def test_estimate_at_speed_falls_with_speed_and_knows_statics(
    inverse: InverseStatics, problem: Ocp
) -> None:
    """Slowly, the inputs are those at rest; the error grows with the speed."""
    rest = find_rest_path(inverse, INSIDE, nodes=24)
    response = Response(inverse.model, rest.middle.q, rest.middle.pressures)

    def at(lap: float) -> AtSpeed:
        law = TimeLaw(lap, 2.0)
        return AtSpeed(replace(rest, reference=replace(INSIDE, law=law)), response, problem)

    slow, *others = (at(lap) for lap in (400.0, 1.0, 0.5, 0.25))
    assert slow.u == pytest.approx(rest.held(4.0 * (1 + slow.phase) + 0.5), abs=2e-3)
    assert slow.gain == pytest.approx(1.0, abs=1e-3) and slow.off.max() < 1e-6
    off = [one.off.max() for one in others]
    assert off == sorted(off) and off[-1] > 10 * off[0]


@pytest.mark.slow
def test_model_of_the_controller_is_asked_too(inverse: InverseStatics) -> None:
    """A planar one does not leave its plane; it says nothing of a path within."""
    planar = build(Scene(chen2022(), strains=("epsilon", "kappa_y")))
    found = find_preflight(inverse, INSIDE, tracking_problem(planar), nodes=24)
    assert {one.kind for one in found.findings} == {"controller"}
    assert max(one.excess for one in found.findings) == pytest.approx(40.0, abs=0.5)
    flat = Reference(Line((0.1, 0, 0.57), (0.15, 0, 0.57)), TimeLaw(4.0, 1.0))
    assert find_preflight(inverse, flat, tracking_problem(planar), nodes=24).feasible


def test_a_horizon_shorter_than_the_arm_takes_to_answer_is_said(
    model: Model, caplog: pytest.LogCaptureFixture
) -> None:
    """As of an arm ten times as large, whose loop swung from limit to limit."""
    posture = find_equilibrium(model, np.full(6, 0.3e6))
    response = Response(model, posture.q, np.full(6, 0.3e6))
    response.warn_of_short_sight(0.5)
    assert not caplog.messages
    response.warn_of_short_sight(0.1)
    assert "looks 0.1 s ahead and the arm takes 0.1" in caplog.text


def test_what_is_found_is_called_after_the_input() -> None:
    found = Finding("torque rate", 0.0, 1.0, (0.1, 0.0, 0.5), 2e5, "Pa/s")
    assert "pressure at rest changes faster than allowed by up to 200000 Pa/s" in found.text
    assert "torque at rest changes faster" in replace(found, unit="N·m/s").text


def test_a_planar_arm_in_and_out_of_its_plane() -> None:
    """Its tip does not move across the plane at all; to be slower would be no help there."""
    planar = build(Scene(chen2022(), strains=("epsilon", "kappa_y")))
    inverse, problem = InverseStatics(planar, starts=2), tracking_problem(planar)
    flat = Reference(Line((0.1, 0, 0.57), (0.15, 0, 0.57)), TimeLaw(4.0, 1.0))
    assert find_preflight(inverse, flat, problem, nodes=4).feasible
    found = find_preflight(inverse, INSIDE, problem, nodes=4)
    assert {one.kind for one in found.findings} == {"reach"}
    assert np.isfinite(list(found.facts.values())).all()


def test_response_is_that_of_the_simulated_arm(model: Model) -> None:
    """A small sine of one torque moves the tip as G says, once the start has died away."""
    pressures = np.array([0.3, 0.35, 0.4, 0.25, 0.3, 0.2]) * 1e6
    posture = find_equilibrium(model, pressures)
    omega, amplitude, unit = 2 * np.pi * 1.0, 5e-3, 1
    G = Response(model, posture.q, pressures)(omega)[:, unit]
    u0 = np.linalg.solve(model.drive.static_gain, pressures)
    x = np.concatenate([posture.q, np.zeros(8), model.drive.at_rest(u0)])
    plant, step = RadauIIA(model, 1e-8), 0.02
    times, tips = np.arange(0.0, 9.0, step), []
    direction = np.eye(6)[unit] * amplitude
    for t in times:
        ends = (u0 + np.sin(omega * s) * direction for s in (t, t + step))
        x = plant.advance(x, next(ends), step, 1, next(ends))[-1]
        tips.append(np.asarray(model.tip(x[:8])).ravel() - posture.tips[-1])
    last = times >= 7.0 - 1e-9  # whole periods
    t, moved = times[last] + step, np.array(tips)[last]
    found = 2 * (moved * np.exp(-1j * omega * t)[:, None]).mean(axis=0) * 1j / amplitude
    assert np.abs(found - G).max() < 0.03 * np.abs(G).max()
