"""One problem on one mesh: from a guess or a coarser plan to the best motion around it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from softmpc.control.costs import Torque
from softmpc.control.ocp import Ocp
from softmpc.control.trajectory import Moment, Trajectory
from softmpc.control.transcription import Transcription
from softmpc.planning.conditions import Conditions
from softmpc.planning.guesses import Guess
from softmpc.planning.mesh import Mesh, Phases
from softmpc.planning.motion import Motion, Roller
from softmpc.planning.objective import Objective
from softmpc.planning.problem import PlanProblem
from softmpc.planning.sqp import Solved, Sqp

__all__ = ["Attempt", "Found"]

STAGES = 3  # of Radau IIA: two misjudge what follows a jump of the input
NOMINAL = 0.02  # s; the intervals of a plan are as long as it says

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Found:
    """A motion in SI: nodes t (K+1, s), inputs u (K×k), states x (K+1×nx)."""

    t: Array
    ends: Array  # the nodes of the goals
    durations: Array  # of the phases, s
    u: Array
    x: Array
    a: Array  # stage accelerations (K×s·n)
    cost: float  # of the kind that is least: s, or SI squares
    converged: bool
    met: bool
    iterations: int

    @property
    def counts(self) -> tuple[int, ...]:
        """Intervals of each phase."""
        return tuple(np.diff(self.ends, prepend=0).tolist())


class Attempt:
    """Solves one problem on one mesh; `more` is how much more clearance (m) to keep."""

    def __init__(
        self, problem: PlanProblem, counts: tuple[int, ...], more: Mapping[str, float] | None = None
    ) -> None:
        self.problem, self.more = problem, dict(more or {})
        # The plan has an objective of its own, but a problem has a cost.
        ocp = Ocp(problem.model, sum(counts), NOMINAL, (Torque(),), problem.all_limits)
        self.t = t = Transcription(ocp, STAGES)
        rests = tuple(goal.rest or goal.state is not None for goal in problem.goals)
        self.mesh = Mesh(t, Phases(counts, rests))
        start = problem.start
        none = np.zeros((t.N, t.nr))
        self.moment = Moment(start.x / t.x_scale, t.decisions(start.u), none)
        self.roll = Roller(self.mesh, self.moment)
        self.conditions = Conditions(self.mesh, self.moment, problem.goals, problem.rate)
        if self.more:
            self.conditions.tighten(self.more)

    def from_guess(self, guess: Guess) -> Motion | None:
        """A motion under the inputs of a guess, or with the input before where there is none."""
        t = self.t
        q, u = (np.concatenate(part) for part in zip(*self._nodes(guess), strict=True))
        z = u @ t.model.drive.at_rest(np.eye(t.inputs)).T
        x = np.hstack([q, np.zeros_like(q), z]) / t.x_scale
        none = np.zeros((t.N, t.na))
        found = self.roll(Trajectory(u / t.u_scale, none, x), guess.durations)
        if found is None:
            still = np.tile(self.moment.u_before, (t.N, 1)), none, np.tile(self.moment.x, (t.N, 1))
            found = self.roll(Trajectory(*still), guess.durations)
        return found

    def _nodes(self, guess: Guess) -> list[tuple[Array, Array]]:
        """Strains at the ends of the intervals of each phase, inputs in their middles."""
        phases, nodes = self.mesh.phases, []
        for phase in range(len(phases.counts)):
            share = phases.share[phases.of_interval == phase]
            end = np.cumsum(share)
            nodes.append((guess.at(phase, end)[0], guess.at(phase, end - 0.5 * share)[1]))
        return nodes

    def from_plan(self, plan: Found) -> Motion | None:
        """A motion on this mesh near one on another, whose phases have fractions of its nodes."""
        t, old = self.t, plan.t
        new = np.cumsum(self.mesh.phases.lengths(plan.durations))
        middle = new - 0.5 * np.diff(new, prepend=0.0)
        held = np.clip(np.searchsorted(old, middle) - 1, 0, len(plan.u) - 1)
        x = np.stack([np.interp(new, old, column) for column in plan.x.T], axis=1)
        a = plan.a[held] / t.a_scale
        return self.roll(Trajectory(plan.u[held] / t.u_scale, a, x / t.x_scale), plan.durations)

    def improve(self, motion: Motion, stop: Callable[[int], bool] | None = None) -> Found:
        """The best motion around this one; `stop` is asked with each iteration."""
        size = self._objective(1.0).amount(motion)
        self.objective = self._objective(size if size > 0 else 1.0)
        sqp = Sqp(self.roll, self.conditions, self.objective, self.problem.timing)
        self.solved = sqp(motion, stop)
        return self._found(self.solved)

    def _objective(self, size: float) -> Objective:
        return Objective(self.mesh, self.moment, self.problem.least, size)

    def _found(self, solved: Solved) -> Found:
        t, motion, phases = self.t, solved.motion, self.mesh.phases
        at = motion.at
        return Found(
            t=np.concatenate([[0.0], np.cumsum(phases.lengths(motion.durations))]),
            ends=phases.ends + 1,
            durations=motion.durations,
            u=(at.u * t.u_scale)[:, : t.inputs],
            x=np.vstack([self.problem.start.x, at.x * t.x_scale]),
            a=at.a * t.a_scale,
            cost=self.objective.amount(motion) * self.cost_unit,
            converged=solved.converged,
            met=solved.met,
            iterations=solved.iterations,
        )

    @cached_property
    def cost_unit(self) -> float:
        """SI over scaled cost; all inputs have one scale."""
        return 1.0 if self.problem.least == "time" else float(self.t.u_scale[0]) ** 2
