"""Calibration against closed forms, textbook regression and SciPy; what cannot be told apart."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import pi
from typing import Any, ClassVar

import numpy as np
import pytest
from scipy import optimize, stats

from softmpc import PressureDrive, Scene, chen2022
from softmpc.errors import InputError, SoftmpcError
from softmpc.model.actuation import FrictionDrive
from softmpc.model.effects import Gravity, Payload
from softmpc.model.scene_paths import places_of, resolve, value_at, with_values
from softmpc.study.arm_at import ArmAt
from softmpc.study.calibrate import CalibrationProblem, calibrate
from softmpc.study.calibration_result import Calibration
from softmpc.study.free_parameters import FreeParameter, ParameterSpace, Tie
from softmpc.study.least_squares import minimise
from softmpc.study.observations import StaticPose
from softmpc.study.summary_values import SummaryValue
from softmpc.study.uncertainty import uncertainty, undetermined
from softmpc.view.calibration import calibration_figure

ARM = replace(chen2022(), sections=chen2022().sections[:1])
SCENE = Scene(ARM, strains=("epsilon", "kappa_x", "kappa_y"), actuation=PressureDrive())
DRIVEN = Scene(ARM, strains=("epsilon", "kappa_x", "kappa_y"))
PAPER_FRICTION = FrictionDrive()
RADIUS = FreeParameter("sections.bending_radius", start=0.032, low=0.01, high=0.1, log=True)


@dataclass(frozen=True)
class Line:
    """Values a x + b at places x, where a is the mass of the section and b its disc radius."""

    places: tuple[float, ...]
    measured: tuple[float, ...]
    sigma: float = 1.0
    counts: bool = True

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(f"at {x:g}" for x in self.places)

    @property
    def values(self) -> np.ndarray:
        return np.array(self.measured)

    @property
    def sigmas(self) -> np.ndarray:
        return np.full(len(self.places), self.sigma)

    @property
    def senses(self) -> tuple[str, ...]:
        return ("=",) * len(self.places)

    def check(self, scene: Scene) -> None:
        assert scene is not None

    def predict(self, arm: ArmAt) -> np.ndarray:
        section = arm.scene.manipulator.sections[0]
        return section.mass * np.array(self.places) + section.disc_radius


MASS = FreeParameter("sections.mass", start=1.0, low=1e-3, high=50.0)
DISC = FreeParameter("sections.disc_radius", start=0.1, low=1e-3, high=50.0)
X = (0.0, 1.0, 2.0, 4.0, 7.0)
Y = (1.2, 3.1, 4.4, 9.9, 15.8)


# ---------------------------------------------------------------- paths


def test_paths_name_every_number() -> None:
    scene = Scene(chen2022(), effects=(Gravity(), Payload(0.2)))
    paths = places_of(scene)
    assert {"sections.mass", "sections[2].mass", "hydraulics.friction", "effects.payload.mass",
            "effects.gravity.vector[3]", "sections[1].unit_angles[2]"} <= set(paths)  # fmt: skip
    assert "hydraulics.screw" not in paths  # a word
    new = with_values(
        scene,
        {
            paths["sections.mass"]: 0.7,
            paths["sections[2].viscosity"]: 5.0,
            paths["effects.gravity.vector[3]"]: -9.81,
            paths["effects.payload.mass"]: 0.3,
            paths["hydraulics.efficiency"]: 0.6,
        },
    )
    assert [s.mass for s in new.manipulator.sections] == [0.7, 0.7]
    assert [s.viscosity for s in new.manipulator.sections] == [1e4, 5.0]
    gravity, payload = new.effect(Gravity), new.effect(Payload)
    assert gravity is not None and gravity.vector == (0.0, 0.0, -9.81)
    assert payload is not None and payload.mass == 0.3
    assert value_at(new, paths["hydraulics.efficiency"]) == 0.6
    assert value_at(scene, paths["sections.mass"]) == 0.56  # as it was


@pytest.mark.parametrize(
    ("path", "message"),
    [
        ("sections.bending_radios", "did you mean 'sections.bending_radius'"),
        ("section.mass", "'sections.mass'"),
        ("sections[3].mass", r"'sections\[1\].mass'"),
        ("effects.payload.mass", "effects.gravity"),
        ("hydraulics.screw", "no number of this scene is called"),
    ],
)
def test_wrong_paths_get_near_ones(path: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        resolve(Scene(chen2022()), path)


@pytest.mark.parametrize(
    ("parameter", "message"),
    [
        (dict(low=0.05, high=0.02), "must be in order"),
        (dict(low=-1.0), "must be in order, and between 0.0001 and 100 m"),
        (dict(start=0.5, high=0.1), "start = 0.5: must be between"),
        (dict(start=float("nan")), "must be a finite number"),
        (dict(prior=(0.03, 0.0)), "standard deviation above 0"),
        (dict(prior=(0.5, 0.1), high=0.1), "mean of the prior = 0.5: must be between"),
        (dict(scale=-1.0), "scale = -1: must be above 0"),
    ],
)
def test_wrong_parameters(parameter: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        ParameterSpace(SCENE, [FreeParameter("sections.bending_radius", **parameter)])


def test_a_number_is_fitted_once() -> None:
    with pytest.raises(InputError, match="given twice"):
        ParameterSpace(SCENE, [RADIUS, RADIUS])
    with pytest.raises(InputError, match="given twice"):
        ParameterSpace(SCENE, [RADIUS], [Tie(RADIUS.path, "sections.length", 0.1)])
    with pytest.raises(InputError, match="at least one"):
        ParameterSpace(SCENE, [])


def test_ties_and_logarithms() -> None:
    young = FreeParameter("sections.young_modulus", log=True, prior=(1.2e6, 3e5), low=1e5, high=1e7)
    space = ParameterSpace(SCENE, [young, MASS], [Tie("sections.shear_modulus", young.path, 1 / 3)])
    section = space.scene_at(np.array([np.log(1.5e6), 2.0])).manipulator.sections[0]
    assert section.young_modulus == pytest.approx(1.5e6)
    assert section.shear_modulus == pytest.approx(0.5e6)
    assert section.mass == 2.0
    mean, deviation = space.prior
    assert mean[0] == pytest.approx(np.log(1.2e6)) and deviation[0] == pytest.approx(0.25)
    assert np.isinf(deviation[1])
    assert space.values(space.bounds[0]).tolist() == [1e5, 1e-3]  # no rounding at bounds


# ---------------------------------------------------------------- least squares by IPOPT


def bent(x: np.ndarray) -> np.ndarray:
    if x[0] < -1.6:
        raise SoftmpcError("not there")
    return np.array([1 - x[0], 10 * (x[1] - x[0] ** 2), 0.3 * np.sin(x[1])])


def bent_jacobian(x: np.ndarray) -> np.ndarray:
    return np.array([[-1, 0], [-20 * x[0], 10], [0, 0.3 * np.cos(x[1])]])


@pytest.mark.parametrize("high", [[5.0, 5.0], [5.0, 0.4]])
def test_minimum_is_that_of_scipy(high: list[float]) -> None:
    low = np.array([-5.0, -5.0])
    start = np.array([-1.5, 0.3])
    found = minimise(bent, bent_jacobian, start, (low, np.array(high)), tolerance=1e-8)
    plain = optimize.least_squares(
        lambda x: np.array([1 - x[0], 10 * (x[1] - x[0] ** 2), 0.3 * np.sin(x[1])]),
        start, bounds=(low, high), xtol=1e-14, ftol=1e-14, gtol=1e-14,
    )  # fmt: skip
    assert found.converged
    np.testing.assert_allclose(found.x, plain.x, atol=1e-5)
    assert found.cost == pytest.approx(plain.cost, rel=1e-6)


def test_what_fails_at_the_start_is_said() -> None:
    with pytest.raises(SoftmpcError, match="not there"):
        minimise(bent, bent_jacobian, np.array([-2.0, 0.0]), (np.full(2, -5.0), np.full(2, 5.0)))


def test_errors_of_residuals_are_not_lost() -> None:
    def broken(x: np.ndarray) -> np.ndarray:
        if x[0] != -1.5:
            raise ZeroDivisionError("a bug")
        return bent(x)

    with pytest.raises(ZeroDivisionError, match="a bug"):
        minimise(broken, bent_jacobian, np.array([-1.5, 0.3]), (np.full(2, -5.0), np.full(2, 5.0)))


# ---------------------------------------------------------------- against textbook regression


def line(sigma: float = 1.0, **about: Any) -> Calibration:
    problem = CalibrationProblem(SCENE, (MASS, DISC), (Line(X, Y, sigma),), **about)
    return calibrate(problem)


def test_estimates_and_errors_are_those_of_a_regression() -> None:
    book = stats.linregress(X, Y)
    found = line(estimate_sigma=True)
    half = stats.t.ppf(0.975, len(X) - 2)
    for path, value, error in (
        ("sections.mass", book.slope, book.stderr),
        ("sections.disc_radius", book.intercept, book.intercept_stderr),
    ):
        estimate = found[path]
        assert estimate.estimate == pytest.approx(value, rel=1e-3)
        assert estimate.std_error == pytest.approx(error, rel=1e-3)
        assert estimate.high95 - estimate.estimate == pytest.approx(half * error, rel=1e-3)
        assert estimate.determined and not estimate.bound
    assert found.freedom == pytest.approx(3.0)


def test_known_sigma_gives_normal_intervals_and_chi_square() -> None:
    found = line(sigma=0.5)
    design = np.stack([X, np.ones(5)], axis=1)
    covariance = 0.25 * np.linalg.inv(design.T @ design)
    residuals = np.array(Y) - design @ np.linalg.lstsq(design, np.array(Y), rcond=None)[0]
    estimate = found["sections.mass"]
    assert estimate.std_error == pytest.approx(np.sqrt(covariance[0, 0]), rel=1e-3)
    half = estimate.high95 - estimate.estimate
    assert half == pytest.approx(1.959964 * np.sqrt(covariance[0, 0]), rel=1e-3)
    assert found.chi2 == pytest.approx(np.sum(residuals**2) / 0.25, rel=1e-3)
    assert found.probability == pytest.approx(stats.chi2.sf(found.chi2, 3), rel=1e-3)
    assert found.correlation[0, 1] == pytest.approx(
        covariance[0, 1] / np.sqrt(covariance[0, 0] * covariance[1, 1]), rel=1e-3
    )


@pytest.mark.parametrize(
    ("sigma", "words"), [(0.05, "too large"), (0.5, "as their sigmas say"), (20.0, "smaller")]
)
def test_verdict_on_the_sigmas(sigma: float, words: str) -> None:
    assert words in line(sigma).verdict


def test_priors_weigh_like_data() -> None:
    """A normal prior on the slope of a line through known places, in closed form."""
    slope = replace(MASS, prior=(1.0, 0.05))
    found = calibrate(CalibrationProblem(SCENE, (slope,), (Line(X, Y),)))
    x, y = np.array(X), np.array(Y) - SCENE.manipulator.sections[0].disc_radius
    weight = x @ x + 1 / 0.05**2
    assert found["sections.mass"].estimate == pytest.approx((x @ y + 400) / weight, rel=1e-4)
    assert found["sections.mass"].std_error == pytest.approx(weight**-0.5, rel=1e-4)
    assert found.freedom == pytest.approx(5 - x @ x / weight)


def test_estimated_sigma_with_priors_settles() -> None:
    """The factor of the sigmas follows from the residuals that it itself leads to."""
    slope = replace(MASS, prior=(1.0, 0.05))
    problem = CalibrationProblem(SCENE, (slope,), (Line(X, Y, 0.01),), estimate_sigma=True)
    found = calibrate(problem)
    assert found["sections.mass"].estimate < np.polyfit(X, Y, 1)[0] - 0.05  # the prior still pulls
    assert 0.01 * found.sigma_factor == pytest.approx(
        np.sqrt(1e-4 * found.chi2 / found.freedom), rel=0.02
    )


# ---------------------------------------------------------------- what data can and cannot say


def test_singular_directions_by_hand() -> None:
    """Residuals that know a + b and c: not a - b, and not d."""
    J = np.array([[30.0, 30.0, 0.0, 0.0], [0.0, 0.0, 50.0, 0.0]])
    directions, determined = undetermined(J, np.ones(4))
    assert determined.tolist() == [False, False, True, False]
    ways = sorted(tuple(np.round(d.x / d.x[np.argmax(np.abs(d.x))], 6) + 0.0) for d in directions)
    assert ways == [(0.0, 0.0, 0.0, 1.0), (1.0, -1.0, 0.0, 0.0)]
    sure = uncertainty(J, np.full(4, np.inf), np.ones(4, bool), 1.0)
    assert np.isinf(sure.deviations).tolist() == [True, True, False, True]
    assert sure.deviations[2] == pytest.approx(1 / 50)
    held = uncertainty(J, np.array([np.inf, 0.01, np.inf, 0.2]), np.ones(4, bool), 1.0)
    assert held.deviations[0] == pytest.approx(np.hypot(1 / 30, 0.01))
    assert held.deviations[3] == pytest.approx(0.2)


def radius(value: float, pressures: tuple[float, ...] = (1e6, 0, 0), **more: Any) -> SummaryValue:
    return SummaryValue(
        "radius", value, 1e-4, pressures=pressures, without=("gravity",), name="radius", **more
    )


def test_radius_in_closed_form() -> None:
    """κ = A_d P r_d/(E π r⁴/4): one radius of curvature gives the stiffness radius."""
    s = ARM.sections[0]
    expected = (4 * s.unit_area * 1e6 * s.unit_offset * 0.139 / (pi * s.young_modulus)) ** 0.25
    found = calibrate(CalibrationProblem(SCENE, (RADIUS,), (radius(0.139),)))
    estimate = found["sections.bending_radius"]
    assert estimate.estimate == pytest.approx(expected, rel=1e-6)
    # R ~ r⁴, so dr/r = dR/(4 R)
    assert estimate.std_error / estimate.estimate == pytest.approx(1e-4 / 0.139 / 4, rel=1e-4)
    assert "no more values than parameters" in found.verdict


def test_modulus_and_radius_are_not_told_apart() -> None:
    """E r⁴ is all that a radius of curvature knows: r up by 10 %, E down by 40 %."""
    young = FreeParameter("sections.young_modulus", log=True, low=1e5, high=1e7)
    found = calibrate(CalibrationProblem(SCENE, (RADIUS, young), (radius(0.139), radius(0.139))))
    assert found.converged
    assert [e.determined for e in found.estimates] == [False, False]
    assert [np.isinf(e.std_error) for e in found.estimates] == [True, True]
    (words,) = found.undetermined
    assert "sections.young_modulus +10 %" in words and "sections.bending_radius -2.5 %" in words
    section = found.scene.manipulator.sections[0]
    stiffness = section.young_modulus * section.bending_radius**4
    s = ARM.sections[0]
    assert stiffness == pytest.approx(4 * s.unit_area * 1e6 * s.unit_offset * 0.139 / pi, rel=1e-5)
    # With a prior on one of them, the other follows.
    known = replace(young, prior=(1.2e6, 0.12e6))
    found = calibrate(CalibrationProblem(SCENE, (RADIUS, known), (radius(0.139),)))
    assert found["sections.young_modulus"].estimate == pytest.approx(1.2e6, rel=1e-4)
    assert found["sections.bending_radius"].std_error / found.values[RADIUS.path] == pytest.approx(
        np.hypot(0.025, 1e-4 / 0.139 / 4), rel=1e-3
    )
    assert found["sections.bending_radius"].source == "data and priors"
    assert found["sections.young_modulus"].source == "prior"


def test_efficiency_and_friction() -> None:
    """One pressure knows η T/s - f; a second torque tells them apart."""
    scene = replace(DRIVEN, actuation=PAPER_FRICTION)
    free = (
        FreeParameter("hydraulics.efficiency", low=0.1, high=1.0),
        FreeParameter("hydraulics.friction", start=100.0, low=0.0, high=1e3),
    )
    push = 2 * pi / 0.004
    true = {torque: (0.6 * push * torque - 200.0) / 0.0021 / 1e6 for torque in (2.5, 1.0)}
    data = tuple(
        SummaryValue("pressure", p, 0.001, torques=(torque, 0, 0), name=f"{torque}")
        for torque, p in true.items()
    )
    one = calibrate(CalibrationProblem(scene, free, data[:1]))
    assert "hydraulics.efficiency" in one.undetermined[0]
    assert "hydraulics.friction" in one.undetermined[0]
    assert len(one.undetermined) == 1
    both = calibrate(CalibrationProblem(scene, free, data))
    assert not both.undetermined
    assert both.values["hydraulics.efficiency"] == pytest.approx(0.6, rel=1e-4)
    assert both.values["hydraulics.friction"] == pytest.approx(200.0, rel=1e-3)


def test_limits_cost_only_when_broken() -> None:
    least = SummaryValue("least_torque", 0.5, 0.05, "<")
    scene = replace(DRIVEN, actuation=PAPER_FRICTION)
    friction = FreeParameter("hydraulics.friction", start=50.0, low=0.0, high=1e3, scale=100.0)
    prior = replace(friction, prior=(100.0, 20.0))
    kept = calibrate(CalibrationProblem(scene, (prior,), (least,)))
    assert kept["hydraulics.friction"].estimate == pytest.approx(100.0, abs=0.1)
    assert kept.chi2 == 0.0 and kept["hydraulics.friction"].source == "prior"
    screw = 0.535 * 2 * pi / 0.004
    far = replace(friction, prior=(2 * 0.5 * screw, 0.05 * screw))
    broken = calibrate(CalibrationProblem(scene, (far,), (least,)))
    # Equal weights: half way between the limit and the prior.
    assert broken["hydraulics.friction"].estimate == pytest.approx(0.75 * screw, rel=1e-3)


def test_a_bound_is_said() -> None:
    tight = replace(RADIUS, start=0.033, low=0.032)
    found = calibrate(CalibrationProblem(SCENE, (tight, MASS), (radius(0.139), Line(X, Y))))
    estimate = found[tight.path]
    assert (estimate.bound, estimate.estimate) == ("low", 0.032)
    assert np.isnan(estimate.std_error) and np.isnan(estimate.low95)
    assert np.isfinite(found[MASS.path].std_error)
    assert "too large" in found.verdict


@pytest.mark.slow
def test_poses_without_noise_give_the_truth_back() -> None:
    arm = ArmAt(SCENE)
    poses = []
    for k, p in enumerate(([5e5, 0, 1e5], [0, 8e5, 2e5], [3e5, 3e5, 3e5])):
        tip = arm.tips(arm.rest(np.array(p)))[0]
        poses.append(StaticPose({"x_1": tip[0], "z_1": tip[2]}, p, name=f"pose {k}"))
    free = (replace(RADIUS, low=0.025, high=0.04), replace(MASS, start=0.4, scale=0.1))
    found = calibrate(CalibrationProblem(SCENE, free, tuple(poses)), starts=3)
    assert found.agreeing == 3
    assert found.values["sections.bending_radius"] == pytest.approx(0.0298, rel=1e-6)
    assert found.values["sections.mass"] == pytest.approx(0.56, rel=1e-5)
    assert found.scene.manipulator.name == "chen2022-v1, calibrated"
    assert max(abs(r.residual) for r in found.residuals) < 1e-3


class Interrupting(Line):
    """Ctrl-C while the seventh arm is computed."""

    calls: ClassVar[list[int]] = [0]

    def predict(self, arm: ArmAt) -> np.ndarray:
        self.calls[0] += 1
        if self.calls[0] == 7:
            raise KeyboardInterrupt
        return super().predict(arm)


def test_interrupt_keeps_the_best() -> None:
    found = calibrate(CalibrationProblem(SCENE, (MASS, DISC), (Interrupting(X, Y),)))
    assert found.status == "interrupted" and not found.converged
    assert found.chi2 < 500


def test_nothing_to_fit_to() -> None:
    with pytest.raises(InputError, match="nothing to fit to"):
        CalibrationProblem(SCENE, (RADIUS,), (radius(0.139, counts=False),))


# ---------------------------------------------------------------- the picture


def test_picture_says_what_is_open_and_at_a_bound() -> None:
    tight = replace(RADIUS, start=0.033, low=0.032)
    loose = FreeParameter("sections.viscosity", prior=(1e4, 1e4), log=True)
    friction = FreeParameter("hydraulics.friction", low=0.0, high=9.0, prior=(0.0, 1.0))
    data = (radius(0.139), Line(X, Y))
    found = calibrate(CalibrationProblem(SCENE, (tight, MASS, loose, friction), data))
    made = calibration_figure(found)
    estimates, correlations, residuals = made.axes[0], made.axes[1], made.axes[-1]
    names = [text.get_text() for text in estimates.get_yticklabels()]
    assert names == [
        "bending_radius\n0.032 m (at its low bound)",
        "mass\n2.309 kg",
        "viscosity\n1e+04 Pa·s (not by data)",
        "friction\n0 N (at its low bound)",
    ]
    assert [text.get_text() for text in correlations.get_xticklabels()][3] == "friction"
    bars = {text.get_text() for text in residuals.get_yticklabels()}
    assert bars == {"radius", *(f"at {x:g}" for x in X)}
    many = replace(found, residuals=found.residuals * 10)
    assert len(calibration_figure(many).axes[-1].lines[0].get_xdata()) == 60


@pytest.mark.parametrize("starts", [1, 3])
def test_what_nothing_sees_keeps_its_start(starts: int) -> None:
    """Weight without gravity: the barrier or another start would leave it anywhere."""
    weightless = SCENE.with_(effects=())
    mass = FreeParameter("sections.mass", low=0.1, high=2.0)
    printed = SummaryValue("radius", 0.139, 0.001, pressures=(1e6, 0, 0))
    found = calibrate(CalibrationProblem(weightless, (RADIUS, mass), (printed,)), starts=starts)
    seen, unseen = found.estimates
    assert seen.source == "data" and seen.estimate != pytest.approx(0.032, rel=1e-3)
    assert unseen.source == "nothing: its start"
    assert unseen.estimate == ARM.sections[0].mass == found.scene.manipulator.sections[0].mass
