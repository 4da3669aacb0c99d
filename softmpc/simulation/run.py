"""Open-loop simulation: a model under inputs over time.

The time axis is cut at every breakpoint of the inputs, so that integrators see only inputs linear
in time: steps and the corners of ramps are hit, not stepped over.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from softmpc.errors import InputError, errors_in
from softmpc.interrupts import InterruptLater
from softmpc.model.model import Model, build
from softmpc.model.scene_file import read_document, scene_from_dict
from softmpc.simulation.inputs import InputProfile
from softmpc.simulation.integrator import IntegrationError, Integrator
from softmpc.simulation.methods import integrator_for
from softmpc.simulation.result import Simulation, titles_of
from softmpc.simulation.settings import STARTS, read_settings
from softmpc.simulation.validity import VAPOUR, MotionWarning, late_inputs, motion_warnings
from softmpc.statics.equilibrium import Equilibrium, find_equilibrium

__all__ = ["sample_times", "simulate", "simulate_file", "start_state", "states_at"]

CHUNK = 200  # samples of one call at most: between calls there is progress, and an end on Ctrl-C
MOST_SAMPLES = 5_000_000
SHORTEST_STRETCH = -0.95  # ε; at -1 a segment has no length
Progress = Callable[[float, float], None]


def simulate(
    model: Model,
    profile: InputProfile,
    duration: float,
    *,
    sample_time: float = 0.01,
    start: str | np.ndarray = "rest",
    method: str = "radau",
    tip_tolerance: float | None = None,
    tolerance: float | None = None,
    step: float | None = None,
    progress: Progress | None = None,
    title: str = "",
) -> Simulation:
    """The motion from t = 0 to `duration` (s), with a sample every `sample_time` (s).

    `start` is "rest" (equilibrium under the inputs before t = 0), "straight", or a state x (nx).
    `method` and its `tip_tolerance` (m), `tolerance` or `step` (s) are those of
    `softmpc.simulation.methods`; by default Radau IIA within 1 µm at the tip a step.
    `progress(t, duration)` is called now and then. Raises `InputError` for wrong arguments,
    `BuildError` where the model cannot move, `IntegrationError` where there is no rest to start
    from. What fails later, or is interrupted, is told by the result's status.
    """
    profile.check(model)
    began = time.perf_counter()
    stamps = sample_times(duration, sample_time)
    numbers = {"tip_tolerance": tip_tolerance, "tolerance": tolerance, "step": step}
    integrator = integrator_for(model, method, **numbers)
    x, warnings = _start(model, profile, start)
    integrator.prepare()
    setup, began = time.perf_counter() - began, time.perf_counter()
    status, times, states = states_at(integrator, profile, x, stamps, progress)
    wall = time.perf_counter() - began
    q, _, z = np.split(states, [model.strains, 2 * model.strains], axis=1)
    warnings += motion_warnings(model, times, z, profile(times), q)
    warnings += late_inputs(profile, stamps[-1])
    about = {"setup_s": setup, "status": status, "wall_s": wall, "title": title}
    return _result(model, profile, times, states, warnings=tuple(warnings), **about)


def states_at(
    integrator: Integrator,
    profile: InputProfile,
    x: np.ndarray,
    times: np.ndarray,
    progress: Progress | None = None,
) -> tuple[str, np.ndarray, np.ndarray]:
    """Status, the times (s, increasing) that were reached from x at t = 0, and the states there."""
    run, times = _Run(integrator, profile, x), _rounded(times)
    status = run.through(*_pieces(times, profile.breakpoints), progress)
    return status, *run.at(times)


def simulate_file(
    path: str | os.PathLike[str], progress: Progress | None = None, **changes: Any
) -> Simulation:
    """Simulate what the table [simulate] of a scene file asks for.

    `changes` replace arguments of `simulate`, for instance `duration`.
    """
    path = Path(path)
    document = read_document(path)
    with errors_in(path):
        model = build(scene_from_dict(document))
        wanted = vars(read_settings(document, model, path.parent)) | changes
    return simulate(model, progress=progress, title=document.get("title", path.stem), **wanted)


def start_state(
    model: Model, profile: InputProfile, start: str | np.ndarray = "rest"
) -> np.ndarray:
    """State x (nx) to start from, with the drive at rest under the inputs before t = 0."""
    return _start(model, profile, start)[0]


def _start(
    model: Model, profile: InputProfile, start: str | np.ndarray
) -> tuple[np.ndarray, list[MotionWarning]]:
    """State to start from, and a warning where it is a rest that will not last."""
    if not isinstance(start, str):
        return np.asarray(start, dtype=float), []
    if start not in STARTS:
        raise InputError(f"start = {start!r}: must be one of {', '.join(STARTS)}, or a state")
    u, drive = profile.before(0.0), model.drive
    z = model.drive_rest(u)
    q, warnings = np.zeros(model.strains), []
    if start == "rest":
        rest = find_equilibrium(model, (drive.C @ z + drive.D @ u).tolist())
        if not rest.converged:
            raise IntegrationError(f"no rest to start from: {rest.status}; take start = 'straight'")
        q = rest.q
        z = model.drive_rest(u, q)
        if not rest.stable:
            warnings.append(_unstable(rest))
    return np.concatenate([q, np.zeros(model.strains), z]), warnings


def _unstable(rest: Equilibrium) -> MotionWarning:
    said = (
        "the rest to start from is not stable (smallest stiffness "
        f"{rest.smallest_stiffness:.3g} J): the least disturbance leaves it"
    )
    return MotionWarning(
        "unstable_start", 0.0, "start", rest.smallest_stiffness, 0.0, "J", None, said
    )


class _Run:
    """Marks in time and the states there, as far as they were reached."""

    def __init__(self, integrator: Integrator, profile: InputProfile, x: np.ndarray) -> None:
        self.integrator, self.profile = integrator, profile
        self.times, self.states = [0.0], [x]
        self._valid = _Validity(integrator.model)

    def through(
        self, marks: np.ndarray, pieces: list[tuple[int, int]], progress: Progress | None
    ) -> str:
        """Go through pieces (first and last mark) of equal steps; returns the status."""
        try:
            with InterruptLater() as interrupt:
                for first, last in pieces:
                    self._piece(marks[first : last + 1])
                    if progress:
                        progress(self.times[-1], marks[-1])
                    if interrupt.asked:
                        return "interrupted"
        except KeyboardInterrupt:
            return "interrupted"
        except IntegrationError as error:
            return f"stopped: {error}, after t = {self.times[-1]:.6g} s"
        return "finished"

    def _piece(self, marks: np.ndarray) -> None:
        try:
            self._add(marks)
        except IntegrationError:
            if len(marks) == 2:
                raise
            for k in range(len(marks) - 1):  # keeps what comes before the failure
                self._add(marks[k : k + 2])

    def _add(self, marks: np.ndarray) -> None:
        u0, u1 = self.profile.over(marks[0], marks[-1])
        span, steps = marks[-1] - marks[0], len(marks) - 1
        states = self.integrator.advance(self.states[-1], u0, span, steps, u1)
        for t, x in zip(marks[1:], states, strict=True):
            self._valid.check(x)
            self.times.append(t)
            self.states.append(x)

    def at(self, stamps: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Those of the stamps that were reached, and the states there."""
        times = np.array(self.times)
        wanted = np.isin(times, stamps)
        return times[wanted], np.stack(self.states)[wanted]


