"""Forces on bodies at the section ends of an arm, from written-out energies and finite differences.

Shares no code with the package under test. One segment a section with strains (ε, kx, ky, kz) of
`lengths` (m) at rest; bodies sit at the ends of the sections. Velocities are J q̇ with J by central
differences, and Euler-Lagrange's equation is differentiated numerically, so nothing here knows how
a force is passed from body to body. Results are generalised forces on the strains (J): what the
bodies need, the sign of M q̈.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from oracles.closed_forms import constant_strain_arc

Array = NDArray[np.float64]
Weighing = Callable[[Array, list[Array], list[Array]], list[Array]]  # q, places, rotations

STEP = 2e-3  # of the strains' size; sixth-order differences


def section_ends(lengths: Sequence[float], q: Array) -> tuple[list[Array], list[Array]]:
    """Places (m) and orientations of the section ends, base frame."""
    place, rotation = np.zeros(3), np.eye(3)
    places, rotations = [], []
    for length, strains in zip(lengths, q.reshape(-1, 4), strict=True):
        arc = constant_strain_arc(length * (1 + strains[0]), strains[1:])
        place = place + rotation @ arc.position
        rotation = rotation @ arc.rotation
        places.append(place)
        rotations.append(rotation)
    return places, rotations


def slope(function: Callable[[Array], Array], at: Array, scale: Array) -> Array:
    """Derivatives by central differences of sixth order, along a new last axis."""
    columns = []
    for j, h in enumerate(STEP * scale):
        shift = np.zeros(len(at))
        shift[j] = h
        pairs = [
            np.asarray(function(at + m * shift)) - np.asarray(function(at - m * shift))
            for m in (1, 2, 3)
        ]
        columns.append((45 * pairs[0] - 9 * pairs[1] + pairs[2]) / (60 * h))
    return np.stack(columns, axis=-1)


def jacobians(lengths: Sequence[float], q: Array, scale: Array) -> Array:
    """∂(section ends)/∂q, (sections, 3, strains)."""
    return slope(lambda x: np.array(section_ends(lengths, x)[0]), q, scale)


def inertia_matrix(lengths: Sequence[float], q: Array, scale: Array, weighing: Weighing) -> Array:
    """Σ Jᵀ W J, where `weighing` gives the 3×3 matrix W (kg) of each body."""
    weights = weighing(q, *section_ends(lengths, q))
    J = jacobians(lengths, q, scale)
    return np.asarray(sum(j.T @ w @ j for j, w in zip(J, weights, strict=True)))


def euler_lagrange(
    lengths: Sequence[float],
    motion: tuple[Array, Array, Array],
    scale: Array,
    weighing: Weighing,
    potential: Callable[[Array], float] | None = None,
) -> Array:
    """d/dt ∂T/∂q̇ - ∂T/∂q + ∂U/∂q for T = ½ Σ vᵀ W v."""
    q, dq, ddq = motion
    M = inertia_matrix(lengths, q, scale, weighing)
    gradient = slope(lambda x: inertia_matrix(lengths, x, scale, weighing), q, scale)
    forces = M @ ddq + (gradient @ dq) @ dq - 0.5 * np.einsum("ijk,i,j->k", gradient, dq, dq)
    if potential is not None:
        forces = forces + slope(lambda x: np.array(potential(x)), q, scale)
    return np.asarray(forces)


def on_strains(lengths: Sequence[float], q: Array, scale: Array, forces: Sequence[Array]) -> Array:
    """Σ Jᵀ F of forces (N, base frame) on the section ends."""
    J = jacobians(lengths, q, scale)
    return np.asarray(sum(j.T @ f for j, f in zip(J, forces, strict=True)))


def quadratic_drag(
    velocity: Array, tangent: Array, area: float, density: float, across: float, along: float
) -> Array:
    """Force (N) that resists: ½ ρ A (C_n |v_n| v_n + π C_t |v_t| v_t), A the projected area."""
    parallel = float(tangent @ velocity)
    normal = velocity - parallel * tangent
    return np.asarray(
        0.5
        * density
        * area
        * (
            across * float(np.linalg.norm(normal)) * normal
            + np.pi * along * abs(parallel) * parallel * tangent
        )
    )
