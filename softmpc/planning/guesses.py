"""First guesses without help: postures at rest along a path, straight or around an obstacle.

Between two postures inputs and strains go straight, slowly at both ends. Where an arm on that way
meets obstacles there are more guesses, which lead the tip past the worst of them on each side.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from softmpc.control.clearance import arm_clearance
from softmpc.planning.problem import PlanProblem
from softmpc.statics.inverse import InverseStatics
from softmpc.statics.targets import Position, Target

__all__ = ["Guess", "find_guesses"]

SPEED = 0.25  # m/s of the tip in a first motion,
LEAST_TIME = 0.6  # s, and at least so long
SAMPLES = 41  # postures looked at along a phase
BESIDE = (1.3, 2.2)  # how far past an obstacle, in depths of the arm in it, plus
ROOM = 0.02  # m

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Guess:
    """Knots of each phase: strains (K×n) and inputs (K×k) from its begin to its end, SI."""

    name: str
    strains: tuple[Array, ...]
    inputs: tuple[Array, ...]
    durations: Array  # s

    def at(self, phase: int, share: Array) -> tuple[Array, Array]:
        """Strains and inputs at shares (N) of a phase's time, at rest at both ends."""
        smooth = share**2 * (3 - 2 * share)
        q, u = self.strains[phase], self.inputs[phase]
        knots = np.linspace(0.0, 1.0, len(q))
        between = (
            np.stack([np.interp(smooth, knots, column) for column in values.T], axis=1)
            for values in (q, u)
        )
        return next(between), next(between)


@dataclass(frozen=True, eq=False)
class _Posture:
    q: Array
    u: Array
    tip: Array


class _Finder:
    """Postures of one model by inverse statics."""

    def __init__(self, problem: PlanProblem) -> None:
        self.problem, self.model = problem, problem.model
        self._inverse = InverseStatics(self.model)

    def first(self) -> _Posture:
        n = self.model.strains
        q = self.problem.start.x[:n]
        return _Posture(q, self.problem.start.u, self.tip(q))

    def tip(self, q: Array) -> Array:
        return np.asarray(self.model.tip(q)).ravel()

    def posture(self, targets: Sequence[Target], before: _Posture) -> _Posture:
        """A posture that holds them, or the nearest one."""
        found = self._inverse.solve(targets)
        u = found.pressures if found.torques is None else found.torques
        return _Posture(found.q, u, found.tips[-1])

    def goal(self, i: int, before: _Posture) -> _Posture:
        goal = self.problem.goals[i]
        if goal.state is not None:
            tip = self.tip(goal.state[: self.model.strains])
            return self.posture([Position(tuple(tip))], before)
        return self.posture(goal.targets, before) if goal.targets else before


def find_guesses(problem: PlanProblem) -> list[Guess]:
    """The straight one first, then those around obstacles, where there is need."""
    finder = _Finder(problem)
    knots = [finder.first()]
    for i in range(len(problem.goals)):
        knots.append(finder.goal(i, knots[-1]))
    straight = _guess("straight", problem, [knots[i : i + 2] for i in range(len(problem.goals))])
    return [straight, *_detours(problem, finder, knots, straight)]


def _guess(name: str, problem: PlanProblem, phases: Sequence[Sequence[_Posture]]) -> Guess:
    lengths = [
        sum(float(np.linalg.norm(b.tip - a.tip)) for a, b in pairwise(knots)) for knots in phases
    ]
    return Guess(
        name,
        tuple(np.array([knot.q for knot in knots]) for knots in phases),
        tuple(np.array([knot.u for knot in knots]) for knots in phases),
        _durations(problem, np.array(lengths)),
    )


def _durations(problem: PlanProblem, lengths: Array) -> Array:
    """Times of the phases: those given, and for the others what is left, or as long as is easy."""
    easy = np.maximum(lengths / SPEED, LEAST_TIME)
    given = np.array([np.nan if g.after is None else g.after for g in problem.goals], float)
    free = np.isnan(given)
    if problem.duration is not None and free.any():
        left = problem.duration - float(given[~free].sum())
        easy = easy * left / float(easy[free].sum())
    return np.asarray(np.where(free, easy, given))


def _detours(
    problem: PlanProblem, finder: _Finder, knots: Sequence[_Posture], straight: Guess
) -> list[Guess]:
    """Past the obstacle that is deepest in the way, on four sides, near and far."""
    if not problem.obstacles:
        return []
    closest = arm_clearance(problem.model, problem.obstacles, 20)
    share = np.linspace(0.0, 1.0, SAMPLES)
    depths = np.array([-closest(straight.at(i, share)[0]).clearance for i in range(len(knots) - 1)])
    phase, sample, _ = (int(i) for i in np.unravel_index(int(depths.argmax()), depths.shape))
    deepest = float(depths.max())
    if deepest <= 0:
        return []
    tip = finder.tip(straight.at(phase, share)[0][sample])
    found = []
    for far in BESIDE:
        for side, way in _sides(knots[phase + 1].tip - knots[phase].tip).items():
            via = finder.posture(
                [Position(tuple(tip + (far * deepest + ROOM) * way))], knots[phase]
            )
            phases = [list(knots[i : i + 2]) for i in range(len(knots) - 1)]
            phases[phase].insert(1, via)
            found.append(_guess(f"{'near' if far == BESIDE[0] else 'far'} {side}", problem, phases))
    return found


def _sides(along: Array) -> dict[str, Array]:
    """Four ways past something, seen along a way: up is against z, as a hanging arm has it."""
    size = float(np.linalg.norm(along))
    ahead = along / size if size > 1e-6 else np.array([1.0, 0.0, 0.0])
    up = np.array([0.0, 0.0, -1.0])
    if abs(ahead @ up) > 0.9:
        up = np.array([1.0, 0.0, 0.0])
    right = np.cross(ahead, up)
    right /= np.linalg.norm(right)
    up = np.cross(right, ahead)
    return {"above": up, "below": -up, "right": right, "left": -right}
