"""A plan replayed by another method at a tight tolerance: what it is really worth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from softmpc.control.clearance import arm_clearance
from softmpc.model.obstacles import obstacle_names
from softmpc.planning.along import Along, Beyond
from softmpc.planning.goals import Goal
from softmpc.planning.problem import PlanProblem
from softmpc.simulation.inputs import InputProfile
from softmpc.simulation.methods import Method
from softmpc.simulation.run import states_at

__all__ = ["Replay", "Replayer"]

TIGHT = Method("idas", tolerance=1e-9)
BETWEEN = 8  # samples an interval
ROUNDING = 1e-9  # s, of the times
AFTER = 0.5  # s, for which the arm is watched at its last goal

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Replay:
    """Samples of the replay (M), and how it compares with the plan's nodes (K)."""

    status: str
    t: Array
    x: Array  # M×nx
    tips: Array  # M×S×3
    pressures: Array  # M×m
    defect: float  # m, largest distance of a section tip from the plan's, at its nodes
    misses: tuple[float, ...]  # m, of each goal's places; 0 without any
    turns: tuple[float, ...]  # rad, of its directions
    drift: float  # m, of section tips after the end, where the last goal is to rest
    clearance: dict[str, float]  # m, least along arm and time, by obstacle
    beyond: dict[str, Beyond]  # by how much other limits are passed, by their names

    @property
    def finished(self) -> bool:
        return self.status == "finished"


class Replayer:
    """Replays plans of one problem."""

    def __init__(self, problem: PlanProblem) -> None:
        self.problem, self.model = problem, problem.model
        self._along = Along(problem)
        self._integrator = TIGHT.integrator(self.model)
        self._closest = arm_clearance(self.model, problem.obstacles) if problem.obstacles else None

    def __call__(self, t: Array, u: Array, x: Array, u_after: Array, ends: Sequence[int]) -> Replay:
        """Nodes t (K+1), inputs u (K×k), states x (K+1×nx); `ends` are the nodes of the goals."""
        rest = self.problem.goals[-1].rest
        times = _between(t)
        later = (
            t[-1] + np.linspace(0.0, AFTER, 1 + round(AFTER / 0.01))[1:] if rest else np.zeros(0)
        )
        profile = InputProfile.from_table(t, np.vstack([u, u_after]), hold=True)
        status, reached, states = states_at(
            self._integrator, profile, x[0], np.concatenate([times, later])
        )
        tips = self.tips(states)
        pressures = self.pressures(states, profile(reached + ROUNDING))  # at jumps, the new one
        during = reached <= t[-1] + ROUNDING
        nodes = np.arange(0, min(len(times), int(during.sum())), BETWEEN)
        planned = self.tips(x[: len(nodes)])
        off = np.linalg.norm(tips[nodes] - planned, axis=2)
        whole = status == "finished"
        at_goals = [states[BETWEEN * end] for end in ends] if whole else []
        missed = [
            self._missed(goal, s) for goal, s in zip(self.problem.goals, at_goals, strict=False)
        ]
        after = np.linalg.norm(tips[~during] - tips[during][-1], axis=2) if whole else np.zeros(0)
        return Replay(
            status, reached[during], states[during], tips[during], pressures[during],
            defect=float(off.max()) if whole else np.inf,
            misses=tuple(m for m, _ in missed), turns=tuple(a for _, a in missed),
            drift=float(after.max(initial=0.0)),
            clearance=self.clearance(states),
            beyond=self._along(states[during], profile(reached[during])),
        )  # fmt: skip

    def tips(self, x: Array) -> Array:
        """Section tips (N×S×3, m) of states (N×nx)."""
        found = self.model.frames.map(len(x))(x[:, : self.model.strains].T)[0]
        return np.asarray(found).T.reshape(len(x), -1, 3)

    def pressures(self, x: Array, u: Array) -> Array:
        """Unit pressures (N×m, Pa) of states and inputs."""
        drive, z = self.model.drive, x[:, 2 * self.model.strains :]
        return np.asarray(z @ drive.C.T + u @ drive.D.T)

    def clearance(self, x: Array) -> dict[str, float]:
        """Least clearance (m) of the arm, by obstacle."""
        if self._closest is None:
            return {}
        least = self._closest(x[:, : self.model.strains]).clearance.min(axis=0)
        names = obstacle_names(self.problem.obstacles)
        return {name: float(d) for name, d in zip(names, least, strict=True)}

    def _missed(self, goal: Goal, x: Array) -> tuple[float, float]:
        """Distance (m) and angle (rad) of a state from a goal."""
        q = x[: self.model.strains]
        tips, turns = (np.asarray(part) for part in self.model.frames(q))
        if goal.state is not None:
            wanted = np.asarray(self.model.frames(goal.state[: self.model.strains])[0])
            return float(np.linalg.norm(tips - wanted, axis=0).max()), 0.0
        rotations = turns.T.reshape(-1, 3, 3).transpose(0, 2, 1)
        errors = [(target.turns, target.error(tips.T, rotations)) for target in goal.targets]
        places, angles = ([e for turns, e in errors if turns is kind] for kind in (False, True))
        return max(places, default=0.0), max(angles, default=0.0)


def _between(t: Array) -> Array:
    """Times of the nodes, and between them."""
    inside = t[:-1, None] + np.diff(t)[:, None] * np.arange(BETWEEN) / BETWEEN
    return np.append(inside.ravel(), t[-1])
