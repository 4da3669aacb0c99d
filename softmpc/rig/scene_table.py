"""The table [rig] of a scene file: sensors, estimator, supervision, link and faults."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any, TypeVar

from softmpc.errors import SceneError, errors_in, unknown_name
from softmpc.estimation.estimator import Spread
from softmpc.estimation.process import ProcessNoise
from softmpc.estimation.sensors import SENSORS, SectionTips, Sensor, UnitPressures
from softmpc.model.disturbance import Disturbance
from softmpc.model.scene import STRAINS, Scene
from softmpc.model.tables import Table
from softmpc.rig.faults import FAULTS, Fault
from softmpc.rig.machine import Link
from softmpc.rig.supervision import Supervision

__all__ = ["RigSettings", "read_rig"]

T = TypeVar("T")
HUGE = 1e12


@dataclass(frozen=True)
class RigSettings:
    """What stands between controller and plant. Without `forces` and `offsets` no disturbance."""

    sensors: tuple[Sensor, ...] = (SectionTips(), UnitPressures())
    forces: tuple[str, ...] | None = None  # strains that an unknown force may push; None: but twist
    offsets: bool | None = None  # of the inputs; None: of torques
    noise: ProcessNoise = field(default_factory=ProcessNoise)
    spread: Spread = field(default_factory=Spread)
    supervision: Supervision = field(default_factory=Supervision)
    link: Link = field(default_factory=Link)
    faults: tuple[Fault, ...] = ()
    wait: float = 0.5  # s at rest before the path begins, for the estimate to settle
    seed: int = 0

    def disturbance(self, scene: Scene) -> Disturbance:
        """The disturbance that estimator and controller of this scene share."""
        return Disturbance.of(scene, self.forces, self.offsets)


def read_rig(data: object) -> RigSettings:
    """Settings of a [rig] table; raises `SceneError` naming the key, what was given and allowed."""
    table = Table(data, "[rig]")
    sensors = tuple(
        _sensor(kind, Table(table.raw(name), f"[rig.{name}]"))
        for name, kind in SENSORS.items()
        if name in table
    )
    estimator = Table(table.raw("estimator", {}), "[rig.estimator]")
    settings = RigSettings(
        sensors=sensors or RigSettings.sensors,
        forces=estimator.strings("forces", (), allowed=STRAINS) if "forces" in estimator else None,
        offsets=estimator.boolean("offsets") if "offsets" in estimator else None,
        noise=_numbers(ProcessNoise, estimator, "noise"),
        spread=_numbers(Spread, estimator, "spread"),
        supervision=_numbers(Supervision, table, "supervision"),
        link=_link(table),
        faults=tuple(_fault(one, k + 1) for k, one in enumerate(_list(table, "faults"))),
        wait=table.number("wait", RigSettings.wait, unit="s", low=0.0, high=60.0),
        seed=table.integer("seed", 0),
    )
    estimator.finish()
    table.finish()
    return settings


def _list(table: Table, key: str) -> list[Any]:
    given = table.raw(key, [])
    if not isinstance(given, list):
        raise table.error(key, given, "a list of tables, [[rig.faults]]")
    return given


def _link(table: Table) -> Link:
    delay = table.number("command_delay", 0.0, unit="s", low=0.0, high=0.5)
    lost = table.number("lost_commands", 0.0, low=0.0, high=1.0)
    with errors_in(table.where):
        return Link(delay, lost)


def _sensor(kind: type[Sensor], table: Table) -> Sensor:
    return _made(kind, table)


def _fault(data: Any, number: int) -> Fault:
    table = Table(data, f"[[rig.faults]] {number}")
    name = table.string("kind")
    if name not in FAULTS:
        raise SceneError(f"{table.where} {unknown_name('kind', name, FAULTS)}")
    for key in ("start", "duration"):
        table.number(key, unit="s", low=0.0, high=3600.0)
    return _made(FAULTS[name], table)


def _numbers(kind: type[T], above: Table, key: str) -> T:
    """A dataclass of numbers, of the table below `key`."""
    return _made(kind, Table(above.raw(key, {}), f"{above.where[:-1]}.{key}]"))


def _made(kind: type[T], table: Table) -> T:
    """A dataclass from the keys that the table has; its own checks name what is wrong."""
    given: Mapping[str, Any] = {
        one.name: _value(table, one.name, str(one.type))
        for one in fields(kind)  # type: ignore[arg-type]
        if one.name in table
    }
    table.finish()
    with errors_in(table.where):
        return kind(**given)


def _value(table: Table, key: str, kind: str) -> Any:
    """A value of the type that the field is declared with."""
    if kind == "bool":
        return table.boolean(key)
    if kind == "int":
        return table.integer(key)
    if kind == "str":
        return table.string(key)
    if kind == "tuple[int, ...]":
        return tuple(int(one) for one in table.vector(key, None, low=0.0, high=1e6))
    if kind == "tuple[float, ...]":
        return table.vector(key, None, low=-HUGE, high=HUGE)
    return table.number(key, low=-HUGE, high=HUGE)
