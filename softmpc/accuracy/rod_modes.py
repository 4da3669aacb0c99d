"""Small oscillations of the reference rod about an equilibrium, by Chebyshev collocation.

Shares no code with the model. With the displacement u and the rotation δθ of each cross-section
(base frame, δR = skew(δθ) R) and the increments of force and moment, the equations of `rod.py`
become for a motion with angular frequency ω

    u'  = δε d3 + (1 + ε) δθ × d3,     δθ' = R δw,
    δn' = −ω² μ u,                     δm' = −u' × n − r' × δn − ω² ι (1 + d3 d3ᵀ) δθ

    δM = Rᵀ(δm − δθ × m),   δk = K⁻¹ δM,   δw = (1 + ε) δk + k δε
    δε = (d3·δn + n·(δθ × d3) + k·δM) / (n E A_s)        (without k·δM where not coupled)

clamped at the base, with a thin disc of mass m at the tip: δn = ω² m u and
δm = ω² (m r²/4) (1 + d3 d3ᵀ) δθ. μ is the mass per length and ι = μ r²/4, as of thin discs; fluid
that moves along when the rod moves across itself adds to μ, but not along d3.

At the nodes this is A y = ω² B y with a singular B. The largest eigenvalues of A⁻¹ B, 1/ω², are the
lowest frequencies. L. N. Trefethen, *Spectral Methods in MATLAB* (2000), chapter 6, has the matrix
that differentiates.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, lu_factor, lu_solve

from softmpc.accuracy.rod import rod_along
from softmpc.accuracy.rod_parts import Array, RodError, RodSection, RodSolution

__all__ = ["chebyshev", "rod_frequencies"]

NODES = 24  # a section
LOOKED_AT = 3  # times as many as are asked for, for those that do not oscillate
COMPLEX = 1e-6  # of ω², what rounding leaves
U, TURN, FORCE, MOMENT = (slice(3 * k, 3 * k + 3) for k in range(4))


def rod_frequencies(
    sections: Sequence[RodSection],
    found: RodSolution,
    count: int = 4,
    tip_mass: float = 0.0,
    tip_radius: float = 0.0,
    nodes: int = NODES,
) -> Array:
    """The lowest undamped natural frequencies (rad/s) about an equilibrium, rising.

    `found` is that of `solve_rod` for the same sections; its `tip_force` must have the weight of
    the tip. `tip_mass` (kg) and `tip_radius` (m) are of a thin disc at the tip, `nodes` a section.
    Raises `RodError` where small motions do not oscillate but leave the equilibrium.
    """
    A, B, moving = _assembled(sections, found, _Tip(tip_mass, tip_radius), nodes)
    try:
        compliance = lu_solve(lu_factor(A), B[:, moving])[moving]
    except (LinAlgError, ValueError) as error:
        raise RodError(f"no frequencies: {error}") from None
    periods = np.linalg.eigvals(compliance)  # 1/ω²
    periods = periods[np.argsort(-np.abs(periods))][: LOOKED_AT * count]
    if np.any(periods.real <= 0) or np.any(np.abs(periods.imag) > COMPLEX * np.abs(periods)):
        raise RodError("the rod leaves this equilibrium: it is not stable")
    return np.sort(1 / np.sqrt(periods.real))[:count]


def chebyshev(nodes: int) -> tuple[Array, Array]:
    """Chebyshev points in 0 … 1, rising, and the matrix that differentiates at them."""
    k = np.arange(nodes)
    x = 0.5 - 0.5 * np.cos(np.pi * k / (nodes - 1))
    weight = (-1.0) ** k * np.where((k == 0) | (k == nodes - 1), 2.0, 1.0)
    gaps = x[:, None] - x + np.eye(nodes)
    D = np.outer(weight, 1 / weight) / gaps
    return x, D - np.diag(D.sum(axis=1))


@dataclass(frozen=True)
class _Tip:
    mass: float
    radius: float


def _assembled(
    sections: Sequence[RodSection], found: RodSolution, tip: _Tip, nodes: int
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """A, B and which unknowns have inertia; unknowns are y at all nodes of all sections."""
    x, D = chebyshev(nodes)
    block = 12 * nodes
    size = block * len(sections)
    A, B = np.zeros((size, size)), np.zeros((size, size))
    fields = rod_along(sections, found, x)
    for i, (section, pressure, (state, force)) in enumerate(
        zip(sections, found.load.pressures, fields, strict=True)
    ):
        first = i * block
        own = slice(first, first + block)
        A[own, own] = np.kron(D / section.length, np.eye(12))
        for k in range(nodes):
            at = slice(first + 12 * k, first + 12 * k + 12)
            static, moving = _slopes(section, pressure, state[:, k], force[:, k])
            A[at, at] -= static
            B[at, at] += moving
        _joined(A, B, first, i == 0)
    end = fields[-1][0][3:12, -1].reshape(3, 3)[:, 2]
    _at_tip(A, B, tip, end)
    moves = np.tile(np.arange(12) < 6, nodes * len(sections))
    return A, B, moves


def _slopes(
    section: RodSection, pressure: Array, state: Array, force: Array
) -> tuple[Array, Array]:
    """The matrices s and m of y' = (s + ω² m) y at a place, for y = (u, δθ, δn, δm)."""
    R, m = state[3:12].reshape(3, 3), state[12:15]
    d3, K = R[:, 2], section.stiffness
    axial_drive, moment_drive = section.drive(pressure)
    k = (R.T @ m + moment_drive) / K
    bent = 0.5 * float(k @ (K * k)) if section.coupled else 0.0
    stretch = 1 + (float(force @ d3) + axial_drive + bent) / section.axial_stiffness
    body_moment, tension = np.zeros((3, 12)), np.zeros(12)
    body_moment[:, TURN] = R.T @ _skew(m)  # −δθ × m = m × δθ
    body_moment[:, MOMENT] = R.T
    tension[FORCE], tension[TURN] = d3, np.cross(d3, force)  # n·(δθ × d3) = δθ·(d3 × n)
    if section.coupled:
        tension = tension + k @ body_moment
    stretching = tension / section.axial_stiffness
    static, moving = np.zeros((12, 12)), np.zeros((12, 12))
    static[U] = np.outer(d3, stretching)
    static[U, TURN] -= stretch * _skew(d3)
    static[TURN] = R @ (stretch * body_moment / K[:, None] + np.outer(k, stretching))
    static[MOMENT] = _skew(force) @ static[U]
    static[MOMENT, FORCE] -= stretch * _skew(d3)
    mass, disc = section.mass / section.length, section.disc_radius**2 / 4
    across = section.added / section.length * (np.eye(3) - np.outer(d3, d3))
    moving[FORCE, U] = -(mass * np.eye(3) + across)
    moving[MOMENT, TURN] = -mass * disc * (np.eye(3) + np.outer(d3, d3))
    return static, moving


def _joined(A: Array, B: Array, first: int, clamped: bool) -> None:
    """The rows at the start of a section: it goes on where the one before it ended, or is held."""
    rows = slice(first, first + 12)
    A[rows], B[rows] = 0.0, 0.0
    if clamped:
        A[0:6, 0:6] = np.eye(6)  # six more rows are the tip's
        return
    A[rows, rows] = np.eye(12)
    A[rows, first - 12 : first] = -np.eye(12)


def _at_tip(A: Array, B: Array, tip: _Tip, d3: Array) -> None:
    """Six rows at the tip, in the place of those that the clamped base leaves over."""
    end, disc = len(A) - 12, tip.mass * tip.radius**2 / 4
    A[6:12, end + 6 : end + 12] = np.eye(6)
    B[6:9, end : end + 3] = tip.mass * np.eye(3)
    B[9:12, end + 3 : end + 6] = disc * (np.eye(3) + np.outer(d3, d3))


def _skew(v: Array) -> Array:
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
