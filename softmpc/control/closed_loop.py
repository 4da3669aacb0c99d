"""The loop: controller and plant in turn, errors sampled between the controller's steps."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from softmpc.control.mpc import Mpc, Step
from softmpc.control.paths import Reference
from softmpc.control.track_result import TrackResult
from softmpc.errors import InputError
from softmpc.interrupts import InterruptLater
from softmpc.model.model import Model
from softmpc.simulation.integrator import IntegrationError, Integrator
from softmpc.statics.equilibrium import Equilibrium

__all__ = ["Start", "close_loop", "start_at"]

SAMPLE = 1e-3  # s, between the samples of the error

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Start:
    """State and input of an arm at rest."""

    x: np.ndarray
    u: np.ndarray


def start_at(model: Model, posture: Equilibrium) -> Start:
    """The arm at rest in a posture, the drive in balance with it."""
    u = np.linalg.solve(model.drive.static_gain, posture.pressures)
    rest = np.zeros(model.strains)
    return Start(np.concatenate([posture.q, rest, model.drive.at_rest(u)]), u)


def close_loop(
    mpc: Mpc,
    plant: Integrator,
    reference: Reference,
    start: Start,
    *,
    duration: float | None = None,
    settle: float = 1.0,
    progress: Progress | None = None,
) -> TrackResult:
    """Run controller and plant from `start` for `duration` (s; the reference's by default).

    The plant has the controller's states. Interrupted (Ctrl-C) or stopped by the plant, the result
    holds what was done until then and says so in `status`.
    """
    step = mpc.ocp.step
    samples = max(1, round(step / SAMPLE))
    count = _steps(reference.duration if duration is None else duration, step)
    nodes = mpc.ocp.nodes
    x, u = start.x, start.u
    states, steps, status = [x[None, :]], [], "finished"
    mpc.reset()
    try:
        with InterruptLater() as interrupt:
            for k in range(count):
                taken = mpc.step(x, u, reference.position(k * step + nodes))
                moved = plant.advance(x, taken.u, step, samples)
                steps.append(taken)
                states.append(moved)
                x, u = moved[-1], taken.u
                if progress is not None:
                    progress(k + 1, count)
                if interrupt.asked:
                    status = "interrupted"
                    break
    except KeyboardInterrupt:
        status = "interrupted"
    except IntegrationError as error:
        status = f"plant stopped: {error}"
    return _result(mpc, reference, np.vstack(states), steps, step / samples, settle, status)


def _steps(duration: float, step: float) -> int:
    if not (np.isfinite(duration) and duration >= step):
        raise InputError(f"duration = {duration!r} s: must be at least one step of {step:g} s")
    return round(duration / step)


def _result(
    mpc: Mpc,
    reference: Reference,
    states: np.ndarray,
    steps: Sequence[Step],
    sample: float,
    settle: float,
    status: str,
) -> TrackResult:
    model = mpc.ocp.model
    n, per_step = model.strains, round(mpc.ocp.step / sample)
    states = states[: 1 + len(steps) * per_step]
    time = sample * np.arange(len(states))
    frames = model.frames.map(len(states))
    tips = np.asarray(frames(states[:, :n].T)[0]).T.reshape(len(states), -1, 3)
    inputs = np.array([s.u for s in steps]).reshape(-1, len(model.layout.u))
    held = np.repeat(inputs, per_step, axis=0)
    held = np.vstack([held[:1], held]) if len(held) else np.zeros((1, inputs.shape[1]))
    drive = model.drive
    return TrackResult(
        title="",
        status=status,
        settle=settle,
        time=time,
        tips=tips,
        reference=reference.position(time),
        q=states[:, :n],
        dq=states[:, n : 2 * n],
        p=states[:, 2 * n :] @ drive.C.T + held @ drive.D.T,
        control_time=mpc.ocp.step * np.arange(len(steps)),
        u=inputs,
        step_ms=np.array([1e3 * s.seconds for s in steps]),
        iterations=np.array([s.iterations for s in steps], dtype=int),
        statuses=[s.status if s.solved else f"{s.status} {s.worst}".strip() for s in steps],
        names=(model.layout.q.names, model.layout.u.names, model.layout.p.names),
    )
