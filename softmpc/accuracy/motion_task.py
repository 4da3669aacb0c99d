"""The motion that a study runs: models and settings of a scene file with some keys changed."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from softmpc.accuracy.configuration import Task
from softmpc.accuracy.motion_inputs import tracking_inputs
from softmpc.errors import SceneError
from softmpc.model.model import Model, build
from softmpc.model.scene_file import scene_from_dict
from softmpc.simulation.inputs import InputProfile
from softmpc.simulation.integrator import IntegrationError, Integrator
from softmpc.simulation.methods import integrator_for
from softmpc.simulation.run import sample_times, start_state, states_at
from softmpc.simulation.settings import SimulationSettings, read_settings
from softmpc.study.windows import later, mapped_state

__all__ = [
    "PATIENCE", "Moved", "about_motion", "integrator_of", "longest", "model_of", "moved", "run",
    "settings_of", "why_no_motion",
]  # fmt: skip

QUICK, FULL = 2.0, 10.0  # s of motion at most
LEAD = 0.05  # s of rest that is kept before the inputs begin to change
MOST_SAMPLES = 1000
PATIENCE = {True: 30.0, False: 120.0}  # s of a core that one run may take, by `quick`


def why_no_motion(task: Task) -> str:
    """What a scene lacks to have a motion; empty where it has one."""
    if "simulate" in task.document or "track" in task.document:
        return ""
    return "the scene has no motion: add a table [simulate] or [track]"


def longest(task: Task) -> float:
    """How much of a motion is run (s)."""
    return QUICK if task.quick else FULL


def model_of(document: dict[str, Any]) -> Model:
    """The model of a parsed scene file."""
    return build(scene_from_dict(document))


def settings_of(task: Task, document: dict[str, Any], model: Model) -> SimulationSettings:
    """Inputs, start and method of the motion for a model of the scene file as changed.

    Of a motion that is longer than `longest` the part is taken that begins when the inputs begin to
    change, where the arm rests until then. Raises `SceneError` where there is no motion.
    """
    if reason := why_no_motion(task):
        raise SceneError(reason)
    given = model_of(dict(task.document))
    if "simulate" in task.document:
        settings = read_settings(document, given, Path(task.folder))
    else:
        settings = _tracking(task, document, given)
    settings = _shortened(settings, longest(task))
    return replace(settings, start=_start(settings, given, model))


def _tracking(task: Task, document: dict[str, Any], given: Model) -> SimulationSettings:
    """The torques that the task applied, as inputs of a motion from rest."""
    profile = tracking_inputs(task, longest(task))
    duration = float(max(curve.times[-1] for curve in profile.curves))
    table = {"duration": duration, **document.get("simulate", {})}
    settings = read_settings({"simulate": table}, given, Path(task.folder))
    return replace(settings, profile=profile)


def _shortened(settings: SimulationSettings, most: float) -> SimulationSettings:
    """At most so long (s), and with a bearable number of samples."""
    begin = _calm(settings) if settings.duration > most else 0.0
    duration = min(settings.duration - begin, most)
    coarsest = max(settings.sample_time, duration / MOST_SAMPLES)
    profile = later(settings.profile, begin) if begin else settings.profile
    return replace(settings, profile=profile, duration=duration, sample_time=coarsest)


def _calm(settings: SimulationSettings) -> float:
    """How long (s) the arm rests before its inputs change, less a little; whole samples."""
    starts = np.concatenate([curve.starts for curve in settings.profile.curves])
    if settings.start != "rest" or not len(starts):
        return 0.0
    samples = int(max(0.0, starts.min() - LEAD) / settings.sample_time)
    begin = samples * settings.sample_time
    return begin if begin < settings.duration else 0.0


def _start(settings: SimulationSettings, given: Model, model: Model) -> str | np.ndarray:
    """A start given as a state is one of the scene as given."""
    if isinstance(settings.start, str) or model.scene == given.scene:
        return settings.start
    held = InputProfile.constant(settings.profile.before(0.0).tolist())
    return mapped_state(settings.start, given, model, start_state(model, held, "straight"))


def about_motion(task: Task) -> str:
    """What is run, for people."""
    document = dict(task.document)
    settings = settings_of(task, document, model_of(document))
    whole = "the motion of [simulate]"
    if "simulate" not in task.document:
        whole = "open loop under the torques that [track] applied"
    return f"{whole}, {settings.duration:g} s of it"


@dataclass(frozen=True, eq=False)
class Moved:
    """A motion at K times (s): strains (K×n) and section tips (K×S×3, m)."""

    time: np.ndarray
    q: np.ndarray
    tips: np.ndarray


def integrator_of(model: Model, settings: SimulationSettings) -> Integrator:
    """The method of the settings, its functions made."""
    numbers = {key: getattr(settings, key) for key in ("tip_tolerance", "tolerance", "step")}
    integrator = integrator_for(model, settings.method, **numbers)
    integrator.prepare()
    return integrator


def moved(model: Model, settings: SimulationSettings, patience: float) -> Moved:
    """The motion; raises `IntegrationError` where its end is not reached, within `patience` (s).

    As `simulate` runs it, without what that makes besides.
    """
    settings.profile.check(model)
    x = start_state(model, settings.profile, settings.start)
    time, states = run(integrator_of(model, settings), settings, x, patience)
    q = states[:, : model.strains]
    tips = np.asarray(model.frames.map(len(q))(q.T)[0]).T.reshape(len(q), -1, 3)
    if not np.all(np.isfinite(tips)):
        raise IntegrationError("the motion has values that are not finite")
    return Moved(time, q, tips)


def run(
    integrator: Integrator, settings: SimulationSettings, x: np.ndarray, patience: float
) -> tuple[np.ndarray, np.ndarray]:
    """Times (K, s) and states (K×nx) from x on; raises as `moved`.

    Patience is time of the processor (s), which other programs do not change. It is looked at
    between the pieces of a run: where inputs bend, and every 200 samples.
    """
    began = time.process_time()

    def waiting(reached: float, duration: float) -> None:
        if time.process_time() - began > patience and reached < duration:
            raise IntegrationError(f"took longer than {patience:g} s to come to {reached:.3g} s")

    stamps = sample_times(settings.duration, settings.sample_time)
    status, times, states = states_at(integrator, settings.profile, x, stamps, waiting)
    if status == "interrupted":
        raise KeyboardInterrupt
    if status != "finished":
        raise IntegrationError(status.removeprefix("stopped: "))
    return times, states
