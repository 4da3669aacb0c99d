"""The family of rests: orders against the rod, what does not converge, references and costs."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from arms import PAPER, SMALL, States, arm, differences, model_of

from softmpc.accuracy import rest_references
from softmpc.accuracy.configuration import Configuration, Task
from softmpc.accuracy.motion_variants import PRINTED_RATES
from softmpc.accuracy.orders import AS_THEORY, DIVERGES, Fit, fit_series
from softmpc.accuracy.points import Point
from softmpc.accuracy.printed_rates import with_printed_rates
from softmpc.accuracy.rest import Rest
from softmpc.accuracy.rest_references import AT_BENT, AT_ZERO, END, POSTURE
from softmpc.accuracy.study import read_task
from softmpc.errors import BuildError, InputError, SceneError, SoftmpcError
from softmpc.model.counting import executed
from softmpc.model.scene import STRAINS, Scene, default_effects
from softmpc.model.scene_file import KINEMATICS, scene_from_dict, scene_to_dict

EXAMPLE = Path(__file__).resolve().parents[1] / "examples" / "accuracy.toml"
FAMILY = Rest()
GAUSS = ("1 Gauss point", "2 Gauss points", "3 Gauss points")
FULL, PRINTED = "Newton-Euler, full wrench", "Newton-Euler, as printed"
RATES = "printed, passed on by virtual power"


@cache
def task_of(name: str) -> Task:
    """The example, or an arm of three sections of other sizes, units and angles."""
    if name == "example":
        return read_task(EXAMPLE, quick=True)
    base, _ = PAPER.sections
    third = replace(base, length=0.18, mass=0.3, bending_radius=0.024, unit_angles=(0.4, 2.4, 4.4))
    return Task(scene_to_dict(Scene(arm(base, third, SMALL))), quick=True)


@cache
def references(name: str) -> dict[str, dict[str, Any]]:
    task = task_of(name)
    return {each: FAMILY.reference(task, each) for each in FAMILY.references(task)}


def configuration(name: str, series: str, segments: int) -> Configuration:
    found = [  # of a full study, for a quick one leaves series out
        one
        for one in FAMILY.configurations(replace(task_of(name), quick=False))
        if one.series == series and one.changes["model.segments"] == segments
    ]
    return found[0]


@cache
def error(name: str, series: str, segments: int) -> dict[str, Any]:
    one = configuration(name, series, segments)
    return FAMILY.error(task_of(name), one, references(name))


def fit(name: str, series: str, counts: Iterable[int], key: str = "error_m") -> Fit:
    points = [Point(configuration(name, series, n), error(name, series, n)) for n in counts]
    return fit_series(points, key)


def check_order(found: Fit, theory: float) -> None:
    assert found.theory == theory
    assert found.order == pytest.approx(theory, abs=0.2)
    assert found.verdict == AS_THEORY


# ---------------------------------------------------------------- orders


@pytest.mark.slow
def test_gauss_mass_is_of_second_order() -> None:
    """Frequencies too, once the third is a bending again: of one segment it is torsion."""
    check_order(fit("example", "2 Gauss points", (1, 2, 4)), 2.0)
    check_order(fit("example", "2 Gauss points", (2, 4, 8), "frequency_error"), 2.0)


@pytest.mark.sampled
@pytest.mark.parametrize("series", ["lumped mass", FULL])
def test_lumped_mass_is_of_first_order(series: str) -> None:
    check_order(fit("example", series, (1, 2, 4)), 1.0)


@pytest.mark.slow
def test_rates_that_are_passed_on_cost_an_order() -> None:
    """Out of plane ω = dw/dt leaves first order, and eight times the error at four segments."""
    check_order(fit("example", RATES, (1, 2, 4)), 1.0)
    counts = (1, 2, 4)
    rates, exact = ([error("example", s, n)["error_m"] for n in counts] for s in (RATES, "exact"))
    gains = np.array(rates) / exact
    assert np.all(np.diff(gains) > 0) and gains[-1] > 6


def test_the_printed_transmission_does_not_converge() -> None:
    counts = (1, 2, 4)
    errors = [error("example", PRINTED, n) for n in counts]
    assert fit("example", PRINTED, counts).verdict == DIVERGES
    assert errors[2]["error_m"] > max(errors[0]["error_m"], errors[1]["error_m"])
    lowest = np.array([each["frequencies_rad_s"][AT_ZERO][0] for each in errors])
    assert np.all(lowest[1:] / lowest[:-1] > 1.3)  # with √n, beyond all bounds
    assert lowest[-1] > 1.5 * references("example")[AT_ZERO]["frequencies"][0]


def test_newton_euler_lets_frequencies_be_complex() -> None:
    assert error("example", FULL, 2)["growing"] > 0
    assert error("example", "2 Gauss points", 2)["growing"] == 0


@pytest.mark.slow
@pytest.mark.parametrize(
    "series, theory",
    [*((each, 2.0) for each in GAUSS), ("lumped mass", 1.0), (FULL, 1.0), (RATES, 1.0)],
)
@pytest.mark.parametrize("name", ["example", "three sections"])
def test_orders_of_the_finest_sizes(name: str, series: str, theory: float) -> None:
    check_order(fit(name, series, (2, 4, 8)), theory)


@pytest.mark.slow
def test_the_printed_transmission_of_three_sections() -> None:
    counts = (1, 2, 4)
    assert fit("three sections", PRINTED, counts).verdict == DIVERGES
    found = [error("three sections", PRINTED, n) for n in counts]
    lowest = np.array([each["frequencies_rad_s"][AT_ZERO][0] for each in found])
    assert np.all(lowest[1:] > 1.2 * lowest[:-1])


# ---------------------------------------------------------------- references and errors


def test_references_of_a_study() -> None:
    known = references("example")
    postures = [name for name in known if name.startswith(POSTURE)]
    assert [*known] == [*postures, END, AT_ZERO, AT_BENT] and len(postures) == 4
    limits = task_scene("example").manipulator.limits
    for name in (*postures, END):
        one = known[name]
        assert one["doubt_m"] < 1e-8 and "rod" in one["about"]
        assert min(one["pressures"]) >= limits.pressure_min
        assert max(one["pressures"]) <= limits.pressure_max
    for name in postures:  # out of plane: the base and both tips are in no plane with gravity
        (x1, y1, _), (x2, y2, _) = known[name]["tips"]
        assert abs(x1 * y2 - x2 * y1) > 1e-4
    assert known[AT_ZERO]["pressures"] == [0.0] * 6
    assert known[AT_BENT]["pressures"] == known["posture 1"]["pressures"]
    assert known[AT_BENT]["frequency_doubt"] < 1e-8
    # 1.5 N·m on unit 1 and 1 N·m on unit 5 at 0.4002 MPa per N·m, and the ramp's end on unit 2.
    assert np.allclose(
        known[END]["pressures"], 4.002e5 * np.array([1.5, 1.2, 0, 0, 1, 0]), rtol=1e-3
    )


def task_scene(name: str) -> Scene:
    return scene_from_dict(dict(task_of(name).document))


def test_full_mode_has_more_postures() -> None:
    names = FAMILY.references(replace(task_of("example"), quick=False))
    assert sum(name.startswith(POSTURE) for name in names) == 8


def test_errors_of_the_scene_as_given() -> None:
    task = task_of("example")
    first = FAMILY.configurations(task)[0]
    assert not first.changes
    found = FAMILY.error(task, first, references("example"))
    assert found["error_m"] == max(found["by_posture_m"].values())
    assert found["median_m"] == np.median([*found["by_posture_m"].values()])
    assert found["median_m"] < found["error_m"] and found["tip_m"] <= found["error_m"]
    assert found["unstable"] == []
    given = [np.array(one["given"]) for one in references("example").values() if "given" in one]
    tips = [np.array(one["tips"]) for one in references("example").values() if "tips" in one]
    wanted = max(np.linalg.norm(a - b, axis=1).max() for a, b in zip(given, tips, strict=True))
    assert found["error_m"] == pytest.approx(wanted, abs=1e-12)


def test_another_elastic_law_is_a_change() -> None:
    task = task_of("example")
    others = [one for one in FAMILY.configurations(task) if one.axis == "elasticity"]
    assert {one.changes["model.elasticity"] for one in others} == {"strain", "printed"}
    for one in others:
        found = FAMILY.error(task, one, references("example"))
        assert [*found] == ["change_m"] and found["change_m"] > 1e-3


def test_a_scene_with_the_papers_elasticity_keeps_it() -> None:
    document = scene_to_dict(Scene(PAPER)) | {"model": {"elasticity": "strain"}}
    found = FAMILY.configurations(Task(document, quick=True))
    laws = {one.changes["model.elasticity"] for one in found if one.axis != "elasticity"
            and one.changes}  # fmt: skip
    assert laws == {"strain"}
    printed = Task(document | {"model": {"elasticity": "printed"}})
    assert "depends on the number of segments" in FAMILY.missing(printed)
    assert FAMILY.missing(task_of("example")) == ""


@pytest.mark.slow
def test_a_scene_beyond_the_rod_is_measured_against_a_fine_model(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """An arm that does not twist: the limit of its own segments, where the rod's tip is not."""
    monkeypatch.setattr(rest_references, "segment_counts", lambda task: [1, 2])  # for speed
    strains = STRAINS[:3]
    scene = Scene(PAPER, strains=strains, effects=default_effects(strains))
    task = Task(scene_to_dict(scene), quick=True)
    known = {name: FAMILY.reference(task, name) for name in ("posture 1", AT_ZERO)}
    assert "not independent" in known["posture 1"]["about"]
    assert "kappa_z" in known["posture 1"]["about"]
    assert "2 and 4 segments" in known["posture 1"]["about"]
    assert 1e-4 < known["posture 1"]["doubt_m"] < 1e-2
    rest = {name: {"about": "left out"} for name in FAMILY.references(task) if name not in known}
    one, two = (
        FAMILY.error(task, Configuration("", "", {"model.segments": n}), known | rest)
        for n in (1, 2)
    )
    assert 3.5 < one["error_m"] / two["error_m"] < 4.6
    assert one["doubt_m"] == known["posture 1"]["doubt_m"]


