"""Truncated time series: a value with its first and second time derivative.

The geometry of a segment is written once, on anything that adds and multiplies. Evaluated on
CasADi expressions it gives positions; evaluated on a `Jet` it gives velocities and accelerations
too, without a Jacobian and without growth of the graph that automatic differentiation would bring.
"""

from __future__ import annotations

from collections.abc import Callable
from math import comb
from typing import Any

import casadi as ca

__all__ = ["Jet", "cross", "dot", "stack"]


class Jet:
    """`x, dx/dt, d²x/dt²` (as many as are given); products follow Leibniz' rule."""

    __slots__ = ("terms",)

    def __init__(self, *terms: Any) -> None:
        self.terms = terms

    def __getitem__(self, index: int | slice) -> Jet:
        return Jet(*(term[index] for term in self.terms))

    def __add__(self, other: Any) -> Jet:
        if not isinstance(other, Jet):
            return Jet(self.terms[0] + other, *self.terms[1:])
        return Jet(*(a + b for a, b in zip(self.terms, other.terms, strict=False)))

    def __neg__(self) -> Jet:
        return Jet(*(-term for term in self.terms))

    def __sub__(self, other: Any) -> Jet:
        return self + (-other)

    def __mul__(self, other: Any) -> Jet:
        return _leibniz(lambda a, b: a * b, self, other)

    __radd__ = __add__
    __rmul__ = __mul__


def _leibniz(product: Callable[[Any, Any], Any], a: Any, b: Any) -> Any:
    """Derivatives of a bilinear product of jets or constants."""
    if not isinstance(a, Jet) and not isinstance(b, Jet):
        return product(a, b)
    if not isinstance(b, Jet):
        return Jet(*(product(term, b) for term in a.terms))
    if not isinstance(a, Jet):
        return Jet(*(product(a, term) for term in b.terms))
    order = min(len(a.terms), len(b.terms))
    terms = []
    for n in range(order):
        parts = [product(a.terms[k], b.terms[n - k]) for k in range(n + 1)]
        terms.append(sum((comb(n, k) * part for k, part in enumerate(parts[1:], 1)), parts[0]))
    return Jet(*terms)


def cross(a: Any, b: Any) -> Any:
    """Cross product of two 3-vectors, jets or not."""
    return _leibniz(ca.cross, a, b)


def dot(a: Any, b: Any) -> Any:
    """Scalar product of two 3-vectors, jets or not."""
    return _leibniz(ca.dot, a, b)


def stack(*components: Any) -> Any:
    """A vector from scalar components, jets if one of them is."""
    order = min((len(c.terms) for c in components if isinstance(c, Jet)), default=0)
    if not order:
        return ca.vertcat(*components)
    padded = [c if isinstance(c, Jet) else Jet(c, *[0.0] * (order - 1)) for c in components]
    return Jet(*(ca.vertcat(*(c.terms[n] for c in padded)) for n in range(order)))
