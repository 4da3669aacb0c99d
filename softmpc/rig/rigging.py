"""From the tables [track] and [rig] of a scene file to a run on a simulated rig."""

from __future__ import annotations

import logging
import os
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

import numpy as np

from softmpc.control.closed_loop import loop_result
from softmpc.control.guide import PlanGuide
from softmpc.control.loop_cost import loop_costs
from softmpc.control.planned_start import is_at_rest
from softmpc.control.solvers import CONDENSING
from softmpc.control.state_map import StateMap
from softmpc.control.track_result import TrackResult
from softmpc.control.tracking import Setup, Tracking, plant_of, read_track_file, ready, set_up
from softmpc.errors import SceneError, errors_in
from softmpc.estimation.estimator import Estimator
from softmpc.estimation.process import Process
from softmpc.estimation.sensing import Sensing
from softmpc.estimation.sensors import TICK
from softmpc.model.model import Model, build
from softmpc.model.payload import Payload
from softmpc.model.scene import Scene
from softmpc.model.scene_file import read_document
from softmpc.rig.faults import PayloadDropped, SolverCap
from softmpc.rig.loop import Flight, check_cap, fly
from softmpc.rig.machine import Machine, check_faults
from softmpc.rig.pilot import Pilot
from softmpc.rig.result import RigResult
from softmpc.rig.scene_table import RigSettings, read_rig
from softmpc.rig.supervision import Supervisor
from softmpc.simulation.integrator import Integrator

__all__ = ["Rig", "RigDeputy", "read_rig_file", "rig_up", "run_rig_file"]

LOG = logging.getLogger(__name__)
Array = np.ndarray
Progress = Callable[[int, int], None]


def read_rig_file(path: str | os.PathLike[str]) -> RigSettings | None:
    """The [rig] table of a scene file; None where it has none."""
    document = read_document(path)
    with errors_in(path):
        return read_rig(document["rig"]) if "rig" in document else None


class RigDeputy(Protocol):
    """Who flies a rig instead of its own pilot."""

    def on_rig(self, rig: Rig) -> AbstractContextManager[Rig]:
        """The rig with that pilot, or with that pilot's controller."""


def run_rig_file(
    path: str | os.PathLike[str],
    progress: Progress | None = None,
    on_infeasible: str | None = None,
    checking: Progress | None = None,
    by: RigDeputy | None = None,
) -> RigResult:
    """Run the scene file's tracking task on its rig; progress as for `track_file`.

    `by` has another pilot, or another controller, fly it.
    """
    title, scene, task = read_track_file(path, on_infeasible)
    settings = read_rig_file(path)
    if settings is None:
        raise SceneError(f"{Path(path)}: [rig] is missing: it says what is measured, and how well")
    with errors_in(path):
        rig = ready(lambda report: rig_up(scene, task, settings, report), checking)
    with nullcontext(rig) if by is None else by.on_rig(rig) as flown:
        result = flown.run(progress)
    name = getattr(flown.pilot.mpc, "name", result.track.controller)
    return replace(result, track=replace(result.track, title=title, controller=name))


@dataclass(frozen=True, eq=False)
class Rig:
    """A task on a rig, ready to run."""

    setup: Setup
    settings: RigSettings
    machine: Machine
    pilot: Pilot
    seen: StateMap  # the plant's state as one of the controller's model

    def run(self, progress: Progress | None = None, duration: float | None = None) -> RigResult:
        """Run it from rest at the start of the path, for the path's duration by default."""
        setup = self.setup
        believed = self.seen(setup.start.x, setup.start.u)
        lasts = setup.guide.duration if duration is None else duration
        wait = self.settings.wait
        flight = fly(self.machine, self.pilot, setup.start, believed, lasts, wait, progress)
        return _result(self, flight)


