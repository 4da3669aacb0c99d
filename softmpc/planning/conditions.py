"""What a motion must meet: limits at all nodes, goals at some, and rates of the inputs.

Every row is `low ≤ value ≤ high`, scaled, with its slopes in the moves of a quadratic program.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np
from scipy import sparse

from softmpc.control.stage import Stage
from softmpc.control.terms import Terms
from softmpc.control.trajectory import Moment
from softmpc.model.model import Model
from softmpc.planning.goals import Goal
from softmpc.planning.mesh import Mesh
from softmpc.planning.motion import Motion

__all__ = ["Conditions", "Label", "Rows"]

Array = np.ndarray
Part = tuple[Array, Array, Array, sparse.csr_matrix]


@dataclass(frozen=True)
class Label:
    """What a row is, for messages: its name, the node it is at, the size of 1 in its unit."""

    name: str
    node: int  # 1 is the end of the first interval
    scale: float
    unit: str


@dataclass(frozen=True, eq=False)
class Rows:
    """The rows of a motion (R), and their slopes (R × moves)."""

    value: Array
    low: Array
    high: Array
    slopes: sparse.csr_matrix

    @property
    def excess(self) -> Array:
        """By how much each is outside."""
        return np.maximum(np.maximum(self.low - self.value, self.value - self.high), 0.0)


class Conditions:
    """The rows of one problem on one mesh; `rate` is that of the inputs (SI a second)."""

    def __init__(
        self,
        mesh: Mesh,
        moment: Moment,
        goals: Sequence[Goal],
        rate: float | None = None,
    ) -> None:
        self.mesh, self.moment, self.rate = mesh, moment, rate
        t = mesh.t
        rows, symbols = t.objective.rows, t.objective.symbols
        value = ca.vertcat(*(row.value for row in rows))
        # Not compiled: that takes longer than all that one plan calls it for.
        self._limits = Terms("limits", value, symbols, np.ones(t.N), 2 * t.n, "never")
        self._limits.make()
        self._goals = [_GoalRows(t.model, goal) for goal in goals]
        low, high = (bound[t.nu + t.na :] for bound in t.variable_bounds())
        bounded = np.flatnonzero(np.isfinite(low) | np.isfinite(high))
        self._bounded = bounded, low[bounded], high[bounded]
        self._lows = np.array([row.low for row in rows])
        self._highs = np.array([row.high for row in rows])

    def tighten(self, more: Mapping[str, float]) -> None:
        """From now on ask for so much more clearance (m) of each obstacle."""
        for i, row in enumerate(self.mesh.t.objective.rows):
            for obstacle, margin in more.items():
                if row.name.startswith(f"clearance of {obstacle} to "):
                    self._lows[i] += margin / row.scale

    def __call__(self, motion: Motion) -> Rows:
        """The rows of a motion."""
        parts = [self._along(motion), self._bounds(motion)]
        if self.rate is not None:
            parts.append(self._rates(motion, self.rate))
        parts += [self._at_goal(motion, i) for i in range(len(self._goals))]
        value, low, high = (np.concatenate([part[i] for part in parts]) for i in range(3))
        return Rows(value, low, high, sparse.vstack([part[3] for part in parts]).tocsr())

    @cached_property
    def labels(self) -> list[Label]:
        """What each row is."""
        t, layout, nodes = self.mesh.t, self.mesh.t.model.layout, range(1, self.mesh.t.N + 1)
        rows, x, u = t.objective.rows, layout.x, layout.u
        found = [Label(row.name, k, row.scale, row.unit) for k in nodes for row in rows]
        found += [
            Label(x.names[i], k, float(x.scale[i]), x.units[i])
            for k in nodes
            for i in self._bounded[0]
        ]
        if self.rate is not None:
            for _ in ("up", "down"):
                each = [*zip(u.names, u.scale, u.units, strict=True)]
                found += [Label(f"rate of {n}", k, float(s), i) for k in nodes for n, s, i in each]
        for i, (goal, end) in enumerate(zip(self._goals, self.mesh.phases.ends, strict=True)):
            labels = zip(goal.names, goal.scale, goal.units, strict=True)
            node = int(end) + 1
            found += [Label(f"goal {i + 1}: {n}", node, float(s), unit) for n, s, unit in labels]
        return found

    # --- parts -----------------------------------------------------------------------------------

    def _along(self, motion: Motion) -> Part:
        """Limits at all nodes."""
        t, mesh, at = self.mesh.t, self.mesh, motion.at
        _, before = self.moment.before(at)
        value, slopes = self._limits(before, at.u, at.x, self.moment.given)
        slopes = slopes.copy()
        slopes[0, :, : t.nu] = 0.0  # the input before the plan is given
        earlier = np.vstack([mesh.of_u[:1], mesh.of_u[:-1]])
        columns = np.hstack([earlier, mesh.of_u, mesh.of_x])
        S = mesh.matrix(slopes, columns[:, None, :], value.size)
        return value.ravel(), np.tile(self._lows, t.N), np.tile(self._highs, t.N), S

    def _bounds(self, motion: Motion) -> Part:
        """Bounds of the states."""
        which, low, high = self._bounded
        N = self.mesh.t.N
        places = self.mesh.of_x[:, which].reshape(-1, 1)
        S = self.mesh.matrix(np.ones(places.shape), places, len(places))
        return motion.at.x[:, which].ravel(), np.tile(low, N), np.tile(high, N), S

    def _rates(self, motion: Motion, rate: float) -> Part:
        """± change - rate · length ≤ 0."""
        t, mesh = self.mesh.t, self.mesh
        scaled = np.tile(rate / t.u_scale, t.N)
        _, before = self.moment.before(motion.at)
        change = (motion.at.u - before).ravel()
        room = np.repeat(mesh.phases.lengths(motion.durations), t.nu) * scaled
        by_time = sparse.diags(scaled) @ mesh.length
        up, down = mesh.input_change - by_time, -mesh.input_change - by_time
        value = np.concatenate([change - room, -change - room])
        none = np.full(len(value), -np.inf)
        return value, none, np.zeros(len(value)), sparse.vstack([up, down]).tocsr()

    def _at_goal(self, motion: Motion, i: int) -> Part:
        k, mesh = int(self.mesh.phases.ends[i]), self.mesh
        value, J = self._goals[i](motion.at.u[k], motion.at.x[k])
        band = self._goals[i].band
        S = mesh.matrix(J, np.concatenate([mesh.of_u[k], mesh.of_x[k]])[None], len(value))
        return value, -band, band, S


class _GoalRows:
    """What is zero where a goal is met: a function of the scaled input and state there."""

    def __init__(self, model: Model, goal: Goal) -> None:
        stage, layout = Stage.of(model), model.layout
        rows = goal.rows(stage)
        self.band, self.names, self.scale, self.units = (
            rows.band,
            rows.names,
            rows.scale,
            rows.units,
        )
        u, x = ca.SX.sym("u", len(layout.u)), ca.SX.sym("x", len(layout.x))
        scaled = [u * layout.u.scale, x * layout.x.scale]
        value = ca.densify(ca.substitute([rows.value], [stage.u, stage.x], scaled)[0])
        J = ca.densify(ca.jacobian(value, ca.vertcat(u, x)))
        self._function = ca.Function("goal", [u, x], [value, J], {"cse": True})

    def __call__(self, u: Array, x: Array) -> tuple[Array, Array]:
        value, J = self._function(u, x)
        return np.asarray(value).ravel(), np.asarray(J)
