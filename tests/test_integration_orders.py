"""Order of convergence of every integrator, also where the drive is stiff.

The reference is SciPy's DOP853 or Radau on the model's forward dynamics, which shares no code with
any of the integrators here.
"""

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from softmpc import (
    Coriolis,
    Gravity,
    Inertia,
    Model,
    PressureDrive,
    RotaryInertia,
    Scene,
    build,
    chen2022,
)
from softmpc.model.drive_effects import ChamberCoupling
from softmpc.simulation.cvodes import Cvodes
from softmpc.simulation.idas import Idas
from softmpc.simulation.inputs import InputProfile
from softmpc.simulation.run import simulate, start_state
from softmpc.simulation.runge_kutta import GaussLegendre, RadauIIA
from softmpc.simulation.tableau import gauss_legendre, radau_iia

Case = tuple[Model, np.ndarray, np.ndarray, np.ndarray, float]
FIRST, SLOPE = np.array([0.5, 0.0, 0.0, 0.0, 0.2, 0.4]), 8.0  # N·m, N·m/s on every unit


@cache
def free() -> Case:
    """Let go from a bent posture, without damping and pressure.

    Model, state, input at both ends, duration.
    """
    effects = (Gravity(), Inertia(), Coriolis(), RotaryInertia())
    model = build(Scene(chen2022(), effects=effects, actuation=PressureDrive()))
    bent = start_state(model, InputProfile.constant([3e5, 0, 0, 0, 1e5, 2e5]))
    return model, bent, np.zeros(6), np.zeros(6), 0.04


def ramped(*more: Any) -> Case:
    """Under a ramp that has been going on, so that the fast modes of the drive have died out."""
    scene = Scene(chen2022())
    model = build(scene.with_(effects=(*scene.effects, *more)))
    rest = start_state(model, InputProfile.constant(FIRST))
    middle, end = FIRST + 0.1 * SLOPE, FIRST + 0.2 * SLOPE
    moving = RadauIIA(model, 1e-10).advance(rest, FIRST, 0.1, 1, middle)[-1]
    return model, moving, middle, end, 0.1


@cache
def hydraulic() -> Case:
    """Poles at -10485 and -1149 1/s, steps up to 25 ms; the drive is in closed form."""
    return ramped()


@cache
def coupled() -> Case:
    """The arm acts back on the drive: poles near -1e5 1/s inside the implicit step."""
    return ramped(ChamberCoupling())


CASES = {"free": free, "hydraulic": hydraulic, "coupled": coupled}


@cache
def exact(name: str) -> np.ndarray:
    """The arm's state at the end, scaled."""
    model, x, u0, u1, duration = CASES[name]()
    found = solve_ivp(
        lambda t, x: np.asarray(model.x_dot(x, u0 + (u1 - u0) * t / duration)).ravel(),
        (0.0, duration),
        x,
        method="DOP853" if name == "free" else "Radau",
        rtol=3e-13,
        atol=1e-13 * model.layout.x.scale,
    )
    return arm(model, found.y[:, -1])


def arm(model: Model, x: np.ndarray) -> np.ndarray:
    """Strains and rates over their typical sizes."""
    n = model.strains
    return x[: 2 * n] / model.layout.x.scale[: 2 * n]


def errors(name: str, make: Callable[[Model, float], Any], steps: list[float]) -> np.ndarray:
    model, x, u0, u1, duration = CASES[name]()
    ends = [make(model, step).advance(x, u0, duration, 1, u1)[-1] for step in steps]
    return np.array([np.linalg.norm(arm(model, end) - exact(name)) for end in ends])