def rig_up(
    scene: Scene, task: Tracking, settings: RigSettings, progress: Progress | None = None
) -> Rig:
    """Plant, sensors, estimator, supervision and controller of a task.

    Raises `SceneError` where the task is infeasible and says stop, and where sensors, faults or
    disturbance do not fit the scenes.
    """
    if abs(task.controller.step / TICK - round(task.controller.step / TICK)) > 1e-9:
        raise SceneError(
            f"[track.controller] step = {task.controller.step:g} s: on a rig it must be a whole "
            "number of milliseconds"
        )
    plant = plant_of(scene, task)
    with errors_in("[rig]"):
        _check_fits(settings, task, plant)
    setup = set_up(scene, task, settings.disturbance, progress, known=(plant,))
    if settings.wait and isinstance(setup.guide, PlanGuide):
        _check_rests(setup, settings.wait)
    mpc, disturbance = setup.controller, setup.ocp.disturbance
    seen = StateMap(setup.plant.model, setup.ocp.model)
    assert disturbance is not None
    with errors_in("[rig]"):
        process = Process(setup.ocp.model, disturbance, settings.noise)
        at = seen(setup.start.x, setup.start.u), setup.start.u
        estimator = Estimator(process, settings.sensors, settings.spread, at)
        plants = _plants(setup, task, settings)
        machine = Machine(plants, settings.sensors, settings.link, settings.faults, settings.seed)
    supervisor = Supervisor(settings.supervision)
    pilot = Pilot(mpc, estimator, supervisor, setup.guide, settings.link.ticks)
    return Rig(setup, settings, machine, pilot, seen)


def _check_fits(settings: RigSettings, task: Tracking, plant: Model) -> None:
    """Raise where sensors or faults do not fit plant and controller."""
    check_faults(settings.faults, settings.sensors, plant)
    for fault in settings.faults:
        if fault.start >= task.reference.duration:
            LOG.warning("fault %s: the run ends at %g s", fault, task.reference.duration)
    Sensing(settings.sensors, plant)
    if any(isinstance(fault, PayloadDropped) for fault in settings.faults):
        _without_payload(plant.scene)
    if any(isinstance(fault, SolverCap) for fault in settings.faults):
        check_cap(task.controller.solver in CONDENSING)


def _check_rests(setup: Setup, wait: float) -> None:
    """Raise where a plan begins in motion, so that the rig cannot wait for it."""
    if not is_at_rest(setup.plant.model, setup.start.x, setup.start.u):
        raise SceneError(
            f"[rig] wait = {wait:g} s: the arm cannot wait, the plan begins in motion; set wait = 0"
        )


def _plants(setup: Setup, task: Tracking, settings: RigSettings) -> Mapping[str, Integrator]:
    """The plant, and where a fault drops its payload that without."""
    plants = {"": setup.plant}
    if any(isinstance(fault, PayloadDropped) for fault in settings.faults):
        light = build(_without_payload(setup.plant.model.scene))
        plants[PayloadDropped.name] = task.plant.integrator(light)
    return plants


def _without_payload(scene: Scene) -> Scene:
    kept = tuple(effect for effect in scene.effects if not isinstance(effect, Payload))
    if len(kept) == len(scene.effects):
        raise SceneError(
            "fault 'payload_dropped': the plant carries none; add one to its scene, "
            "[track.plant] scene = {effects = {payload = {mass = 0.2}}}"
        )
    return replace(scene, effects=kept)


# ---------------------------------------------------------------- the record


