"""What errors of the scene's numbers do to a plan: stiffness, masses, the payload, the drive.

Three questions, each by the relative change of a number (1 is 100 %):

- open loop: the plan's inputs stay, the arm is another: where do its tips go, what do goals miss?
- value: by how much is the least time, or cost, another if the plan is made anew? That is the
  derivative of the Lagrangian, with the multipliers of the plan.
- planned anew: how do durations and inputs change? That is in the KKT conditions with the limits
  that hold the plan now.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from softmpc.control.one_thread import one_thread
from softmpc.errors import InputError
from softmpc.model.payload import Payload
from softmpc.model.scene import Scene
from softmpc.planning.attempt import Attempt
from softmpc.planning.result import PlanResult, cost_unit
from softmpc.planning.sensitivity_open_loop import OpenLoop, open_loop
from softmpc.planning.sensitivity_optimum import Optimum, find_optimum
from softmpc.planning.sensitivity_scene import Numbers, Slopes, Varied, rests

__all__ = ["PlanSensitivities", "Replanned", "Sensitivity", "default_numbers", "find_sensitivities"]

STIFFNESS = "sections.young_modulus+sections.shear_modulus"
STARTS = ("rest", "state")

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Replanned:
    """By the relative change of a number, the plan made anew.

    `within` is the relative change up to which the same limits hold the plan, to first order:
    beyond it `durations` and `u` are others, while `cost` changes its slope only.
    """

    cost: float  # in the plan's `cost_unit`
    durations: Array  # s
    u: Array  # K×k, N·m or Pa
    within: float


@dataclass(frozen=True, eq=False)
class Sensitivity:
    """What one number, or some that change together, do to a plan; `values` in SI, `units`."""

    name: str
    values: tuple[float, ...]
    units: tuple[str, ...]
    open_loop: OpenLoop
    replanned: Replanned | None  # None where no optimum was found near the plan


@dataclass(frozen=True, eq=False)
class PlanSensitivities:
    """See the module. `start` is "rest": the changed arm starts at rest under the start's input,
    or "state": in the very state of the plan.

    `exact`: the optimum next to the plan was found to rounding, and the KKT conditions are those
    of it. `freedom` is how many moves the limits leave to the objective there, `flat` in how many
    of these it hardly tells one motion from others: `Replanned.u` has no change along those.
    `pressures` says that the inputs are pressures, not torques.
    """

    start: str
    least: str
    cost_unit: str
    pressures: bool
    exact: bool
    freedom: int
    flat: int
    numbers: tuple[Sensitivity, ...]

    def summary(self) -> list[dict[str, Any]]:
        """Numbers for programs, by per cent; keys name their units."""
        return [self._numbers(one) for one in self.numbers]

    def _numbers(self, one: Sensitivity) -> dict[str, Any]:
        way, anew = one.open_loop, one.replanned
        data: dict[str, Any] = {
            "name": one.name,
            "values": dict(zip(one.name.split("+"), one.values, strict=True)),
            "start": self.start,
            "miss_mm_per_percent": [10 * miss for miss in way.misses],
            "turn_deg_per_percent": (0.01 * np.degrees(way.turns)).tolist(),
            "drift_mm_per_percent": 10 * way.drift,
            "end_mm_per_percent": (10 * way.tips[-1]).tolist(),
            "settled_mm_per_percent": None if way.settled is None else (10 * way.settled).tolist(),
        }
        if anew is not None:
            data |= {
                "cost_per_percent": 0.01 * anew.cost,
                "cost_unit": self.cost_unit,
                "durations_ms_per_percent": (10 * anew.durations).tolist(),
                "input_per_percent": 0.01 * float(np.abs(anew.u).max()),
                "within_percent": 100 * anew.within,
            }
        return data

    def text(self) -> str:
        """A table for people."""
        heads = ["a number 1 % higher", "end, mm", "drift, mm", "settled, mm", "turned, deg"]
        heads += ["time, ms"] if self.least == "time" else [f"cost, {self.cost_unit}"]
        heads += ["input, MPa" if self.pressures else "input, N·m", "within"]
        rows = [heads, *(self._row(one) for one in self.numbers)]
        widths = [max(len(row[i]) for row in rows) for i in range(len(heads))]
        lines = [
            "  ".join([row[0].ljust(widths[0]), *map(str.rjust, row[1:], widths[1:])]).rstrip()
            for row in rows
        ]
        return "\n".join([*lines, *self._notes()])

    def _row(self, one: Sensitivity) -> list[str]:
        way, anew = one.open_loop, one.replanned
        end, settled = (
            "-" if tips is None else f"{10 * float(np.linalg.norm(tips[-1])):.3g}"
            for tips in (way.tips[-1], way.settled)
        )
        row = [one.name.replace("+", " + "), end, f"{10 * way.drift:.3g}", settled]
        row.append(f"{0.01 * float(np.degrees(max(way.turns))):.3g}")
        if anew is None:
            return [*row, "-", "-", "-"]
        row.append(f"{10 * anew.cost:+.3g}" if self.least == "time" else f"{0.01 * anew.cost:+.3g}")
        change = 0.01 * float(np.abs(anew.u).max()) * (1e-6 if self.pressures else 1.0)
        return [*row, f"{change:.3g}", f"{100 * anew.within:.2g} %"]

    def _notes(self) -> list[str]:
        ways = {"rest": "at rest under the start's input", "state": "in the state of the plan"}
        notes = [f"the changed arm starts {ways[self.start]}"]
        if any(one.replanned is None for one in self.numbers):
            return [*notes, "no optimum was found near the plan: nothing is said about a new one"]
        if not self.exact:
            notes.append("the optimum next to the plan was not found to rounding: inputs are rough")
        if self.flat:
            notes.append(
                f"in {self.flat} of {self.freedom} ways that limits leave, many motions are as "
                "good: inputs have the least change"
            )
        return notes


def default_numbers(scene: Scene) -> tuple[str, ...]:
    """Stiffness (both moduli together), mass, and the payload where there is one."""
    payload = scene.effect(Payload)
    names = STIFFNESS, "sections.mass", *(("effects.payload.mass",) if payload else ())
    return tuple(names)


@one_thread
def find_sensitivities(
    result: PlanResult, names: Sequence[str] | None = None, start: str | None = None
) -> PlanSensitivities:
    """What errors of numbers of the scene do to a plan.

    `names` are paths of numbers (`softmpc.model.scene_paths`), with `+` between those that change
    together; None: `default_numbers`. `start` is "rest" or "state", see `PlanSensitivities`; None:
    "rest" where the plan starts at rest. Raises `InputError` for other names, numbers that are
    zero, and a plan that does not meet its limits.
    """
    if result.found is None or not result.found.met:
        raise InputError(
            f"a plan with the status {result.status!r} has no optimum: sensitivities need one "
            "that meets all limits"
        )
    scene = result.problem.model.scene
    numbers = [Numbers.of(scene, name) for name in names or default_numbers(scene)]
    begin = _checked_start(result, start)
    attempt = Attempt(result.problem, result.found.counts, result.more)
    motion = attempt.from_plan(result.found)
    if motion is None:
        raise InputError("the plan is no motion of its scene: was the scene changed afterwards?")
    attempt.improve(motion)
    optimum, found = find_optimum(attempt), []
    for one in numbers:
        varied = Varied(attempt, one, begin == "rest")
        units = tuple(place.span.unit for place in one.places)
        way = open_loop(attempt, motion, varied, varied.steps(motion))
        anew = None if optimum is None else _replanned(attempt, optimum, varied)
        found.append(Sensitivity(one.name, one.values, units, way, anew))
    kkt = None if optimum is None else optimum.kkt
    problem = result.problem
    return PlanSensitivities(
        begin, problem.least, cost_unit(problem),
        problem.model.scene.actuation.input == "pressure", optimum is not None and optimum.exact,
        kkt.freedom if kkt else 0, kkt.flat if kkt else 0, tuple(found),
    )  # fmt: skip


def _checked_start(result: PlanResult, start: str | None) -> str:
    begin, model = result.problem.start, result.problem.model
    still = rests(model, begin.x, begin.u)
    if start is None:
        return "rest" if still else "state"
    if start not in STARTS:
        raise InputError(f"start = {start!r}: must be {' or '.join(map(repr, STARTS))}")
    if start == "rest" and not still:
        raise InputError("start = 'rest': this plan does not start at rest; use 'state'")
    return start


def _replanned(attempt: Attempt, optimum: Optimum, varied: Varied) -> Replanned:
    kkt, m, t = optimum.kkt, optimum.multipliers, attempt.t
    if kkt is None:
        raise AssertionError("an optimum has KKT conditions")
    slopes = varied.slopes(optimum.motion, m)
    left = np.where(kkt.active > 0, slopes.high, slopes.low)
    v, change = kkt.change(slopes.gradient, slopes.d, left)
    du, _, durations = attempt.mesh.split(v)
    cost = -float(m.of_equations @ slopes.d) - float(m.of_rows @ left)
    unit = attempt.cost_unit * attempt.objective.size
    return Replanned(
        cost * unit, durations, (du * t.u_scale)[:, : t.inputs],
        _within(optimum, slopes, v, change.of_rows),
    )  # fmt: skip


def _within(optimum: Optimum, slopes: Slopes, v: Array, of_rows: Array) -> float:
    """The relative change, up or down, at which the first limit begins or ends to hold."""
    here, m = optimum.here, optimum.multipliers.of_rows
    active = optimum.kkt.active != 0 if optimum.kkt else np.zeros(len(m), bool)
    moves = here.J @ v
    rates = [moves - slopes.high, moves - slopes.low, of_rows]
    rooms = [here.high - here.value, here.value - here.low, np.abs(m)]
    counts = [~active, ~active, active & (m != 0)]
    found = [
        float(np.min(room[some] / np.maximum(np.abs(rate[some]), 1e-12), initial=np.inf))
        for room, rate, some in zip(rooms, rates, counts, strict=True)
    ]
    return max(min(found), 0.0)
