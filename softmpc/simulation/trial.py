"""Steps of an implicit Runge-Kutta method as one CasADi function that can be compiled.

A trial solves the stages of one step from where the motion is and accepts it, or makes the step
shorter. Many trials make one call: after the end of the interval they cost nothing. What a trial
hands on is a `Carry`; what the whole interval shares (its end, tolerances, the input) is `given`.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import cached_property, reduce
from operator import mul
from typing import Any

import casadi as ca
import numpy as np

from softmpc.simulation.newton import Stages, Start
from softmpc.simulation.system import System
from softmpc.simulation.tableau import Tableau

__all__ = ["MOST_FAILURES", "Carry", "Trials"]

HEAD = 3  # numbers in `given` before the coefficients of the input
MOST_FAILURES = 40  # steps refused in a row; 12 are too few for sharp friction that lets go
# Most Newton iterations, and the contraction at which they are given up. A shorter step is cheaper
# than slow iterations; a step that is given has no such choice.
ADAPTIVE, GIVEN = (7, 0.9), (30, 3.0)
SAFETY, SHRINK, GROW = 0.9, 0.2, 4.0
NEWTON = 0.02  # accuracy of the stages, of the tolerance


class Carry:
    """The numbers one trial hands to the next, in one column; `slices` by name."""

    def __init__(self, system: System, stages: int) -> None:
        n, k, m = system.n, system.k, system.size
        sizes = {
            "t": 1,
            "h": 1,  # of the next step
            "h_before": 1,  # of the last step
            "failures": 1,  # in a row
            "refused": 1,  # steps not accepted, in all
            "iterations": 1,
            "q": n,
            "dq": n,
            "z": k,
            "y": m,  # the unknowns at t
            "stages": m * stages,  # the unknowns at the stages of the last step
        }
        ends = np.cumsum([0, *sizes.values()])
        self.size = int(ends[-1])
        self.slices = {
            name: slice(int(a), int(b)) for name, a, b in zip(sizes, ends, ends[1:], strict=False)
        }

    def unpack(self, column: Any) -> dict[str, Any]:
        """Parts by name, of an MX column or of an array (size×K)."""
        return {name: column[part] for name, part in self.slices.items()}

    def pack(self, parts: dict[str, Any]) -> Any:
        return ca.vertcat(*(parts[name] for name in self.slices))


class Trials:
    """Trials of one method for one system; `adaptive` or with a step that is given.

    A step that is given is kept wherever its stages can be solved, and halved where not.
    """

    def __init__(self, system: System, tableau: Tableau, adaptive: bool) -> None:
        self.system, self.tableau, self.adaptive = system, tableau, adaptive
        self.carry = Carry(system, tableau.stages)
        self.stages = Stages(system, tableau, *(ADAPTIVE if adaptive else GIVEN))

    @property
    def given_size(self) -> int:
        """Length of `given`: end (s), tolerance (m), longest step (s), the input's coefficients."""
        return HEAD + self.system.coefficients

    def many(self, count: int) -> ca.Function:
        """(carry, given) -> the carry after each of `count` trials (size×count)."""
        carry = ca.MX.sym("carry", self.carry.size)
        given = ca.MX.sym("given", self.given_size)
        all_after = self._one.mapaccum("trials", count, 1)(carry, ca.repmat(given, 1, count))
        return ca.Function("steps", [carry, given], [all_after], ["carry", "given"], ["after"])

    @cached_property
    def _one(self) -> ca.Function:
        carry = ca.MX.sym("carry", self.carry.size)
        given = ca.MX.sym("given", self.given_size)
        trial = ca.Function("trial", [carry, given], [self._trial(carry, given)])
        rest = ca.Function("rest", [carry, given], [carry])
        maybe = ca.Function.if_else("maybe_trial", trial, rest)
        now = self.carry.unpack(carry)
        busy = ca.logic_and(now["t"] < given[0], now["failures"] < MOST_FAILURES)
        return ca.Function("one", [carry, given], [maybe(busy, carry, given)])

    # --- one trial -----------------------------------------------------------------------------

    def _trial(self, carry: Any, given: Any) -> Any:
        now = self.carry.unpack(carry)
        h, last = self._length(now, given)
        start = Start(now["q"], now["dq"], now["z"], h)
        w = ca.horzcat(*(self.system.input(given[HEAD:], now["t"] + c * h) for c in self.tableau.c))
        guess = self._predicted(now, h)
        middle = [x[:, self.tableau.stages // 2] for x in (*self.stages.at(start, guess), guess, w)]
        blocks = self.system.blocks(*middle)
        inverse = self.stages.inverse(list(blocks), h)
        wanted = NEWTON * given[1]
        y, solved, used = self.stages.newton(start, guess, w, inverse, wanted)
        error = ca.MX(0.0)
        if self.adaptive:
            error = self._error(now["y"], y, blocks[0], inverse, h) / given[1]
        accepted = ca.logic_and(solved, error <= 1)
        q, dq, z = self.stages.end(start, y)
        end = y @ ca.DM(self.tableau.lagrange(np.array(1.0)))
        if self.system.order == 1:
            dq = end[: self.system.n]
        reached = {
            "t": ca.if_else(last, given[0], now["t"] + h),
            "h_before": h,
            "failures": 0.0,
            "q": q,
            "dq": dq,
            "z": z,
            "y": end,
            "stages": ca.vec(y),
        }
        missed = {"failures": now["failures"] + 1, "refused": now["refused"] + 1}
        both = {
            "h": self._next(now, given, h, error, solved, accepted),
            "iterations": now["iterations"] + used,
        }
        outcomes = [self.carry.pack({**now, **both, **outcome}) for outcome in (reached, missed)]
        return ca.if_else(accepted, *outcomes)

    def _length(self, now: dict[str, Any], given: Any) -> tuple[Any, Any]:
        """Length of the step, and whether it is the last: no sliver is left at the end."""
        remaining, h = given[0] - now["t"], now["h"]
        last = remaining <= h * (1 + 1e-6)
        if self.adaptive:
            h = ca.if_else(remaining < 2 * h, remaining / 2, h)
        return ca.if_else(last, remaining, h), last

    def _next(
        self, now: dict[str, Any], given: Any, h: Any, error: Any, solved: Any, accepted: Any
    ) -> Any:
        if not self.adaptive:
            return ca.if_else(solved, ca.fmin(2 * now["h"], given[2]), now["h"] / 2)
        power = 1 / (self.tableau.stages + self.system.order)
        factor = SAFETY * (1 / ca.fmax(error, 1e-12)) ** power
        highest = ca.if_else(now["failures"] > 0, 1.0, GROW)
        factor = ca.fmin(ca.fmax(factor, SHRINK), highest)
        # A step cut short at the end of the interval does not shorten what comes after it.
        longer = ca.if_else(factor >= 1, ca.fmax(h * factor, now["h"]), h * factor)
        return ca.if_else(solved, ca.if_else(accepted, longer, h * factor), h / 4)

    def _predicted(self, now: dict[str, Any], h: Any) -> Any:
        """Unknowns at the stages from the polynomial of the last step."""
        c, s = self.tableau.c, self.tableau.stages
        before = ca.reshape(now["stages"], self.system.size, s)
        ahead = 1 + (h / now["h_before"]) * ca.DM(c)
        weights = [
            ca.vertcat(
                *(
                    _product((ahead[i] - c[k]) / (c[j] - c[k]) for k in range(s) if k != j)
                    for j in range(s)
                )
            )
            for i in range(s)
        ]
        return before @ ca.horzcat(*weights)

    def _error(self, y0: Any, y: Any, by_y: Any, inverse: Any, h: Any) -> Any:
        """Estimate (m, at the tip) of the error of this step."""
        gamma, weights = self.tableau.embedded
        scaled = ca.horzcat(y0, y) / ca.repmat(
            ca.DM(self.system.y_scale), 1, 1 + self.tableau.stages
        )
        raw = scaled @ ca.DM([gamma, *weights])
        # What stiff modes would do with it in a step: the Newton matrix takes them out.
        filtered = self.stages.solve(inverse, ca.repmat(by_y @ raw, 1, self.tableau.stages))[:, -1]
        n, levers = self.system.n, ca.DM(self.system.levers * self.system.y_scale)
        strains = h**self.system.order * filtered[:n]
        return ca.dot(levers, ca.fabs(ca.vertcat(strains, h * filtered[n:])))


def _product(factors: Iterable[Any]) -> Any:
    return reduce(mul, factors, ca.MX(1))
