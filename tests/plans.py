"""Planned motions for tests: held torques simulated from rest, written as a planner does."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from softmpc.control.closed_loop import start_at
from softmpc.model.model import Model
from softmpc.simulation.runge_kutta import RadauIIA
from softmpc.statics.equilibrium import find_equilibrium

SAMPLE = 1e-3  # s


def simulated_plan(
    model: Model, before: Any, t: Any, u: Any, after: Any = None, tolerance: float = 1e-8
) -> dict[str, np.ndarray]:
    """Arrays of a plan: inputs u (K×k) between nodes t (K+1), from rest under `before` (k)."""
    t, u, before = (np.asarray(one, float) for one in (t, u, before))
    posture = find_equilibrium(model, model.drive.static_gain @ before)
    plant, x = RadauIIA(model, tolerance), start_at(model, posture).x
    nodes, states, times, acting = [x], [x[None]], [np.zeros(1)], [u[:1]]
    for begin, end, held in zip(t[:-1], t[1:], u, strict=True):
        count = max(1, round((end - begin) / SAMPLE))
        states.append(plant.advance(nodes[-1], held, end - begin, count))
        nodes.append(states[-1][-1])
        times.append(begin + (end - begin) * np.arange(1, count + 1) / count)
        acting.append(np.tile(held, (count, 1)))
    samples, held, n = np.vstack(states), np.vstack(acting), model.strains
    tips = np.asarray(model.frames.map(len(samples))(samples[:, :n].T)[0]).T
    return {
        "t": t, "u": u, "x": np.array(nodes), "u_before": before,
        "u_after": u[-1] if after is None else np.asarray(after, float),
        "samples_t": np.concatenate(times), "samples_tips": tips.reshape(len(samples), -1, 3),
        "samples_x": samples,
        "samples_p": samples[:, 2 * n :] @ model.drive.C.T + held @ model.drive.D.T,
    }  # fmt: skip


def still_plan(inputs: int = 6, states: int = 34, sections: int = 2) -> dict[str, np.ndarray]:
    """Arrays of the right shapes: an arm that stays where it is for a second."""
    return {
        "t": np.array([0.0, 0.5, 1.0]), "u": np.full((2, inputs), 0.5),
        "x": np.zeros((3, states)), "u_before": np.full(inputs, 0.5),
        "u_after": np.full(inputs, 0.5), "samples_t": np.linspace(0, 1, 11),
        "samples_tips": np.tile([0.0, 0.0, 0.6], (11, sections, 1)),
        "samples_x": np.zeros((11, states)), "samples_p": np.zeros((11, inputs)),
    }  # fmt: skip


def write_plan(folder: Path, arrays: dict[str, Any], schema: int = 1) -> Path:
    """The arrays as `plan.npz` in a folder."""
    path = folder / "plan.npz"
    np.savez_compressed(path, about=json.dumps({"schema": schema}), **arrays)
    return path
