"""What a running controller is close to, in Python: the same as `c/monitor.h` sees.

For controllers in Python, and to check that in C. It only watches: no input depends on it.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

from softmpc.codegen.monitor_data import checked_shell, tube_count
from softmpc.control.step import Step
from softmpc.model.model import Model
from softmpc.simulation.validity import LAMINAR, reynolds_numbers
from softmpc.statics.workspace_result import Workspace
from softmpc.statics.workspace_shell import Shell

__all__ = ["Monitor", "Observed", "margins"]

Array = np.ndarray
SMALLEST = ("tip_margin", "reference_margin", "pressure_room")  # the worst of these


def margins(shell: Shell, places: Any) -> Array:
    """Margins (K) of places (K×3, m) to the edge of a reachable set, m; below zero outside.

    Inside, the smallest of three: along the ray from the base to the outer surface and to the
    inner one, and across it to a rim, at the same azimuth. Where a surface stands oblique to the
    ray the true distance is smaller. Outside, minus `Shell.outside`. NaN for a place that is not
    finite.
    """
    places = np.asarray(places, float).reshape(-1, 3)
    found = np.full(len(places), np.nan)
    good = np.isfinite(places).all(axis=1)
    away = shell.outside(places[good])
    found[good] = np.where(away > 0, -away, _inside(shell, places[good]))
    return found


def _inside(shell: Shell, places: Array) -> Array:
    x, y, z = (places @ shell.frame).T
    if shell.flat:
        y = np.zeros_like(y)
    radius, polar = np.sqrt(x**2 + y**2 + z**2), np.arctan2(np.hypot(x, y), z)
    rims, outer, inner = shell.between(np.arctan2(y, x))
    every = shell.between(shell.azimuths)[0]
    ways = np.full((4, len(places)), np.inf)
    for k, (low, high) in enumerate(rims):
        u = (polar[k] - low) / max(high - low, 1e-12)
        ways[0, k] = np.interp(u, shell.nodes, outer[k]) - radius[k]
        ways[1, k] = radius[k] - np.interp(u, shell.nodes, inner[k])
    if np.any(every[:, 0] > 0):  # else the axis is in reach, and no edge
        ways[2] = radius * np.sin(np.minimum(polar - rims[:, 0], np.pi / 2))
    if np.any(every[:, 1] < np.pi):
        ways[3] = radius * np.sin(np.minimum(rims[:, 1] - polar, np.pi / 2))
    return np.asarray(np.maximum(ways.min(axis=0), 0.0))


@dataclass(frozen=True)
class Observed:
    """What was seen; None where it is not known.

    `pressure_room` is the distance of the nearest pressure from its limit, a share of the range;
    `back_off` how much of the margin before these limits was used, see `RigResult.back_off`.
    `iterations` are those that a step counts: of the quadratic program in C, of the nonlinear one
    in Python.
    """

    tip_margin: float | None = None  # m
    reference_margin: float | None = None  # m
    pressure_room: float | None = None
    back_off: float | None = None
    reynolds: float | None = None  # the largest of all tubes
    iterations: int = 0

    @property
    def turbulent(self) -> bool:
        """Whether a Reynolds number is beyond laminar flow."""
        return self.reynolds is not None and self.reynolds > LAMINAR

    def worse(self, other: Observed) -> Observed:
        """The worst of both."""
        found: dict[str, Any] = {}
        for one in fields(self):
            pair = [getattr(which, one.name) for which in (self, other)]
            known = [value for value in pair if value is not None]
            choose = min if one.name in SMALLEST else max
            found[one.name] = choose(known) if known else None
        return Observed(**found)


@dataclass(eq=False)
class Monitor:
    """Watches one controller of `model`.

    `back_off`: how much closer its limits of pressure are, a share of their range. Without a
    `workspace` no margin is known; raises `InputError` for that of another arm.
    """

    model: Model
    back_off: float = 0.0
    workspace: Workspace | None = None
    last: Observed = field(init=False, default=Observed())
    worst: Observed = field(init=False, default=Observed())

    def __post_init__(self) -> None:
        space = self.workspace
        self._shell = None if space is None else checked_shell(self.model, space)
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self.last = self.worst = Observed()
        self.statuses: dict[str, int] = {}
        self.steps = self.since_solved = self.programs = self.iterations = 0

    @property
    def mean_iterations(self) -> float:
        """Of the steps that asked the quadratic program; 0 without."""
        return self.iterations / self.programs if self.programs else 0.0

    def update(self, step: Step, x: Any, u: Any, reference: Any = None) -> Observed:
        """After a step from the state x: u is its input, `reference` (3, m) that of the tip."""
        x, u = np.asarray(x, float), np.asarray(u, float)
        self.last = Observed(
            reference_margin=None if reference is None else self._margin(reference),
            **(self._state(x, u) if np.isfinite(x).all() else {}),
            iterations=step.iterations,
        )
        self.worst = self.worst.worse(self.last)
        self._count(step)
        return self.last

    def _count(self, step: Step) -> None:
        status = step.status.split(":")[0]  # a failure says why
        self.statuses[status] = self.statuses.get(status, 0) + 1
        self.steps += 1
        self.since_solved = 0 if step.solved else self.since_solved + 1
        if step.qp not in ("", "not asked"):
            self.programs += 1
            self.iterations += step.iterations

    def _margin(self, place: Any) -> float | None:
        if self._shell is None:
            return None
        margin = float(margins(self._shell, place)[0])
        return margin if np.isfinite(margin) else None

    def _state(self, x: Array, u: Array) -> dict[str, Any]:
        """Tip, pressures and flows."""
        n, drive, limits = self.model.strains, self.model.drive, self.model.scene.manipulator.limits
        low, high = limits.pressure_min, limits.pressure_max
        room = used = number = None
        if np.isfinite(u).all():
            pressures = drive.C @ x[2 * n :] + drive.D @ u
            room = float(np.minimum(pressures - low, high - pressures).min() / (high - low))
            used = max(1 - room / self.back_off, 0.0) if self.back_off else None
        if tube_count(self.model):
            number = float(reynolds_numbers(self.model, x[2 * n :]).max())
        tip = np.asarray(self.model.tip(x[:n])).ravel()
        return {
            "tip_margin": self._margin(tip), "pressure_room": room, "back_off": used,
            "reynolds": number,
        }  # fmt: skip
