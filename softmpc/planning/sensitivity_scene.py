"""Derivatives of all that holds a motion by numbers of the scene, which is built anew for each.

Numbers are changed by ±`CHANGE` of themselves; all derivatives are by the relative change.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import sparse

from softmpc.control.trajectory import Trajectory
from softmpc.errors import InputError
from softmpc.model.model import Model, build
from softmpc.model.scene import Scene
from softmpc.model.scene_paths import Place, resolve, value_at, with_values
from softmpc.planning.attempt import Attempt
from softmpc.planning.goals import REST, Start
from softmpc.planning.motion import Motion
from softmpc.planning.sensitivity_constraints import Constraints, Multipliers

__all__ = ["Numbers", "Slopes", "Varied", "rests", "shift_at_rest"]

CHANGE = 1e-3
STILL = 2 * REST  # in scales, of an arm at rest: a plan may begin where another one ends

Array = np.ndarray


@dataclass(frozen=True)
class Numbers:
    """Numbers of a scene that change together, by one factor: paths joined by `+`."""

    name: str
    places: tuple[Place, ...]
    values: tuple[float, ...]

    @classmethod
    def of(cls, scene: Scene, name: str) -> Numbers:
        """Raises `InputError` for a path that the scene does not have, or a number that is zero."""
        places = tuple(resolve(scene, path.strip()) for path in name.split("+"))
        values = tuple(value_at(scene, place) for place in places)
        if 0.0 in values:
            path = places[values.index(0.0)].path
            raise InputError(
                f"{path} = 0: a relative change of it is none; give it a value, or leave it out"
            )
        return cls(name, places, values)

    def scene(self, scene: Scene, factor: float) -> Scene:
        pairs = zip(self.places, self.values, strict=True)
        return with_values(scene, {place: factor * value for place, value in pairs})


def rests(model: Model, x: Array, u: Array) -> bool:
    """Whether the arm is at rest in a state under an input that is held."""
    n, layout = model.strains, model.layout
    z = model.drive.at_rest(u)
    balance = np.asarray(model.balance(x[:n], model.drive.static_gain @ u)).ravel()
    parts = (
        x[n : 2 * n] / layout.dq.scale,
        (x[2 * n :] - z) / layout.z.scale,
        balance / layout.r.scale,
    )
    return all(float(np.abs(part).max(initial=0.0)) <= 2 * REST for part in parts)


def shift_at_rest(model: Model, changed: tuple[Model, Model], q: Array, u: Array) -> Array:
    """By how much strains at rest under an input differ between two changed models."""
    K = np.asarray(model.stiffness(q, model.drive.static_gain @ u)[0])
    up, down = (np.asarray(m.balance(q, m.drive.static_gain @ u)).ravel() for m in changed)
    return np.asarray(-np.linalg.solve(K, up - down))


@dataclass(frozen=True, eq=False)
class Slopes:
    """By a relative change: of the gradient of the Lagrangian, of d, and of what is left to the
    lower and upper bounds of rows.
    """

    gradient: Array
    d: Array
    low: Array
    high: Array


class Varied:
    """A problem with some numbers of its scene higher and lower.

    With `from_rest` the start is what the changed arm does under the start's input; else it is the
    state itself.
    """

    def __init__(self, attempt: Attempt, numbers: Numbers, from_rest: bool) -> None:
        self.attempt, self.from_rest, self.numbers = attempt, from_rest, numbers
        scene = attempt.problem.model.scene
        factors = _factors(numbers)
        if factors[0] == factors[1]:
            raise InputError(f"{numbers.name}: its range leaves no room for a change of {CHANGE:g}")
        self.width = factors[0] - factors[1]
        self.offsets = factors[0] - 1.0, factors[1] - 1.0
        up, down = (build(numbers.scene(scene, factor)) for factor in factors)
        self.models = up, down

    @cached_property
    def starts(self) -> tuple[Array, Array]:
        """States at the start (SI)."""
        start, model = self.attempt.problem.start, self.attempt.problem.model
        if not self.from_rest:
            return start.x, start.x
        n = model.strains
        dq = shift_at_rest(model, self.models, start.x[:n], start.u) / self.width
        still, z = np.concatenate([dq, np.zeros(n)]), model.drive.at_rest(start.u)
        up, down = (
            start.x + np.concatenate([off * still, m.drive.at_rest(start.u) - z])
            for m, off in zip(self.models, self.offsets, strict=True)
        )
        return up, down

    @cached_property
    def _attempts(self) -> list[Attempt]:
        base = self.attempt
        found = []
        for model, x in zip(self.models, self.starts, strict=True):
            start = Start(x, base.problem.start.u)
            problem = replace(base.problem, model=model, start=start)
            found.append(Attempt(problem, base.mesh.phases.counts, base.more))
        return found

    def steps(self, motion: Motion) -> Slopes:
        """Slopes without multipliers."""
        here = Constraints.of(self.attempt, motion)
        return self.slopes(motion, Multipliers(np.zeros(len(here.d)), np.zeros(len(here.value))))

    def slopes(self, motion: Motion, m: Multipliers) -> Slopes:
        """Of what holds a motion, which stays the same."""
        up, down = (_around(self.attempt, one, motion) for one in self._attempts)
        width = self.width
        return Slopes(
            (up.gradients(m) - down.gradients(m)).sum(axis=0) / width,
            (up.d - down.d) / width,
            _difference(up.low, up.value, down.low, down.value) / width,
            _difference(up.high, up.value, down.high, down.value) / width,
        )


def _difference(up: Array, value_up: Array, down: Array, value_down: Array) -> Array:
    """Of what is left to bounds; 0 of bounds that are none."""
    some = np.isfinite(up) & np.isfinite(down)
    bounds = np.where(some, up, 0.0) - np.where(some, down, 0.0)
    return np.where(some, bounds - value_up + value_down, 0.0)


def _factors(numbers: Numbers) -> tuple[float, float]:
    """Higher and lower; one of them is 1 where a number is at its bound."""
    pairs = list(zip(numbers.places, numbers.values, strict=True))
    up, down = (
        factor if all(factor * value in place.span for place, value in pairs) else 1.0
        for factor in (1 + CHANGE, 1 - CHANGE)
    )
    return up, down


def _around(base: Attempt, changed: Attempt, motion: Motion) -> Constraints:
    """Constraints of a changed problem around a motion of the base: its stages are moved, so that
    they fit the changed arm, and its states stay.
    """
    t, to = base.t, changed.t
    u, a, x = t.u_scale / to.u_scale, t.a_scale / to.a_scale, t.x_scale / to.x_scale
    at = Trajectory(motion.at.u * u, motion.at.a * a, motion.at.x * x)
    dynamics = changed.roll.dynamics
    dynamics.use(base.mesh.phases.lengths(motion.durations))
    for _ in range(2):
        steps = dynamics(changed.moment, at, by_length=True)
        at = Trajectory(at.u, at.a + steps.a_0, at.x)
    steps = dynamics(changed.moment, at, by_length=True)
    here = Constraints.of(changed, Motion(at, motion.durations, steps))
    moves = np.concatenate([np.tile(u, t.N), np.tile(x, t.N), np.ones(len(motion.durations))])
    columns = sparse.diags(moves)
    rows = np.concatenate([np.tile(1 / x, t.N), np.ones(len(here.d) - t.N * t.nx)])
    return replace(
        here, D=(sparse.diags(rows) @ here.D @ columns).tocsr(), d=rows * here.d,
        J=(here.J @ columns).tocsr(),
    )  # fmt: skip
