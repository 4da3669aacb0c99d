"""The loop: controller and plant in turn, errors sampled between the controller's steps."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from softmpc.control.guide import Guide
from softmpc.control.loop_cost import loop_costs
from softmpc.control.ocp import Ocp
from softmpc.control.paths import Reference
from softmpc.control.rest_path import IN_REACH
from softmpc.control.state_map import StateMap
from softmpc.control.step import Step
from softmpc.control.track_result import TrackResult
from softmpc.errors import InputError
from softmpc.interrupts import InterruptLater
from softmpc.model.model import Model
from softmpc.simulation.integrator import IntegrationError, Integrator
from softmpc.statics.equilibrium import Equilibrium

__all__ = ["Controller", "Start", "close_loop", "loop_result", "start_at"]

SAMPLE = 1e-3  # s, between the samples of the error

Progress = Callable[[int, int], None]


class Controller(Protocol):
    """What closes a loop: an `Mpc`, or a baseline."""

    ocp: Ocp

    def reset(self) -> None:
        """Forget what was before."""

    def step(self, x: Any, u_before: Any, given: Any) -> Step:
        """The input for the state x and the references at the coming nodes."""


@dataclass(frozen=True)
class Start:
    """State and input of an arm at rest."""

    x: np.ndarray
    u: np.ndarray


def start_at(model: Model, posture: Equilibrium) -> Start:
    """The arm at rest in a posture, the drive in balance with it."""
    u = np.linalg.solve(model.drive.static_gain, posture.pressures)
    rest = np.zeros(model.strains)
    return Start(np.concatenate([posture.q, rest, model.drive_rest(u, posture.q)]), u)


def close_loop(
    controller: Controller,
    plant: Integrator,
    reference: Reference | Guide,
    start: Start,
    *,
    duration: float | None = None,
    settle: float = 1.0,
    progress: Progress | None = None,
) -> TrackResult:
    """Run controller and plant from `start` for `duration` (s; the reference's by default).

    `start` is a state of the plant. Where the controller's model is another one its state follows
    by `StateMap`. Interrupted (Ctrl-C) or stopped by the plant, the result holds what was done
    until then and says so in `status`.
    """
    guide = reference if isinstance(reference, Guide) else Guide(reference)
    step, nodes = controller.ocp.step, controller.ocp.nodes
    samples = max(1, round(step / SAMPLE))
    count = _steps(guide.duration if duration is None else duration, step)
    seen = StateMap(plant.model, controller.ocp.model)
    x, u = start.x, start.u
    states, steps, status = [x[None, :]], [], "finished"
    controller.reset()
    try:
        with InterruptLater() as interrupt:
            for k in range(count):
                state = x if seen.is_identity else seen(x, u)
                taken = controller.step(state, u, guide.given(k * step + nodes))
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
    times = step, step / samples, settle
    result = loop_result(plant.model, guide, np.vstack(states), steps, start.u, times, status)
    ends = np.vstack(states)[samples::samples][: len(steps)]
    return replace(result, costs=loop_costs(controller.ocp, plant.model, guide, ends, result))


def _steps(duration: float, step: float) -> int:
    if not (np.isfinite(duration) and duration >= step):
        raise InputError(f"duration = {duration!r} s: must be at least one step of {step:g} s")
    return round(duration / step)


def loop_result(
    model: Model,
    guide: Guide,
    states: np.ndarray,
    steps: Sequence[Step],
    u_start: np.ndarray,
    times: tuple[float, float, float],
    status: str,
) -> TrackResult:
    """The record of a loop from its states at all samples; `times`: step, sample, settled."""
    step, sample, settle = times
    n, per_step = model.strains, round(step / sample)
    states = states[: 1 + len(steps) * per_step]
    time = sample * np.arange(len(states))
    frames = model.frames.map(len(states))
    tips = np.asarray(frames(states[:, :n].T)[0]).T.reshape(len(states), -1, 3)
    inputs = np.array([s.u for s in steps]).reshape(-1, len(model.layout.u))
    held = np.repeat(inputs, per_step, axis=0)
    held = np.vstack([held[:1], held]) if len(held) else np.zeros((1, inputs.shape[1]))
    drive = model.drive
    asked = guide.asked(time)
    return TrackResult(
        title="",
        status=status,
        settle=settle,
        time=time,
        tips=tips,
        reference=asked,
        followed=guide.followed(time),
        q=states[:, :n],
        dq=states[:, n : 2 * n],
        p=states[:, 2 * n :] @ drive.C.T + held @ drive.D.T,
        control_time=step * np.arange(len(steps)),
        u=inputs,
        u_start=u_start,
        step_ms=np.array([1e3 * s.seconds for s in steps]),
        prepare_ms=np.array([1e3 * s.prepare_seconds for s in steps]),
        iterations=np.array([s.iterations for s in steps], dtype=int),
        statuses=[": ".join(filter(None, (s.status, s.worst))) for s in steps],
        names=(model.layout.q.names, model.layout.u.names, model.layout.p.names),
        **_known_before(guide, time),
    )


def _known_before(guide: Guide, time: np.ndarray) -> dict[str, Any]:
    """What the rest path says: how far the path is out of reach, when the posture jumps."""
    if guide.rest is None:
        return {}
    far = guide.rest.out_of_reach(time)
    return {
        "out_of_reach": np.where(far > IN_REACH, far, 0.0),
        "jumps": guide.rest.jump_times(time),
        "u_rest": guide.rest.inputs(time),
    }