def _result(rig: Rig, flight: Flight) -> RigResult:
    states, acting = np.vstack(flight.states), np.vstack(flight.inputs)
    estimator, model = rig.pilot.estimator, rig.pilot.estimator.model
    disturbance = estimator.process.disturbance
    acts, n = flight.acts, model.strains
    x = np.array([act.estimate.x for act in acts]).reshape(len(acts), len(model.layout.x))
    P = np.array([act.estimate.P for act in acts]).reshape(len(acts), *2 * [estimator.process.size])
    spread = np.sqrt(np.diagonal(P, axis1=1, axis2=2))
    tips, tips_spread = _tips(rig, x[:, :n], P)
    found = [one for one in estimator.innovations if one.stamp >= 0]
    ticks = round(rig.setup.ocp.step / TICK)
    truth = states[: len(acts) * ticks : ticks]
    true = np.array([rig.seen(one, act.u)[:n] for one, act in zip(truth, acts, strict=True)])
    track = _track(rig, flight, states)
    return RigResult(
        track=track,
        state=np.array([int(act.state) for act in acts], dtype=int),
        estimate_ms=np.array([1e3 * act.estimate_seconds for act in acts]),
        strains=x[:, :n],
        strains_true=true.reshape(-1, n),
        strains_spread=spread[:, :n] * model.layout.q.scale,
        tips=tips,
        tips_spread=tips_spread,
        d=np.array([act.estimate.d for act in acts]).reshape(len(acts), len(disturbance)),
        d_spread=spread[:, estimator.process.nx :],
        acting=acting[: len(track.time)],
        innovation_sensor=np.array([one.sensor for one in found], dtype=int),
        innovation_time=TICK * np.array([one.stamp for one in found]),
        nis=np.array([one.nis for one in found]),
        accepted=np.array([one.accepted for one in found], dtype=bool),
        names=(model.layout.q.names, disturbance.names),
        sensors=tuple(sensor.name for sensor in estimator.sensors),
        sizes=tuple(len(reading.names) for reading in estimator.readings),
        transitions=tuple(str(one) for one in rig.pilot.supervisor.log),
        faults=tuple((str(f), f.start, f.start + f.duration) for f in rig.settings.faults),
        back_off=_back_off(rig, track),
        counts=_counts(rig),
    )


def _track(rig: Rig, flight: Flight, states: Array) -> TrackResult:
    """The closed loop as it is without a rig."""
    setup, task = rig.setup, rig.setup.task
    model, steps = setup.plant.model, [act.step for act in flight.acts]
    times = setup.ocp.step, TICK, task.settle
    result = loop_result(model, setup.guide, states, steps, setup.start.u, times, flight.status)
    ticks = round(setup.ocp.step / TICK)
    ends = states[ticks::ticks][: len(steps)]
    return replace(
        result,
        costs=loop_costs(setup.ocp, model, setup.guide, ends, result),
        step_ms=np.array([1e3 * act.seconds for act in flight.acts]),
        **setup.about(),
    )


def _tips(rig: Rig, q: Array, P: Array) -> tuple[Array, Array]:
    """Tips of sections as estimated and their standard deviations (N×S×3)."""
    model, n = rig.pilot.estimator.model, q.shape[1]
    if not len(q):
        return np.zeros((0, 1, 3)), np.zeros((0, 1, 3))
    tips = np.asarray(model.frames.map(len(q))(q.T)[0]).T.reshape(len(q), -1, 3)
    slopes = np.asarray(model.tip_jacobian.map(len(q))(q.T)).reshape(-1, len(q), n)
    slopes = slopes.swapaxes(0, 1) * model.layout.q.scale
    spread = np.einsum("kij,kjl,kil->ki", slopes, P[:, :n, :n], slopes)
    return tips, np.sqrt(np.maximum(spread, 0.0)).reshape(tips.shape)


def _back_off(rig: Rig, track: TrackResult) -> dict[str, float]:
    """How much of the margin before each kind of limit the plant used; above 1 it broke one."""
    settings, model = rig.setup.task.controller, rig.setup.plant.model
    arm = model.scene.manipulator.limits
    ranges = [("pressure", track.p, arm.pressure_min, arm.pressure_max)]
    for kind, low, high in settings.strains:
        columns = [i for i, name in enumerate(track.names[0]) if name.startswith(f"{kind}_")]
        ranges.append((kind, track.q[:, columns], low, high))
    found = {}
    for name, values, low, high in ranges if settings.back_off else []:
        margin = settings.back_off * (high - low)
        over = np.maximum(values - (high - margin), (low + margin) - values)
        found[name] = float(max(over.max(initial=0.0), 0.0) / margin)
    return found


def _counts(rig: Rig) -> dict[str, int]:
    """Readings that were not used, by sensor and reason, and commands that were lost."""
    estimator = rig.pilot.estimator
    found = {
        f"{sensor.name} {reason}": count
        for sensor, health in zip(estimator.sensors, estimator.health, strict=True)
        for reason, count in sorted(health.reasons.items())
    }
    return found | ({"commands lost": rig.machine.lost} if rig.machine.lost else {})
