"""Sequential quadratic programming along motions.

Each iteration takes a step of the objective within a trust region, and then the smallest changes of
the inputs that bring the conditions back, at the durations it chose. So nearly every iterate is a
motion that meets them, and steps stay long where a least time is at the corners of what is allowed.
Where nothing meets the conditions they give way at a price: the end is the nearest motion.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import sparse

from softmpc.planning.conditions import Conditions, Rows
from softmpc.planning.elastic import Elastic, Step
from softmpc.planning.motion import Motion, Roller, equations
from softmpc.planning.objective import Objective

__all__ = ["Solved", "Sqp"]

PRICE = 30.0  # of a scaled unit outside, in relative cost
DEARER, DEAREST = 10.0, 3e5  # where conditions are not met in the end
HOPELESS = 0.9  # of what was wrong before, left at a higher price
NEAR = 0.3  # scaled rows further from their bounds are left out of a program
TRUST, MOST_TRUST, LEAST_TRUST = 0.3, 1.0, 1e-6  # of scaled inputs, and of durations
MOST = 80  # iterations
RESTORATIONS = 8  # of one iteration, as long as each removes RESTORED of what is wrong
RESTORED = 0.3
RESTORING = 1e-2  # curvature of a restoration in the inputs: prices are high above it
CLEAN = 1e-7  # scaled, counts as met
MET = 1e-5  # scaled, the same at the end: a tenth of the band of rest
DECREASE = 1e-4  # relative, that is worth another iteration
SHORTEST = 1e-3  # s, of a phase

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Solved:
    """Where it ended; `step` is that of the last program, around `motion`, with its multipliers."""

    motion: Motion
    rows: Rows
    cost: float  # relative
    converged: bool
    iterations: int
    step: Step | None
    used: Array  # rows that the last program had

    @property
    def met(self) -> bool:
        """Whether all conditions are."""
        return bool(self.rows.excess.max(initial=0.0) <= MET)


class Sqp:
    """Improves motions of one problem on one mesh.

    `timing` are rows and values of what is known of the durations.
    """

    def __init__(
        self,
        roller: Roller,
        conditions: Conditions,
        objective: Objective,
        timing: tuple[Array, Array],
    ) -> None:
        self.roll, self.conditions, self.objective = roller, conditions, objective
        self.mesh, self.timing = roller.mesh, timing
        t = self.mesh.t
        low, high = t.variable_bounds()
        self._inputs = low[: t.nu], high[: t.nu]

    def __call__(self, motion: Motion, stop: Callable[[int], bool] | None = None) -> Solved:
        """The best motion around; dearer and dearer, where conditions are not met.

        `stop(iterations)` may end it early, with what there is then.
        """
        price, done, stop, wrong = PRICE, 0, stop or _never, np.inf
        motion, _ = self._restored(motion, MOST_TRUST)
        while True:
            found = self._improved(motion, price, done, stop)
            done, left = found.iterations, float(found.rows.excess.sum())
            hopeless = left > HOPELESS * wrong  # a higher price did not help
            if found.met or hopeless or price >= DEAREST or done >= MOST or stop(done):
                return found
            motion, price, wrong = found.motion, price * DEARER, left

    def _improved(
        self, motion: Motion, price: float, done: int, stop: Callable[[int], bool]
    ) -> Solved:
        rows, trust, step, used = self.conditions(motion), TRUST, None, np.zeros(0, int)
        cost, converged = self.objective(motion) + price * float(rows.excess.sum()), False
        while done < MOST and trust >= LEAST_TRUST and not converged and not stop(done):
            done += 1
            H, f = self.objective.model(motion)
            step, used, promised = self._step(motion, rows, H, f, price, trust)
            there = self.roll.moved(motion, step.v) if step.solved else None
            if there is None:
                trust *= 0.3
                continue
            size = self._size(motion, step.v)
            there, rows_there = self._restored(there, max(trust, TRUST))
            cost_there = self.objective(there) + price * float(rows_there.excess.sum())
            converged = promised <= self._small(cost, size, trust)
            if cost_there <= cost - 0.05 * promised or (converged and cost_there <= cost):
                share = (cost - cost_there) / max(promised, 1e-300)
                motion, rows, cost = there, rows_there, cost_there
                if share > 0.7 and size > 0.9 * trust:
                    trust = min(2 * trust, MOST_TRUST)
                elif share < 0.25:
                    trust = 0.5 * max(size, 0.2 * trust)
            else:
                trust = 0.4 * min(size, trust)
        stuck = trust < LEAST_TRUST  # nothing better within reach of the arithmetic
        return Solved(motion, rows, cost, converged or stuck, done, step, used)

    def _small(self, cost: float, size: float, trust: float) -> float:
        """A promise that is not worth another iteration; what a short leash promises is more."""
        held = size > 0.9 * trust and trust < 0.3 * TRUST
        return DECREASE * max(abs(cost), 1e-3) * (0.1 if held else 1.0)

    # --- programs --------------------------------------------------------------------------------

    def _step(
        self, motion: Motion, rows: Rows, H: sparse.csc_matrix, f: Array, price: float, trust: float
    ) -> tuple[Step, Array, float]:
        """A step of the objective, the rows it was told of, and the decrease that it promises."""
        longest = trust * motion.durations
        shortest = np.maximum(-longest, np.minimum(SHORTEST - motion.durations, 0.0))
        program, used = self._program(motion, rows, H, f, price, trust, (shortest, longest))
        step = program.solve()
        cost = float(f @ step.v + 0.5 * step.v @ (H @ step.v)) + price * float(step.slack.sum())
        return step, used, price * float(rows.excess[used].sum()) - cost

    def _restored(self, motion: Motion, trust: float) -> tuple[Motion, Rows]:
        """As near to the conditions as the smallest changes of the inputs bring it."""
        rows, moves = self.conditions(motion), self.mesh.moves
        squares = np.full(moves, 1e-9)
        squares[: self.mesh.inputs] = RESTORING
        H, f = sparse.diags(squares).tocsc(), np.zeros(moves)
        for _ in range(RESTORATIONS):
            wrong = float(rows.excess.sum())
            if wrong <= CLEAN:
                break
            program, _ = self._program(motion, rows, H, f, PRICE, trust)
            step = program.solve()
            there = self.roll.moved(motion, step.v) if step.solved else None
            if there is None:
                break
            rows_there = self.conditions(there)
            if not rows_there.excess.sum() <= (1 - RESTORED) * wrong:
                break
            motion, rows = there, rows_there
        return motion, rows

    def _program(
        self,
        motion: Motion,
        rows: Rows,
        H: sparse.csc_matrix,
        f: Array,
        price: float,
        trust: float,
        longer: tuple[Array, Array] | None = None,
    ) -> tuple[Elastic, Array]:
        """The elastic program around a motion, and the rows that it has: those that are near.

        Without bounds for what is `longer`, all durations stay.
        """
        low, high = rows.low - rows.value, rows.high - rows.value
        used = np.flatnonzero((low > -NEAR) | (high < NEAR))
        # Where all durations stay it is by equations: an interior-point method has no way between
        # two bounds that are one.
        stay = np.eye(len(motion.durations)), motion.durations
        D, d = equations(self.mesh, motion, stay if longer is None else self.timing)
        lowest, highest = np.full(self.mesh.moves, -np.inf), np.full(self.mesh.moves, np.inf)
        count = self.mesh.inputs
        u = motion.at.u
        lowest[:count] = np.maximum(self._inputs[0] - u, -trust).ravel()
        highest[:count] = np.minimum(self._inputs[1] - u, trust).ravel()
        if longer is not None:
            lowest[-len(longer[0]) :], highest[-len(longer[1]) :] = longer
        prices = np.full(len(used), price)
        program = Elastic(
            H, f, D, d, rows.slopes[used], low[used], high[used], prices, lowest, highest
        )
        return program, used

    def _size(self, motion: Motion, v: Array) -> float:
        """Of a step, in units of the trust region."""
        du, _, longer = self.mesh.split(v)
        return float(max(np.abs(du).max(), np.abs(longer / motion.durations).max()))


def _never(iterations: int) -> bool:
    return False
