"""What a controller may be: segments, drive, how far and how finely it looks ahead, its step."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from softmpc.accuracy.candidates import (
    AS_GIVEN,
    Candidate,
    Option,
    Space,
    coarser_drives,
    coarser_strains,
    discretisations,
    left_out,
)
from softmpc.accuracy.configuration import Task, changed
from softmpc.control.controller_table import ControllerSettings
from softmpc.control.track_scene import read_tracking
from softmpc.errors import SceneError
from softmpc.model.scene_file import scene_from_dict

__all__ = ["PREFIX", "controller_document", "loop_space"]

CONTROLLER = "track.controller."
PREFIX = f"{CONTROLLER}scene."  # of the keys of what the controller takes the arm for
ALONE = 4  # intervals of one step, before a graded look ahead has longer ones
SEGMENTS = (1, 2), (3,)  # below the plant's, or nothing would tell a model from the truth
INERTIA = "effect inertia"  # a controller's model moves
MOST_EQUAL = 40  # intervals
SAMPLES = 200  # of a path
STRAIGHT = 1e-3  # m; a path that leaves a plane by less stays in it


def loop_space(task: Task, rate_hz: float | None) -> Space:
    """Controllers of a scene; with a rate their step is its inverse.

    Raises `SceneError` where the controller's scene is another file, which cannot be changed here.
    """
    given = task.document["track"].get("controller", {})
    if isinstance(given.get("scene"), str):
        raise SceneError(
            f"[track.controller] scene = {given['scene']!r}: a choice changes keys of the "
            "controller's scene; write these as a table, scene = { model = { segments = 2 } }"
        )
    scene = scene_from_dict(controller_document(task.document))
    whole, graded, short = _looks_ahead(given, rate_hz)
    first, finer = discretisations(scene, PREFIX, SEGMENTS)
    start = AS_GIVEN if rate_hz is None else AS_GIVEN.with_(whole)
    rounds = (start, *_loops(first, [graded])), (*_loops(first, [whole]), *_loops(finer, [graded]))
    strains = [one for one in coarser_strains(scene, PREFIX) if _stays_in(task, one)]
    light = Option("mass", 0.65, "1 Gauss point", {f"{PREFIX}model.mass": "gauss-1"})
    extras = [
        *coarser_drives(scene, PREFIX), *strains,
        *(one for one in left_out(scene, PREFIX) if one.slot != INERTIA),
        light, short, *_fewer_stages(given),
    ]  # fmt: skip
    return Space(rounds, tuple(extras))


def controller_document(document: Mapping[str, Any]) -> dict[str, Any]:
    """The scene that the controller takes the arm for, as the parsed file of its own."""
    own = {name: part for name, part in document.items() if name not in ("track", "rig", "plan")}
    changes = document["track"].get("controller", {}).get("scene", {})
    return changed(own, dict(_dotted(changes)))


def _stays_in(task: Task, strains: Option) -> bool:
    """Whether the path stays in the plane that strains bend in, where they bend in one alone."""
    across = [i for i, plane in enumerate(("about y", "about x")) if plane in strains.name]
    if not across:
        return True
    document = dict(task.document)
    path = read_tracking(document["track"], Path(task.folder), document).reference
    places = path.position(np.linspace(0.0, path.duration, SAMPLES))
    return bool(np.abs(places[:, 1 - across[0]]).max() <= STRAIGHT)


def _loops(choices: Sequence[tuple[Option, ...]], ahead: Sequence[Option]) -> list[Candidate]:
    """With two Gauss points alone: fewer are an extra."""
    fine = [one for one in choices if one[1].share == 1.0]
    return [Candidate((*one, look)) for one, look in product(fine, ahead)]


def _looks_ahead(given: Mapping[str, Any], rate_hz: float | None) -> Iterator[Option]:
    """The time looked ahead as given, in equal and in growing intervals, and half of it."""
    own = given.get("step", ControllerSettings.step)
    step = own if rate_hz is None else float(f"{1 / rate_hz:.6g}")
    lengths = given.get("grid") or [1.0] * given.get("horizon", ControllerSettings.horizon)
    steps = max(2, round(sum(lengths) * own / step))
    same: dict[str, Any] = {} if step == own else {"step": step}
    equal = same | {"horizon": steps, "grid": None, "blocks": None}
    if step == own or steps > MOST_EQUAL:
        count = len(lengths)
        equal = same if step == own else equal | {"horizon": None, "grid": _graded(steps)}
    else:
        count = steps
    yield _ahead(count, "" if step == own else f"step {1e3 * step:g} ms", equal)
    for share, name in ((1, "growing intervals"), (2, "half as far ahead")):
        grid = _graded(max(2, steps // share))
        own_grid = same | {"horizon": None, "blocks": None, "grid": grid}
        yield _ahead(len(grid), name, own_grid)


def _ahead(count: int, name: str, changes: Mapping[str, Any]) -> Option:
    return Option("ahead", count, name, {f"{CONTROLLER}{key}": v for key, v in changes.items()})


def _graded(steps: int) -> list[float]:
    """Lengths of intervals, in steps: some of one, then growing ones, that end at `steps`."""
    lengths = [1.0] * min(ALONE, steps)
    while (left := steps - sum(lengths)) > 0:
        lengths.append(min(left, 2.0 ** (1 + (len(lengths) - ALONE) // 2)))
    return lengths


def _fewer_stages(given: Mapping[str, Any]) -> Iterator[Option]:
    now = given.get("stages", ControllerSettings.stages)
    for count in range(1, now):
        spelt = "1 stage" if count == 1 else f"{count} stages"
        yield Option("stages", count / now, f"{spelt} an interval", {f"{CONTROLLER}stages": count})


def _dotted(changes: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, Any]]:
    """Dotted keys of nested tables."""
    for key, value in changes.items():
        if isinstance(value, Mapping):
            yield from _dotted(value, f"{above}{key}.")
        else:
            yield f"{above}{key}", value