@pytest.mark.sampled
@pytest.mark.parametrize(
    ("case", "method", "stages", "order", "parts"),
    [
        ("free", RadauIIA, 2, 3, (40, 80, 160)),
        ("free", RadauIIA, 3, 5, (16, 24, 32)),
        ("free", GaussLegendre, 2, 4, (10, 20, 40)),
        ("free", GaussLegendre, 3, 6, (14, 20, 28)),
        ("hydraulic", RadauIIA, 2, 3, (10, 20, 40)),
        ("hydraulic", RadauIIA, 3, 5, (8, 12, 18)),
        ("hydraulic", GaussLegendre, 2, 4, (8, 16, 32)),
        ("hydraulic", GaussLegendre, 3, 6, (5, 8, 12)),
        ("coupled", RadauIIA, 2, 3, (10, 20, 40)),
        ("coupled", RadauIIA, 3, 5, (4, 8, 12)),
    ],
)
def test_order(case: str, method: Any, stages: int, order: int, parts: tuple[int, ...]) -> None:
    steps = [CASES[case]()[-1] / k for k in parts]
    found = errors(case, lambda m, h: method(m, stages=stages, step=h), steps)
    slope = np.polyfit(np.log(steps), np.log(found), 1)[0]
    assert slope == pytest.approx(order, abs=0.2)


@pytest.mark.parametrize("method", [Idas, Cvodes])
@pytest.mark.parametrize("case", ["free", "hydraulic"])
def test_error_follows_the_tolerance(case: str, method: Any) -> None:
    """A method that chooses order and step itself: its error falls about as its tolerance."""
    tolerances = [1e-5, 1e-6, 1e-7, 1e-8, 1e-9]
    found = errors(case, method, tolerances)
    slope = np.polyfit(np.log(tolerances), np.log(found), 1)[0]
    assert 0.7 < slope < 1.3


@pytest.mark.parametrize("case", CASES)
def test_error_stays_within_the_tolerance_at_the_tip(case: str) -> None:
    model, x, u0, u1, duration = CASES[case]()
    q = exact(case)[: model.strains] * model.layout.q.scale
    for tolerance in (1e-3, 1e-4, 1e-5, 1e-6):
        end = RadauIIA(model, tolerance).advance(x, u0, duration, 1, u1)[-1]
        gap = np.asarray(model.frames(end[: model.strains])[0] - model.frames(q)[0])
        assert np.linalg.norm(gap, axis=0).max() < tolerance


@pytest.mark.parametrize(("make", "order"), [(radau_iia, -1), (gauss_legendre, 0)])
@pytest.mark.parametrize("stages", [1, 2, 3, 4])
def test_tableau(make: Any, order: int, stages: int) -> None:
    """Known nodes, collocation conditions, order; Radau's last row is its quadrature."""
    tableau = make(stages)
    assert tableau.order == 2 * stages + order
    powers = np.arange(1, stages + 1)
    collocated = tableau.c[:, None] ** powers / powers
    np.testing.assert_allclose(
        tableau.A @ tableau.c[:, None] ** (powers - 1), collocated, atol=1e-13
    )
    if order == 0:
        nodes, weights = np.polynomial.legendre.leggauss(stages)
        np.testing.assert_allclose(tableau.c, 0.5 + nodes / 2, atol=1e-14)
        np.testing.assert_allclose(tableau.b, weights / 2, atol=1e-13)
    else:
        assert tableau.stiffly_accurate
        np.testing.assert_allclose(tableau.A[-1], tableau.b, atol=1e-13)


def test_radau_is_l_stable_and_gauss_is_not() -> None:
    """The growth 1 + z bᵀ(1 - zA)⁻¹1 far out on the left."""
    for make, far in ((radau_iia, 0.0), (gauss_legendre, 1.0)):
        for stages in (2, 3):
            t = make(stages)
            z = -1e9
            growth = 1 + z * t.b @ np.linalg.solve(np.eye(stages) - z * t.A, np.ones(stages))
            assert abs(growth) == pytest.approx(far, abs=1e-6)


@pytest.mark.slow
def test_conservative_arm_keeps_its_energy_for_a_minute() -> None:
    """Gauss at 2.5 ms: errors swing with the motion and do not add up. Radau loses energy."""
    model, x, *_ = free()
    motion = simulate(model, InputProfile.of(6), 60.0, start=x, method="gauss", step=2.5e-3)
    assert motion.finished
    total = sum(motion.energies.values())
    turnover = np.ptp(motion.energies["kinetic"])
    assert turnover > 0.1
    assert np.abs(total - total[0]).max() < 1e-6 * turnover
    assert abs(total[-1000:].mean() - total[:1000].mean()) < 1e-7 * turnover
