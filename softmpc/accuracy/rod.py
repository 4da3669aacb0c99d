"""Reference solution: an extensible, unshearable Kirchhoff rod with distributed weight.

Shares no code with the model. All quantities are SI; the base frame has the base
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
A section that is not `coupled` lacks the term -1/2 k.Kk: the paper's law, which has no energy.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import solve_ivp

from softmpc.accuracy.rod_parts import (
    Array,
    RodError,
    RodLoad,
    RodSection,
    RodSolution,
    by_section,
)

__all__ = ["RodError", "RodLoad", "RodSection", "RodSolution", "rod_along", "solve_rod"]

TOLERANCE = 1e-11  # of the integration along the rod, relative
SMALLEST_STEP = 1e-4
NEWTON_ITERATIONS = 12


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
    if section.coupled:
        tension = tension + 0.5 * (stiffness * curvature**2).sum(axis=0)
    stretch = 1.0 + tension / section.axial_stiffness
    if not np.all(stretch > 0.0):
        raise RodError("the rod is crushed to nothing")
    w = stretch * curvature
    tangent = stretch * rotation[:, 2, :]
    turned = np.cross(rotation, w[None], axis=1)  # rows of R skew(w)
    torque = np.cross(tangent, force[:, None], axis=0)
    return np.concatenate((tangent, turned.reshape(9, -1), -torque))


def _cross_section(
    section: RodSection,
    pressure: Array,
    load: Array,
    state: Array,
    tolerance: float,
    places: Array | None = None,
) -> Array:
    """Integrate one section; `load` (2, 3) is n at its end and its weight (N).

    Returns the state at its end (15, copies), or at `places` (15, copies, places).
    """
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
        t_eval=places,
        rtol=tolerance,
        atol=tolerance / 100,
    )
    if not path.success or not np.all(np.isfinite(path.y[:, -1])):
        raise RodError(f"integration failed: {path.message}")
    if places is not None:
        return np.asarray(path.y).reshape(15, -1, len(places))
    return np.asarray(path.y[:, -1]).reshape(15, -1)


def _start(base_moments: Array) -> Array:
    """State at the base (15, copies) for some base moments (3, copies)."""
    state = np.zeros((15, base_moments.shape[1]))
    state[3:12] = np.eye(3).reshape(9, 1)
    state[12:15] = base_moments
    return state


def _shoot(
    sections: Sequence[RodSection],
    load: RodLoad,
    base_moment: Array,
    scale: float,
    tolerance: float,
) -> _Shot:
    """Integrate from base to tip, with three copies at a shifted base moment for the Jacobian."""
    shift = 1e-6 * scale
    state = _start(base_moment[:, None] + np.hstack((np.zeros((3, 1)), shift * np.eye(3))))
    ends = []
    forces = load.forces(sections)
    for section, pressure, force in zip(sections, load.pressures, forces, strict=True):
        state = _cross_section(section, pressure, force, state, tolerance)
        ends.append(state[:, 0])
    tip_moments = state[12:15]
    residual = tip_moments[:, 0] - load.tip_moment
    return _Shot(np.array(ends), residual, (tip_moments[:, 1:] - tip_moments[:, :1]) / shift)


def rod_along(
    sections: Sequence[RodSection], found: RodSolution, places: Array
) -> list[tuple[Array, Array]]:
    """State and force along each section of an equilibrium.

    `places` are shares of a section's length, rising to 1. A section has its state (15, places),
    which is r (m), R row by row and m (N·m), and the internal force n (3, places; N).
    """
    state, fields = _start(found.base_moment[:, None]), []
    load = found.load
    for section, pressure, force in zip(
        sections, load.pressures, load.forces(sections), strict=True
    ):
        at = places * section.length
        path = _cross_section(section, pressure, force, state, TOLERANCE, at)[:, 0]
        state = path[:, -1:]
        end, weight = force[:, :, None]
        fields.append((path, end + (1.0 - places) * weight))
    return fields


def _newton(
    sections: Sequence[RodSection],
    load: RodLoad,
    base_moment: Array,
    accuracy: float,
    tolerance: float,
) -> tuple[Array, _Shot] | None:
    """Base moment with the small residual asked for, or None when Newton does not get there.

    `accuracy` is relative to a moment that bends the whole arm.
    """
    scale = _moment_scale(sections)
    moment = base_moment
    last = np.inf
    for _ in range(NEWTON_ITERATIONS):
        try:
            shot = _shoot(sections, load, moment, scale, tolerance)
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
    """A bending moment (N·m) that turns the whole arm by about one radian."""
    return float(1.0 / sum(section.length / section.stiffness[0] for section in sections))


def _follow(
    sections: Sequence[RodSection], load: RodLoad, steps: int, tolerance: float
) -> tuple[Array, _Shot]:
    """Raise all loads together from zero, halving the increment wherever Newton fails."""
    path = [(0.0, np.zeros(3))]
    step = 1.0 / steps
    while True:
        at, moment = path[-1]
        target = at + step if at + step < 1.0 - 1e-9 else 1.0
        guess = moment
        if len(path) > 1:
            before, old = path[-2]
            guess = moment + (target - at) / (at - before) * (moment - old)
        accuracy = 10 * tolerance if target == 1.0 else 1e-5
        found = _newton(sections, load.scaled(target), guess, accuracy, tolerance)
        if found is not None and target == 1.0:
            return found
        if found is not None:
            path.append((target, found[0]))
            continue
        step *= 0.5
        if step < SMALLEST_STEP:
            raise RodError(f"no equilibrium beyond {at:.4f} of the load; try more steps")


def _vector(values: ArrayLike) -> Array:
    return np.asarray(values, dtype=float).reshape(3)


def solve_rod(
    sections: Sequence[RodSection],
    pressures: Iterable[float],
    gravity: ArrayLike = (0.0, 0.0, 9.81),
    tip_force: ArrayLike = (0.0, 0.0, 0.0),
    tip_moment: ArrayLike = (0.0, 0.0, 0.0),
    steps: int = 4,
    tolerance: float = TOLERANCE,
) -> RodSolution:
    """Equilibrium of the rod on the load path that starts at the straight arm.

    Args:
        sections: from base to tip.
        pressures: of all units, section by section (Pa).
        gravity: acceleration in the base frame (m/s²).
        tip_force: dead force in the base frame (N); the weight of a load at the tip is one.
        tip_moment: dead moment in the base frame (N·m).
        steps: number of load increments to start with; they are halved where Newton fails.
        tolerance: of the integration along the rod, relative.

    Raises:
        RodError: the path could not be followed to the full load.
        InputError: not one pressure a unit.
    """
    load = RodLoad(by_section(sections, pressures), *map(_vector, (gravity, tip_force, tip_moment)))
    base_moment, shot = _follow(sections, load, steps, tolerance)
    return RodSolution(
        section_tips=shot.ends[:, :3],
        section_rotations=shot.ends[:, 3:12].reshape(-1, 3, 3),
        base_force=load.forces(sections)[0].sum(axis=0),
        base_moment=base_moment,
        residual=float(np.abs(shot.residual).max()),
        moment_jacobian=shot.jacobian,
        load=load,
    )
