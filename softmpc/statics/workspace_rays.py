"""How far the tip gets along a ray, and how far a ray may turn: programs for IPOPT.

What IPOPT finds is an optimum near its start, maybe on a branch that the arm never takes. So each
search has several starts, the best answer first is confirmed by forward statics, and where that
ends elsewhere or not stably, the next best one has its turn.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from softmpc.model.model import Model
from softmpc.statics.equilibrium import find_equilibrium
from softmpc.statics.program import Extra, RestProgram, RestSolution, RestSolver, Rows
from softmpc.statics.workspace_samples import Start

__all__ = ["HIT", "Place", "RaySearch", "Search"]

HIT = 1e-5  # m: as near forward statics must come to a place
FAR = 10.0  # rest lengths of the arm, a bound on the way along a ray
SAME = 1e-9  # of a value: answers nearer to each other are one
HALVINGS = 12  # of the way between what holds and what does not
OPTIONS: dict[str, Any] = {"max_iter": 100}  # what takes longer is on its way to nowhere
UNLIMITED = 1e6


@dataclass(frozen=True, eq=False)
class Place:
    """A stable posture that forward statics confirmed, SI."""

    pressures: np.ndarray  # (m)
    q: np.ndarray  # strains (n)
    tip: np.ndarray  # (3)
    smallest_stiffness: float  # J
    best: bool = True  # no search came further, not even to what could not be confirmed
    normal: np.ndarray | None = None  # of the edge here (3), along the search; for rays only

    def plain(self) -> list[Any]:
        """What can travel as JSON."""
        return [*(v.tolist() for v in (self.pressures, self.q, self.tip)),
                self.smallest_stiffness, self.best]  # fmt: skip

    @classmethod
    def of(cls, plain: Sequence[Any] | None) -> Place | None:
        """From what came back."""
        if plain is None:
            return None
        pressures, q, tip, stiffness, best = plain
        return cls(np.array(pressures), np.array(q), np.array(tip), float(stiffness), bool(best))


@dataclass(frozen=True, eq=False)
class Search:
    """A program that makes `value` large; its last parameter is the most that it may become."""

    solver: RestSolver
    value: Callable[[RestSolution], float]
    worth: Callable[[Start], float]  # the value at a start
    # further variables at a start, and where the tip is expected at a solution
    guess: Callable[[Start], list[float]] = lambda start: []
    at: Callable[[RestSolution], np.ndarray] | None = None
    normal: Callable[[RestSolution], np.ndarray] | None = None


class RaySearch:
    """Searches for one place on the arm, the tip of `section` (1, 2, …), of one model.

    Polar angles are from the third column of `frame` (3×3), azimuths from the first to the second.
    A `flat` arm moves in the plane of the first and third only, so rows across it are left out.
    """

    def __init__(
        self,
        model: Model,
        section: int,
        held: Mapping[int, float] | None = None,
        frame: Any = None,
        flat: bool = False,
    ) -> None:
        self.model, self.section = model, section
        self.program = RestProgram(model, held)
        self.frame = np.eye(3) if frame is None else np.asarray(frame, float)
        self.flat = flat
        self.length = model.scene.manipulator.length
        self.place: ca.SX = self.program.tips[section - 1] / self.length

    def solver(
        self, value: ca.SX, extra: Extra, rows: ca.SX, parameters: ca.SX | None = None
    ) -> RestSolver:
        """A program that makes `value` large, at most its last parameter, with these rows zero."""
        most = ca.SX.sym("most")
        still = np.zeros(rows.numel())
        return self.program.solver(
            -value,
            extra=extra,
            rows=Rows(
                ca.vertcat(rows, value - most), np.append(still, -np.inf), np.append(still, 0.0)
            ),
            parameters=most if parameters is None else ca.vertcat(parameters, most),
            options=OPTIONS,
        )

    # --- programs ------------------------------------------------------------------------------

    @cached_property
    def _along(self) -> RestSolver:
        """Go from a place along a direction as far as possible, or as little (sign -1)."""
        s, given = ca.SX.sym("s"), ca.SX.sym("given", 7)
        off = self.place - given[:3] - s * given[3:6]
        off = ca.mtimes(ca.DM(self.frame[:, [0, 2]].T), off) if self.flat else off
        return self.solver(given[6] * s, Extra(s, np.zeros(1), np.full(1, FAR)), off, given)

    @cached_property
    def _rim(self) -> RestSolver:
        """Turn a ray in the half-plane of an azimuth as far as possible, or as little (-1)."""
        turn, given = ca.SX.sym("turn", 2), ca.SX.sym("given", 3)
        s, polar = turn[0], turn[1]
        x, y, z = ca.vertsplit(ca.mtimes(ca.DM(self.frame.T), self.place))
        out, beside = given[0] * x + given[1] * y, given[0] * y - given[1] * x
        off = ca.vertcat(out - s * ca.sin(polar), z - s * ca.cos(polar))
        off = off if self.flat else ca.vertcat(off, beside)
        extra = Extra(turn, np.zeros(2), np.array([FAR, np.pi]))
        return self.solver(given[2] * polar, extra, off, given)

    @cached_property
    def _nearest(self) -> RestSolver:
        return self.solver(-ca.sumsqr(self.place), Extra(), ca.SX(0, 1))

    # --- searches ------------------------------------------------------------------------------

    def along(
        self, direction: np.ndarray, sense: int, starts: Sequence[Start], origin: Any = (0, 0, 0)
    ) -> Place | None:
        """The place farthest from `origin` (m) along a unit vector; `sense` -1: the nearest.

        None where no start led to a place on the ray that holds.
        """
        base = np.asarray(origin, float) / self.length

        def way(start: Start) -> float:
            return max(float((start.tip / self.length - base) @ direction), 0.0)

        search = Search(
            self._along,
            lambda found: float(found.extra[0]) * sense,
            lambda start: way(start) * sense,
            lambda start: [way(start)],
            lambda found: (base + found.extra[0] * direction) * self.length,
            None if self.flat else lambda found: _normal(found, direction),
        )
        return self.best(search, np.concatenate([base, direction, [sense]]), starts)

    def rim(self, azimuth: float, sense: int, starts: Sequence[Start]) -> Place | None:
        """The place of largest polar angle in the half-plane of an azimuth; -1: of smallest."""
        side = np.array([np.cos(azimuth), np.sin(azimuth)])

        def turn(start: Start) -> list[float]:
            tip = self.frame.T @ np.asarray(start.tip) / self.length
            return [float(np.linalg.norm(tip)), float(np.arctan2(max(tip[:2] @ side, 0.0), tip[2]))]

        def at(found: RestSolution) -> np.ndarray:
            s, polar = found.extra
            direction = np.array([*(np.sin(polar) * side), np.cos(polar)])
            return np.asarray(self.frame @ direction * s * self.length)

        search = Search(
            self._rim,
            lambda found: float(found.extra[1]) * sense,
            lambda start: turn(start)[1] * sense,
            turn,
            at,
        )
        return self.best(search, np.array([*side, sense]), starts)

    def nearest(self, starts: Sequence[Start]) -> Place | None:
        """The place nearest to the base."""
        search = Search(
            self._nearest,
            lambda found: -found.objective,
            lambda start: -float(np.sum((start.tip / self.length) ** 2)),
        )
        return self.best(search, np.zeros(0), starts)

    def best(self, search: Search, given: np.ndarray, starts: Sequence[Start]) -> Place | None:
        """The best answer of all starts that forward statics confirms."""
        answers = []
        for start in starts:
            found = self._solve(search, given, start)
            if found.solved:
                answers.append((search.value(found), found))
        refused: float | None = None
        last = np.inf
        for worth, found in sorted(answers, key=lambda answer: -answer[0]):
            if abs(worth - last) < SAME:
                continue  # the same answer again
            place, last = self._confirmed(search, found), worth
            if place is not None:
                if refused is None:
                    return place
                return self._between(search, given, place, worth, refused)
            refused = worth if refused is None else refused
        return None if refused is None else self._below(search, given, starts, refused)

    def _below(
        self, search: Search, given: np.ndarray, starts: Sequence[Start], refused: float
    ) -> Place | None:
        """Where no answer holds: from a start that is kept at its own value, as far as it holds."""
        for start in sorted(starts, key=lambda start: -search.worth(start)):
            found = self._solve(search, given, start, min(search.worth(start), refused))
            place = self._confirmed(search, found) if found.solved else None
            if place is not None:
                return self._between(search, given, place, search.value(found), refused)
        return None

    def _between(
        self, search: Search, given: np.ndarray, place: Place, low: float, high: float
    ) -> Place:
        """The best place that holds, between one that does and a value that does not."""
        for _ in range(HALVINGS):
            middle = (low + high) / 2
            start = Start(place.q, place.pressures, place.tip)
            found = self._solve(search, given, start, middle)
            better = self._confirmed(search, found) if found.solved else None
            if better is not None and search.value(found) > low:
                place, low = better, search.value(found)
            else:
                high = middle
        return replace(place, best=False)

    def _solve(
        self, search: Search, given: np.ndarray, start: Start, most: float = UNLIMITED
    ) -> RestSolution:
        guess = self.program.guess(start.q, start.pressures, search.guess(start))
        return search.solver(guess, np.append(given, most))

    def _confirmed(self, search: Search, found: RestSolution) -> Place | None:
        """A solution by continuation from the straight arm, if it ends there, and stably."""
        rest = find_equilibrium(self.model, found.pressures)
        tip = rest.tips[self.section - 1]
        expected = search.at(found) if search.at else self._tip(found.q)
        if not rest.stable or np.linalg.norm(tip - expected) > HIT:
            return None
        normal = search.normal(found) if search.normal else None
        return Place(rest.pressures, rest.q, tip, rest.smallest_stiffness, normal=normal)

    def _tip(self, q: np.ndarray) -> np.ndarray:
        return np.asarray(self.model.frames(q)[0])[:, self.section - 1]


def _normal(found: RestSolution, direction: np.ndarray) -> np.ndarray:
    """Normal of the edge where a ray ends: what shifts of the ray cost, from its multipliers."""
    shift = found.point[2][-4:-1]  # of the three rows before that of `most`
    size = np.linalg.norm(shift)
    if size < 1e-9:
        return direction
    normal = shift / size
    return np.asarray(normal if normal @ direction > 0 else -normal)
