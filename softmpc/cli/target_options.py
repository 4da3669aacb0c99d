"""Targets on the command line and in files: --tip, --direction, --rotation, --targets."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from softmpc.cli.common import Numbers
from softmpc.errors import InputError, errors_in

if TYPE_CHECKING:
    from softmpc.model.scene import Scene
    from softmpc.statics.targets import Target

__all__ = [
    "Held",
    "Place",
    "SectionNumbers",
    "check_targets",
    "held_units",
    "read_targets",
    "targets_from",
]

FREE = ("-", "")
COLUMNS = ("x", "y", "z", "dx", "dy", "dz")
Given = tuple[int | None, list[float | None]]


class SectionNumbers(click.ParamType):
    """Three finite numbers, with the section in front where it is not the last: 1:0.1,0,0.3."""

    name = "three numbers"
    free = False

    def convert(self, value: Any, param: Any, ctx: Any) -> Given:
        """(section or None, numbers); a number that is free is None."""
        front, colon, rest = value.rpartition(":")
        section = None
        if colon:
            if not front.strip().isdigit():
                self.fail(f"{front.strip()!r} before the colon is no section: 1, 2, …", param, ctx)
            section = int(front)
        items = rest.split(",")
        if len(items) != 3:
            self.fail(f"{value!r} has {_count(items, 'number')}, three are needed", param, ctx)
        return section, [self._number(item.strip(), param, ctx) for item in items]

    def _number(self, item: str, param: Any, ctx: Any) -> float | None:
        if self.free and item in FREE:
            return None
        return Numbers().convert(item, param, ctx)[0]


class Place(SectionNumbers):
    """As above; "-" leaves a coordinate free."""

    free = True


class Held(click.ParamType):
    """A unit that is stuck at a pressure: 2=0.3, or P_2=0.3 as results call it."""

    name = "unit and pressure"

    def convert(self, value: Any, param: Any, ctx: Any) -> tuple[int, float]:
        """(unit, pressure in MPa)."""
        unit, equals, pressure = value.partition("=")
        number = unit.strip().removeprefix("P_")
        if not equals or not number.isdecimal():
            self.fail(f"{value!r}: must be UNIT=MPA, such as 2=0.3 or P_2=0.3", param, ctx)
        return int(number), Numbers().convert(pressure, param, ctx)[0]


def held_units(held: tuple[tuple[int, float], ...]) -> dict[int, float]:
    """Pressures (Pa) by unit of all --hold; `InputError` where a unit is given twice."""
    found: dict[int, float] = {}
    for unit, pressure in held:
        if unit in found:
            raise InputError(
                f"--hold gives unit {unit} twice, {found[unit] / 1e6:g} and {pressure:g} MPa: "
                "give each unit once"
            )
        found[unit] = pressure * 1e6
    return found


def targets_from(
    tips: tuple[Given, ...], directions: tuple[Given, ...], rotations: tuple[Given, ...]
) -> list[Target]:
    """The targets of --tip, --direction and --rotation."""
    from math import radians

    from scipy.spatial.transform import Rotation

    from softmpc.statics.targets import Direction, Orientation, Position

    found: list[Target] = [Position(tuple(place), section=section) for section, place in tips]
    found += [Direction(_whole(axis), section=section) for section, axis in directions]
    for section, turn in rotations:
        matrix = Rotation.from_rotvec([radians(angle) for angle in _whole(turn)]).as_matrix()
        found.append(Orientation(tuple(map(tuple, matrix.tolist())), section=section))
    return found


def _count(items: list[str], what: str) -> str:
    return f"{len(items)} {what}" + ("" if len(items) == 1 else "s")


def _whole(numbers: list[float | None]) -> tuple[float, ...]:
    if None in numbers:
        raise InputError("dx, dy, dz are three numbers, or all empty: a direction has no free one")
    return tuple(x for x in numbers if x is not None)


def check_targets(which: str, scene: Scene, targets: list[Target]) -> None:
    """Raise `InputError` for two wishes of a kind, and places so far that the unit is another."""
    from softmpc.statics.reach import FAR, too_far
    from softmpc.statics.targets import Position

    sections, wishes = len(scene.manipulator.sections), set()
    for target in targets:
        target.check(sections)
        section = target.index(sections) + 1
        if (target.name, section) in wishes:
            raise InputError(
                f"the tip of section {section} is given two of {target.name}: give one"
            )
        wishes.add((target.name, section))
        if not isinstance(target, Position):
            continue
        if why := too_far(scene, target.place, target.section, FAR):
            raise InputError(f"{which} is far out of reach: {why}")


def read_targets(path: Path) -> list[list[Target]]:
    """Targets of a CSV file: columns x, y, z (m), and dx, dy, dz where there are directions.

    The header may be missing; an empty cell of x, y, z is a free coordinate. Raises `InputError`
    with the line.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "is not a text file"
        raise InputError(f"targets {path}: {reason}") from None
    rows = [
        (n, [cell.strip() for cell in row])
        for n, row in enumerate(csv.reader(text.splitlines()), 1)
    ]
    rows = [(n, row) for n, row in rows if any(row) and not row[0].startswith("#")]
    with errors_in(f"targets {path}"):
        if rows and not any(_is_number(cell) for cell in rows[0][1]):
            _check_header(rows.pop(0)[1])
        if not rows:
            raise InputError("has no targets: give a row x,y,z or x,y,z,dx,dy,dz for each")
        return [_target(number, row) for number, row in rows]


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _check_header(names: list[str]) -> None:
    if tuple(names) not in (COLUMNS[:3], COLUMNS):
        raise InputError(
            f"the header is {','.join(names)}: must be {','.join(COLUMNS[:3])} (m), or "
            f"{','.join(COLUMNS)} with a direction"
        )


def _target(number: int, row: list[str]) -> list[Target]:
    from softmpc.statics.targets import Direction, Position

    with errors_in(f"line {number}"):
        if len(row) not in (3, 6):
            raise InputError(f"has {_count(row, 'value')}: must be x,y,z or x,y,z,dx,dy,dz")
        numbers = [_cell(text) for text in row]
        targets: list[Target] = []
        if any(x is not None for x in numbers[:3]) or len(row) == 3:
            targets.append(Position(tuple(numbers[:3])))
        if len(row) == 6 and any(x is not None for x in numbers[3:]):
            targets.append(Direction(_whole(numbers[3:])))
        if not targets:
            raise InputError("is empty: must be x,y,z or x,y,z,dx,dy,dz")
        return targets


def _cell(text: str) -> float | None:
    if text in FREE:
        return None
    if not _is_number(text):
        raise InputError(f"{text!r} is not a number")
    return float(text)
