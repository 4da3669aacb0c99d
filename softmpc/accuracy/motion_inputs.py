"""Inputs of a motion for scenes that only have a tracking task: the torques that it applied."""

from __future__ import annotations

import hashlib
import json
import sys
from contextlib import suppress
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from softmpc import library_cache
from softmpc.accuracy.configuration import Task
from softmpc.control.paths import TimeLaw
from softmpc.control.planned import motion_of
from softmpc.control.track_scene import Tracking, read_tracking
from softmpc.control.tracking import track
from softmpc.errors import SceneError
from softmpc.files import replacing
from softmpc.model.scene_file import scene_from_dict
from softmpc.simulation.inputs import InputProfile

__all__ = ["tracking_inputs"]


def tracking_inputs(task: Task, longest: float) -> InputProfile:
    """What the scene's tracking task applied in its first seconds, each torque held for its step.

    The task is run once a scene: a file in the folder of the cache (SOFTMPC_CACHE) keeps what it
    applied for other processes. Raises `SceneError` where it does not come to its end.
    """
    told = json.dumps([dict(task.document), task.folder, longest], sort_keys=True, default=str)
    times, values = _kept(told)
    return InputProfile.from_table(times, values, hold=True)


@cache
def _kept(told: str) -> tuple[list[float], list[list[float]]]:
    version = sys.modules["softmpc"].__version__
    name = hashlib.sha256((version + told).encode()).hexdigest()[:32]
    path = library_cache.folder() / f"inputs-{name}.json"
    with suppress(OSError, ValueError, TypeError, KeyError):
        kept = json.loads(path.read_text(encoding="utf-8"))
        return kept["times"], kept["values"]
    times, values = _applied(*json.loads(told))
    with suppress(OSError), replacing(path) as beside:
        beside.write_text(json.dumps({"times": times, "values": values}), encoding="utf-8")
    return times, values


def _applied(
    document: dict[str, Any], folder: str, longest: float
) -> tuple[list[float], list[list[float]]]:
    """Times (K, s) and torques (K×k) of a run; the first row is what held the start."""
    task = read_tracking(document["track"], Path(folder), document)
    run = track(scene_from_dict(document), _shortened(task, longest))
    if run.status == "interrupted":
        raise KeyboardInterrupt
    if run.status != "finished":
        raise SceneError(f"[track]: its torques cannot be had, {run.status}")
    step = task.controller.step
    before = run.u[:1] if run.u_start is None else run.u_start[None]
    ends = run.control_time[-1] + step  # where the last torque ends
    times = np.concatenate([[-step], run.control_time, [ends]])
    values = np.vstack([before, run.u, run.u[-1:]])
    return np.round(times, 12).tolist(), values.tolist()


def _shortened(task: Tracking, longest: float) -> Tracking:
    """As far as the path is within reach, and no longer (s) where its laps can be cut."""
    reference, law = task.reference, task.reference.law
    task = replace(task, on_infeasible="project")
    if reference.duration <= longest or motion_of(reference) or not isinstance(law, TimeLaw):
        return task
    laps = (longest - law.smooth_start / 2) / law.lap_time
    if laps <= 0:
        return task
    return replace(task, reference=replace(reference, law=replace(law, laps=laps)))
