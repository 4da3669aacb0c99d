"""Does a short horizon come to rest? From seeded starts to a held target, by real-time iteration.

python -m tests.benchmarks.stability [--starts 200] [--horizons 5 10 20] [--processes 1]

Half of the starts are postures at rest under random torques within the limits, half are states on
the way from one such posture to another. The plant is integrated by another code at its own steps.
At rest means: tip within 0.1 mm of the target and slower than 1 mm/s for a quarter of a second.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from softmpc.control.closed_loop import Start, start_at
from softmpc.control.mpc import Mpc
from softmpc.control.ocp import tracking_problem
from softmpc.control.real_time import RealTime
from softmpc.control.terminal import terminal_cost
from softmpc.control.transcription import Transcription
from softmpc.model.model import Model, build
from softmpc.model.presets import chen2022
from softmpc.model.scene import Scene
from softmpc.simulation.runge_kutta import RadauIIA
from softmpc.statics.equilibrium import find_equilibrium, pressures_from_torques
from softmpc.sweeps import sweep
from tests.benchmarks.common import arguments, key

TARGET = np.array([0.9, 0.5, 0.7, 0.8, 0.6, 0.4])  # N·m that hold the target
STEP = 0.025  # s
NEAR, SLOW, HELD = 1e-4, 1e-3, 10  # m, m/s, steps
LONGEST = 5.0  # s
NEVER = -1.0
ON_THE_WAY = (0.05, 0.4)  # s


@dataclass(frozen=True)
class Case:
    """One run: its start by number, horizon, with or without terminal cost."""

    number: int
    horizon: int
    terminal: bool


@dataclass(frozen=True)
class Bench:
    """Runs cases; what it builds is kept."""

    seed: int = 2022
    mode: str = "auto"
    _loops: dict[tuple[int, bool], Mpc] = field(default_factory=dict, compare=False, repr=False)

    @cached_property
    def model(self) -> Model:
        return build(Scene(chen2022()))

    @cached_property
    def plant(self) -> RadauIIA:
        return RadauIIA(self.model, tolerance=1e-6)

    @cached_property
    def target(self) -> Start:
        return self.at_rest(TARGET)

    def at_rest(self, torque: np.ndarray) -> Start:
        posture = find_equilibrium(self.model, pressures_from_torques(self.model, torque))
        assert posture.stable
        return start_at(self.model, posture)

    def tip(self, x: np.ndarray) -> np.ndarray:
        return np.asarray(self.model.tip(x[: self.model.strains])).ravel()

    def start(self, number: int) -> tuple[np.ndarray, np.ndarray]:
        """State and last input of one start; even numbers rest, odd ones move."""
        rng = np.random.default_rng([self.seed, number])
        limits = self.model.scene.manipulator.limits
        draw = rng.uniform(limits.torque_min, limits.torque_max, (2, len(TARGET)))
        rest = self.at_rest(draw[0])
        if number % 2 == 0:
            return rest.x, rest.u
        return self.plant.advance(rest.x, draw[1], rng.uniform(*ON_THE_WAY))[-1], draw[1]

    def loop(self, horizon: int, terminal: bool) -> Mpc:
        key = horizon, terminal
        if key not in self._loops:
            ocp = tracking_problem(self.model, horizon, STEP)
            if terminal:
                ocp = terminal_cost(ocp, self.target.x, self.target.u).problem
            t = Transcription(ocp)
            self._loops[key] = Mpc(t, RealTime(t, mode=self.mode))
        return self._loops[key]

    def __call__(self, case: Case) -> dict[str, float]:
        """Seconds until the arm rests, the last error (m), steps that were not solved."""
        mpc = self.loop(case.horizon, case.terminal)
        mpc.reset()
        tip = self.tip(self.target.x)
        every = np.ones((case.horizon, 1))
        given = {
            "tip": tip * every,
            "rest": self.target.x * every,
            "rest input": self.target.u * every,
        }
        x, u = self.start(case.number)
        place, still, failed, count = self.tip(x), 0, 0, round(LONGEST / STEP)
        for k in range(count):
            step = mpc.step(x, u, given)
            failed += not step.solved
            u = step.u
            x = self.plant.advance(x, u, STEP)[-1]
            before, place = place, self.tip(x)
            error, moved = np.linalg.norm(place - tip), np.linalg.norm(place - before)
            still = still + 1 if error < NEAR and moved < SLOW * STEP else 0
            if still == HELD:
                return {"rested": STEP * (k + 2 - HELD), "error": float(error), "failed": failed}
        return {"rested": NEVER, "error": float(error), "failed": failed}


def measured(
    bench: Bench, horizon: int, terminal: bool, starts: int, processes: int
) -> tuple[dict[str, float], list[int]]:
    """What came of all starts, and those that did not come to rest."""
    began = time.perf_counter()
    cases = [Case(i, horizon, terminal) for i in range(starts)]
    found = sweep(bench, cases, executor=processes)
    took = [one["rested"] for one in found if one["rested"] != NEVER]
    lost = [case.number for case, one in zip(cases, found, strict=True) if one["rested"] == NEVER]
    return {
        "at_rest_count": len(took),
        "rested_after_s_median": float(np.median(took)) if took else np.nan,
        "rested_after_s_last": max(took, default=np.nan),
        "worst_error_mm": 1e3 * max(one["error"] for one in found),
        "not_solved_count": sum(one["failed"] for one in found),
        "took_s": time.perf_counter() - began,
    }, lost


def numbers(quick: bool) -> dict[str, float]:
    """Ten starts and horizons of 5 and 20 in quick mode; else 200 and 5, 10, 20."""
    bench, starts = Bench(), 10 if quick else 200
    found: dict[str, float] = {"starts_count": starts}
    for horizon in (5, 20) if quick else (5, 10, 20):
        for terminal in (False, True):
            each, _ = measured(bench, horizon, terminal, starts, 1)
            where = key(f"{horizon}_intervals", "terminal" if terminal else "")
            found |= {f"{where}_{what}": v for what, v in each.items() if np.isfinite(v)}
    return found


def row(bench: Bench, horizon: int, terminal: bool, starts: int, processes: int) -> None:
    found, lost = measured(bench, horizon, terminal, starts, processes)
    print(
        f"{horizon:4d}  {'Riccati' if terminal else 'none':13s} {found['at_rest_count']:8d}"
        f"  {found['rested_after_s_median']:8.2f}  {found['rested_after_s_last']:6.2f}"
        f"  {found['worst_error_mm']:14.3f}"
        f"  {found['not_solved_count']:16.0f} {found['took_s']:8.0f}",
        flush=True,
    )
    if lost:
        print(f"      not at rest after {LONGEST:g} s: starts {lost}")


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--starts", type=int, default=200)
    parser.add_argument("--horizons", type=int, nargs="+", default=[5, 10, 20])
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--seed", type=int, default=Bench.seed)
    given = parser.parse_args()
    bench = Bench(given.seed)
    print(f"{given.starts} starts, seed {bench.seed}, steps of {1e3 * STEP:g} ms")
    print(
        "   N  terminal cost  at rest  median s  last s  worst error mm  steps not solved   took s"
    )
    for horizon in given.horizons:
        for terminal in (False, True):
            row(bench, horizon, terminal, given.starts, given.processes)


if __name__ == "__main__":
    main()
