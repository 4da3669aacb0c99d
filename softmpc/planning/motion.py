"""A motion on its way to a plan: held inputs, states that follow from them, and durations."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse

from softmpc.control.dynamics import Dynamics, Steps
from softmpc.control.interval import Interval, Scales
from softmpc.control.rollout import Rollout
from softmpc.control.trajectory import Moment, Trajectory
from softmpc.planning.mesh import Mesh

__all__ = ["Motion", "Roller", "equations"]

TOLERANCE = 1e-9  # of scaled defects
MOST = 8  # Newton iterations
HOPELESS = 1e3  # of a scaled defect

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Motion:
    """Inputs, stage accelerations and states (scaled), durations of the phases (s), and the steps
    around it; it breaks the model's equations by no more than rounding."""

    at: Trajectory
    durations: Array
    steps: Steps

    @property
    def time(self) -> float:
        """Of the whole, s."""
        return float(self.durations.sum())


class Roller:
    """Makes motions on one mesh: Newton's method on all intervals at once, else one by one."""

    def __init__(self, mesh: Mesh, moment: Moment, mode: str = "auto") -> None:
        self.mesh, self.moment = mesh, moment
        self.dynamics = Dynamics(mesh.t, mode)
        self._rollout = Rollout(mesh.t)

    def __call__(self, guess: Trajectory, durations: Array) -> Motion | None:
        """The motion under the guess's inputs; None where Newton's method finds none."""
        lengths = self.mesh.phases.lengths(durations)
        self.dynamics.use(lengths)
        with np.errstate(over="ignore", invalid="ignore"):  # where Newton's method runs away
            found = self._at_once(guess, durations)
            if found is not None:
                return found
            w = self._rollout.one_by_one(self.moment, guess, self._intervals(lengths))
            return None if w is None else self._at_once(Trajectory.of(self.mesh.t, w), durations)

    def _at_once(self, guess: Trajectory, durations: Array) -> Motion | None:
        at, still = guess, (np.zeros_like(self.moment.x), np.zeros_like(guess.u))
        for _ in range(MOST):
            try:
                steps = self.dynamics(self.moment, at, by_length=True)
            except np.linalg.LinAlgError:
                return None
            worst = float(np.abs(steps.defects).max())
            if worst <= TOLERANCE:
                return Motion(at, durations, steps)
            if not worst < HOPELESS:
                return None
            dx = steps.free(still[0])
            at = Trajectory(at.u, at.a + steps.stages(still[0], dx, still[1]), at.x + dx)
        return None

    def _intervals(self, lengths: Array) -> list[Interval]:
        t = self.mesh.t
        scales = Scales(t.x_scale, t.u_scale, t.a_scale)
        return [Interval(t.model, t.tableau, scales, float(h)) for h in lengths]

    def moved(self, motion: Motion, v: Array) -> Motion | None:
        """The motion after the moves v of a quadratic program around `motion`."""
        du, dx, longer = self.mesh.split(v)
        steps, phases = motion.steps, self.mesh.phases
        lengths = longer[phases.of_interval] * phases.share
        da = steps.stages(np.zeros_like(self.moment.x), dx, du)
        if steps.by_h is not None:
            da = da - steps.by_h * lengths[:, None]
        step = Trajectory(du, da, dx)
        return self(motion.at.moved(step, 1.0), motion.durations + longer)


def equations(
    mesh: Mesh, motion: Motion, timing: tuple[Array, Array]
) -> tuple[sparse.csr_matrix, Array]:
    """D v = d around a motion: the steps from node to node, then what is known of the durations.

    `timing` has rows M and values of M · durations = values.
    """
    s, (M, times) = motion.steps, timing
    if s.G is None:
        raise AssertionError("a motion has slopes in its lengths")
    N, nx, nu = s.B.shape
    states = np.zeros((N, nx, 2 * nx + nu + 1))
    states[1:, :, :nx] = s.A[1:]
    states[:, :, nx : 2 * nx] = -np.eye(nx)
    states[:, :, 2 * nx : -1] = s.B
    states[:, :, -1] = s.G * mesh.phases.share[:, None]
    before = np.vstack([mesh.of_x[:1], mesh.of_x[:-1]])
    columns = np.hstack([before, mesh.of_x, mesh.of_u, mesh.of_duration[:, None]])
    D = mesh.matrix(states, columns[:, None, :])
    if not len(times):
        return D, -s.gaps.ravel()
    known = sparse.hstack([sparse.csr_matrix((len(times), mesh.moves - M.shape[1])), M])
    right = np.concatenate([-s.gaps.ravel(), times - M @ motion.durations])
    return sparse.vstack([D, known]).tocsr(), right
