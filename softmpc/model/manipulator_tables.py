"""The arm in the flat words of a scene file: [manipulator], [hydraulics], [limits]."""

import math
from dataclasses import Field, fields, replace
from typing import Any, TypeVar

from softmpc.model.parameters import Hydraulics, Limits, Manipulator, Section
from softmpc.model.presets import DEFAULT_PRESET, PRESETS, preset
from softmpc.model.quantities import Range, toml_key
from softmpc.model.tables import Table

__all__ = ["MAX_SECTIONS", "manipulator_from_dict", "manipulator_to_dict"]

MAX_SECTIONS = 64
ANGLES = "section_angles_deg"
R = TypeVar("R", Hydraulics, Limits)


def manipulator_from_dict(document: dict[str, Any]) -> Manipulator:
    """Return the arm of a parsed scene file; what is not given comes from the preset.

    With a number of sections that is not the preset's, its sections are repeated in turn.
    """
    top = Table(document, "the scene file")
    table = top.table("manipulator")
    base = preset(table.string("preset", DEFAULT_PRESET, PRESETS))
    count = table.integer("sections", len(base.sections), low=1, high=MAX_SECTIONS)
    sections = _read_sections(table, [base.sections[i % len(base.sections)] for i in range(count)])
    arm = replace(
        base,
        sections=sections,
        hydraulics=_read_record(top.table("hydraulics"), base.hydraulics),
        limits=_read_record(top.table("limits"), base.limits),
    )
    name = table.string("name", _derived_name(arm, base))
    table.finish()
    return replace(arm, name=name)


def manipulator_to_dict(arm: Manipulator) -> dict[str, dict[str, Any]]:
    """Return the tables of an arm, every value spelt out; `manipulator_from_dict` reads them."""
    base = PRESETS.get(arm.name, PRESETS[DEFAULT_PRESET])
    table: dict[str, Any] = {"preset": base.name, "sections": len(arm.sections)}
    if arm.name != _derived_name(arm, base):
        table["name"] = arm.name
    for item in fields(Section):
        values = [_written(item, getattr(section, item.name)) for section in arm.sections]
        same = all(value == values[0] for value in values)
        table[toml_key(item)] = values[0] if same else values
    records = {"hydraulics": arm.hydraulics, "limits": arm.limits}
    return {"manipulator": table} | {name: dict(vars(part)) for name, part in records.items()}


def _derived_name(arm: Manipulator, base: Manipulator) -> str:
    """Return the preset's name only for the preset's numbers."""
    return base.name if replace(arm, name=base.name) == base else f"{base.name}, changed"


def _read_sections(table: Table, bases: list[Section]) -> tuple[Section, ...]:
    """Read every quantity for all sections at once, then deal them out."""
    columns = {item.name: _read_column(table, item, bases) for item in fields(Section)}
    return tuple(
        replace(base, **{name: column[i] for name, column in columns.items()})
        for i, base in enumerate(bases)
    )


def _read_column(table: Table, item: "Field[Any]", bases: list[Section]) -> tuple[Any, ...]:
    default = tuple(getattr(base, item.name) for base in bases)
    if toml_key(item) == ANGLES:
        return _read_angles(table, item.metadata["range"], default)
    return table.spread(toml_key(item), default, **vars(item.metadata["range"]))


def _read_angles(table: Table, span: Range, default: tuple[Any, ...]) -> tuple[Any, ...]:
    """Read one list of angles for all sections, or a list with one list a section."""
    if ANGLES not in table:
        return default
    given, count = table.raw(ANGLES), len(default)
    allowed: dict[str, Any] = {"unit": "deg"}
    allowed |= {"low": math.degrees(span.low), "high": math.degrees(span.high)}
    if not isinstance(given, list) or not any(isinstance(row, list) for row in given):
        return (_radians(table.vector(ANGLES, **allowed)),) * count
    if len(given) != count:
        wanted = f"one list of angles in deg for all sections or {count} lists, one a section"
        raise table.error(ANGLES, given, wanted)
    rows = Table({f"{ANGLES}[{i}]": row for i, row in enumerate(given)}, table.where)
    return tuple(_radians(rows.vector(f"{ANGLES}[{i}]", **allowed)) for i in range(count))


def _read_record(table: Table, base: R) -> R:
    """Read a table whose keys are the fields of a parameter class."""
    given: dict[str, Any] = {}
    for item in fields(base):
        default = getattr(base, item.name)
        if "range" in item.metadata:
            given[item.name] = table.number(item.name, default, **vars(item.metadata["range"]))
        else:
            given[item.name] = table.string(item.name, default, item.metadata["allowed"])
    table.finish()
    return replace(base, **given)


def _written(item: "Field[Any]", value: Any) -> Any:
    return [_degrees(angle) for angle in value] if toml_key(item) == ANGLES else value


def _radians(degrees: tuple[float, ...]) -> tuple[float, ...]:
    return tuple(math.radians(angle) for angle in degrees)


def _degrees(angle: float) -> float:
    """Return the shortest number of degrees that reads back as the same radians."""
    exact = math.degrees(angle)
    return next((d for n in range(15) if math.radians(d := round(exact, n)) == angle), exact)
