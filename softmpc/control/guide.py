"""What a controller is told about the path: places of the tip, and the arm at rest along it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from softmpc.control.paths import Reference
from softmpc.control.rest_path import RestPath

__all__ = ["Guide"]

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
