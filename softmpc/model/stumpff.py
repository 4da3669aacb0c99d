"""Stumpff functions c_k(s) = Σ_j (-s)^j / (k + 2j)!, the entire functions behind every arc.

With s = θ² they replace sin θ/θ, (1 - cos θ)/θ², … and have no singularity at θ = 0:

    c_0 = cos θ,   c_1 = sin θ/θ,   c_k = 1/k! - s c_{k+2},   dc_k/ds = (k c_{k+2} - c_{k+1})/2.
"""

from __future__ import annotations

from math import factorial
from typing import Any

import casadi as ca

from softmpc.model.jets import Jet

__all__ = ["slopes", "stumpff", "stumpff_jets"]

# Below the switch: power series of the two highest functions, then the recurrence downwards.
# Above it: sine and cosine, then the recurrence upwards, which loses few digits once s is this
# large. The series is long enough for fourth derivatives at the switch (tests/test_stumpff.py).
SWITCH = 10.0
TERMS = 14


def stumpff(s: Any, highest: int) -> list[Any]:
    """c_0 … c_highest at a CasADi scalar `s` ≥ 0, accurate with its derivatives."""
    highest = max(highest, 1)
    small = s < SWITCH
    # Each branch sees an argument it can stand, so the branch not taken never yields NaN.
    series = _downwards(ca.if_else(small, s, 0.0), highest)
    closed = _upwards(ca.if_else(small, SWITCH, s), highest)
    return [ca.if_else(small, a, b) for a, b in zip(series, closed, strict=True)]


def slopes(c: list[Any]) -> list[Any]:
    """dc_k/ds for every k that the list `c` reaches; two fewer than it holds."""
    return [(c[k + 2] * k - c[k + 1]) * 0.5 for k in range(len(c) - 2)]


def stumpff_jets(c: list[Any], s: Jet) -> list[Jet]:
    """The functions along a motion s(t), from their values `c` at s; two fewer an order."""
    order = len(s.terms) - 1
    tables = [c]
    for _ in range(order):
        tables.append(slopes(tables[-1]))
    jets = []
    for k in range(len(tables[-1])):
        terms = [c[k]]
        if order >= 1:
            terms.append(tables[1][k] * s.terms[1])
        if order >= 2:
            terms.append(tables[2][k] * s.terms[1] ** 2 + tables[1][k] * s.terms[2])
        jets.append(Jet(*terms))
    return jets


def _downwards(s: ca.SX, highest: int) -> list[ca.SX]:
    c: dict[int, ca.SX] = {k: _series(s, k) for k in (highest, highest - 1)}
    for k in range(highest - 2, -1, -1):
        c[k] = 1 / factorial(k) - s * c[k + 2]
    return [c[k] for k in range(highest + 1)]


def _series(s: ca.SX, k: int) -> ca.SX:
    total: Any = 0.0
    for j in range(TERMS - 1, -1, -1):
        total = (-1) ** j / factorial(k + 2 * j) + s * total
    return total


def _upwards(s: ca.SX, highest: int) -> list[ca.SX]:
    theta = ca.sqrt(s)
    c = [ca.cos(theta), ca.sin(theta) / theta]
    inverse = 1 / s
    for k in range(2, highest + 1):
        c.append((1 / factorial(k - 2) - c[k - 2]) * inverse)
    return c
