"""The last good plan of a controller: what it would do next, and where it expects the arm."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from softmpc.control.solver import Solution
from softmpc.control.transcription import Transcription

__all__ = ["Plan"]


@dataclass(frozen=True)
class Plan:
    """A usable solution, `age` steps of the controller after the sample it was made for."""

    transcription: Transcription
    solution: Solution
    age: int

    def older(self) -> Plan:
        """The same plan a step later."""
        return replace(self, age=self.age + 1)

    @property
    def over(self) -> bool:
        """Whether its last interval has passed."""
        ocp = self.transcription.ocp
        return bool(self.age * ocp.step >= ocp.nodes[-1] * (1 - 1e-9))

    @cached_property
    def shifted(self) -> np.ndarray:
        """Its variables, from this step on."""
        return self._shifted(self.solution.w, self.transcription.nw, self.age)

    @property
    def input(self) -> np.ndarray:
        """The input that it has for this step (k), SI."""
        return self.transcription.split(self.shifted)[0][0]

    @property
    def state(self) -> np.ndarray:
        """The state that it expects now (nx), SI; only for a plan that is a step old or more."""
        before = self._shifted(self.solution.w, self.transcription.nw, self.age - 1)
        return self.transcription.split(before)[2][0]

    @property
    def multipliers(self) -> Solution | None:
        """Its multipliers with its variables, from this step on; None where it has none to use."""
        t, found = self.transcription, self.solution
        if not (found.solved and len(found.lam_w) and len(found.lam_g)):
            return None
        lam_w = self._shifted(found.lam_w, t.nw, self.age)
        lam_g = self._shifted(found.lam_g, len(found.lam_g) // t.N, self.age)
        finite = np.all(np.isfinite(lam_w)) and np.all(np.isfinite(lam_g))
        return replace(found, w=self.shifted, lam_w=lam_w, lam_g=lam_g) if finite else None

    def _shifted(self, vector: np.ndarray, width: int, times: int) -> np.ndarray:
        for _ in range(times):
            vector = self.transcription.shifted(vector, width)
        return vector
