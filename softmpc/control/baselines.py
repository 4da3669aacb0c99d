"""Simpler controllers to compare with: what model predictive control has to be better than.

    feed-forward   the inputs that hold the path at rest, or a plan's; it looks at no state
    table          these, and proportional-integral feedback of the tip through inverse statics
    LQR            these, and a linear-quadratic regulator about the moving posture
    IPOPT          the same problem as the controller's, solved to convergence in every step

All of them keep the limits of the input and of its rate as the controller does. What each is told
of a time is in `told`; `softmpc.codegen.baselines` writes table and LQR in C.
"""

from __future__ import annotations

import time
from functools import cached_property
from typing import Any

import numpy as np

from softmpc.control.guide import Guide
from softmpc.control.input_guard import InputGuard
from softmpc.control.ipopt import Ipopt
from softmpc.control.mpc import Mpc
from softmpc.control.ocp import Ocp
from softmpc.control.response import Response
from softmpc.control.rest_path import RestPath
from softmpc.control.step import FAILED, INPUT_NOT_FINITE, SOLVED, Step
from softmpc.control.terminal import Terminal, terminal_cost
from softmpc.control.tip_gains import tip_gains
from softmpc.control.transcription import Transcription
from softmpc.errors import BuildError, InputError
from softmpc.statics.equilibrium import Equilibrium, find_equilibrium, refine_equilibrium

__all__ = ["FeedForward", "Regulated", "StaticsTable", "converged"]

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
        self._last: Array | None = None

    def told(self, t: float) -> dict[str, Array]:
        """What the input of the step that begins at t follows from, beside the state; by name."""
        return {"input": self._held(t)}

    def step(self, x: Array, u_before: Array, given: Any) -> Step:
        """The input for the next step; its time counts from `reset`."""
        began = time.perf_counter()
        x, u_before = np.asarray(x, float), np.asarray(u_before, float)
        before = self.guard.finite(u_before, self._last)
        finite = bool(np.all(np.isfinite(x)) and np.all(np.isfinite(u_before)))
        wanted = self._input(x, before, self.told(self._time)) if finite else before
        status, source = (SOLVED, "solution") if finite else (INPUT_NOT_FINITE, "held input")
        if not np.all(np.isfinite(wanted)):
            status, source, wanted = f"{FAILED}: no finite input", "held input", before
        self._last = u = self.guard.after(before, wanted)
        self._time += self.ocp.step
        clipped = bool(np.any(u != wanted))
        return Step(u.copy(), status, source, 0.0, time.perf_counter() - began, clipped=clipped)

    def _input(self, x: Array, u_before: Array, told: dict[str, Array]) -> Array:
        return told["input"]

    def _held(self, t: float) -> Array:
        return np.asarray(self.guide.input(t, self.ocp.step))


class _AtPlaces(FeedForward):
    """Feed-forward, and feedback with gains made at a few places of a rest path."""

    def __init__(self, ocp: Ocp, guide: Guide) -> None:
        super().__init__(ocp, guide)
        if guide.rest is None:
            raise InputError(f"{self.name}: needs a guide with a rest path, see `find_rest_path`")
        self.rest = guide.rest
        self._at = np.linspace(0, len(self.rest.found) - 1, PLACES, endpoint=False).astype(int)

    @property
    def places(self) -> Array:
        """Tips at rest where the gains are made (places × 3), m."""
        return self.rest.tips[self._at]

    def _nearest(self, tip: Array) -> int:
        return int(np.argmin(np.linalg.norm(self.places - tip, axis=1)))


