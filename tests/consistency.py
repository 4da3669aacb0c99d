"""Monte Carlo runs of the estimator: errors and innovations normalised by what it says of them.

The truth without mismatch is the model that the filter believes in, integrated by another method
from another form of its equations in far smaller steps, and pushed at the ends of the filter's
steps by noise drawn with the filter's covariances. Initial errors are drawn from its spread.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import casadi as ca
import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.stats import chi2

from softmpc.compiled import compiled
from softmpc.control.buffered import Buffered
from softmpc.control.closed_loop import Start, start_at
from softmpc.control.discretise import held_input
from softmpc.control.state_map import StateMap
from softmpc.estimation.estimator import Estimator
from softmpc.estimation.process import Process, ProcessNoise, Spread
from softmpc.estimation.sensing import Sample, Sensing
from softmpc.estimation.sensors import TICK, SectionTips, Sensor, UnitPressures
from softmpc.model.disturbance import Disturbance
from softmpc.model.model import build
from softmpc.model.payload import Payload
from softmpc.model.presets import chen2022
from softmpc.model.scene import Scene
from softmpc.simulation.idas import Idas
from softmpc.statics.equilibrium import find_equilibrium

Array = np.ndarray
CONTROL = 25  # ticks, of an input
PRESSURES = [3e5, 1e5, 0, 2e5, 0, 4e5]
SENSORS: tuple[Sensor, ...] = (SectionTips(latency=0.01), UnitPressures())


@dataclass
class Runs:
    """Normalised squares of many runs: one row a run, one column a time."""

    whole: list[list[float]] = field(default_factory=list)  # of (x, d)
    state: list[list[float]] = field(default_factory=list)  # of x
    by_sensor: list[list[list[float]]] = field(default_factory=list)
    tips: list[float] = field(default_factory=list)  # mm, RMS of a run
    refused: int = 0


@dataclass(frozen=True)
class Line:
    """A row of the table: how the mean over runs lies in its 95 % band, along time."""

    name: str
    mean: float  # over runs and times, over the number of values: 1 is right
    low: float
    high: float
    within: float  # share of times

    def __str__(self) -> str:
        return (
            f"{self.name:<26}{self.mean:8.3f}   {self.low:.3f} to {self.high:.3f}"
            f"{100 * self.within:12.1f} %"
        )


def line(name: str, squares: Sequence[Sequence[float]], size: int, skip: int = 0) -> Line:
    """Of normalised squares (runs × times) of `size` values."""
    of_runs = np.array(squares)[:, skip:]
    runs = len(of_runs)
    low, high = chi2.ppf([0.025, 0.975], runs * size) / (runs * size)
    means = of_runs.mean(axis=0) / size
    within = np.mean((means >= low) & (means <= high))
    return Line(name, float(means.mean()), float(low), float(high), float(within))


class Laboratory:
    """One arm, its sensors and its estimator."""

    def __init__(self, sensors: Sequence[Sensor] = SENSORS, spread: Spread | None = None) -> None:
        self.model, self.sensors = build(Scene(chen2022())), tuple(sensors)
        self.disturbance = Disturbance.of(self.model.scene)
        self.process = Process(self.model, self.disturbance, ProcessNoise())
        self.spread = spread or Spread()
        self.estimator = Estimator(self.process, sensors, self.spread)
        self.start = start_at(self.model, find_equilibrium(self.model, PRESSURES))

    def input(self, k: int) -> Array:
        """Of control step k."""
        swing = np.sin(2 * np.pi * 0.5 * k * CONTROL * TICK + np.arange(len(self.start.u)))
        return self.start.u + 0.25 * swing

    # --- without mismatch ------------------------------------------------------------------------

    def matched(self, runs: int, steps: int, seed: int = 0) -> Runs:
        """Runs of the model that the filter believes in."""
        truth, found = Truth(self.process), Runs(by_sensor=[[] for _ in self.sensors])
        for run in range(runs):
            self._matched_run(truth, steps, seed + run, found)
        return found

    def _matched_run(self, truth: Truth, steps: int, seed: int, found: Runs) -> None:
        p, random = self.process, np.random.default_rng([seed, 7])
        nx, sensing = p.nx, Sensing(self.sensors, self.model, seed)
        s = np.concatenate([self.start.x, np.zeros(p.size - nx)]) / p.scale
        self.estimator.reset(self.start.x, self.start.u)
        s = s + np.sqrt(p.variances(self.spread)) * random.standard_normal(p.size)
        u, tick, waiting = self.start.u, 0, _taken(sensing, 0, s[:nx] * p.scale[:nx], self.start.u)
        whole, state = [], []
        for k in range(steps):
            waiting = self._told(waiting, tick)
            now = self.estimator.estimate(tick)
            e = s - np.concatenate([now.x, now.d]) / p.scale
            whole.append(square(e, now.P))
            state.append(square(e[:nx], now.P[:nx, :nx]))
            u = self.input(k)
            self.estimator.applied(u, tick)
            for stop in _stops(self.sensors, tick, tick + CONTROL):
                length = (stop - tick) * TICK
                push = np.sqrt(p.spread(length)) * random.standard_normal(p.size)
                s, tick = truth.advance(s, u, length) + push, stop
                waiting += _taken(sensing, tick, s[:nx] * p.scale[:nx], u)
        found.whole.append(whole)
        found.state.append(state)
        self._keep_innovations(found)

    def _told(self, waiting: list[Sample], tick: int) -> list[Sample]:
        self.estimator.receive([one for one in waiting if one.arrival <= tick])
        return [one for one in waiting if one.arrival > tick]

    def _keep_innovations(self, found: Runs) -> None:
        innovations = self.estimator.innovations
        for i, squares in enumerate(found.by_sensor):
            squares.append([one.nis for one in innovations if one.sensor == i])
        found.refused += sum(not one.accepted for one in innovations)

    # --- with mismatch ---------------------------------------------------------------------------

    def mismatched(self, runs: int, steps: int, seed: int = 0) -> Runs:
        """A plant of 4 segments, 15 % stiffer, with 200 g that the filter does not know of."""
        plant = Idas(build(stiff_scene()), 1e-7)
        seen = StateMap(plant.model, self.model)
        start = start_at(plant.model, find_equilibrium(plant.model, PRESSURES))
        found = Runs(by_sensor=[[] for _ in self.sensors])
        for run in range(runs):
            self._mismatched_run(plant, seen, start, steps, seed + run, found)
        return found

    def _mismatched_run(
        self, plant: Idas, seen: StateMap, start: Start, steps: int, seed: int, found: Runs
    ) -> None:
        sensing, n = Sensing(self.sensors, plant.model, seed), plant.model.strains
        nx, x, u = self.process.nx, start.x, start.u
        self.estimator.reset(seen(x, u), u)
        waiting, state, off = _taken(sensing, 0, x, u), [], []
        for k in range(steps):
            tick = k * CONTROL
            waiting = self._told(waiting, tick)
            estimate = self.estimator.estimate(tick)
            e = (seen(x, u) - estimate.x) / self.process.scale[:nx]
            state.append(square(e, estimate.P[:nx, :nx]))
            tips = self.model.tip(estimate.x[: self.model.strains]), plant.model.tip(x[:n])
            off.append(1e3 * float(np.linalg.norm(np.asarray(tips[0] - tips[1]))))
            u = self.input(k)
            self.estimator.applied(u, tick)
            moved = plant.advance(x, u, CONTROL * TICK, CONTROL)
            for i, x in enumerate(moved):
                waiting += _taken(sensing, tick + 1 + i, x, u)
        found.state.append(state)
        found.tips.append(float(np.sqrt(np.mean(np.square(off[steps // 2 :])))))
        self._keep_innovations(found)


class Truth:
    """M ddq = τ - C dq - N + F d by the classical Runge-Kutta method in steps of half a tick at
    most, and dz/dt = A z + B (u + G d) exactly; scaled variables."""

    def __init__(self, process: Process) -> None:
        self.process, self.step = process, 0.5 * TICK
        model, n = process.model, process.model.strains
        drive = model.drive
        self._half = held_input(drive.A, drive.B, 0.5 * self.step)
        y, f = ca.MX.sym("y", 2 * n), ca.MX.sym("f", n)
        p = [ca.MX.sym(f"p_{i}", len(model.layout.p)) for i in range(3)]

        def rate(y: ca.MX, p: ca.MX) -> ca.MX:
            q, dq = ca.vertsplit(y, n)
            M, C, N, tau = model.equations(q, dq, p)
            return ca.vertcat(dq, ca.solve(M, tau - C @ dq - N + f, "qr"))

        h = self.step
        k1 = rate(y, p[0])
        k2 = rate(y + h / 2 * k1, p[1])
        k3 = rate(y + h / 2 * k2, p[1])
        k4 = rate(y + h * k3, p[2])
        end = y + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        self._arm = Buffered(compiled(ca.Function("truth", [y, f, *p], [end])))

    def advance(self, s: Array, u: Array, length: float) -> Array:
        """s after `length` seconds (a multiple of the step) under u (SI)."""
        of, drive = self.process, self.process.model.drive
        ends, d = 2 * of.n, s[of.nx :]
        x, given, f = s * of.scale, u + of.disturbance.G @ d, of.disturbance.F @ d
        y, z, (phi, gamma) = x[:ends], x[ends : of.nx], self._half
        for _ in range(round(length / self.step)):
            middle = phi @ z + gamma @ given
            last = phi @ middle + gamma @ given
            pressures = [drive.C @ one + drive.D @ given for one in (z, middle, last)]
            y, z = self._arm(y, f, *pressures)[0].ravel().copy(), last
        return np.concatenate([y, z, d]) / of.scale


def square(e: Array, P: Array) -> float:
    """eᵀ P⁻¹ e."""
    return float(e @ cho_solve(cho_factor(P), e))


def stiff_scene() -> Scene:
    """The arm with what the filter does not know."""
    arm = chen2022()
    sections = tuple(
        replace(
            one,
            young_modulus=1.15 * one.young_modulus,
            shear_modulus=1.15 * one.shear_modulus,
        )
        for one in arm.sections
    )
    scene = Scene(replace(arm, sections=sections), segments=4)
    return scene.with_(effects=(*scene.effects, Payload(0.2)))


def _taken(sensing: Sensing, tick: int, x: Array, u: Array) -> list[Sample]:
    samples = [sensing.sample(i, tick, x, u) for i in sensing.due(tick)]
    return [one for one in samples if one is not None]


def _stops(sensors: Sequence[Sensor], tick: int, end: int) -> list[int]:
    """Times at which the filter ends its steps: samples, and the next input."""
    due = {t for t in range(tick + 1, end) for one in sensors if t % one.period == 0}
    return sorted(due | {end})
