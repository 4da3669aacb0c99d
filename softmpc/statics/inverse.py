"""Inverse statics: pressures that hold section tips at places and in directions, at rest.

IPOPT minimises a cost among all equilibria within the limits. What the tips miss is a variable at
a high price: a target in reach is hit, and one out of reach gives the nearest posture.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import cached_property
from operator import attrgetter

import numpy as np

from softmpc.errors import InputError
from softmpc.model.model import Model
from softmpc.statics.active_limits import ActiveLimits
from softmpc.statics.equilibrium import Equilibrium
from softmpc.statics.inverse_candidate import HIT, Candidate, Judge
from softmpc.statics.inverse_program import InverseProgram
from softmpc.statics.inverse_result import (
    NO_CONVERGENCE,
    SOLVED,
    UNREACHABLE,
    InverseResult,
    torque_band,
    torques_within,
)
from softmpc.statics.program import RestProgram, RestSolution
from softmpc.statics.rest_costs import LeastPressure, RestCost
from softmpc.statics.rest_limits import beyond_limits, torques_at_rest
from softmpc.statics.rest_spread import Spread
from softmpc.statics.sensitivities import Sensitivities, tip_compliance
from softmpc.statics.targets import Target, as_targets

__all__ = ["InverseStatics"]

STARTS = 40  # postures to start from, before a target counts as out of reach:
FIRST = 3  # a few of the spread, which mostly hit,
AT_LIMITS = 8  # then the nearest ones with units at their limits, as the nearest of all is one,
# then others of the spread, unless none of either lies beyond the nearest posture found.
NEAR = 1e-4  # m; a smaller miss may be the cost's doing, at the edge of what is in reach
LIGHT = 1e-4  # weight of the cost then

Targets = Target | Iterable[Target]
RANK = attrgetter("rank")


class InverseStatics:
    """Inverse statics of one model by one cost.

    `held` gives the pressure (Pa) of units that are stuck, by unit 1, 2, …; `angle_length` (m, the
    arm's length) is what an error of one radian is worth where place and direction compete;
    `starts` is from how many postures a target is sought before it counts as out of reach.
    """

    def __init__(
        self,
        model: Model,
        cost: RestCost | None = None,
        held: Mapping[int, float] | None = None,
        angle_length: float | None = None,
        starts: int = STARTS,
    ) -> None:
        self.model, self.cost = model, cost or LeastPressure()
        self.program = RestProgram(model, held)
        self.length = model.scene.manipulator.length
        self.angle_length = self.length if angle_length is None else float(angle_length)
        if not 0 < self.angle_length < np.inf:
            raise InputError(f"angle_length = {angle_length!r} m: must be a positive number")
        _check_whole("starts", starts)
        self.starts = starts
        self._programs: dict[tuple[object, ...], InverseProgram] = {}
        self._active = ActiveLimits(model, self.program.limits)

    @cached_property
    def spread(self) -> Spread:
        """Postures to start from."""
        return Spread.of(self.model, self.program.limits)

    @cached_property
    def edge(self) -> Spread:
        """Postures with units at their limits, for what is out of reach."""
        return Spread.at_limits(self.model, self.program.limits)

    def solve(
        self,
        targets: Targets,
        start: InverseResult | Equilibrium | None = None,
        compare: int = 1,
    ) -> InverseResult:
        """The posture that holds one target or several at once.

        It is sought from `start`, then from the nearest postures of the spread, until `compare` of
        them led to postures that hold the targets and are stable; the best one is returned. More
        than one is for those who want the lowest of several local optima of the cost.
        """
        began = time.perf_counter()
        _check_whole("compare", compare)
        wanted = as_targets(targets, len(self.model.scene.manipulator.sections))
        inverse, values = self._inverse(wanted), self._values(wanted, start)
        judge = Judge(self.program, inverse, wanted, self.angle_length)
        best, good, iterations, starts = None, 0, 0, 0
        for guess in self._starts(judge, start):
            found = inverse.solver(guess, values)
            iterations, starts = iterations + found.iterations, starts + 1
            if not found.solved:
                continue
            candidate = judge.optimum(found)
            if HIT < candidate.miss < NEAR:
                closer = inverse.solver(found, np.append(values[:-1], LIGHT))
                iterations += closer.iterations
                if closer.solved:
                    candidate = min(candidate, judge.optimum(closer), key=RANK)
            best = candidate if best is None else min(best, candidate, key=RANK)
            good += candidate.rank[0] == 0
            enough = starts >= FIRST + AT_LIMITS and self._is_outermost(best, judge)
            if good >= compare or enough:
                break
        return self._result(judge, best, iterations, starts, time.perf_counter() - began)

    def solve_path(
        self,
        path: Sequence[Targets],
        start: InverseResult | Equilibrium | None = None,
        progress: Callable[[int, int], None] | None = None,
    ) -> list[InverseResult]:
        """One target after the other, each from the last one that was solved."""
        results = []
        for k, targets in enumerate(path):
            results.append(self.solve(targets, start))
            start = results[-1] if results[-1].solved else start
            if progress is not None:
                progress(k + 1, len(path))
        return results

    def sensitivities(self, result: InverseResult) -> Sensitivities:
        """Derivatives at a solution: compliance, and how pressures follow the targets.

        With the limits that are active now; where one is about to become so they hold to one side.
        NaN where the pressures are not settled, as by `GreatestMargin` where units are to spare,
        and where the result is no optimum.
        """
        targets, solution, model = result.targets, result.solution, self.model
        n, m = model.strains, len(self.program.limits.low)
        if solution is None:
            slopes = np.full((n + m, sum(len(target.values) for target in targets)), np.nan)
        else:
            slopes = self._inverse(targets).solver.derivative(solution)
        names, columns, place = [], [], 0
        for target in targets:
            own, moved = target.moves()
            section = "" if target.section is None else f"_{target.section}"
            names += [name + section for name in own]
            columns.append(slopes[:, place : place + len(moved)] @ moved)
            place += len(moved)
        by_moves = np.hstack(columns)
        pressures = by_moves[n : n + m]
        return Sensitivities(
            compliance=tip_compliance(model, result.posture),
            moves=tuple(names),
            pressures=pressures,
            torques=torques_at_rest(model, pressures),
            strains=by_moves[:n],
        )

    # --- the program -----------------------------------------------------------------------------

    def _inverse(self, targets: tuple[Target, ...]) -> InverseProgram:
        kinds = tuple(target.kind for target in targets)
        if kinds not in self._programs:
            self._programs[kinds] = InverseProgram.of(
                self.program, self.cost, targets, self.angle_length
            )
        return self._programs[kinds]

    def _values(
        self, targets: tuple[Target, ...], start: InverseResult | Equilibrium | None
    ) -> np.ndarray:
        own = self.cost.values(self.model, None if start is None else start.q)
        return np.concatenate([*(target.values for target in targets), own, [1.0]])

    def _starts(
        self, judge: Judge, start: InverseResult | Equilibrium | None
    ) -> Iterator[np.ndarray | RestSolution]:
        """The start that was given, then postures of the spread, nearest first."""
        nothing = np.zeros(judge.inverse.extra)
        if start is not None:
            limits = self.program.limits
            inside = np.clip(start.pressures, limits.low, limits.high)
            last = _solution_of(start, judge.targets)
            yield last or self.program.guess(start.q, inside, nothing)
        for rest in self._postures(judge):
            yield self.program.guess(rest.q, rest.pressures, nothing)

    def _postures(self, judge: Judge) -> Iterator[Equilibrium]:
        """Postures to start from, most promising first; made as far as they are asked for."""
        near = self.spread.starts(_misses(judge, self.spread), self.starts)
        yield from near[:FIRST]
        if self.starts > FIRST:
            at_limits = self.edge.nearest(_misses(judge, self.edge), AT_LIMITS)
            yield from [*at_limits, *near[FIRST:]][: self.starts - FIRST]

    # --- what is known of the workspace ----------------------------------------------------------

    def _is_outermost(self, best: Candidate, judge: Judge) -> bool:
        """Whether all known postures are behind a plane at a near miss, across the way left.

        Were the target in reach, there should be some on its side of the plane.
        """
        if not best.good or best.miss <= HIT:
            return False
        off = judge.off(best.posture.tips[None], best.posture.rotations[None])[0]
        known = [judge.off(some.tips, some.rotations) for some in (self.spread, self.edge)]
        # Rounding: the posture may itself be one of them.
        return bool(np.all((np.vstack(known) - off) @ off >= -1e-9 * best.miss))

    def _known(self, judge: Judge) -> Candidate | None:
        """The nearest posture to start from that is stable and allowed, if any is."""
        best: Candidate | None = None
        for some in (self.spread, self.edge):
            for rest in some.nearest(_misses(judge, some), len(some.postures)):
                if rest.stable and not beyond_limits(self.model, rest.q, rest.pressures):
                    found = judge.posture(rest, True)
                    best = found if best is None else min(best, found, key=RANK)
                    break
        return best

    def _result(
        self,
        judge: Judge,
        best: Candidate | None,
        iterations: int,
        starts: int,
        seconds: float,
    ) -> InverseResult:
        status = NO_CONVERGENCE if best is None else SOLVED
        if best is None or best.miss > HIT:
            # IPOPT knows nothing of stability: where it finds other postures only, one of these.
            status = NO_CONVERGENCE if best is None else UNREACHABLE
            known = [one for one in (best, self._known(judge)) if one is not None]
            best = min(known, key=RANK, default=None)
        if best is None:  # no posture at all, or none within the limits
            rest = self.spread.postures[0]
            best = judge.posture(rest, rest.converged)
        posture, model = best.posture, self.model
        return InverseResult(
            status=status,
            targets=judge.targets,
            posture=posture,
            torques=torques_within(model, posture.pressures),
            torque_band=torque_band(model),
            distance=best.distance,
            angle=best.angle,
            on_rest_branch=best.on_rest_branch,
            active=self._active(posture.q, posture.pressures),
            cost=best.cost,
            iterations=iterations,
            starts=starts,
            seconds=seconds,
            solution=best.solution,
        )


def _misses(judge: Judge, some: Spread) -> np.ndarray:
    """What its postures miss (N, m)."""
    return np.asarray(np.linalg.norm(judge.off(some.tips, some.rotations), axis=1))


def _check_whole(name: str, value: int) -> None:
    if isinstance(value, bool) or not isinstance(value, int) or value < 1:
        raise InputError(f"{name} = {value!r}: must be a whole number from 1")


def _solution_of(
    start: InverseResult | Equilibrium, targets: tuple[Target, ...]
) -> RestSolution | None:
    """The solution to start from with its multipliers: of a target hit, of the same kind."""
    if not isinstance(start, InverseResult) or not start.solved:
        return None
    same = [t.kind for t in start.targets] == [t.kind for t in targets]
    return start.solution if same else None