class Regulated(_AtPlaces):
    """Feed-forward and a linear-quadratic regulator, with the costs of the problem.

    The model is linearised at rest at a few places of the path, the nearest one counts. States and
    inputs are measured from those of the rest path, with the rates of the strains along it.
    """

    name = "LQR"

    def __init__(self, ocp: Ocp, guide: Guide) -> None:
        super().__init__(ocp, guide)
        self._terminals = [_terminal(ocp, guide, self.rest, k) for k in self._at]

    @cached_property
    def gains(self) -> Array:
        """K (places × k × (nx+k), SI) of u = input - K (x - moving, u_before - input before)."""
        layout = self.ocp.model.layout
        by = np.concatenate([layout.x.scale, layout.u.scale])
        K = np.array([terminal.regulator.K for terminal in self._terminals])
        return np.asarray(layout.u.scale[:, None] * K / by)

    def told(self, t: float) -> dict[str, Array]:
        given = self.guide.given(np.array([t]))
        return {
            "moving": given["moving"][0],
            "input before": self._held(t - self.ocp.step),
            "input": self._held(t),
            "tip": self.guide.followed(np.array([t]))[0],
        }

    def _input(self, x: Array, u_before: Array, told: dict[str, Array]) -> Array:
        off = np.concatenate([x - told["moving"], u_before - told["input before"]])
        return told["input"] - self.gains[self._nearest(told["tip"])] @ off


class StaticsTable(_AtPlaces):
    """Feed-forward and proportional-integral feedback of the tip, through inverse statics.

    u = input + S (k e + k_i Σ e h) with e the tip's distance from the path and S the inverse of
    the static sensitivity of the tip to the inputs, at the nearest of a few places. Where the
    limits change the input the sum waits. k and k_i are those of `tip_gains`.
    """

    name = "inverse-statics table"

    def __init__(self, ocp: Ocp, guide: Guide) -> None:
        super().__init__(ocp, guide)
        places = [_response(ocp, guide, self.rest, k) for k in self._at]
        self.gains, self.proportional, self.integral = tip_gains(places, ocp.step)

    def reset(self) -> None:
        super().reset()
        self._sum = np.zeros(3)

    def told(self, t: float) -> dict[str, Array]:
        return {"input": self._held(t), "tip": self.guide.followed(np.array([t]))[0]}

    def step(self, x: Array, u_before: Array, given: Any) -> Step:
        """The input for the next step; its time counts from `reset`."""
        before = self._sum
        taken = super().step(x, u_before, given)
        if taken.clipped or not taken.solved:
            self._sum = before
        return taken

    def _input(self, x: Array, u_before: Array, told: dict[str, Array]) -> Array:
        model = self.ocp.model
        error = told["tip"] - np.asarray(model.tip(x[: model.strains])).ravel()
        self._sum = self._sum + self.ocp.step * error
        push = self.proportional * error + self.integral * self._sum
        return told["input"] + self.gains[self._nearest(told["tip"])] @ push


def _response(ocp: Ocp, guide: Guide, rest: RestPath, node: int) -> Response:
    return Response(ocp.model, _posture(ocp, guide, rest, node).q, rest.found[node].pressures)


def _posture(ocp: Ocp, guide: Guide, rest: RestPath, node: int) -> Equilibrium:
    """The controller's model at rest at a node of the rest path."""
    found = rest.found[node]
    if guide.to_state is not None:
        return find_equilibrium(ocp.model, found.pressures)
    return refine_equilibrium(ocp.model, found.pressures, found.q)


def _terminal(ocp: Ocp, guide: Guide, rest: RestPath, node: int) -> Terminal:
    """The regulator at a node of the rest path, in the controller's model."""
    from softmpc.control.closed_loop import start_at

    start = start_at(ocp.model, _posture(ocp, guide, rest, node))
    try:
        return terminal_cost(ocp, start.x, start.u)
    except InputError as error:
        raise BuildError(f"LQR: no rest at node {node} of the path: {error}") from None


def converged(ocp: Ocp, stages: int = 2) -> Mpc:
    """The problem solved by IPOPT until it converges, in every step."""
    transcription = Transcription(ocp, stages)
    return Mpc(transcription, Ipopt(transcription, max_iterations=200))
