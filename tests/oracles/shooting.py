"""Least effort from rest to rest by single shooting: an oracle for planned motions.

min ∫ Σ_j T_j² dt over torques held on given pieces of time, from one rest state exactly to another,
within the torque limits. Of the package only laws of physics are used: the residual, its Jacobian,
M, and the matrices of the linear drive. The drive is stepped by matrix exponentials, the arm by the
classical Runge-Kutta method, both with their exact tangents. Each iteration takes the torques of
least effort among those that reach the end by the last tangent, a problem of few multipliers that
Newton's method solves on its dual. Where it stops, Pontryagin's principle holds: each torque is
Σ λ_i ∂x_i(end)/∂T over twice the length of its piece, clipped at its limits; `Effort.change` is how
far off that was. Ends are at rest with their drive, which has modes of 0.1 and 1 ms: equal pieces
longer than those must hold the last torque, and cost more than pieces that shrink.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import expm
from scipy.optimize import brentq

Array = NDArray[np.float64]

STEP = 2.5e-3  # s, longest step of the arm; the fastest mode of the paper's arm is near -520 1/s
DROPPED = 1e-5  # scaled; ends that torques of effort 1 move less than this are left to decay
FREE = 100.0  # an error of the end, scaled, costs its square over 10⁴: nothing beside an effort
FLAT = 1e-10  # keeps Newton's matrix regular where the dual is flat
STAGES = ((1, 0.0, 0), (2, 0.5, 1), (2, 0.5, 1), (1, 1.0, 2))  # weight/6, place in the step, twice


@dataclass(frozen=True)
class Rest:
    """A state that constant torques hold."""

    q: Array  # strains (n)
    torques: Array  # N·m (k)


@dataclass(frozen=True)
class Effort:
    """A motion of least effort, SI."""

    cost: float  # ∫ Σ T² dt, N²·m²·s
    times: Array  # nodes (K + 1), s
    torques: Array  # K×k, N·m, row i from times[i] to times[i + 1]
    states: Array  # (K + 1)×nx: (q, dq, z) at the nodes
    miss: float  # largest scaled error of the end state
    change: float  # largest change of a torque in the last iteration, N·m
    iterations: int


def even(duration: float, pieces: int) -> Array:
    """Nodes of equal pieces."""
    return np.linspace(0.0, duration, pieces + 1)


def graded(duration: float, longest: float, shortest: float, growth: float = 1.15) -> Array:
    """Nodes of pieces that shrink towards the end, where the drive has to come to rest as well."""
    lengths = []
    while shortest < longest:
        lengths.append(shortest)
        shortest *= growth
    left = duration - sum(lengths)
    count = int(np.ceil(left / longest))
    ends = duration - np.cumsum(lengths + [left / count] * count)
    return np.concatenate([[0.0], ends[-2::-1], [duration]])


def halved(times: Array) -> Array:
    """Nodes with every piece cut in two."""
    return np.sort(np.concatenate([times, (times[1:] + times[:-1]) / 2]))


class Shooter:
    """Motions of a model with inertia and a linear drive."""

    def __init__(self, model: Any, step: float = STEP) -> None:
        if not model.drive_is_linear or model.order != 2 or not len(model.drive.A):
            raise ValueError("the shooting oracle wants inertia and a linear drive with states")
        self.model, self.longest = model, step
        self.scale = np.asarray(model.layout.x.scale)
        self.n, self.h = model.strains, len(model.drive.A)
        self.known: dict[float, tuple[float, list[Array]]] = {}

    def rest(self, rest: Rest) -> Array:
        """The state (q, dq, z)."""
        z = np.linalg.solve(self.model.drive.A, -self.model.drive.B @ rest.torques)
        return np.concatenate([rest.q, np.zeros(self.n), z])

    def drive(self, piece: float) -> tuple[float, list[Array]]:
        """Step of a piece (s), and matrices from (z, u) to itself each half step later."""
        if piece not in self.known:
            A, B = self.model.drive.A, self.model.drive.B
            rate = np.zeros((self.h + B.shape[1],) * 2)
            rate[: self.h] = np.hstack([A, B])
            steps = int(np.ceil(piece / self.longest - 1e-9))
            half = [np.asarray(expm(rate * piece / steps * i / 2)) for i in range(2 * steps + 1)]
            self.known[piece] = piece / steps, half
        return self.known[piece]

    def rate(self, y: Array, p: Array) -> tuple[Array, Array, Array]:
        """Of y = (q, dq) at pressures p, and its Jacobians by y and by p."""
        n, model = self.n, self.model
        q, dq = y[:n], y[n:]
        held = np.asarray(model.residual(q, dq, 0, p)).ravel()
        ddq = -np.linalg.solve(np.asarray(model.M(q)), held)
        by_q, by_dq, mass, by_p = (np.asarray(b) for b in model.residual_jacobian(q, dq, ddq, p))
        slopes = -np.linalg.solve(mass, np.hstack([by_q, by_dq, by_p]))
        by_y, by_pressure = np.eye(2 * n, k=n), np.zeros((2 * n, by_p.shape[1]))
        by_y[n:], by_pressure[n:] = slopes[:, : 2 * n], slopes[:, 2 * n :]
        return np.concatenate([dq, ddq]), by_y, by_pressure

    def advance(self, x: Array, u: Array, piece: float) -> tuple[Array, Array]:
        """The state after a piece with torques u, and its Jacobian by (x, u)."""
        n2, (step, half) = 2 * self.n, self.drive(piece)
        zu, columns = np.concatenate([x[n2:], u]), len(x) + len(u)
        out = np.hstack([self.model.drive.C, self.model.drive.D])
        y, slope = x[:n2], np.eye(n2, columns)
        for i in range(0, len(half) - 1, 2):
            rate, tangent = np.zeros(n2), np.zeros((n2, columns))
            total, totals = np.zeros(n2), np.zeros((n2, columns))
            for weight, place, later in STAGES:
                by_zu = out @ half[i + later]
                at, along = y + place * step * rate, slope + place * step * tangent
                rate, by_y, by_p = self.rate(at, by_zu @ zu)
                tangent = by_y @ along
                tangent[:, n2:] += by_p @ by_zu
                total, totals = total + weight * rate, totals + weight * tangent
            y, slope = y + step / 6 * total, slope + step / 6 * totals
        after = half[-1][: self.h]
        below = np.hstack([np.zeros((self.h, n2)), after])
        return np.concatenate([y, after @ zu]), np.vstack([slope, below])

    def run(self, start: Array, torques: Array, times: Array) -> tuple[Array, Array]:
        """States at the nodes, and ∂(scaled end state)/∂(all torques)."""
        states, slopes = [start], []
        for u, piece in zip(torques, np.diff(times).round(12), strict=True):
            x, slope = self.advance(states[-1], u, float(piece))
            states.append(x)
            slopes.append(slope)
        left, columns, nx = np.diag(1 / self.scale), [], len(start)
        for slope in reversed(slopes):
            columns.append(left @ slope[:, nx:])
            left = left @ slope[:, :nx]
        return np.array(states), np.hstack(columns[::-1])


def least_effort(
    model: Any,
    start: Rest,
    end: Rest,
    times: ArrayLike,
    guess: ArrayLike | None = None,
    step: float = STEP,
    band: ArrayLike = 0.0,
    iterations: int = 60,
    tolerance: float = 1e-6,
) -> Effort:
    """The motion of least effort with torques held between nodes; `guess` (K×k) to start from.

    Each state, in its scale, may end within `band` (nx, or one number) of where it should.
    """
    shooter, nodes, k = Shooter(model, step), np.asarray(times, float), len(start.torques)
    begin, goal, pieces = shooter.rest(start), shooter.rest(end), np.diff(nodes)
    share = (nodes[1:, None] + nodes[:-1, None]) / (2 * nodes[-1])
    u = start.torques + share * (end.torques - start.torques)
    u = u if guess is None else np.asarray(guess, float)
    bands = np.broadcast_to(np.asarray(band, float), begin.shape)
    for iteration in range(1, iterations + 1):
        states, by_u = shooter.run(begin, u, nodes)
        missing = (goal - states[-1]) / shooter.scale
        for way in (1.0, 0.5, 0.25, 0.1, 0.03):
            wanted = by_u @ u.ravel() + way * missing
            better = _smallest(model, by_u, wanted, np.repeat(pieces, k), bands)
            if better is not None:
                break
        else:
            raise RuntimeError("no torques within their limits lead towards the end")
        change = float(np.abs(better - u.ravel()).max())
        if change < tolerance and way == 1.0:
            cost, miss = float(pieces @ np.sum(u**2, axis=1)), float(np.abs(missing).max())
            return Effort(cost, nodes, u, states, miss, change, iteration)
        u = better.reshape(u.shape)
    raise RuntimeError(f"torques still change by {change:.3g} N·m after {iterations} iterations")


def _smallest(model: Any, by_u: Array, wanted: Array, lengths: Array, bands: Array) -> Array | None:
    """Torques of least effort with by_u u = wanted, to within bands; None if there are none."""
    limits, root = model.scene.manipulator.limits, np.sqrt(lengths)  # effort: a sum of squares
    errors, room = FREE * np.eye(len(wanted))[:, bands > 0], bands[bands > 0] / FREE
    low = np.append(limits.torque_min * root, -room)
    high = np.append(limits.torque_max * root, room)
    found = shortest(np.hstack([by_u / root, errors]), wanted, low, high)
    return None if found is None else found[: len(root)] / root


def shortest(rows: Array, values: Array, low: Array, high: Array) -> Array | None:
    """The shortest v with rows v = values and low <= v <= high; None if there seems to be none.

    v = clip(rowsᵀ λ), with λ by Newton's method on the concave dual, as far along each step as the
    dual rises. Directions of the rows that no v moves are left out.
    """
    left, size, right = np.linalg.svd(rows, full_matrices=False)
    kept = size > DROPPED
    right, b = right[kept], (left.T @ values)[kept] / size[kept]
    enough = 1e-11 * max(1.0, float(np.abs(b).max()))
    multipliers = b

    def off(at: Array) -> Array:
        return np.asarray(right @ np.clip(right.T @ at, low, high) - b)

    for _ in range(100):
        now, v = off(multipliers), right.T @ multipliers
        if float(np.abs(now).max()) < enough:
            return np.clip(v, low, high)
        free = right[:, (v > low) & (v < high)]
        step = -np.linalg.solve(free @ free.T + FLAT * np.eye(len(b)), now)
        length = _top(lambda share, at=multipliers, step=step: -step @ off(at + share * step))
        if length is None:
            return None
        multipliers = multipliers + length * step
    return None


def _top(slope: Callable[[float], float]) -> float | None:
    """Where a falling slope, positive at 0, is zero; None if it never is."""
    far = 1.0
    while slope(far) > 0:
        far *= 8
        if far > 1e9:
            return None
    return float(brentq(slope, 0.0, far, rtol=1e-12)) if slope(0.0) > 0 else 1.0
