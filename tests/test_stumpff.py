"""Stumpff functions against 50-digit arithmetic: they carry every derivative of the model.

Tolerances are relative to max(|exact|, envelope): the functions oscillate through zero, and there
a relative error of the value means nothing. The envelope is the size of the m-th derivative at
s = 0, damped by (1 + s)^(-(k + m)/2), which is how c_k^(m) falls off for large s.
"""

from __future__ import annotations

import casadi as ca
import mpmath as mp
import numpy as np
import pytest

from softmpc.model.jets import Jet
from softmpc.model.stumpff import SWITCH, slopes, stumpff, stumpff_jets

ORDERS = 5  # the value and four derivatives
# Measured worst cases 2.4e-15, 9e-15, 8e-14, 5e-13, 9e-12: the higher derivatives lose digits only
# just above the switch, where the upward recurrence divides by s for each order.
TOLERANCES = (5e-15, 2e-14, 2e-13, 1e-12, 2e-11)
LARGEST = (4 * np.pi) ** 2
HARD = (0.0, 1e-24, 1e-18, 1e-12, 1e-9, 1e-6, 1e-3, np.pi**2, 4 * np.pi**2, LARGEST)
AROUND = tuple(SWITCH * (1 + side * d) for d in (0, 1e-15, 1e-6, 0.1) for side in (-1, 1))
GRID = (*np.logspace(-26, np.log10(LARGEST), 60), *np.linspace(0.5, LARGEST, 80))


def exact(k: int, s: float, order: int) -> mp.mpf:
    """d^order c_k / ds^order, its power series term by term with 50 digits."""
    with mp.workdps(50):
        total, j = mp.mpf(0), order
        while True:
            term = mp.ff(j, order) * mp.mpf(s) ** (j - order) / mp.factorial(k + 2 * j)
            total += (-1) ** j * term
            if j > order + 3 and term < mp.mpf(10) ** -50:
                return total
            j += 1


def tower(highest: int) -> ca.Function:
    """c_0 … c_highest with their derivatives by CasADi's automatic differentiation."""
    s = ca.SX.sym("s")
    rows = [ca.vertcat(*stumpff(s, highest))]
    for _ in range(ORDERS - 1):
        rows.append(ca.densify(ca.jacobian(rows[-1], s)))
    return ca.Function("tower", [s], [ca.horzcat(*rows)])


def error(found: float, k: int, s: float, order: int) -> float:
    value = exact(k, s, order)
    envelope = float(abs(exact(k, 0.0, order))) * (1 + s) ** (-(k + order) / 2)
    return float(abs(mp.mpf(found) - value)) / max(abs(float(value)), envelope)


@pytest.mark.sampled
@pytest.mark.parametrize("points", [HARD, AROUND, GRID], ids=["hard", "switch", "grid"])
def test_values_and_four_derivatives(points: tuple[float, ...]) -> None:
    evaluate = tower(5)
    worst = np.zeros(ORDERS)
    for s in points:
        found = np.asarray(evaluate(s))
        for k in range(6):
            worst = np.maximum(worst, [error(found[k, m], k, s, m) for m in range(ORDERS)])
    assert np.all(worst <= TOLERANCES), worst


@pytest.mark.parametrize("highest", [1, 3, 7, 9])
def test_other_heights(highest: int) -> None:
    """The model asks for up to c_9 (the jerk in its Jacobian); c_9 costs digits."""
    evaluate = tower(highest)
    for s in (*HARD, *AROUND):
        found = np.asarray(evaluate(s))
        worst = [max(error(found[k, m], k, s, m) for k in range(highest + 1)) for m in range(3)]
        assert np.all(np.array(worst) <= (1e-14, 1e-12, 5e-11)), (s, worst)


def test_second_derivative_through_the_square_of_an_angle() -> None:
    """As in the model, s = θ²: c_1 = sin θ/θ has the second derivative -1/3 at 0, never NaN."""
    theta = ca.SX.sym("theta")
    c = stumpff(theta**2, 3)[1]
    second = ca.Function("second", [theta], [ca.hessian(c, theta)[0]])
    for value in (0.0, 1e-300, 1e-160, 1e-12, 1e-8):
        assert float(second(value)) == pytest.approx(-1 / 3, abs=1e-15)
    with mp.workdps(50):
        for value in (1e-3, 0.7, float(mp.pi), float(2 * mp.pi)):
            wanted = mp.diff(lambda x: mp.sin(x) / x, value, 2)
            assert float(second(value)) == pytest.approx(float(wanted), abs=1e-14)


@pytest.mark.parametrize("s", [0.0, 1e-9, 0.3, SWITCH * (1 - 1e-9), SWITCH, 39.0, LARGEST])
def test_identities(s: float) -> None:
    """c_k = 1/k! - s c_{k+2}, c_0² + s c_1² = 1, c_1² = c_2 (1 + c_0), and the slopes."""
    c = [float(x) for x in ca.Function("c", [_S], [*stumpff(_S, 7)])(s)]
    for k in range(6):
        assert c[k] == pytest.approx(1 / float(mp.factorial(k)) - s * c[k + 2], abs=3e-15)
    assert c[0] ** 2 + s * c[1] ** 2 == pytest.approx(1, abs=3e-15)
    assert c[1] ** 2 - c[2] * (1 + c[0]) == pytest.approx(0, abs=1e-15)
    for k, slope in enumerate(slopes(c)):
        assert error(slope, k, s, 1) < 1e-13


_S = ca.SX.sym("s")


@pytest.mark.parametrize("order", [0, 1, 2])
@pytest.mark.parametrize("start", [0.0, 1e-12, 2.0, SWITCH, 30.0])
def test_jets_are_time_derivatives(order: int, start: float) -> None:
    """Along s(t) = s0 + a t + b t²/2 the jets equal automatic derivatives by t at t = 0."""
    t, a, b = ca.SX.sym("t"), 0.7, 1.3
    s = start + a * t + b * t**2 / 2
    along = stumpff(s, 5)
    terms = [s, ca.gradient(s, t), ca.SX(b)][: order + 1]
    jets = stumpff_jets(stumpff(s, 5 + 2 * order), Jet(*terms))
    assert len(jets) == 6
    for jet, derivative in zip(jets, along, strict=True):
        assert len(jet.terms) == order + 1
        for term in jet.terms:
            found, wanted = (float(ca.Function("at", [t], [x])(0)) for x in (term, derivative))
            assert found == pytest.approx(wanted, rel=1e-11, abs=1e-14)
            derivative = ca.gradient(derivative, t)
