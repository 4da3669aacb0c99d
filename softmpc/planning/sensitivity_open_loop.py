"""What an arm does that is not the one a plan was made for, under the plan's inputs: linearised.

dx⁺ = A dx + ∂(what is missing)/∂p,   from the changed start
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softmpc.model.model import Model
from softmpc.planning.attempt import Attempt
from softmpc.planning.goals import Goal
from softmpc.planning.motion import Motion
from softmpc.planning.sensitivity_scene import Slopes, Varied, shift_at_rest

__all__ = ["OpenLoop", "open_loop"]

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class OpenLoop:
    """By the relative change of a number, inputs as planned; nodes K+1, sections S.

    `settled` is where section tips come to rest under the last input; None without rest.
    """

    tips: Array  # K+1×S×3, m
    misses: tuple[float, ...]  # m, of each goal's places; 0 without any
    turns: tuple[float, ...]  # rad, of its directions
    settled: Array | None  # S×3, m

    @property
    def drift(self) -> float:
        """Largest along the motion, of any section tip (m)."""
        return float(np.linalg.norm(self.tips, axis=2).max())


def open_loop(attempt: Attempt, motion: Motion, varied: Varied, slopes: Slopes) -> OpenLoop:
    """Of a motion, from the slopes of its steps."""
    x, dx = _states(attempt, motion, varied, slopes)
    n, goals = varied.models[0].strains, attempt.problem.goals
    poses = [
        _poses(model, x[:, :n] + off * dx[:, :n])
        for model, off in zip(varied.models, varied.offsets, strict=True)
    ]
    tips = (poses[0][0] - poses[1][0]) / varied.width
    ends = attempt.mesh.phases.ends + 1
    off = [_off(goal, poses, end) for goal, end in zip(goals, ends, strict=True)]
    return OpenLoop(
        tips, tuple(miss / varied.width for miss, _ in off),
        tuple(turn / varied.width for _, turn in off),
        _settled(attempt, motion, varied) if goals[-1].rest else None,
    )  # fmt: skip


def _states(
    attempt: Attempt, motion: Motion, varied: Varied, slopes: Slopes
) -> tuple[Array, Array]:
    """States at the nodes and their change (K+1×nx, SI)."""
    t = attempt.t
    missing = -slopes.d[: t.N * t.nx].reshape(t.N, t.nx)  # of what changed starts make, too
    found, at = [(varied.starts[0] - varied.starts[1]) / varied.width], np.zeros(t.nx)
    for A, gap in zip(motion.steps.A, missing, strict=True):
        at = A @ at + gap
        found.append(at * t.x_scale)
    x = np.vstack([attempt.problem.start.x, motion.at.x * t.x_scale])
    return x, np.array(found)


def _poses(model: Model, q: Array) -> tuple[Array, Array]:
    """Section tips (K×S×3) and rotations (K×S×3×3) of strains (K×n)."""
    tips, turns = (np.asarray(part) for part in model.frames.map(len(q))(q.T))
    rotations = turns.T.reshape(len(q), -1, 3, 3).transpose(0, 1, 3, 2)
    return tips.T.reshape(len(q), -1, 3), rotations


def _off(goal: Goal, poses: list[tuple[Array, Array]], node: int) -> tuple[float, float]:
    """How far (m, rad) what a goal asks for is apart in two changed arms."""
    (up, turned_up), (down, turned_down) = poses
    if goal.state is not None:
        return float(np.linalg.norm(up[node] - down[node], axis=1).max()), 0.0
    apart: dict[bool, list[float]] = {False: [0.0], True: [0.0]}
    for target in goal.targets:
        features = (
            target.seen(tips[node][None], rotations[node][None])[0]
            for tips, rotations in ((up, turned_up), (down, turned_down))
        )
        apart[target.turns].append(float(np.linalg.norm(next(features) - next(features))))
    return max(apart[False]), max(apart[True])


def _settled(attempt: Attempt, motion: Motion, varied: Varied) -> Array:
    t, model = attempt.t, attempt.problem.model
    q = (motion.at.x[-1] * t.x_scale)[: model.strains]
    u = (motion.at.u[-1] * t.u_scale)[: t.inputs]
    dq = shift_at_rest(model, varied.models, q, u) / varied.width
    up, down = (
        _poses(m, (q + off * dq)[None])[0][0]
        for m, off in zip(varied.models, varied.offsets, strict=True)
    )
    return np.asarray((up - down) / varied.width)
