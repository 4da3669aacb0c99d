"""What gives way where a problem has no solution, and what is to blame for it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softmpc.planning.attempt import Attempt
from softmpc.planning.sqp import MET, Solved

__all__ = ["GivesWay", "gives_way", "held_by"]

MOST = 6  # in a message
SHARE = 0.02  # of the largest, that is worth a word
AT_BOUND = 1e-4  # scaled

Array = np.ndarray


@dataclass(frozen=True)
class GivesWay:
    """A condition that is not met: by how much in its unit at most, when (s), and how often."""

    name: str
    amount: float
    unit: str
    time: float
    nodes: int
    scaled: float

    def __str__(self) -> str:
        return f"{self.name} by {self.amount:.3g} {self.unit}".rstrip() + f" at {self.time:.3g} s"


def gives_way(attempt: Attempt, solved: Solved) -> tuple[GivesWay, ...]:
    """Conditions that are not met, the worst first."""
    excess, labels = solved.rows.excess, attempt.conditions.labels
    times = np.cumsum(attempt.mesh.phases.lengths(solved.motion.durations))
    groups: dict[str, dict[int, list[int]]] = {}
    for i in np.flatnonzero(excess > MET):
        groups.setdefault(labels[i].name, {}).setdefault(labels[i].node, []).append(int(i))
    found = []
    for name, nodes in groups.items():
        sizes = {node: float(np.linalg.norm(excess[rows])) for node, rows in nodes.items()}
        worst = max(sizes, key=lambda node: sizes[node])
        label = labels[nodes[worst][0]]
        amount = sizes[worst] * label.scale
        time = float(times[worst - 1])
        found.append(GivesWay(name, amount, label.unit, time, len(nodes), sizes[worst]))
    return tuple(sorted(found, key=lambda one: -one.scaled))


def held_by(attempt: Attempt, solved: Solved) -> tuple[str, ...]:
    """Names of the limits that keep a motion from being better, those that weigh most first.

    From the multipliers of the last program; goals and what gives way are no such limits.
    """
    if solved.step is None:
        return ()
    weights: dict[str, float] = {}
    labels = attempt.conditions.labels
    for i, weight in zip(solved.used, solved.step.of_rows, strict=True):
        name = labels[i].name
        if not name.startswith("goal "):
            name = name.split(" to section")[0]
            weights[name] = weights.get(name, 0.0) + abs(float(weight))
    for name, weight in _inputs(attempt, solved).items():
        weights[name] = weights.get(name, 0.0) + weight
    worst = max(weights.values(), default=0.0)
    names = sorted(weights, key=lambda name: -weights[name])
    return tuple(name for name in names if weights[name] > SHARE * worst > 0)[:MOST]


def _inputs(attempt: Attempt, solved: Solved) -> dict[str, float]:
    """Weight of the inputs' own bounds; those of the trust region are none."""
    t, step = attempt.t, solved.step
    if step is None:
        return {}
    low, high = (bound[: t.nu] for bound in t.variable_bounds())
    weight = np.abs(step.of_bounds[: attempt.mesh.inputs]).reshape(t.N, t.nu)
    u = solved.motion.at.u
    at_bound = (u - low < AT_BOUND) | (high - u < AT_BOUND)
    sums = np.where(at_bound, weight, 0.0).sum(axis=0)
    names = t.model.layout.u.names
    return {f"limit of {name}": float(sums[j]) for j, name in enumerate(names)}
