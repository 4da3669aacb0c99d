"""Textbook answers for straight slender rods; shares no code with the package under test.

Most results are dimensionless: lengths in units of L, and loads as alpha = P L^2 / EI (dead tip
force P across the rod) or gamma = w L^3 / EI (dead weight w per length across the rod). `x`
points along the undeformed rod, `y` along the load. Vectors and rotations use the base frame of
the arm, whose undeformed axis is +z.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import solve_bvp
from scipy.optimize import brentq
from scipy.special import ellipe, ellipeinc, ellipk, ellipkinc, jn_zeros, jv

Array = NDArray[np.float64]

ROOT_TOLERANCE = 1e-14


class PlanarTip(NamedTuple):
    """Tip of a planar rod: x/L along the undeformed rod, y/L along the load, angle (rad)."""

    x: float
    y: float
    angle: float


class Pose(NamedTuple):
    """Position (m) and rotation matrix (3, 3) in the base frame."""

    position: Array
    rotation: Array


def elastica_tip_load(alpha: float) -> PlanarTip:
    """Inextensible cantilever under a dead tip force across it, alpha = P L^2 / EI > 0.

    With tip angle a, modulus m = (1 + sin a) / 2 and sin(p) = 1 / sqrt(2 m):
    sqrt(alpha) = K(m) - F(p, m),  y/L = 1 - 2 (E(m) - E(p, m)) / sqrt(alpha),
    x/L = sqrt(2 sin a / alpha) (the moment at the clamp is P x).
    """

    def lengths(angle: float) -> tuple[float, float]:
        m = (1.0 + np.sin(angle)) / 2.0
        amplitude = np.arcsin(min(1.0, 1.0 / np.sqrt(2.0 * m)))
        first = ellipk(m) - ellipkinc(amplitude, m)
        return float(first), float(ellipe(m) - ellipeinc(amplitude, m))

    root = np.sqrt(alpha)
    upper = np.pi / 2 - 1e-7
    angle = brentq(lambda a: lengths(a)[0] - root, 1e-12, upper, xtol=ROOT_TOLERANCE)
    second = lengths(angle)[1]
    return PlanarTip(
        float(np.sqrt(2.0 * np.sin(angle)) / root), float(1.0 - 2.0 * second / root), float(angle)
    )


def elastica_own_weight(gamma: float) -> PlanarTip:
    """Inextensible cantilever under its own weight across it, gamma = w L^3 / EI.

    Collocation of theta'' = -gamma (1 - s) cos(theta), theta(0) = theta'(1) = 0.
    """

    def slope(s: Array, state: Array) -> Array:
        angle = state[0]
        return np.vstack(
            (state[1], -gamma * (1.0 - s) * np.cos(angle), np.cos(angle), np.sin(angle))
        )

    def ends(base: Array, tip: Array) -> Array:
        return np.array([base[0], tip[1], base[2], base[3]])

    mesh = np.linspace(0.0, 1.0, 41)
    guess = np.vstack((mesh, 1.0 - mesh, mesh, 0.5 * mesh**2))
    found = solve_bvp(slope, ends, mesh, guess, tol=1e-10, max_nodes=50_000)
    if not found.success:
        raise RuntimeError(found.message)
    angle, _, x, y = found.y[:, -1]
    return PlanarTip(float(x), float(y), float(angle))


def cantilever_bending_frequencies(count: int) -> Array:
    """Clamped-free omega L^2 sqrt(rho A / EI): squared roots of 1 + cos(b) cosh(b) = 0."""

    def characteristic(b: float) -> float:
        return float(np.cos(b) + 1.0 / np.cosh(b))

    roots = [
        brentq(characteristic, n * np.pi, (n + 1) * np.pi, xtol=ROOT_TOLERANCE)
        for n in range(count)
    ]
    return np.asarray(roots) ** 2


def cantilever_with_end_mass(ratio: float) -> float:
    """Lowest omega L^2 sqrt(rho A / EI) with a point mass of `ratio` rho A L at the free end.

    1 + cos(b) cosh(b) = ratio b (sin(b) cosh(b) - cos(b) sinh(b)).
    """

    def characteristic(b: float) -> float:
        shear = np.sin(b) * np.cosh(b) - np.cos(b) * np.sinh(b)
        return float(1.0 + np.cos(b) * np.cosh(b) - ratio * b * shear)

    return float(brentq(characteristic, 1e-3, 2.0, xtol=ROOT_TOLERANCE) ** 2)


def cantilever_axial_frequencies(count: int) -> Array:
    """Clamped-free omega L sqrt(rho / E) = (2 n - 1) pi / 2. Torsion: E -> G."""
    return np.asarray((np.arange(count) + 0.5) * np.pi, dtype=float)


def hanging_chain_frequencies(count: int) -> Array:
    """omega sqrt(L / g) of a chain hanging from one end: zeros of J_0 over two."""
    return np.asarray(jn_zeros(0, count)) / 2.0


def column_buckling_own_weight() -> float:
    """Critical w L^3 / EI of the upright clamped-free column: (9/4) j^2, J_{-1/3}(j) = 0."""
    root = brentq(lambda z: float(jv(-1.0 / 3.0, z)), 1.0, 3.0, xtol=ROOT_TOLERANCE)
    return float(2.25 * root**2)


def column_buckling_tip_load() -> float:
    """Critical P L^2 / EI of the clamped-free column under a dead tip force: pi^2 / 4."""
    return float(np.pi**2 / 4)


def rotation_matrix(rotation_vector: ArrayLike) -> Array:
    """Rotation by |w| (rad) about w (Rodrigues)."""
    w = np.asarray(rotation_vector, dtype=float)
    angle = float(np.linalg.norm(w))
    if angle == 0.0:
        return np.eye(3)
    axis = _skew(w / angle)
    turn = np.sin(angle) * axis + (1.0 - np.cos(angle)) * axis @ axis
    return np.asarray(np.eye(3) + turn)


def constant_strain_arc(length: float, curvature: ArrayLike) -> Pose:
    """End of a uniform helix: deformed length (m), curvature and twist (1/m) in the body frame.

    p = l (e_z + (1 - cos a)/a  u x e_z + (1 - sin a / a)  u x (u x e_z)), a = |k| l, u = k / |k|.
    """
    k = np.asarray(curvature, dtype=float)
    size = float(np.linalg.norm(k))
    straight = np.array([0.0, 0.0, 1.0])
    if size == 0.0:
        return Pose(length * straight, np.eye(3))
    axis = _skew(k / size)
    angle = size * length
    bow = (
        2.0 * np.sin(angle / 2.0) ** 2 / angle * axis + (1.0 - np.sin(angle) / angle) * axis @ axis
    )
    position = length * (straight + bow @ straight)
    return Pose(np.asarray(position), rotation_matrix(length * k))


def drive_arc(
    length: float,
    axial_force: float,
    moment: ArrayLike,
    axial_stiffness: float,
    stiffness: ArrayLike,
) -> Pose:
    """Weightless rod under an axial force (N) and a body-fixed moment (N m), both uniform.

    K k = moment and n E A_s eps = force + 1/2 k.Kk, so the rod is an arc of length
    (1 + eps) L. Also holds for a dead tip moment along the axis, or across it in a plane.

    Args:
        length: undeformed (m).
        axial_force: stretching (N).
        moment: body frame (N m).
        axial_stiffness: n E A_s (N).
        stiffness: diagonal of K (N m^2).
    """
    rigidity = np.asarray(stiffness, dtype=float)
    curvature = np.asarray(moment, dtype=float) / rigidity
    energy = 0.5 * float(curvature @ (rigidity * curvature))
    stretch = 1.0 + (axial_force + energy) / axial_stiffness
    return constant_strain_arc(stretch * length, curvature)


def _skew(v: Array) -> Array:
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
