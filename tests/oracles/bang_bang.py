"""Least time of a linear system with one bounded input: bang-bang, by exact switching times.

dx/dt = A x + b u + c, low <= u <= high, from `start` exactly to `end`. A linear program, convex
and so without local optima, finds for a trial time the smallest input range that gets there; the
time at which that is the range allowed shows how often and roughly when u switches. The durations
then solve the boundary conditions by matrix exponentials, no mesh left. Pontryagin's principle is
necessary and sufficient here: `BangBang.switching` is his function, for tests to look at.

`elongation_swing` is an arm for which that is the exact answer: it can only stretch, which makes
its equation of motion linear at any size of motion, and its three units are driven alike.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import expm
from scipy.optimize import brentq, least_squares, linprog

from softmpc.model.actuation import Actuation, PressureDrive
from softmpc.model.effects import Payload
from softmpc.model.model import build
from softmpc.model.parameters import Manipulator
from softmpc.model.presets import chen2022
from softmpc.model.scene import Scene, default_effects

Array = NDArray[np.float64]

CELLS = 240  # of the linear program,
FINEST = 1e-4  # the last this much shorter than the first: fast modes come to rest at the end
EXACT = 1e-9  # scaled error at the end


@dataclass(frozen=True)
class Linear:
    """dx/dt = A x + b u + c with low <= u <= high."""

    A: Array
    b: Array
    low: float
    high: float
    c: Array | float = 0.0

    def after(self, x: Array, u: float, duration: float) -> Array:
        """The state a while later under a constant input."""
        rate = np.zeros((len(x) + 1,) * 2)
        rate[:-1, :-1], rate[:-1, -1] = self.A, self.b * u + self.c
        return np.asarray((expm(rate * duration) @ np.append(x, 1.0))[:-1])

    def at_rest(self, u: float) -> Array:
        """The state that a constant input holds."""
        return np.asarray(np.linalg.solve(self.A, -(self.b * u + self.c)))


@dataclass(frozen=True)
class BangBang:
    """The motion of least time: `inputs[i]` acts from the i-th switch (the start) to the next."""

    system: Linear
    time: float
    switches: Array  # s
    inputs: Array  # one more than switches
    miss: float  # scaled error at the end

    def input(self, t: ArrayLike) -> Array:
        """The input at times (s)."""
        return np.asarray(self.inputs[np.searchsorted(self.switches, t)])

    def states(self, start: ArrayLike, times: ArrayLike) -> Array:
        """States at increasing times (s), a row each."""
        x, now, found = np.asarray(start, float), 0.0, []
        for t in np.asarray(times, float):
            while np.any(inside := (self.switches > now) & (self.switches < t)):
                to = self.switches[inside][0]
                x, now = self.system.after(x, float(self.input((now + to) / 2)), to - now), to
            x, now = self.system.after(x, float(self.input((now + t) / 2)), t - now), float(t)
            found.append(x)
        return np.array(found)

    def switching(self, times: ArrayLike) -> Array:
        """Pontryagin's σ(t) = ηᵀ exp(A (T - t)) b: u is high where it is positive, low elsewhere.

        η is what the columns at the switches leave: unique if there are as many as states less one.
        """
        system = self.system
        columns = [expm(system.A * (self.time - t)) @ system.b for t in self.switches]
        size = np.abs(columns).max(axis=0)
        eta = np.linalg.svd((np.array(columns) / size).T)[0][:, -1] / size
        values = np.array([eta @ expm(system.A * (self.time - t)) @ system.b for t in times])
        middle = self.switches[-1] / 2 + self.time / 2
        up = eta @ expm(system.A * (self.time - middle)) @ system.b > 0
        return values if up == (self.inputs[-1] == system.high) else -values


def least_time(system: Linear, start: ArrayLike, end: ArrayLike, longest: float) -> BangBang:
    """The motion of least time from `start` to `end`; `longest` (s) is surely enough."""
    begin, goal = np.asarray(start, float), np.asarray(end, float)

    rough = _shortest(system, begin, goal, longest, _cells())
    _, values, scale = _smallest_range(system, begin, goal, rough * _cells())
    signs, durations = _arcs(values, rough * _cells())
    inputs = np.where(np.array(signs) > 0, system.high, system.low)

    def off(logarithms: Array) -> Array:
        spans, x = np.exp(logarithms), begin
        for u, span in zip(inputs, spans, strict=True):
            x = system.after(x, float(u), float(span))
        error = (x - goal) / scale
        if len(inputs) <= len(goal):
            return error
        # More switches than the end conditions fix: the adjoint vanishes at all of them.
        left = np.cumsum(spans[::-1])[:-1]
        columns = np.array([expm(system.A * t) @ system.b for t in left]) / scale
        columns /= np.linalg.norm(columns, axis=1)[:, None]
        return np.concatenate([error, columns @ np.linalg.svd(columns.T)[0][:, -1]])

    found = least_squares(off, np.log(durations), "3-point", xtol=1e-15, ftol=1e-15, gtol=1e-15)
    spans, miss = np.exp(found.x), float(np.abs(found.fun).max())
    if miss > EXACT:
        raise RuntimeError(f"the switching times miss the end by {miss:.2g}; {len(spans)} arcs")
    times = np.cumsum(spans)
    return BangBang(system, float(times[-1]), times[:-1], inputs, miss)


def held_least_time(
    system: Linear,
    start: ArrayLike,
    end: ArrayLike,
    longest: float,
    pieces: int,
    band: ArrayLike = 0.0,
) -> float:
    """The least time (s) of inputs held on so many equal pieces: what a mesh costs, exactly.

    Each state may end within `band` (one a state, in its unit) of where it should.
    """
    begin, goal = np.asarray(start, float), np.asarray(end, float)
    return _shortest(system, begin, goal, longest, np.full(pieces, 1 / pieces), band)


def _shortest(
    system: Linear, begin: Array, goal: Array, longest: float, cells: Array, band: ArrayLike = 0.0
) -> float:
    """The time at which the smallest range of u is the one allowed."""

    def excess(time: float) -> float:
        return _smallest_range(system, begin, goal, time * cells, band)[0] - 1.0

    return float(brentq(excess, 1e-3 * longest, longest, rtol=1e-7))


def _cells() -> Array:
    """Durations of the program's cells over the whole time."""
    lengths = np.geomspace(1.0, FINEST, CELLS // 3)
    whole = np.concatenate([np.ones(CELLS - len(lengths)), lengths])
    return np.asarray(whole / whole.sum())


def _smallest_range(
    system: Linear, begin: Array, goal: Array, cells: Array, band: ArrayLike = 0.0
) -> tuple[float, Array, Array]:
    """Smallest range of u over the one allowed, u/range in each cell, and sizes of the states."""
    mean, radius = (system.high + system.low) / 2, (system.high - system.low) / 2
    left, columns, n = np.eye(len(begin)), [], len(begin)
    for cell in cells[::-1]:
        rate = np.zeros((n + 1, n + 1))
        rate[:n, :n], rate[:n, n] = system.A, system.b * radius
        whole = expm(rate * cell)
        columns.append(left @ whole[:n, n])
        left = left @ whole[:n, :n]
    rows = np.array(columns[::-1]).T
    scale = np.abs(rows).sum(axis=1)
    missing = (goal - system.after(begin, mean, float(cells.sum()))) / scale
    rows, room = rows / scale[:, None], np.broadcast_to(np.asarray(band, float) / scale, n)
    one = np.eye(len(cells))  # u = p - m with p, m >= 0, p + m <= range; then errors of the end
    rows = np.hstack([rows, -rows, np.zeros((n, 1)), np.eye(n)])
    highest = np.hstack([one, one, -np.ones((len(cells), 1)), np.zeros((len(cells), n))])
    price = np.zeros(rows.shape[1])
    price[2 * len(cells)] = 1.0
    bounds = [(0.0, None)] * (2 * len(cells) + 1) + [(-r, r) for r in room]
    found = linprog(price, highest, np.zeros(len(cells)), rows, missing, bounds, method="highs")
    if found.status != 0:
        raise RuntimeError(f"the linear program ended with: {found.message}")
    plus, minus, smallest = np.split(found.x[: 2 * len(cells) + 1], [len(cells), 2 * len(cells)])
    return float(smallest[0]), (plus - minus) / smallest[0], np.asarray(scale)


def _arcs(values: Array, lengths: Array) -> tuple[list[int], Array]:
    """Signs and durations of arcs of ±1 with the same sums as `values` in -1 … 1."""
    signs: list[int] = []
    spans: list[float] = []

    def add(sign: int, span: float) -> None:
        if span <= 1e-12:
            return
        if signs and signs[-1] == sign:
            spans[-1] += span
        else:
            signs.append(sign)
            spans.append(span)

    full = np.abs(values) > 1 - 1e-6
    for i, (value, length) in enumerate(zip(values, lengths, strict=True)):
        if full[i]:
            add(int(np.sign(value)), length)
            continue
        before = signs[-1] if signs else -int(np.sign(values[full][0]))
        share = (1 + before * value) / 2
        add(before, share * length)
        add(-before, (1 - share) * length)
    return signs, np.array(spans)


class Swing(NamedTuple):
    """A swing of least time, between rests that equal inputs hold, and what it is made of."""

    scene: Scene
    start: Array  # inputs of all units: Pa, or N·m
    end: Array
    time: float  # s, the least
    switches: Array  # s
    motion: BangBang
    states: tuple[Array, Array]  # of the linear system: (ε, dε/dt, drive of one unit)
    heights: tuple[float, float]  # z of the tip at both ends, m


def elongation_swing(
    actuation: Actuation | None = None, load: float = 5.0, shares: tuple[float, float] = (0.3, 0.7)
) -> Swing:
    """One section of the paper's arm with a load (kg), which may only stretch.

    All units go from one share of the input's range to another, and are driven alike between:
    they are equal, and what is best for their sum is full input for each.
    """
    arm = Manipulator(name="stretching arm", sections=chen2022().sections[:1])
    effects = (*default_effects(("epsilon",)), Payload(mass=load))
    drive = actuation or PressureDrive()
    scene = Scene(arm, strains=("epsilon",), effects=effects, actuation=drive)
    system = stretching(scene, load)
    inputs = system.low + np.array(shares) * (system.high - system.low)
    start, end = (system.at_rest(u) for u in inputs)
    motion = least_time(system, start, end, 1.0)
    length = arm.sections[0].length
    return Swing(
        scene,
        np.full(arm.units, inputs[0]),
        np.full(arm.units, inputs[1]),
        motion.time,
        motion.switches,
        motion,
        (start, end),
        (length * (1 + float(start[0])), length * (1 + float(end[0]))),
    )


def stretching(scene: Scene, load: float) -> Linear:
    """The arm that can only stretch, by hand, with one unit's drive before it.

    Speed grows linearly along the section: its mass and drag count a third, its weight a half.
    """
    section, limits = scene.manipulator.sections[0], scene.manipulator.limits
    length, units, gravity = section.length, section.units, 9.81
    mass = length**2 * (section.mass / 3 + load)
    stiff = length * units * section.young_modulus * section.wall_area
    damped = length**2 * section.linear_damping / 3
    damped += length * units * section.viscosity * section.wall_area
    push = length * units * section.unit_area / mass
    drive = build(scene).drive
    unit = slice(None, None, units)  # states are sorted by kind, then by unit
    a, b, out = drive.A[unit, unit], drive.B[unit, :1], drive.C[:1, unit]
    A, B = np.zeros((2 + len(a),) * 2), np.zeros(2 + len(a))
    A[0, 1], A[1, :2] = 1.0, (-stiff / mass, -damped / mass)
    A[1, 2:], A[2:, 2:] = push * out, a
    B[1], B[2:] = push * drive.D[0, 0], b.ravel()
    c = np.zeros(len(A))
    c[1] = length * gravity * (section.mass / 2 + load) / mass
    if scene.actuation.input == "pressure":
        return Linear(A, B, limits.pressure_min, limits.pressure_max, c)
    return Linear(A, B, limits.torque_min, limits.torque_max, c)
