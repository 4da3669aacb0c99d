"""Numbers of a scene by path: `sections.mass`, `sections[2].mass`, `effects.payload.mass`, ….

Sections, and the numbers of a list, are counted from 1, base first. `sections.mass` stands for all
sections together. Every quantity of the arm, of its drive and of the effects has a path.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields, replace
from difflib import get_close_matches
from typing import Any

from softmpc.errors import InputError
from softmpc.model.quantities import Range
from softmpc.model.scene import Scene

__all__ = ["Place", "places_of", "resolve", "value_at", "with_values"]


@dataclass(frozen=True)
class Place:
    """Where a number of a scene is: the part, its field and, in a list, the index."""

    path: str
    part: tuple[str, Any]  # ("sections", 0 or None), ("hydraulics", None), ("effects", name)
    field: str
    index: int | None
    span: Range


def places_of(scene: Scene) -> dict[str, Place]:
    """All places of a scene by path."""
    arm, found = scene.manipulator, {}
    parts: list[tuple[str, tuple[str, Any], Any]] = [
        ("sections", ("sections", None), arm.sections[0])
    ]
    parts += [(f"sections[{i}]", ("sections", i - 1), s) for i, s in enumerate(arm.sections, 1)]
    parts += [("hydraulics", ("hydraulics", None), arm.hydraulics)]
    parts += [(f"effects.{e.name}", ("effects", e.name), e) for e in scene.effects]
    for name, part, record in parts:
        for place in _places(name, part, record):
            found[place.path] = place
    return found


def _places(name: str, part: tuple[str, Any], record: Any) -> Iterable[Place]:
    for item in fields(record):
        if "range" not in item.metadata:
            continue
        path, span = f"{name}.{item.name}", item.metadata["range"]
        if not item.metadata["many"]:
            yield Place(path, part, item.name, None, span)
            continue
        for k in range(len(getattr(record, item.name))):
            yield Place(f"{path}[{k + 1}]", part, item.name, k, span)


def resolve(scene: Scene, path: str) -> Place:
    """The place of that path; raises `InputError` with the nearest ones."""
    places = places_of(scene)
    if path in places:
        return places[path]
    near = get_close_matches(str(path), places, n=5, cutoff=0.5)
    hint = f"did you mean {' or '.join(map(repr, near))}? " if near else ""
    parts = sorted({place.rpartition(".")[0] for place in places})
    raise InputError(
        f"no number of this scene is called {path!r}; {hint}its numbers are those of "
        f"{', '.join(parts)}"
    )


def value_at(scene: Scene, place: Place) -> float:
    """The number at a place; of all sections together, the first one's."""
    kind, which = place.part
    arm = scene.manipulator
    if kind == "sections":
        record: Any = arm.sections[which or 0]
    elif kind == "hydraulics":
        record = arm.hydraulics
    else:
        record = next(effect for effect in scene.effects if effect.name == which)
    value = getattr(record, place.field)
    return float(value if place.index is None else value[place.index])


def with_values(scene: Scene, values: Mapping[Place, float]) -> Scene:
    """The scene with other numbers at some places.

    Raises `ParameterError` or `SceneError` for numbers that it may not have.
    """
    arm = scene.manipulator
    sections, hydraulics, effects = list(arm.sections), arm.hydraulics, list(scene.effects)
    for place, value in values.items():
        kind, which = place.part
        if kind == "sections":
            for i in range(len(sections)) if which is None else (which,):
                sections[i] = _changed(sections[i], place, value)
        elif kind == "hydraulics":
            hydraulics = _changed(hydraulics, place, value)
        else:
            i = next(i for i, effect in enumerate(effects) if effect.name == which)
            effects[i] = _changed(effects[i], place, value)
    changed = replace(arm, sections=tuple(sections), hydraulics=hydraulics)
    return scene.with_(manipulator=changed, effects=tuple(effects))


def _changed(record: Any, place: Place, value: float) -> Any:
    if place.index is None:
        return replace(record, **{place.field: value})
    numbers = list(getattr(record, place.field))
    numbers[place.index] = value
    return replace(record, **{place.field: tuple(numbers)})
