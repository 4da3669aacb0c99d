"""Plans as files: `plan.npz` with all of it, a table, a summary, and scenes that replay and track.

A stored plan loads again as the result it was, with its problem. What scene files do not know
(effects, limits or targets of one's own) is not stored; `load_plan` is then given the problem.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from softmpc import __version__
from softmpc.control import limits
from softmpc.control.clearance import KeepClear
from softmpc.errors import InputError, SceneError
from softmpc.files import as_json, reading_npz, replacing
from softmpc.model.model import build
from softmpc.model.obstacles import OBSTACLES
from softmpc.model.scene import Scene
from softmpc.model.scene_file import scene_from_dict, scene_to_dict, write_document
from softmpc.planning.along import Beyond
from softmpc.planning.attempt import Found
from softmpc.planning.giving_way import GivesWay
from softmpc.planning.goals import Goal, Start
from softmpc.planning.problem import PlanProblem
from softmpc.planning.replay import TIGHT, Replay
from softmpc.planning.result import Level, PlanResult, StartReport
from softmpc.simulation.columns import write_columns
from softmpc.statics.targets import Direction, Orientation, Position

__all__ = ["load_plan", "plan_summary", "save_plan"]

SCHEMA = 1
PARTS: dict[str, Any] = {
    kind.__name__: kind for kind in (Position, Direction, Orientation, KeepClear)
}
PARTS |= {kind.__name__: kind for kind in OBSTACLES.values()}
PARTS |= {name: getattr(limits, name) for name in limits.__all__ if name.endswith("Limit")}
PARTS |= {kind.__name__: kind for kind in (limits.TipBox, limits.TipCone)}
RECORDS: dict[str, type] = {"starts": StartReport, "levels": Level, "gives_way": GivesWay}
SAMPLED = {"t": "samples_t", "x": "samples_x", "tips": "samples_tips", "pressures": "samples_p"}
SAMPLES = 1e-3  # s, between those of the replay's simulation at most
MPA = 1e6

T = TypeVar("T")
Array = np.ndarray


def save_plan(result: PlanResult, folder: str | os.PathLike[str]) -> list[Path]:
    """Write a plan to a folder and return the files; without any motion `plan.json` alone.

    `plan.npz` (everything), `plan.csv` (its simulation), `plan.json` (summary), `replay.csv` (its
    inputs, held), `replay.toml` (`softmpc simulate` moves so) and `track.toml` (`softmpc track`
    follows it). A scene that files do not know has no TOML files.
    """
    folder = Path(folder)
    paths = [folder / "plan.json"]
    with replacing(paths[0]) as beside:
        beside.write_text(as_json(plan_summary(result), indent=2) + "\n", encoding="utf-8")
    if result.found is None or result.replay is None:
        return paths
    paths += [folder / name for name in ("plan.npz", "plan.csv", "replay.csv")]
    about, arrays = json.dumps(_about(result), default=_number), _arrays(result, result.replay)
    with replacing(paths[1]) as beside, open(beside, "wb") as file:
        np.savez_compressed(file, allow_pickle=False, about=np.array(about), **arrays)
    write_columns(paths[2], _samples(result, result.replay))
    inputs = np.vstack([result.u, result.u_after])
    write_columns(paths[3], {"t [s]": result.t, **_inputs(result, inputs)})
    scene = _scene(result.problem.model.scene)
    if scene is not None:
        for name, table in (("replay", _simulate(result)), ("track", _track())):
            paths.append(folder / f"{name}.toml")
            write_document({"title": f"{_title(result)}: {name}", **scene, **table}, paths[-1])
    return paths


def plan_summary(result: PlanResult) -> dict[str, Any]:
    """The summary, and what it was made with: version and a hash of the scene."""
    scene = _scene(result.problem.model.scene)
    text = None if scene is None else json.dumps(scene, sort_keys=True)
    hashed = None if text is None else hashlib.sha256(text.encode()).hexdigest()
    return {**result.summary(), "softmpc": __version__, "scene_sha256": hashed}


def load_plan(path: str | os.PathLike[str], problem: PlanProblem | None = None) -> PlanResult:
    """A plan from its folder, or from its `plan.npz`.

    `problem` is needed where the plan was made with parts of one's own. Raises `InputError` for
    what is no plan.
    """
    path = Path(path)
    path = path / "plan.npz" if path.is_dir() else path
    with reading_npz(path, "plan", (SCHEMA,)) as (about, arrays):
        if problem is None and about["problem"] is None:
            raise InputError(
                f"{path}: has parts that files do not know: give load_plan the problem as well"
            )
        samples = {field: arrays[name] for field, name in SAMPLED.items()}
        moves = {f.name: arrays[f.name] for f in fields(Found) if f.name in arrays}
        beyond = {name: Beyond(**one) for name, one in about["replay"].pop("beyond").items()}
        rest: dict[str, Any] = {name: _all(kind, about[name]) for name, kind in RECORDS.items()}
        return PlanResult(
            problem=problem or _problem(about["problem"], arrays),
            found=Found(**moves, **_tuples(about["found"])),
            replay=Replay(**samples, beyond=beyond, **_tuples(about["replay"])),
            **rest,
            **_tuples({name: about[name] for name in _others()}),
        )


# ---------------------------------------------------------------- everything


def _arrays(result: PlanResult, replay: Replay) -> dict[str, Array]:
    """What readers of motions want, and what else an exact copy needs."""
    none = np.full(len(result.problem.start.x), np.nan)
    states = [none if goal.state is None else goal.state for goal in result.problem.goals]
    samples = {name: getattr(replay, field) for field, name in SAMPLED.items()}
    found = result.found
    assert found is not None  # where there is a replay
    return {
        "t": result.t, **{k: v for k, v in vars(found).items() if isinstance(v, np.ndarray)},
        "u_before": result.problem.start.u, "u_after": result.u_after,
        **samples, "goal_states": np.array(states),
    }  # fmt: skip


def _about(result: PlanResult) -> dict[str, Any]:
    about: dict[str, Any] = {"schema": SCHEMA, "softmpc": __version__}
    about |= {name: getattr(result, name) for name in _others()}
    about |= {name: [vars(one) for one in getattr(result, name)] for name in RECORDS}
    about |= {name: _without_arrays(getattr(result, name)) for name in ("found", "replay")}
    return about | {"problem": _described(result.problem)}


def _others() -> list[str]:
    """Fields of a result that are plain data."""
    known = "problem", "found", "replay", *RECORDS
    return [f.name for f in fields(PlanResult) if f.name not in known]


def _number(value: Any) -> Any:
    """A NumPy scalar as Python has it; a record as its fields."""
    return vars(value) if is_dataclass(value) else value.item()


def _without_arrays(record: Any) -> dict[str, Any]:
    return {k: v for k, v in vars(record).items() if not isinstance(v, np.ndarray)}


def _tuples(record: dict[str, Any]) -> dict[str, Any]:
    return {k: tuple(v) if isinstance(v, list) else v for k, v in record.items()}


def _all(kind: type[T], records: Iterable[dict[str, Any]]) -> tuple[T, ...]:
    return tuple(kind(**record) for record in records)


# ---------------------------------------------------------------- the problem


def _described(problem: PlanProblem) -> dict[str, Any] | None:
    """A problem as plain data, None where it has parts that nobody knows here."""
    scene = _scene(problem.model.scene)
    names = ("least", "duration", "rate", "margin", "back_off", "limits", "obstacles")
    try:
        described = {name: _plain(getattr(problem, name)) for name in names}
        goals = [
            {"targets": _plain(g.targets), "rest": g.rest, "after": g.after} for g in problem.goals
        ]
    except _Unknown:
        return None
    return None if scene is None else {"scene": scene, "goals": goals, **described}


def _problem(data: dict[str, Any], arrays: dict[str, Array]) -> PlanProblem:
    states = arrays["goal_states"]
    goals = tuple(
        Goal(_parts(g["targets"]), g["rest"], None if np.isnan(x).any() else x, g["after"])
        for g, x in zip(data.pop("goals"), states, strict=True)
    )
    model = build(scene_from_dict(data.pop("scene")))
    start = Start(arrays["x"][0], arrays["u_before"])
    return PlanProblem(model, start, goals, **{name: _parts(one) for name, one in data.items()})


class _Unknown(Exception):
    """A part that is none of `PARTS`."""


def _plain(value: Any) -> Any:
    """Numbers, texts, lists, and parts as their class with what it was made of."""
    if isinstance(value, tuple | list):
        return [_plain(one) for one in value]
    if not is_dataclass(value):
        return value
    name = type(value).__name__
    if PARTS.get(name) is not type(value):
        raise _Unknown(name)
    made_of = {f.name: _plain(getattr(value, f.name)) for f in fields(value) if f.init}
    return {"class": name, **made_of}


def _parts(value: Any) -> Any:
    """The inverse; lists become tuples."""
    if isinstance(value, list):
        return tuple(_parts(one) for one in value)
    if not isinstance(value, dict):
        return value
    return PARTS[value["class"]](**{k: _parts(v) for k, v in value.items() if k != "class"})


def _scene(scene: Scene) -> dict[str, Any] | None:
    """The scene as a scene file, None where files do not know it."""
    try:
        return scene_to_dict(scene)
    except SceneError:
        return None


# ---------------------------------------------------------------- tables and scenes


def _inputs(result: PlanResult, u: Array) -> dict[str, Array]:
    """Columns of the inputs, as tables of [simulate] have them: N·m, or MPa."""
    names = result.problem.model.layout.u.names
    unit, size = ("N·m", 1.0)
    if result.problem.model.scene.actuation.input == "pressure":
        unit, size = "MPa", MPA
    return {f"{name} [{unit}]": column / size for name, column in zip(names, u.T, strict=True)}


def _samples(result: PlanResult, replay: Replay) -> dict[str, Array]:
    """Columns over time of the replay: inputs held from then on, section tips, pressures."""
    held = np.minimum(np.searchsorted(result.t, replay.t + 1e-9) - 1, len(result.u))
    columns = {"t [s]": replay.t, **_inputs(result, np.vstack([result.u, result.u_after])[held])}
    for i in range(replay.tips.shape[1]):
        columns |= {f"{a}_{i + 1} [m]": replay.tips[:, i, k] for k, a in enumerate("xyz")}
    if result.problem.model.scene.actuation.input == "torque":
        names = result.problem.model.layout.p.names
        pressures = replay.pressures.T / MPA
        columns |= {f"{name} [MPa]": p for name, p in zip(names, pressures, strict=True)}
    return columns


def _simulate(result: PlanResult) -> dict[str, Any]:
    """The table [simulate] of a replay, which ends with the plan."""
    return {
        "simulate": {
            "duration": result.time,
            "sample_time": min(SAMPLES, result.time),
            "start": "plan.npz",
            "start_time": 0.0,
            "table": "replay.csv",
            "hold": True,
            "method": TIGHT.name,
            "tolerance": TIGHT.tolerance,
        }
    }


def _track() -> dict[str, Any]:
    """The table [track] along the plan."""
    return {"track": {"path": "plan", "file": "plan.npz"}}


def _title(result: PlanResult) -> str:
    return result.title or f"Plan of least {result.problem.least}"