class _Validity:
    """Where the model ends: a segment without length, water that would boil."""

    def __init__(self, model: Model) -> None:
        names = model.layout.x.names
        self._names = names
        self._stretches = [i for i, name in enumerate(names) if name.startswith("epsilon")]
        self._pressures = [i for i, name in enumerate(names) if name.startswith(("P_a", "P_c"))]
        if any(effect.name == "cavitation" for effect in model.scene.effects):
            self._pressures = []  # that effect is the model of what happens below

    def check(self, x: np.ndarray) -> None:
        """Raise `IntegrationError` for a state (nx) outside."""
        shortest = x[self._stretches].min(initial=0.0)
        if shortest <= SHORTEST_STRETCH:
            raise IntegrationError(f"a segment is squeezed to nothing (ε = {shortest:.3g})")
        lowest = x[self._pressures].min(initial=0.0)
        if lowest < VAPOUR:
            name = self._names[self._pressures[int(x[self._pressures].argmin())]]
            raise IntegrationError(
                f"{name} fell to {lowest / 1e6:.3f} MPa, below vapour pressure; add the effect "
                "'cavitation'"
            )


def sample_times(duration: float, sample_time: float) -> np.ndarray:
    """Times of the samples, the last one at `duration`."""
    for name, value in (("duration", duration), ("sample_time", sample_time)):
        if not (np.isfinite(value) and value > 0):
            raise InputError(f"{name} = {value!r} s: must be above 0")
    whole = int(duration / sample_time + 1e-6)
    if whole > MOST_SAMPLES:
        raise InputError(
            f"duration = {duration:g} s with a sample every {sample_time:g} s: more than "
            f"{MOST_SAMPLES} samples; take a longer sample_time or a shorter duration"
        )
    return np.unique(_rounded(np.append(sample_time * np.arange(whole + 1), duration)))


def _rounded(times: np.ndarray) -> np.ndarray:
    """Times without the rounding errors that tell 0.3 from 3·0.1."""
    return np.round(times, 12)


def _pieces(stamps: np.ndarray, bends: np.ndarray) -> tuple[np.ndarray, list[tuple[int, int]]]:
    """Zero, stamps and breakpoints as marks; pieces of equal steps without a breakpoint inside."""
    bends = _rounded(bends)
    bends = bends[(bends > 0) & (bends < stamps[-1])]
    marks = np.union1d(np.append(0.0, stamps), bends)
    return marks, list(_equal_steps(marks, np.isin(marks, bends)))


def _equal_steps(marks: np.ndarray, bend: np.ndarray) -> Iterator[tuple[int, int]]:
    steps, first = np.diff(marks).tolist(), 0
    for last in range(1, len(marks)):
        ends = (
            last == len(marks) - 1
            or bend[last]
            or last - first == CHUNK
            or abs(steps[last] - steps[first]) > 1e-6 * steps[first]
        )
        if ends:
            yield first, last
            first = last


def _result(
    model: Model, profile: InputProfile, times: np.ndarray, states: np.ndarray, **about: Any
) -> Simulation:
    n, count = model.strains, len(times)
    q, dq, z = np.split(states, [n, 2 * n], axis=1)
    u = profile(times)
    tips = np.asarray(model.frames.map(count)(q.T)[0]).T.reshape(count, -1, 3)
    jacobians = np.asarray(model.tip_jacobian.map(count)(q.T))
    energies = model.energies.map(count).call({"q": q.T, "dq": dq.T})
    velocities = np.einsum("ikj,kj->ki", jacobians.reshape(-1, count, n), dq)
    return Simulation(
        time=times,
        q=q,
        dq=dq,
        z=z,
        u=u,
        p=z @ model.drive.C.T + u @ model.drive.D.T,
        tips=tips,
        tip_speeds=np.linalg.norm(velocities.reshape(count, -1, 3), axis=2),
        energies={name: np.asarray(e).ravel() for name, e in energies.items()},
        titles=titles_of(model),
        profile=profile,
        **about,
    )