def test_postures_without_a_rest_say_so(monkeypatch: pytest.MonkeyPatch) -> None:
    """Limits that no posture keeps: all draws are refused, with the reason."""
    monkeypatch.setattr(rest_references, "ATTEMPTS", 2)
    document = scene_to_dict(Scene(PAPER))
    document["limits"]["curvature_max"] = 1e-3
    task = Task(document, quick=True)
    found = FAMILY.reference(task, "posture 1")
    assert "tips" not in found and found["about"].startswith("left out: curvature of segment")
    with pytest.raises(SoftmpcError, match="no posture to compare with"):
        FAMILY.error(task, Configuration("", ""), dict.fromkeys(FAMILY.references(task), found))
    with pytest.raises(InputError, match="unknown reference: 'posture 9'"):
        FAMILY.reference(task, "posture 9")


# ---------------------------------------------------------------- printed rates, costs


def test_printed_rates_are_for_study_only() -> None:
    """Their residual is the derivative of nothing: no scene file names them."""
    model = with_printed_rates(model_of(segments=2).scene)
    assert PRINTED_RATES not in KINEMATICS
    with pytest.raises(SceneError, match="do not know"):
        scene_to_dict(model.scene)


def test_jacobians_of_printed_rates() -> None:
    """Against differences; the recursive ones would take ω for exact."""
    model = with_printed_rates(model_of().scene)
    q, dq, ddq, p = States(model).motion()
    scale = model.layout.q.scale
    K = np.asarray(model.stiffness(q, p)[0])
    slope = differences(lambda x: model.balance(x, p), q, 1e-3 * scale)
    assert np.abs((K - slope) * scale).max() < 1e-8 * np.abs(K * scale).max()
    by_q = np.asarray(model.residual_jacobian(q, dq, ddq, p)[0])
    slope = differences(lambda x: model.residual(x, dq, ddq, p), q, 1e-3 * scale)
    assert np.abs((by_q - slope) * scale).max() < 1e-8 * np.abs(by_q * scale).max()
    M = np.asarray(model.M(q))
    moved = model.residual(q, 0 * dq, ddq, p) - model.balance(q, p)
    assert np.allclose(M @ ddq, np.asarray(moved).ravel(), rtol=1e-9)


@pytest.mark.slow
def test_costs_stand_beside_the_scene_as_given() -> None:
    task = task_of("example")
    found = FAMILY.cost(task, configuration("example", "2 Gauss points", 2))
    assert found["instructions"] > 0 and found["ratio"] > 0
    assert found["ratio"] == pytest.approx(found["time_s"] / found["beside_s"])
    for key in ("time_s", "spread_s", "build_s", "rest_s"):
        assert 0 <= found[key] < 10
    model = model_of(segments=2)
    wanted = executed(model.residual) + executed(model.residual_jacobian)
    assert found["instructions"] == wanted


def test_costs_that_would_take_minutes_are_refused() -> None:
    task = task_of("example")
    with pytest.raises(BuildError, match="takes minutes for 8 segments in all"):
        FAMILY.cost(task, configuration("example", FULL, 4))
