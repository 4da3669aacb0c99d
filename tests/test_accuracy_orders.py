"""Orders of convergence: known numbers, noise, floors, and what does not converge."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from scipy.stats import linregress

from softmpc.accuracy.configuration import Configuration
from softmpc.accuracy.orders import (
    APPROACHES,
    AS_THEORY,
    AT_FLOOR,
    DIFFERS,
    DIVERGES,
    NO_THEORY,
    TOO_FEW,
    Fit,
    fit_series,
    fits,
)
from softmpc.accuracy.points import FamilyResult, Point

# Tip errors at 1, 2, 4, 8 segments a section, m: what the project's equations page lists.
LUMPED = (0.113, 0.063, 0.032, 0.017)
GAUSS = (0.0096, 0.0022, 0.00055, 0.00014)
FULL_WRENCH = (0.157, 0.090, 0.048)
PRINTED = (0.080, 0.046, 0.125)
PRINTED_EIGENVALUES = (54.9, 112.8, 230.0)  # the lowest one of the straight arm, 1/s²


def series(
    errors: Sequence[float | None], theory: float | None = None, key: str = "error_m", **more: Any
) -> list[Point]:
    """Points at 1, 2, 4, … segments."""
    return [
        Point(
            Configuration("axis", f"{2**i}", {"n": 2**i}, "series", 0.5**i, theory),
            {"status": "measured", key: error, **more} if error is not None else {"status": "no"},
        )
        for i, error in enumerate(errors)
    ]


def fitted(errors: Sequence[float | None], theory: float | None = None, **more: Any) -> Fit:
    return fit_series(series(errors, theory, **more))


# ---------------------------------------------------------------- known numbers


@pytest.mark.parametrize(
    ("errors", "theory"), [(LUMPED, 1.0), (GAUSS, 2.0), (FULL_WRENCH, 1.0)], ids=str
)
def test_measured_series_that_converge(errors: tuple[float, ...], theory: float) -> None:
    fit = fitted(errors, theory)
    assert fit.verdict == AS_THEORY
    assert fit.order == pytest.approx(theory, abs=0.2)
    assert len(fit.sizes) == 3 and fit.sizes[-1] == 0.5 ** (len(errors) - 1)


@pytest.mark.parametrize("theory", [None, 0.0, 1.0, 2.0])
def test_the_printed_transmission_is_flagged_by_its_numbers(theory: float | None) -> None:
    fit = fitted(PRINTED, theory)
    assert fit.verdict == DIVERGES
    assert fit.order is not None and fit.order < 0


@pytest.mark.parametrize("exact", [20.0, 40.0, 49.0])
def test_frequencies_without_bound_are_flagged(exact: float) -> None:
    errors = [np.sqrt(value / exact) - 1 for value in PRINTED_EIGENVALUES]
    (fit,) = [fit_series(series(errors, None, "frequency_error"), "frequency_error")]
    assert fit.verdict == DIVERGES


def test_least_squares_are_those_of_scipy() -> None:
    fit = fitted(LUMPED, 1.0)
    other = linregress(np.log([0.5, 0.25, 0.125]), np.log(LUMPED[1:]))
    assert fit.order == pytest.approx(other.slope, rel=1e-12)
    assert fit.standard_error == pytest.approx(other.stderr, rel=1e-9)
    assert fit.scale == pytest.approx(np.exp(other.intercept), rel=1e-12)


def test_exact_powers() -> None:
    fit = fitted([0.3 * (0.5**i) ** 4 for i in range(5)], 4.0)
    assert (fit.order, fit.scale) == (pytest.approx(4.0), pytest.approx(0.3))
    assert fit.standard_error == pytest.approx(0.0, abs=1e-9)
    assert fit.sizes == (0.25, 0.125, 0.0625)
    assert fit.verdict == AS_THEORY


def test_the_order_of_points_does_not_matter() -> None:
    points = series(LUMPED, 1.0)
    assert fit_series(points[::-1]) == fit_series(points)


# ---------------------------------------------------------------- what converges and what does not


@pytest.mark.parametrize("order", [1.0, 2.0])
@pytest.mark.parametrize("count", [4, 5])
def test_noise_is_not_flagged(order: float, count: int) -> None:
    for seed in range(300):
        noise = np.exp(0.2 * np.random.default_rng(seed).standard_normal(count))
        errors = noise * 0.1 * 0.5 ** (order * np.arange(count))
        assert fitted(errors, order).verdict in (AS_THEORY, APPROACHES, DIFFERS), seed


@pytest.mark.parametrize("count", [3, 4, 5])
def test_errors_that_stay_are_flagged_with_noise(count: int) -> None:
    for seed in range(300):
        noise = np.exp(0.03 * np.random.default_rng(seed).standard_normal(count))
        assert fitted(0.05 * noise, 1.0).verdict == DIVERGES, seed


@pytest.mark.parametrize(
    "errors",
    [
        pytest.param((0.1, 0.05, 0.1, 0.05, 0.1), id="up and down"),
        pytest.param((0.05, 0.1, 0.05, 0.1, 0.05), id="down and up"),
        pytest.param((0.1, 0.02, 0.0101, 0.0100, 0.0100), id="to another limit"),
        pytest.param((0.01, 0.1, 1.0, 10.0), id="ever larger"),
        pytest.param((0.05, 0.04, 0.037, 0.035), id="hardly smaller"),
    ],
)
def test_what_does_not_converge(errors: tuple[float, ...]) -> None:
    assert fitted(errors, 1.0).verdict == DIVERGES
    assert fitted(errors).verdict == DIVERGES


@pytest.mark.parametrize(
    "errors",
    [
        pytest.param((0.03, 0.015, 0.0005, 0.004, 0.002), id="third finest small by chance"),
        pytest.param((0.03, 0.015, 0.0075, 0.0001, 0.0018), id="second finest small by chance"),
        pytest.param((0.03, 0.015, 0.0075, 0.004, 0.00001), id="finest small by chance"),
        pytest.param((0.001, 0.02, 0.01, 0.005), id="coarsest small by chance"),
    ],
)
def test_an_error_that_passes_through_zero_is_not_flagged(errors: tuple[float, ...]) -> None:
    assert fitted(errors).verdict == NO_THEORY


def test_verdicts_beside_theory() -> None:
    errors = [0.1 * 0.5 ** (1.5 * i) for i in range(4)]
    assert fitted(errors, 1.5).verdict == AS_THEORY
    assert fitted(errors, 1.31).verdict == AS_THEORY
    assert fitted(errors, 1.29).verdict == DIFFERS
    assert fitted(errors, 2.0).verdict == DIFFERS
    assert fitted(errors, 0.0).verdict == DIFFERS  # theory says it does not converge, and it does
    assert fitted(errors).verdict == NO_THEORY


# ---------------------------------------------------------------- the floor


def test_errors_at_the_floor_are_not_fitted() -> None:
    """Second order down to a reference that is off by 1e-5 m."""
    errors = [0.1 * 0.25**i + 1e-5 for i in range(12)]
    fit = fitted(errors, 2.0, doubt_m=1e-5)
    assert fit.verdict == AS_THEORY
    assert fit.sizes == (1 / 8, 1 / 16, 1 / 32)  # 1.1e-4 at the last; the next is 3.4e-5
    assert fitted(errors, 2.0).verdict == DIVERGES  # as one would take it for without the doubt


def test_the_doubt_of_what_is_fitted_does_not_hide_a_wrong_order() -> None:
    """The reference is off by its doubt, to either side."""
    for sign in (-1, 1):
        errors = [0.1 * 0.25**i + sign * 1e-5 for i in range(6)]
        fit = fitted(errors, 2.0, doubt_m=1e-5)
        assert fit.verdict == AS_THEORY, fit


def test_all_at_the_floor() -> None:
    assert fitted([1e-3, 1e-4, 1e-4, 1e-4], 2.0, doubt_m=1e-4).verdict == AT_FLOOR
    fit = fitted([0.0, 0.0, 0.0], 2.0)
    assert (fit.verdict, fit.order, fit.sizes) == (AT_FLOOR, None, ())
    assert fitted([1e-14, 3e-15, 1e-15], 2.0).verdict == AT_FLOOR


def test_each_error_has_its_own_doubt() -> None:
    points = series([4e-2, 1e-2, 2.5e-3], 2.0, "frequency_error", doubt_m=1.0)
    assert fit_series(points, "frequency_error").verdict == AS_THEORY
    points = series([4e-2, 1e-2, 2.5e-3], 2.0, "frequency_error", frequency_doubt=1.0)
    assert fit_series(points, "frequency_error").verdict == AT_FLOOR
    points = series([4e-2, 1e-2, 2.5e-3], 2.0, "integration_m", integration_doubt_m=1.0)
    assert fit_series(points, "integration_m").verdict == AT_FLOOR


def test_sizes_that_are_not_small_enough_yet() -> None:
    """An error of first order that is not its leading term alone: (1 + 2h) takes the slope down."""
    coarse = [h / (1 + 2 * h) for h in (1, 1 / 2, 1 / 4, 1 / 8)]
    assert fitted(coarse, 1.0).verdict == APPROACHES
    assert fitted(coarse, 2.0).verdict == DIFFERS
    assert fitted([h**1.5 for h in (1, 1 / 2, 1 / 4, 1 / 8)], 1.0).verdict == DIFFERS
    fine = [h / (1 + 2 * h) for h in (1 / 16, 1 / 32, 1 / 64)]
    assert fitted(fine, 1.0).verdict == AS_THEORY


# ---------------------------------------------------------------- what is missing


@pytest.mark.parametrize(
    "errors", [(), (0.1,), (0.1, 0.05), (0.1, None, 0.02), (None, None, None)], ids=str
)
def test_too_few_points(errors: tuple[float | None, ...]) -> None:
    points = series(errors, 1.0) or series([None], 1.0)
    fit = fit_series(points)
    assert (fit.verdict, fit.order, fit.standard_error) == (TOO_FEW, None, None)


@pytest.mark.parametrize("wrong", [float("nan"), float("inf"), None])
def test_what_is_no_number_is_left_out(wrong: float | None) -> None:
    fit = fitted([*LUMPED, wrong], 1.0)
    assert fit.sizes == (0.5, 0.25, 0.125)
    assert fit.verdict == AS_THEORY


def test_the_same_size_twice() -> None:
    points = series(LUMPED, 1.0)
    assert fit_series([*points, points[-1]]) == fit_series(points)


def test_fits_of_a_family() -> None:
    """Each series of each axis on its own; what belongs to none has no fit."""
    given = Point(Configuration("as given", "as given"), {"error_m": 0.1})
    alone = Point(Configuration("elasticity", "strain"), {"error_m": 0.1})
    lumped, printed = series(LUMPED, 1.0), series(PRINTED)
    other = [
        Point(Configuration("axis", p.name, {}, "other", p.configuration.size, 2.0), {"error_m": e})
        for p, e in zip(lumped, GAUSS, strict=True)
    ]
    elsewhere = [
        Point(Configuration("formulation", p.name, {}, "printed", p.configuration.size), p.error)
        for p in printed
    ]
    found = fits(FamilyResult("rest", {}, (given, alone, *lumped, *other, *elsewhere)))
    assert [(fit.axis, fit.series, fit.verdict) for fit in found] == [
        ("axis", "series", AS_THEORY),
        ("axis", "other", AS_THEORY),
        ("formulation", "printed", DIVERGES),
    ]
    assert found[0].summary()["sizes"] == [0.5, 0.25, 0.125]
