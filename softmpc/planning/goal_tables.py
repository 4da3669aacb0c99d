"""The tables [plan.start] and [[plan.goals]]: targets of section tips, and given states."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from softmpc.control.planned_start import is_at_rest
from softmpc.errors import SceneError, errors_in
from softmpc.model.model import Model
from softmpc.model.tables import Table
from softmpc.planning.goals import Goal, Start
from softmpc.simulation.state_file import read_state
from softmpc.statics.equilibrium import find_equilibrium
from softmpc.statics.inverse import InverseStatics
from softmpc.statics.reach import FAR, too_far
from softmpc.statics.rest_costs import REST_COSTS
from softmpc.statics.rest_limits import torques_at_rest
from softmpc.statics.targets import Direction, Orientation, Position, Target

__all__ = ["FREE", "POSTURES", "GoalTable", "Posture", "read_goal", "read_start"]

MPA = 1e6
FREE = "free"
POSTURES = ("least-pressure", "least-strain-energy", "greatest-margin")
TARGETS = ("tip", "direction", "rotation")
ANY = ("-", "")  # a coordinate that is free
COMPARED = 5  # postures of inverse statics

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Posture:
    """A state to be found: of a file, at rest under inputs, or at rest with tips at targets."""

    where: str
    targets: tuple[Target, ...] = ()
    cost: str = FREE  # by which inverse statics chooses a posture
    inputs: Array | None = None  # held at rest (k)
    start: Start | None = None

    @property
    def is_given(self) -> bool:
        """Whether it is one state, not any that meets the targets."""
        return self.start is not None or self.inputs is not None or self.cost != FREE

    def find(self, model: Model) -> Start:
        """The state and the input there. Raises `SceneError` where none rests so."""
        if self.start is not None:
            return self.start
        if self.inputs is not None:
            return self._held(model, self.inputs)
        found = InverseStatics(model, REST_COSTS[self.cost]()).solve(self.targets, compare=COMPARED)
        if not found.solved:
            miss = f"{1e3 * found.distance:.3g} mm and {np.degrees(found.angle):.3g}°"
            raise SceneError(
                f"{self.where}: no posture at rest within the limits holds this; the nearest that "
                f"was found misses it by {miss}"
            )
        u = found.pressures if found.torques is None else found.torques
        return Start.at_rest(model, found.q, u)

    def _held(self, model: Model, u: Array) -> Start:
        rest = find_equilibrium(model, model.drive.static_gain @ u)
        if not rest.stable:
            why = "it is not stable" if rest.converged else rest.status
            raise SceneError(f"{self.where}: the arm does not rest under these inputs: {why}")
        return Start.at_rest(model, rest.q, u)


@dataclass(frozen=True, eq=False)
class GoalTable:
    """A goal before its posture is sought."""

    posture: Posture
    rest: bool
    after: float | None

    def find(self, model: Model) -> Goal:
        if not self.posture.is_given:
            return Goal(self.posture.targets, self.rest, None, self.after)
        return Goal((), self.rest, self.posture.find(model).x, self.after)


def read_start(data: Any, model: Model, folder: Path) -> Posture:
    """The table [plan.start]; without keys, at rest with no input."""
    table = Table(data, "[plan.start]")
    straight = table.boolean("straight", False)
    posture = _read_posture(table, model, folder, POSTURES)
    table.finish()
    ways = _ways(posture) + ["straight"] * straight
    _check_ways(table.where, ways, "one way to say where the arm starts")
    none = np.zeros(len(model.layout.u))
    if straight:
        return Posture(table.where, start=Start.at_rest(model, np.zeros(model.strains), none))
    return posture if ways else Posture(table.where, inputs=none)


def read_goal(data: Any, number: int, last: bool, model: Model, folder: Path) -> GoalTable:
    """One of [[plan.goals]]; the last rests by default, others are passed."""
    table = Table(data, f"[[plan.goals]] {number}")
    posture = _read_posture(table, model, folder, (FREE, *POSTURES))
    rest = table.boolean("rest") if "rest" in table else None
    after = None
    if "after" in table:
        after = table.number("after", unit="s", low=0.0, low_open=True, high=3600.0)
    table.finish()
    _check_ways(table.where, _ways(posture), "one way to say what the goal is")
    if not _ways(posture) and not rest:
        raise SceneError(
            f"{table.where} asks for nothing: give tip, direction, rotation, sections, torques, "
            "pressures or state, or rest = true to come to rest anywhere"
        )
    return GoalTable(posture, _rests(table, posture, rest, last, model), after)


def _rests(table: Table, posture: Posture, rest: bool | None, last: bool, model: Model) -> bool:
    """Whether the arm rests at the goal, which a given posture decides."""
    if not posture.is_given:
        return last if rest is None else rest
    state = posture.start
    given = state is None or is_at_rest(model, state.x, state.u)
    if rest is not None and rest != given:
        what = "at rest" if given else "in motion"
        raise table.error("rest", rest, f"{not rest}".lower() + f": the state given is {what}")
    return given


def _ways(posture: Posture) -> list[str]:
    """What says where the arm is."""
    found = ["tip, direction, rotation or sections"] if posture.targets else []
    found += ["torques or pressures"] if posture.inputs is not None else []
    return found + (["state"] if posture.start is not None else [])


def _check_ways(where: str, ways: list[str], wanted: str) -> None:
    if len(ways) > 1:
        raise SceneError(f"{where} has {' and '.join(ways)}: give {wanted}")


def _read_posture(table: Table, model: Model, folder: Path, costs: tuple[str, ...]) -> Posture:
    targets = _read_targets(table, model, None)
    sections = Table(table.raw("sections", {}), f"{table.where} sections")
    for i in range(1, len(model.scene.manipulator.sections) + 1):
        if str(i) in sections:
            below = Table(sections.raw(str(i)), f"{table.where} sections.{i}")
            found = _read_targets(below, model, i)
            below.finish()
            if not found:
                raise SceneError(f"{below.where} is empty: give {' or '.join(TARGETS)}")
            targets += found
    sections.finish()
    cost = table.string("posture", costs[0], costs)
    if "posture" in table and not targets:
        raise SceneError(f"{table.where} posture: is for targets of inverse statics, give a tip")
    return Posture(
        table.where, targets, cost if targets else FREE, _read_inputs(table, model),
        _read_state(table, model, folder),
    )  # fmt: skip


def _read_targets(table: Table, model: Model, section: int | None) -> tuple[Target, ...]:
    """What tip, direction and rotation of a table ask of a section's tip."""
    found: list[Target] = []
    if "tip" in table:
        place = _place(table)
        if why := too_far(model.scene, place, section, FAR):
            raise SceneError(f"{table.where} tip is far out of reach: {why}")
        found.append(Position(place, section=section))
    if "direction" in table and "rotation" in table:
        raise SceneError(f"{table.where} rotation gives the direction too: leave one of them out")
    if "direction" in table:
        axis = table.vector("direction", 3)
        with errors_in(f"{table.where} direction"):
            found.append(Direction(axis, section=section))
    if "rotation" in table:
        found.append(Orientation(_matrix(table), section=section))
    return tuple(found)


