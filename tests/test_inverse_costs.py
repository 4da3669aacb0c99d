"""What inverse statics minimises, against SciPy's SLSQP over the pressures and forward statics."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import casadi as ca
import numpy as np
import pytest
from arms import PAPER, arm, model_of
from scipy.optimize import minimize

from softmpc.errors import InputError
from softmpc.model.elasticity import StrainElasticity
from softmpc.model.formulations import NewtonEuler
from softmpc.model.model import Model
from softmpc.statics.equilibrium import find_equilibrium
from softmpc.statics.inverse import InverseStatics
from softmpc.statics.program import RestProgram
from softmpc.statics.rest_costs import (
    REST_COSTS,
    ClosestPosture,
    GreatestMargin,
    LeastPressure,
    LeastStrainEnergy,
    RestCost,
    Terms,
)
from softmpc.statics.targets import Position

PLACES = [(0.1, 0.05, 0.55), (-0.2, 0.1, 0.5), (0.05, -0.15, 0.62)]
FULL = 1e6  # Pa


@cache
def model() -> Model:
    return model_of()


def rest_of(share: np.ndarray) -> np.ndarray:
    return find_equilibrium(model(), share * FULL).q


def by_scipy(cost: Callable[[np.ndarray], float], place, start: np.ndarray) -> float:
    """The least cost of pressures (over the highest one) whose forward statics hold the place."""

    def off(share: np.ndarray) -> np.ndarray:
        return find_equilibrium(model(), share * FULL).tips[-1] - place

    def slope(share: np.ndarray) -> np.ndarray:
        rest = find_equilibrium(model(), share * FULL)
        K, by_p = (np.asarray(x) for x in model().stiffness(rest.q, rest.pressures))
        J = np.asarray(model().tip_jacobian(rest.q))[-3:]
        return -J @ np.linalg.solve(K, by_p) * FULL

    found = minimize(
        cost, np.clip(start, 0, 1), method="SLSQP", bounds=[(0, 1)] * 6,
        constraints={"type": "eq", "fun": off, "jac": slope},
        options={"maxiter": 300, "ftol": 1e-12},
    )  # fmt: skip
    assert np.linalg.norm(off(np.clip(found.x, 0, 1))) < 1e-5, found.message
    return float(found.fun)


def pressure(share: np.ndarray) -> float:
    return 0.5 * float(np.mean(share**2))


def energy(share: np.ndarray) -> float:
    """J: length (½ 3 E A ε² + ½ (1 + ε) k·Kk) of each section, a segment each."""
    total = 0.0
    for section, (epsilon, *k) in zip(PAPER.sections, rest_of(share).reshape(2, 4), strict=True):
        K = np.array([section.bending_stiffness] * 2 + [section.torsional_stiffness])
        axial = 0.5 * section.axial_stiffness * epsilon**2
        total += section.length * (axial + 0.5 * (1 + epsilon) * float(K @ np.square(k)))
    return total


PRESENT = find_equilibrium(model_of(), [2e5, 0, 1e5, 4e5, 0, 3e5]).q


def posture(share: np.ndarray) -> float:
    return 0.5 * float(np.mean(((rest_of(share) - PRESENT) / model().layout.q.scale) ** 2))


COSTS: dict[str, tuple[RestCost, Callable[[np.ndarray], float]]] = {
    "least pressure": (LeastPressure(), pressure),
    "least strain energy": (LeastStrainEnergy(), energy),
    "closest posture": (ClosestPosture(tuple(PRESENT)), posture),
}


@pytest.mark.sampled
@pytest.mark.parametrize("name", COSTS)
@pytest.mark.parametrize("place", PLACES)
def test_scipy_finds_nothing_cheaper(name: str, place) -> None:
    """From the solution and from other pressures; and the cost is the one that was asked for."""
    cost, measure = COSTS[name]
    found = InverseStatics(model(), cost).solve(Position(place), compare=5)
    share = found.pressures / FULL
    best = measure(share)
    nudged = share + np.random.default_rng(0).normal(size=6) * 0.05
    others = [by_scipy(measure, place, start) for start in (nudged, np.full(6, 0.5))]
    assert found.solved
    assert best <= min(others) * (1 + 1e-5)
    if name == "least strain energy":
        full = 0.5 * float(model().layout.q.scale @ model().layout.r.scale)
        assert found.cost == pytest.approx(best / full, rel=1e-6)
    else:
        assert found.cost == pytest.approx(best, rel=1e-6)


@pytest.mark.sampled
@pytest.mark.parametrize("place", PLACES)
def test_greatest_margin(place) -> None:
    """SLSQP with the smallest margin as a variable of its own."""
    found = InverseStatics(model(), GreatestMargin()).solve(Position(place), compare=5)
    share = found.pressures / FULL
    margin = float(np.minimum(share, 1 - share).min())
    assert found.solved
    assert -found.cost == pytest.approx(margin, abs=1e-6)

    def off(x: np.ndarray) -> np.ndarray:
        return find_equilibrium(model(), x[:6] * FULL).tips[-1] - place

    for seed in range(2):
        x = np.append(np.random.default_rng(seed).uniform(size=6), 0.0)
        other = minimize(
            lambda x: -x[6], x, method="SLSQP", bounds=[(0, 1)] * 6 + [(-1, 1)],
            constraints=[
                {"type": "eq", "fun": off},
                {"type": "ineq", "fun": lambda x: np.append(x[:6] - x[6], 1 - x[:6] - x[6])},
            ],
            options={"maxiter": 200},
        )  # fmt: skip
        if np.linalg.norm(off(other.x)) < 1e-6:
            assert margin >= other.x[6] - 1e-4


def test_where_pressures_are_settled_every_cost_finds_them() -> None:
    """Three units of one section for three coordinates."""
    single = model_of(arm(PAPER.sections[0]))
    rest = find_equilibrium(single, [3e5, 5e5, 1e5])
    for kind in REST_COSTS.values():
        found = InverseStatics(single, kind()).solve(Position(tuple(rest.tips[-1])))
        assert found.solved, kind
        assert found.pressures == pytest.approx(rest.pressures, rel=1e-3), kind
    assert -InverseStatics(single, GreatestMargin()).solve(
        Position(tuple(rest.tips[-1]))
    ).cost == pytest.approx(0.1, abs=1e-4)


def test_margin_of_units_that_are_free() -> None:
    """A held unit is at its limits on both sides, and counts for nothing."""
    inverse = InverseStatics(model(), GreatestMargin(), held={2: 0.0})
    found = inverse.solve(Position((0.05, 0.0, 0.6)))
    free = np.delete(found.pressures / FULL, 1)
    assert found.solved and found.pressures[1] == 0.0
    assert -found.cost == pytest.approx(float(np.minimum(free, 1 - free).min()), abs=1e-6)
    assert -found.cost > 0.01


def test_a_cost_of_your_own() -> None:
    class OneUnit(RestCost):
        """As little as possible of unit 1."""

        name = "one-unit"

        def terms(self, program: RestProgram) -> Terms:
            return Terms(ca.SX(program.p[0] / FULL))

    place = Position((-0.02, 0.0, 0.62))
    mine = InverseStatics(model(), OneUnit()).solve(place)
    least = InverseStatics(model()).solve(place)
    assert mine.solved
    assert mine.pressures[0] < 1.0 < least.pressures[0]


def test_elasticity_without_energy_is_refused() -> None:
    literal = model_of(formulation=NewtonEuler(elasticity=StrainElasticity()))
    inverse = InverseStatics(literal, LeastStrainEnergy())
    with pytest.raises(InputError, match="has no energy"):
        inverse.solve(Position((0, 0, 0.6)))


@pytest.mark.parametrize("q", [(0.0,) * 7, (float("nan"),) * 8])
def test_posture_that_does_not_fit(q) -> None:
    with pytest.raises(InputError, match="must be the 8 strains"):
        InverseStatics(model(), ClosestPosture(q)).solve(Position((0, 0, 0.6)))
