"""The reference page of scene files, made from the dataclasses and from the slots' docstrings."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import Field, fields
from typing import Any

from softmpc.model.effect_tables import SWITCHED
from softmpc.model.manipulator_tables import ANGLES, MAX_SECTIONS, manipulator_to_dict
from softmpc.model.parameters import Hydraulics, Limits, Section
from softmpc.model.presets import DEFAULT_PRESET, PRESETS, preset
from softmpc.model.quantities import Range, toml_key
from softmpc.model.scene import MAX_SEGMENTS, SCHEMA_VERSION, STRAINS
from softmpc.model.scene_file import (
    ACTUATIONS,
    ELASTICITIES,
    FORMULATIONS,
    KINEMATICS,
    MASSES,
)

__all__ = ["reference_page"]

QUANTITIES = ("key", "unit", "default", "range", "source", "meaning")
WORDS = ("key", "default", "allowed", "meaning")
Rows = Iterable[tuple[Any, ...]]


def reference_page() -> str:
    """Return the Markdown page docs/scene_reference.md."""
    defaults = manipulator_to_dict(preset())
    arm = [(item, defaults["manipulator"][toml_key(item)]) for item in fields(Section)]
    parts = [
        "# Scene files",
        "A scene file is TOML. Every table and key is optional; an unknown one is an error. "
        "[`[track]`](mpc.md#the-table-track), [`[rig]`](rig.md#the-table), "
        "[`[plan]`](planning.md#the-table-plan) and "
        "[`[simulate]`](simulation.md#the-table-simulate) are described with their commands.",
        _table(WORDS, _top_rows()),
        "## [manipulator]",
        "Each number is one for all sections, or a list with one a section. What is not given is "
        "the preset's: nothing is recomputed from another value.",
        _table(WORDS, _manipulator_rows()),
        _table(QUANTITIES, [_quantity_row(item, value) for item, value in arm]),
    ]
    for name, record in (("hydraulics", Hydraulics), ("limits", Limits)):
        rows = [_quantity_row(item, defaults[name][item.name]) for item in fields(record)]
        parts += [f"## [{name}]", _first_line(record), _table(QUANTITIES, rows)]
    parts += ["## [model]", _table(WORDS, _model_rows()), _names("kinematics", KINEMATICS)]
    parts += [_names("formulation", FORMULATIONS), _names("mass", MASSES)]
    parts += [_names("elasticity", ELASTICITIES)]
    parts += ["## [effects]", _table(WORDS, _effect_rows()), *_effect_parts()]
    parts += ["## [actuation]", _table(WORDS, _actuation_rows()), _names("kind", ACTUATIONS)]
    parts += ["## [load]", _table(WORDS, _load_rows())]
    return "\n\n".join(parts) + "\n"


def _top_rows() -> Rows:
    yield "schema", SCHEMA_VERSION, SCHEMA_VERSION, "version of the format"
    yield "title", "", "a text", "for people"


def _manipulator_rows() -> Rows:
    yield "preset", DEFAULT_PRESET, _words(PRESETS), "gives every value that is not written"
    yield (
        "sections",
        len(preset().sections),
        f"1 to {MAX_SECTIONS}",
        "number of sections; beyond the preset's, its sections are repeated in turn",
    )
    yield "name", "the preset's", "a text", "label of the arm"


def _model_rows() -> Rows:
    yield "segments", 1, f"1 to {MAX_SEGMENTS}", "segments a section"
    yield "kinematics", "constant-strain", _words(KINEMATICS), "arc of a segment"
    yield "formulation", "virtual-power", _words(FORMULATIONS), "equations of motion"
    yield "mass", "the formulation's", _words(MASSES), "where a segment's mass is"
    yield "elasticity", "the formulation's", _words(ELASTICITIES), "law of the wall"
    yield "strains", "all four", _words(STRAINS), "list of the strains that are states"


def _effect_rows() -> Rows:
    defaults = {
        "coriolis": "as `inertia`",
        "rotary_inertia": "as `inertia`, where kappa_z is a state",
    }
    for kind in SWITCHED:
        default = defaults.get(kind.name, "true" if kind.by_default else "false")
        allowed = "true, false"
        if kind.bare:
            default, allowed = (
                "none",
                f"[x, y, z] in {_field(kind, kind.bare).metadata['range'].unit}",
            )
        elif fields(kind):  # type: ignore[arg-type]
            allowed = "true, false, or a table of its parameters"
        yield kind.name, default, allowed, _first_line(kind)


def _effect_parts() -> Iterable[str]:
    """Tables of parameters, for each effect that has some."""
    for kind in SWITCHED:
        if kind.bare or not fields(kind):  # type: ignore[arg-type]
            continue
        yield f"### {kind.name}"
        yield _first_line(kind)
        yield from _record_tables(kind)


def _record_tables(kind: type) -> Iterable[str]:
    items = fields(kind)
    yield _table(QUANTITIES, [_quantity_row(item, _default(item)) for item in items])
    for item in items:
        for name, part in item.metadata.get("parts", {}).items():
            yield f'`{item.name}` of `kind = "{name}"`: {_first_line(part)}'
            yield from _record_tables(part)


def _field(kind: type, name: str) -> Any:
    return next(item for item in fields(kind) if item.name == name)


def _default(item: "Field[Any]") -> Any:
    return list(item.default) if isinstance(item.default, tuple) else item.default


def _actuation_rows() -> Rows:
    yield "kind", "hydraulic", _words(ACTUATIONS), "what drives the units"


def _load_rows() -> Rows:
    yield "tip_force", "none", "[x, y, z] in N", "dead force at the tip, in the base frame"
    yield "tip_moment", "none", "[x, y, z] in N·m", "dead moment at the tip, in the base frame"


def _quantity_row(item: "Field[Any]", default: Any) -> tuple[Any, ...]:
    source, doc = item.metadata["source"], item.metadata["doc"]
    if "allowed" in item.metadata:
        return item.name, "", f"`{default}`", _words(item.metadata["allowed"]), source, doc
    if "parts" in item.metadata:
        kinds = _words(item.metadata["parts"])
        return item.name, "", default, f"list of tables, `kind` one of {kinds}", "", doc
    allowed: Range = item.metadata["range"]
    unit, low, high = allowed.unit, allowed.low, allowed.high
    if toml_key(item) == ANGLES:
        unit, low, high = "deg", math.degrees(low), math.degrees(high)
    span = (
        f"{'> ' if allowed.low_open else ''}{low:g} to {high:g}" if math.isfinite(high) else "any"
    )
    span = f"{span}, inf" if allowed.or_inf else span
    return toml_key(item), unit, default, span, source, doc


def _table(header: tuple[str, ...], rows: Rows) -> str:
    lines = [header, ("---",) * len(header)]
    lines += [(f"`{key}`", *(str(cell) for cell in rest)) for key, *rest in rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _names(key: str, options: Mapping[str, Any]) -> str:
    """Return what each name allowed for ``key`` stands for, from the docstrings."""
    lines = [f"- `{name}`: {_first_line(option)}" for name, option in options.items()]
    return "\n".join([f"Names of `{key}`:", "", *lines])


def _words(names: Iterable[str]) -> str:
    return ", ".join(f"`{name}`" for name in names)


def _first_line(option: Any) -> str:
    return (option.__doc__ or "").strip().splitlines()[0]
