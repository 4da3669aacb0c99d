"""What a controller is told about the path: places of the tip, and the arm at rest along it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from softmpc.control.costs import PLANNED, PLANNED_INPUT, StrainRate, TorqueRate
from softmpc.control.paths import Reference
from softmpc.control.planned import PlannedMotion, columns_at
from softmpc.control.rest_path import RestPath
from softmpc.control.state_map import StateMap
from softmpc.errors import InputError
from softmpc.model.model import Model

__all__ = ["Guide", "PlanGuide"]

Array = Any


@dataclass(frozen=True, eq=False)
class Guide:
    """References by name for coming times: "tip", and with a rest path "rest" and "rest input".

    "moving" is as "rest" but with the strains' rates along the path.

    With `project` the tip is to follow the nearest places in reach instead of the path itself,
    and a `Transit` where these jump.
    `to_state` turns states and inputs of the rest path's model into states of the controller's.
    """

    path: Reference
    rest: RestPath | None = None
    project: bool = False
    to_state: Callable[[Array, Array], Array] | None = None

    @property
    def duration(self) -> float:
        return self.path.duration

    def asked(self, t: Array) -> Array:
        """Places of the path (N×3) at times (N)."""
        return self.path.position(t)

    def followed(self, t: Array) -> Array:
        """Places that are to be followed (N×3)."""
        if self.project and self.rest is not None:
            return self.rest.position(t)
        return self.path.position(t)

    def input(self, t: float, step: float) -> Array:
        """The input (k) of feed-forward alone, for a step (s) from time t on."""
        if self.rest is None:
            raise InputError("feed-forward: needs a guide with a rest path, see `find_rest_path`")
        return self.rest.inputs(np.array([t + step / 2]))[0]

    def holding(self, t: float) -> Array:
        """The input (k) that holds the arm at rest where the reference is at time t."""
        return self.given(np.array([t]))["rest input"][0]

    def seen_by(self, model: Model) -> Guide:
        """The same, with states for costs of another model of the arm."""
        return self

    def given(self, t: Array) -> dict[str, Array]:
        """What a controller gets at the times of its nodes (N)."""
        found = {"tip": self.followed(t)}
        if self.rest is None:
            return found
        x, u = self.rest.rest(t), self.rest.inputs(t)
        n = self.rest.model.strains
        moving = x.copy()
        moving[:, n : 2 * n] = self.rest.rates(t)
        if self.to_state is not None:
            x, moving = (
                np.array([self.to_state(*one) for one in zip(states, u, strict=True)])
                for states in (x, moving)
            )
        return found | {"rest": x, "moving": moving, "rest input": u}


@dataclass(frozen=True, eq=False)
class PlanGuide(Guide):
    """Along a planned motion; "rest" is the state that is planned, "rest input" its input.

    Inputs are means over the intervals before the times, of which the first is a `step` (s) long.
    `planner` is the model of the plan's states, `model` the one that gets them.
    """

    motion: PlannedMotion = field(kw_only=True)
    step: float = field(kw_only=True)
    planner: Model = field(kw_only=True)
    model: Model = field(kw_only=True)

    def input(self, t: float, step: float) -> Array:
        return self.motion.mean_input(np.array([t]), np.array([t + step]))[0]

    def holding(self, t: float) -> Array:
        """Of the pressures that are planned then."""
        pressures = self.motion.pressures(np.array([t]))[0]
        return np.linalg.solve(self.planner.drive.static_gain, pressures)

    def seen_by(self, model: Model) -> PlanGuide:
        return self if model is self.model else replace(self, model=model)

    def given(self, t: Array) -> dict[str, Array]:
        edges = np.concatenate([t[0] - self.step * np.array([2.0, 1.0]), t])
        inputs = self.motion.mean_input(edges[:-1], edges[1:])
        n, x = self.model.strains, columns_at(t, self.motion.samples_t, self._states)
        x[t > self.motion.duration, n : 2 * n] = 0.0
        planned = {
            PLANNED_INPUT: inputs[1:],
            PLANNED[TorqueRate]: np.diff(inputs, axis=0),
            PLANNED[StrainRate]: x[:, n : 2 * n],
        }
        return {"tip": self.followed(t), "rest": x, "rest input": inputs[1:], **planned}

    @cached_property
    def _states(self) -> Array:
        """The planned states (M×nx) as states of the model that gets them."""
        to_state, motion = StateMap(self.planner, self.model), self.motion
        acting = motion.u[np.searchsorted(motion.t[1:-1], motion.samples_t, side="right")]
        return motion.samples_x @ to_state.A.T + acting @ to_state.B.T
