"""Simpler controllers to compare with: what model predictive control has to be better than.

    feed-forward   the inputs that hold the path at rest, or a plan's; it looks at no state
    LQR            these, and a linear-quadratic regulator about the moving posture
    IPOPT          the same problem as the controller's, solved to convergence in every step

All of them keep the limits of the input and of its rate as the controller does.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from softmpc.control.guide import Guide
from softmpc.control.input_guard import InputGuard
from softmpc.control.ipopt import Ipopt
from softmpc.control.mpc import Mpc
from softmpc.control.ocp import Ocp
from softmpc.control.rest_path import RestPath
from softmpc.control.step import SOLVED, Step
from softmpc.control.terminal import Terminal, terminal_cost
from softmpc.control.transcription import Transcription
from softmpc.errors import BuildError, InputError

__all__ = ["FeedForward", "Regulated", "converged"]

PLACES = 8  # of a lap, where the regulator is made

Array = Any


class FeedForward:
    """The inputs that hold the path at rest, at the middle of each step; of a plan its own."""

    name = "feed-forward"

    def __init__(self, ocp: Ocp, guide: Guide) -> None:
        self.ocp, self.guide = ocp, guide
        self.guard = InputGuard(ocp)
        self._held(0.0)  # raises where the guide has no input
        self.reset()

    def reset(self) -> None:
        """Back to the start of the path."""
        self._time = 0.0

    def step(self, x: Array, u_before: Array, given: Any) -> Step:
        """The input for the next step; its time counts from `reset`."""
        began = time.perf_counter()
        wanted = self._input(np.asarray(x, float), np.asarray(u_before, float))
        u = self.guard.after(u_before, wanted)
        self._time += self.ocp.step
        clipped = bool(np.any(u != wanted))
        return Step(u, SOLVED, "solution", 0.0, time.perf_counter() - began, clipped=clipped)

    def _input(self, x: Array, u_before: Array) -> Array:
        return self._held(self._time)

    def _held(self, t: float) -> Array:
        return np.asarray(self.guide.input(t, self.ocp.step))


class Regulated(FeedForward):
    """Feed-forward and a linear-quadratic regulator, with the costs of the problem.

    The model is linearised at rest at a few places of the path, the nearest one counts. States and
    inputs are measured from those of the rest path, with the rates of the strains along it.
    """

    name = "LQR"

    def __init__(self, ocp: Ocp, guide: Guide) -> None:
        super().__init__(ocp, guide)
        if guide.rest is None:
            raise InputError(f"{self.name}: needs a guide with a rest path, see `find_rest_path`")
        self.rest = guide.rest
        self._at = np.linspace(0, len(self.rest.found) - 1, PLACES, endpoint=False).astype(int)
        self._terminals = [_terminal(ocp, guide, self.rest, k) for k in self._at]

    def _input(self, x: Array, u_before: Array) -> Array:
        t, layout = self._time, self.ocp.model.layout
        given = self.guide.given(np.array([t]))
        tip = self.guide.followed(np.array([t]))
        near = int(np.argmin(np.linalg.norm(self.rest.tips[self._at] - tip, axis=1)))
        before, after = self._held(t - self.ocp.step), self._held(t)
        off = (x - given["moving"][0]) / layout.x.scale, (u_before - before) / layout.u.scale
        K = self._terminals[near].regulator.K
        return after - layout.u.scale * (K @ np.concatenate(off))


def _terminal(ocp: Ocp, guide: Guide, rest: RestPath, node: int) -> Terminal:
    """The regulator at a node of the rest path, in the controller's model."""
    from softmpc.control.closed_loop import start_at
    from softmpc.statics.equilibrium import find_equilibrium, refine_equilibrium

    found = rest.found[node]
    if guide.to_state is not None:
        posture = find_equilibrium(ocp.model, found.pressures)
    else:
        posture = refine_equilibrium(ocp.model, found.pressures, found.q)
    start = start_at(ocp.model, posture)
    try:
        return terminal_cost(ocp, start.x, start.u)
    except InputError as error:
        raise BuildError(f"LQR: no rest at node {node} of the path: {error}") from None


def converged(ocp: Ocp, stages: int = 2) -> Mpc:
    """The problem solved by IPOPT until it converges, in every step."""
    transcription = Transcription(ocp, stages)
    return Mpc(transcription, Ipopt(transcription, max_iterations=200))
