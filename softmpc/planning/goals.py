"""Where a plan begins, and its goals: what the arm shall do at the end of each phase."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from softmpc.control.stage import Stage
from softmpc.errors import InputError
from softmpc.model.layout import Variables
from softmpc.model.model import Model
from softmpc.statics.targets import Target

__all__ = ["Goal", "GoalRows", "Start"]

PLACE = 1e-4  # m, within which a place is met,
TURN = 1e-3  # and a direction, rad;
STRAIN = 1e-4  # a given posture, in scales of the strains;
REST = 1e-4  # rates, drive and balance at rest, in theirs: the tip then drifts 0.1 mm or so

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Start:
    """The state x (nx) and the input that was held before (k), SI."""

    x: Array
    u: Array

    @classmethod
    def at_rest(cls, model: Model, q: Array, u: Array) -> Start:
        """At rest with strains q (n) under an input u (k)."""
        u = np.asarray(u, float)
        return cls(np.concatenate([q, np.zeros(model.strains), model.drive.at_rest(u)]), u)

    def check(self, model: Model) -> None:
        """Raise `InputError` where it is none of this model."""
        layout = model.layout
        for name, value, size in (("x", self.x, len(layout.x)), ("u", self.u, len(layout.u))):
            if np.shape(value) != (size,) or not np.all(np.isfinite(value)):
                raise InputError(
                    f"Start.{name} of shape {np.shape(value)}: must be {size} finite numbers"
                )


@dataclass(frozen=True, eq=False)
class Goal:
    """Targets for section tips at the end of a phase, and whether the arm rests there.

    `state` (nx, SI) fixes the whole posture and its rates instead, with `rest` under an input that
    holds it; without it the arm is free to choose among the postures that meet the targets.
    `after` is the phase's duration (s), None where the plan chooses it.
    """

    targets: tuple[Target, ...] = ()
    rest: bool = True
    state: Array | None = None
    after: float | None = None

    def __post_init__(self) -> None:
        if not self.targets and self.state is None and not self.rest:
            raise InputError("Goal(): give targets, or a state, or rest=True")
        if self.after is not None and not 0 < self.after < np.inf:
            raise InputError(f"Goal(after={self.after!r}): must be a time above 0 s, or None")

    def check(self, model: Model) -> None:
        """Raise `InputError` where the model has no such section or states."""
        for target in self.targets:
            target.check(len(model.scene.manipulator.sections))
        size = len(model.layout.x)
        if self.state is not None and np.shape(self.state) != (size,):
            raise InputError(f"Goal.state of shape {np.shape(self.state)}: must be ({size},)")

    def rows(self, stage: Stage) -> GoalRows:
        """What is zero where it is met."""
        found = _whole(stage, self.state) if self.state is not None else []
        found += _targets(stage, self.targets)
        if self.rest:
            found += _rest(stage) if self.state is None else [_held(stage)]
        return _together(found)


@dataclass(frozen=True, eq=False)
class GoalRows:
    """Scaled rows that are zero where a goal is met, within a band; 1 is `scale` in `units`."""

    value: ca.SX
    band: Array
    names: list[str]
    scale: Array
    units: list[str]


def _part(value: ca.SX, named: Variables, band: float, about: str = "") -> GoalRows:
    """Rows of variables from their values in SI."""
    names, scale = [about + name for name in named.names], np.asarray(named.scale, float)
    return GoalRows(value / scale, np.full(len(scale), band), names, scale, list(named.units))


def _together(parts: Sequence[GoalRows]) -> GoalRows:
    return GoalRows(
        value=ca.vertcat(*(part.value for part in parts)),
        band=np.concatenate([part.band for part in parts]),
        names=[name for part in parts for name in part.names],
        scale=np.concatenate([part.scale for part in parts]),
        units=[unit for part in parts for unit in part.units],
    )


def _whole(stage: Stage, state: Array) -> list[GoalRows]:
    layout, m = stage.model.layout, stage.model.strains
    parts = (layout.q, STRAIN), (layout.dq, REST), (layout.z, REST)
    values = ca.vertsplit(stage.x - ca.DM(state), [0, m, 2 * m, len(layout.x)])
    return [_part(value, *part) for value, part in zip(values, parts, strict=True)]


def _targets(stage: Stage, targets: Sequence[Target]) -> list[GoalRows]:
    """What section tips miss; places in lengths of the arm."""
    tips, turns = stage.model.frames(stage.q)
    length = stage.model.scene.manipulator.length
    found = []
    for target in targets:
        i = target.index(tips.shape[1])
        off = target.features(tips[:, i], turns[:, 3 * i : 3 * i + 3]) - ca.DM(target.values)
        count = off.numel()
        names = (f"{target.name} of section tip {i + 1}",) * count
        size, band = (1.0, TURN) if target.turns else (length, PLACE / length)
        units = ("rad" if target.turns else "m",) * count
        found.append(_part(off, Variables(names, units, np.full(count, size)), band))
    return found


def _rest(stage: Stage) -> list[GoalRows]:
    """Rates, the drive's rates, and the balance of forces at rest under the input then held."""
    layout = stage.model.layout
    z = ca.DM(stage.model.drive.at_rest(np.eye(len(layout.u)))) @ stage.u
    return [
        _part(stage.dq, layout.dq, REST, "rest: "),
        _part(stage.z - z, layout.z, REST, "rest: "),
        _held(stage),
    ]


def _held(stage: Stage) -> GoalRows:
    """The balance of forces at rest under the input then held."""
    model = stage.model
    z = ca.DM(model.drive.at_rest(np.eye(len(model.layout.u)))) @ stage.u
    still = ca.SX.zeros(model.strains)
    balance = model.residual(stage.q, still, still, model.pressures(z, stage.u))
    return _part(balance, model.layout.r, REST, "rest: ")
