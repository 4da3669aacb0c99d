"""Reference solution: an extensible, unshearable Kirchhoff rod with distributed weight.

Shares no code with the package under test. All quantities are SI; the base frame has the base
at the origin and the undeformed arm along +z. `S` (m) is the arclength of the undeformed rod,
`R = [d1 d2 d3]` its orientation, `eps` the stretch minus one, `k` (1/m, body frame) the
curvature per *deformed* length, and `w = (1 + eps) k` (1/m) the same per undeformed length:

    r' = (1 + eps) d3,    R' = R skew(w)

Energy and drive, per undeformed length (J/m):

    U = 1/2 n E A_s eps^2 + 1/2 (1 + eps) k.Kk  =  1/2 n E A_s eps^2 + 1/2 w.Kw / (1 + eps)
    W = sum_j P_j A_d (1 + eps + w_x rho_jy - w_y rho_jx)
    K = diag(E pi r_b^4 / 4, E pi r_b^4 / 4, G pi r_b^4 / 2)

The internal power is `n.d3 eps_dot + (R^T m).w_dot`, so with U - W in the variables (eps, w):

    n.d3  = n E A_s eps - 1/2 k.Kk - A_d sum_j P_j
    R^T m = K k - A_d sum_j P_j (rho_jy, -rho_jx, 0)

(Holding k instead of w gives `Q_eps = n E A_s eps + 1/2 k.Kk` and `Q_k = (1 + eps) K k`: the same
law, because `R^T m . w_dot = (1 + eps) R^T m . k_dot + k . R^T m eps_dot`.) The balance is

    n' + (mass / length) g = 0,    m' + r' x n = 0,    n(L) = F,  m(L) = M (dead, base frame)

`n(S)` follows from the load alone, so only the three components of m(0) have to be shot for.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import solve_ivp

Array = NDArray[np.float64]

RELATIVE_TOLERANCE = 1e-11
ABSOLUTE_TOLERANCE = 1e-13
SMALLEST_STEP = 1e-4
NEWTON_ITERATIONS = 12


class RodError(RuntimeError):
    """No equilibrium was found on the load path."""


@dataclass(frozen=True)
class RodSection:
    """One section of the rod: uniform, straight and unstretched without load.

    Lengths in m, moduli in Pa, areas in m^2 (of one unit), mass in kg, angles in rad.
    """

    length: float
    young_modulus: float
    shear_modulus: float
    bending_radius: float
    unit_offset: float
    unit_area: float
    wall_area: float
    mass: float
    unit_angles: tuple[float, ...]

    @property
    def axial_stiffness(self) -> float:
        """`n E A_s` (N) of all units together."""
        return len(self.unit_angles) * self.young_modulus * self.wall_area

    @property
    def stiffness(self) -> Array:
        """Diagonal of K (N m^2): bending, bending, twist."""
        fourth = np.pi * self.bending_radius**4
        bending = self.young_modulus * fourth / 4
        return np.array([bending, bending, self.shear_modulus * fourth / 2])

    def drive(self, pressures: Array) -> tuple[float, Array]:
        """Axial force `A_d sum P` (N) and body moment (N m) that the pressures (Pa) exert."""
        thrust = self.unit_area * pressures
        angles = np.asarray(self.unit_angles, dtype=float)
        moment_x = self.unit_offset * float(thrust @ np.sin(angles))
        moment_y = -self.unit_offset * float(thrust @ np.cos(angles))
        return float(thrust.sum()), np.array([moment_x, moment_y, 0.0])


@dataclass(frozen=True)
class RodSolution:
    """An equilibrium of the rod; vectors in the base frame.

    Attributes:
        section_tips: position (m) of the end of every section, (n, 3).
        section_rotations: orientation of the end of every section, (n, 3, 3).
        base_force: internal force n(0) (N): what the arm exerts on its base.
        base_moment: internal moment m(0) (N m), likewise.
        residual: largest component of m(L) - M (N m).
        moment_jacobian: d m(L) / d m(0), (3, 3). Its determinant is 1 without load; at zero the
            equilibrium loses its uniqueness (buckling).
    """

    section_tips: Array
    section_rotations: Array
    base_force: Array
    base_moment: Array
    residual: float
    moment_jacobian: Array

    @property
    def tip(self) -> Array:
        """Position (m) of the tip of the last section."""
        return np.asarray(self.section_tips[-1])

    @property
    def tip_rotation(self) -> Array:
        """Orientation of the tip of the last section, (3, 3)."""
        return np.asarray(self.section_rotations[-1])


@dataclass(frozen=True)
class _Load:
    pressures: tuple[Array, ...]
    gravity: Array
    tip_force: Array
    tip_moment: Array

    def scaled(self, factor: float) -> _Load:
        return _Load(
            tuple(factor * pressure for pressure in self.pressures),
            factor * self.gravity,
            factor * self.tip_force,
            factor * self.tip_moment,
        )


@dataclass(frozen=True)
class _Shot:
    ends: Array  # (sections, 15): r, R row by row, m
    residual: Array
    jacobian: Array


def _slope(section: RodSection, drive: tuple[float, Array], force: Array, state: Array) -> Array:
    """Derivative by S of `state` (15, copies) = (r, R row by row, m) at internal force n (N)."""
    rotation = state[3:12].reshape(3, 3, -1)
    moment = state[12:15]
    axial_drive, moment_drive = drive
    stiffness = section.stiffness[:, None]
    body_moment = (rotation * moment[:, None, :]).sum(axis=0)
    curvature = (body_moment + moment_drive[:, None]) / stiffness
    tension = (force[:, None] * rotation[:, 2, :]).sum(axis=0) + axial_drive
    bending_energy = 0.5 * (stiffness * curvature**2).sum(axis=0)
    stretch = 1.0 + (tension + bending_energy) / section.axial_stiffness
    if not np.all(stretch > 0.0):
        raise RodError("the rod is crushed to nothing")
    w = stretch * curvature
    tangent = stretch * rotation[:, 2, :]
    turned = np.cross(rotation, w[None], axis=1)  # rows of R skew(w)
    torque = np.cross(tangent, force[:, None], axis=0)
    return np.concatenate((tangent, turned.reshape(9, -1), -torque))


def _cross_section(section: RodSection, pressure: Array, load: Array, state: Array) -> Array:
    """Integrate one section; `load` (2, 3) is n at its end and its weight (N)."""
    drive = section.drive(pressure)
    end_force, weight = load

    def slope(s: float, flat: Array) -> Array:
        force = end_force + (1.0 - s / section.length) * weight
        return _slope(section, drive, force, flat.reshape(15, -1)).ravel()

    path = solve_ivp(
        slope,
        (0.0, section.length),
        state.ravel(),
        method="DOP853",
        rtol=RELATIVE_TOLERANCE,
        atol=ABSOLUTE_TOLERANCE,
    )
    if not path.success or not np.all(np.isfinite(path.y[:, -1])):
        raise RodError(f"integration failed: {path.message}")
    return np.asarray(path.y[:, -1]).reshape(15, -1)


def _end_forces(sections: Sequence[RodSection], load: _Load) -> list[Array]:
    """Rows (n at the end of the section, weight of the section), both in N."""
    forces = []
    force = load.tip_force
    for section in reversed(sections):
        weight = section.mass * load.gravity
        forces.append(np.stack((force, weight)))
        force = force + weight
    return forces[::-1]


def _shoot(sections: Sequence[RodSection], load: _Load, base_moment: Array, scale: float) -> _Shot:
    """Integrate from base to tip, with three copies at a shifted base moment for the Jacobian."""
    shift = 1e-6 * scale
    state = np.zeros((15, 4))
    state[3:12] = np.eye(3).reshape(9, 1)
    state[12:15] = base_moment[:, None] + np.hstack((np.zeros((3, 1)), shift * np.eye(3)))
    ends = []
    forces = _end_forces(sections, load)
    for section, pressure, force in zip(sections, load.pressures, forces, strict=True):
        state = _cross_section(section, pressure, force, state)
        ends.append(state[:, 0])
    tip_moments = state[12:15]
    residual = tip_moments[:, 0] - load.tip_moment
    return _Shot(np.array(ends), residual, (tip_moments[:, 1:] - tip_moments[:, :1]) / shift)


def _newton(
    sections: Sequence[RodSection], load: _Load, base_moment: Array, scale: float, accuracy: float
) -> tuple[Array, _Shot] | None:
    """Base moment with |residual| <= accuracy * scale, or None when Newton does not get there."""
    moment = base_moment
    last = np.inf
    for _ in range(NEWTON_ITERATIONS):
        try:
            shot = _shoot(sections, load, moment, scale)
        except RodError:
            return None
        size = float(np.abs(shot.residual).max())
        if size <= accuracy * scale:
            return moment, shot
        if size > 10.0 * last:
            return None
        last = size
        moment = moment - np.linalg.solve(shot.jacobian, shot.residual)
    return None


def _moment_scale(sections: Sequence[RodSection]) -> float:
    """A bending moment (N m) that turns the whole arm by about one radian."""
    return float(1.0 / sum(section.length / section.stiffness[0] for section in sections))


def _follow(sections: Sequence[RodSection], load: _Load, steps: int) -> tuple[Array, _Shot]:
    """Raise all loads together from zero, halving the increment wherever Newton fails."""
    scale = _moment_scale(sections)
    path = [(0.0, np.zeros(3))]
    step = 1.0 / steps
    while True:
        at, moment = path[-1]
        target = at + step if at + step < 1.0 - 1e-9 else 1.0
        guess = moment
        if len(path) > 1:
            before, old = path[-2]
            guess = moment + (target - at) / (at - before) * (moment - old)
        accuracy = 1e-10 if target == 1.0 else 1e-5
        found = _newton(sections, load.scaled(target), guess, scale, accuracy)
        if found is not None and target == 1.0:
            return found
        if found is not None:
            path.append((target, found[0]))
            continue
        step *= 0.5
        if step < SMALLEST_STEP:
            raise RodError(f"no equilibrium beyond {at:.4f} of the load; try more steps")


def _split(sections: Sequence[RodSection], pressures: Iterable[float]) -> tuple[Array, ...]:
    """Pressures (Pa) section by section."""
    flat = np.asarray(list(pressures), dtype=float)
    counts = [len(section.unit_angles) for section in sections]
    if flat.shape != (sum(counts),):
        raise ValueError(f"got {flat.size} pressures for {sum(counts)} units")
    return tuple(np.split(flat, np.cumsum(counts)[:-1]))


def _vector(values: ArrayLike) -> Array:
    return np.asarray(values, dtype=float).reshape(3)


def solve_rod(
    sections: Sequence[RodSection],
    pressures: Iterable[float],
    gravity: ArrayLike = (0.0, 0.0, 9.81),
    tip_force: ArrayLike = (0.0, 0.0, 0.0),
    tip_moment: ArrayLike = (0.0, 0.0, 0.0),
    steps: int = 4,
) -> RodSolution:
    """Equilibrium of the rod on the load path that starts at the straight arm.

    Args:
        sections: from base to tip.
        pressures: of all units, section by section (Pa).
        gravity: acceleration in the base frame (m/s^2).
        tip_force: dead force in the base frame (N).
        tip_moment: dead moment in the base frame (N m).
        steps: number of load increments to start with; they are halved where Newton fails.

    Raises:
        RodError: the path could not be followed to the full load.
    """
    load = _Load(
        _split(sections, pressures), _vector(gravity), _vector(tip_force), _vector(tip_moment)
    )
    base_moment, shot = _follow(sections, load, steps)
    return RodSolution(
        section_tips=shot.ends[:, :3],
        section_rotations=shot.ends[:, 3:12].reshape(-1, 3, 3),
        base_force=_end_forces(sections, load)[0].sum(axis=0),
        base_moment=base_moment,
        residual=float(np.abs(shot.residual).max()),
        moment_jacobian=shot.jacobian,
    )