def _place(table: Table) -> tuple[float | None, ...]:
    """Three coordinates, "-" where one is free."""
    given = table.raw("tip")
    wanted = 'a list of 3 values, each a number in m, or "-" where it is free'
    if not isinstance(given, list | tuple) or len(given) != 3:
        raise table.error("tip", given, wanted)
    free = [isinstance(x, str) and x in ANY for x in given]
    if all(free):
        raise table.error("tip", given, f"{wanted}; one of them must be given")
    numbers = Table(
        {"tip": [0.0 if f else x for f, x in zip(free, given, strict=True)]}, table.where
    )
    kept = numbers.vector("tip", 3, unit="m")
    return tuple(None if f else x for f, x in zip(free, kept, strict=True))


def _matrix(table: Table) -> tuple[tuple[float, ...], ...]:
    """The rotation matrix of a rotation vector in degrees."""
    from scipy.spatial.transform import Rotation

    vector = np.radians(table.vector("rotation", 3, unit="deg", low=-720.0, high=720.0))
    return tuple(map(tuple, Rotation.from_rotvec(vector).as_matrix().tolist()))


def _read_inputs(table: Table, model: Model) -> Array | None:
    """Inputs that are held at rest: torques, or pressures with the torques that hold them."""
    limits, units = model.scene.manipulator.limits, model.scene.manipulator.units
    if "torques" in table and "pressures" in table:
        raise SceneError(f"{table.where} has torques and pressures: one follows from the other")
    if "torques" in table:
        if model.scene.actuation.input != "torque":
            raise SceneError(
                f"{table.where} torques: the actuation {model.scene.actuation.name!r} takes "
                "pressures, write pressures = … in MPa"
            )
        low, high = limits.torque_min, limits.torque_max
        return np.array(table.vector("torques", units, unit="N·m", low=low, high=high))
    if "pressures" not in table:
        return None
    low, high = limits.pressure_min / MPA, limits.pressure_max / MPA
    pressures = MPA * np.array(table.vector("pressures", units, unit="MPa", low=low, high=high))
    torques = torques_at_rest(model, pressures)
    if torques is None:
        return pressures
    for j, torque in enumerate(torques, 1):
        if not limits.torque_min <= torque <= limits.torque_max:
            raise SceneError(
                f"{table.where} pressures: unit {j} needs {torque:.4g} N·m to hold its own: must "
                f"be between {limits.torque_min:g} and {limits.torque_max:g} N·m"
            )
    return torques


def _read_state(table: Table, model: Model, folder: Path) -> Start | None:
    if "state" not in table:
        if "time" in table:
            raise SceneError(f"{table.where} time: is of a file, give state = …")
        return None
    file = table.string("state")
    at = table.number("time", unit="s", low=0.0, high=1e6) if "time" in table else None
    with errors_in(f"{table.where} state"):
        return Start(*read_state(folder / file, model, at))
