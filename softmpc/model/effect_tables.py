"""The [effects] table of scene files: `name = true`, `false`, or a table of its parameters.

All of it comes from `EFFECTS` and from the fields of its classes. `gravity` is its vector, and the
tip load has a table of its own.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import fields
from typing import Any, TypeVar

from softmpc.errors import SceneError, errors_in
from softmpc.model.effects import EFFECTS, Effect, RotaryInertia, TipLoad
from softmpc.model.quantities import Range, toml_key
from softmpc.model.tables import Table

__all__ = ["SWITCHED", "read_effects", "write_effects"]

# The effects that [effects] names, in its order.
SWITCHED: tuple[type[Effect], ...] = tuple(kind for kind in EFFECTS if kind is not TipLoad)

R = TypeVar("R")


def read_effects(table: Table, strains: Iterable[str]) -> tuple[Effect, ...]:
    """Read the effects; of those that are there by default, some follow what they need."""
    if "friction" in table:
        raise SceneError(
            f"{table.where} friction: friction of the pistons belongs to the drive: set "
            "[actuation] kind = 'hydraulic-friction' and its size in [hydraulics]"
        )
    found: list[Effect] = []
    names: set[str] = set()
    for kind in SWITCHED:
        wanted = kind.by_default and names.issuperset(kind.needs)
        if kind is RotaryInertia and "kappa_z" not in strains:
            wanted = False
        effect = _read_effect(table, kind, wanted)
        if effect is not None:
            found.append(effect)
            names.add(kind.name)
    table.finish()
    return tuple(found)


def _read_effect(table: Table, kind: type[Effect], wanted: bool) -> Effect | None:
    value = table.raw(kind.name, wanted)
    if value is False:
        return None
    where = f"{table.where} {kind.name}"
    if kind.bare is not None:
        return kind(**{kind.bare: _read_field(table, kind.name, _field(kind, kind.bare))})
    if not fields(kind):  # type: ignore[arg-type]
        return kind() if table.boolean(kind.name, wanted) else None
    if value is not True and not isinstance(value, dict):
        keys = ", ".join(f"{toml_key(item)} = …" for item in fields(kind))  # type: ignore[arg-type]
        raise table.error(kind.name, value, f"true, false or a table {{{keys}}}")
    return read_record(kind, Table({} if value is True else value, where))


def read_record(kind: type[R], table: Table) -> R:
    """Read an object whose parameters are the keys of a table; what is not given is default."""
    given = {
        item.name: _read_field(table, toml_key(item), item)
        for item in fields(kind)  # type: ignore[arg-type]
        if toml_key(item) in table
    }
    table.finish()
    with errors_in(table.where):
        return kind(**given)


def _field(kind: type, name: str) -> Any:
    return next(item for item in fields(kind) if item.name == name)


def _read_field(table: Table, key: str, item: Any) -> Any:
    data = item.metadata
    if "parts" in data:
        return _read_parts(table, key, data["parts"])
    if "allowed" in data:
        return table.string(key, allowed=data["allowed"])
    span: Range = data["range"]
    if data["many"]:
        return table.vector(key, data["count"], **vars(span))
    return table.number(key, **vars(span))


def _read_parts(table: Table, key: str, allowed: dict[str, type]) -> tuple[Any, ...]:
    value = table.raw(key)
    if not isinstance(value, list | tuple):
        raise table.error(key, value, "a list of tables, each with its kind")
    rows = [Table(row, f"{table.where} {key}[{i}]") for i, row in enumerate(value)]
    return tuple(read_record(allowed[row.string("kind", allowed=allowed)], row) for row in rows)


def write_effects(effects: Iterable[Effect]) -> dict[str, Any]:
    """The [effects] table that `read_effects` reads: what is there, and what is not but would be.

    Effects that scene files do not know are left out; the caller compares.
    """
    there = {type(effect): effect for effect in effects}
    written: dict[str, Any] = {}
    for kind in SWITCHED:
        if kind in there:
            record = write_record(there[kind])
            written[kind.name] = record[kind.bare] if kind.bare else record or True
        elif kind.by_default:
            written[kind.name] = False
    return written


def write_record(record: Any) -> dict[str, Any]:
    """The keys and values of an object, every one spelt out."""
    return {toml_key(item): _written(item, getattr(record, item.name)) for item in fields(record)}


def _written(item: Any, value: Any) -> Any:
    if "parts" in item.metadata:
        kinds = {kind: name for name, kind in item.metadata["parts"].items()}
        return [{"kind": kinds[type(part)], **write_record(part)} for part in value]
    return list(value) if isinstance(value, tuple) else value
