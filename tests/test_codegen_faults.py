"""One table of faults for the controllers in Python and in C: the same statuses, the same inputs.

Whatever happens both give an input that is finite and within the limits of torque and torque rate,
say the same of it, remember the same, and recover in the same way.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from types import SimpleNamespace

import codegen_small as small
import numpy as np
import pytest
from codegen_small import INTERVALS, STEP

from softmpc.codegen.compiled_controller import CompiledController
from softmpc.compiler import compiler
from softmpc.control import mpc as python
from softmpc.control.mpc import CONSISTENT, RESTART_AFTER
from softmpc.control.step import Step
from softmpc.errors import InputError
from softmpc.simulation.runge_kutta import RadauIIA

pytestmark = pytest.mark.skipif(compiler() is None, reason="no C compiler")

SAME = {"double": 1e-9, "float": 2e-3}  # N·m; at once saturated seven digits leave the last one
SAME_COST = {"double": 1e-9, "float": 5e-3}
ROUNDED = {"double": 1e-12, "float": 1e-6}  # N·m, of a limit
CAP = 4  # iterations of the quadratic program, where there are few
NONE, INF = np.nan, np.inf
NEAR, FAR, AWAY = (0.005, 0.0, 0.0), (0.1, 0.05, 0.0), (1.5, 0.5, 1.2)
# Python's linear algebra hands numbers that are not finite on to the quadratic program; in C a
# matrix without a finite pivot ends the step before.
SINGULAR = {"failed: QP singular": "failed: QP not finite"}


class Clock:
    """Seconds that go on by a tick each time that somebody looks."""

    def __init__(self) -> None:
        self.tick = self.now = 0.0

    def __call__(self) -> float:
        self.now += self.tick
        return self.now


@dataclass
class Both:
    """A plant with the two controllers; it follows Python's."""

    monkeypatch: pytest.MonkeyPatch
    cap: int = 1000
    budget: float | None = None
    precision: str = "double"

    def __post_init__(self) -> None:
        self.clocks = Clock(), Clock()
        self.mpc, self.start = small.controller(), small.start()
        self.mpc.solver.qp.max_iterations, self.mpc.budget = self.cap, self.budget
        if self.budget is not None:
            counted = SimpleNamespace(perf_counter=self.clocks[0])
            self.monkeypatch.setattr(python, "time", counted)
        self.c = CompiledController(
            small.folder(self.cap), small.transcription(), flags=["-O0"], budget=self.budget,
            clock=self.clocks[1], single=self.precision == "float",
        )  # fmt: skip
        self.plant = RadauIIA(small.transcription().model, tolerance=1e-5)
        self.x, self.u, self.home = self.start.x, self.start.u, small.home()

    def narrow(self, **limits: float | None) -> None:
        """Limits of the last guard, and those of the arm where there are none."""
        given = {name: None if v is None else np.full(3, v) for name, v in limits.items()}
        self.c.set_limits(**given)
        self.mpc.set_limits(**given)

    def step(self, fault: Fault) -> Step:
        """One of each, of which both say the same."""
        given = np.tile(self.home + np.asarray(fault.target), (INTERVALS, 1))
        given.flat[: fault.spoilt] = fault.value
        x, u = (
            np.asarray(change(v), float) for change, v in ((fault.x, self.x), (fault.u, self.u))
        )
        for clock in self.clocks:
            clock.tick = fault.tick
        last = np.zeros(3) if self.mpc._u is None else self.mpc._u
        theirs, own = self.mpc.step(x, u, given), self.c.step(x, u, given)
        self._require_same(theirs, own)
        self._require_within(own.u, np.where(np.isfinite(u), u, last))
        self.x, self.u = self.plant.advance(self.x, own.u, STEP)[-1], own.u
        return own

    def _require_same(self, theirs: Step, own: Step) -> None:
        assert SINGULAR.get(own.status, own.status) == theirs.status
        assert own.source == theirs.source
        if self.precision == "double":  # what is left of a float's answer may be worth a clip
            assert own.clipped == theirs.clipped
        assert own.share == theirs.share
        assert np.abs(own.u - theirs.u).max() <= SAME[self.precision]
        assert self.c.report.failures == min(self.mpc._failures, RESTART_AFTER)
        if theirs.qp and "singular" not in own.status:
            assert own.qp == theirs.qp
        if own.solved:
            assert own.cost == pytest.approx(theirs.cost, rel=SAME_COST[self.precision])

    def _require_within(self, u: np.ndarray, before: np.ndarray) -> None:
        guard = self.mpc.guard
        assert np.all(np.isfinite(u))
        room = ROUNDED[self.precision]
        assert np.all(u >= guard.low - room) and np.all(u <= guard.high + room)
        held = np.clip(before, guard.low, guard.high)  # outside, the limits of torque go first
        assert np.all(u - held <= guard.rise + room) and np.all(u - held >= guard.fall - room)

    def goes_home(self, within: int = 60) -> None:
        """All is well again, step after step, until the tip is at home."""
        tip, off = small.transcription().model.tip, np.inf
        for _ in range(within):
            step = self.step(WELL)
            off = float(np.linalg.norm(np.asarray(tip(self.x[:4])).ravel() - self.home))
            if off < 1e-4:
                break
        assert step.solved and off < 1e-4


def same(value: np.ndarray) -> np.ndarray:
    return value


def all_of(value: float) -> Callable[[np.ndarray], np.ndarray]:
    return lambda given: np.full_like(given, value)


def one_of(value: float, place: int = 0) -> Callable[[np.ndarray], np.ndarray]:
    return lambda given: np.where(np.arange(len(given)) == place, value, given)


@dataclass(frozen=True)
class Fault:
    """What goes wrong in each of some steps, and what both controllers say then."""

    says: tuple[tuple[str, str], ...] = ()  # status and source of each step
    before: int = 3  # steps in which all is well
    x: Callable[[np.ndarray], np.ndarray] = same
    u: Callable[[np.ndarray], np.ndarray] = same
    target: tuple[float, float, float] = NEAR  # m, from home
    value: float = 0.0  # of references
    spoilt: int = 0  # references that have this value
    cap: int = 1000
    budget: float | None = None
    tick: float = 0.0  # s, by which the clock goes on
    limits: tuple[tuple[str, float], ...] = ()
    clips: bool = False  # whether the last guard has something to do in each step
    violation: float = 0.0  # scaled, that one of the steps has at least
    restarts: tuple[int, ...] = ()  # steps that begin without a plan


WELL = Fault(target=(0.0, 0.0, 0.0))


def says(*parts: tuple[int, str, str]) -> tuple[tuple[str, str], ...]:
    """Count, status and source of steps that say the same."""
    return tuple((status, source) for count, status, source in parts for _ in range(count))


SOLUTION, PLAN, HELD = "solution", "shifted plan", "held input"
BAD, LATE, CAPPED = "input not finite", "budget overrun", "iteration cap"
INFEASIBLE, BROKEN = "failed: QP infeasible", "failed: QP not finite"
FOLLOWED = says((3, BAD, PLAN))
SOLVED = says((8, "solved", SOLUTION))
FAULTS = {
    "NaN in the state": Fault(FOLLOWED, x=one_of(NONE, 5)),
    "infinity in the state": Fault(FOLLOWED, x=one_of(-INF)),
    "NaN in the input before": Fault(FOLLOWED, u=one_of(NONE, 1)),
    "infinity in the input before": Fault(FOLLOWED, u=all_of(INF)),
    "NaN in the references": Fault(FOLLOWED, value=NONE, spoilt=1),
    "infinite references": Fault(FOLLOWED, value=INF, spoilt=3 * INTERVALS),
    "NaN everywhere, first of all": Fault(
        says((4, BAD, HELD)), before=0, x=all_of(NONE), u=all_of(NONE)
    ),
    "NaN until the plan is over": Fault(
        says((INTERVALS - 1, BAD, PLAN), (3, BAD, HELD)), x=all_of(NONE)
    ),
    "a state that no arm has": Fault(
        says((RESTART_AFTER, INFEASIBLE, PLAN), (2, BROKEN, PLAN)),
        x=all_of(1e30), violation=1e38, restarts=(3, 4),
    ),
    "references from elsewhere": Fault(
        says((5, INFEASIBLE, PLAN)), value=1e200, spoilt=3, restarts=(3, 4)
    ),
    "input before above its limit": Fault(
        says((2, INFEASIBLE, PLAN)), u=all_of(4.0), clips=True, violation=CONSISTENT
    ),
    "input before above its limit, first of all": Fault(
        says((1, INFEASIBLE, HELD)), before=0, u=all_of(4.0), clips=True, restarts=(0,)
    ),
    "pressure above its hard limit": Fault(
        says((INTERVALS - 1, INFEASIBLE, PLAN), (2, INFEASIBLE, HELD)),
        x=one_of(1e8, 12),
        violation=CONSISTENT,
        restarts=tuple(range(RESTART_AFTER, INTERVALS + 1)),
    ),
    "far start": Fault(SOLVED, before=0, target=FAR, restarts=(0,)),
    "far target": Fault(SOLVED, target=FAR),
    "target out of reach": Fault(SOLVED, target=AWAY, violation=CONSISTENT),
    "iteration cap, first of all": Fault(
        says((6, CAPPED, SOLUTION)), before=0, target=FAR, cap=CAP, restarts=(0,)
    ),
    "iteration cap": Fault(
        says((RESTART_AFTER, CAPPED, PLAN), (1, CAPPED, SOLUTION), (2, CAPPED, PLAN)),
        target=FAR, cap=CAP, restarts=(RESTART_AFTER,),
    ),
    "late": Fault(says((6, LATE, PLAN)), budget=0.05, tick=0.1),
    "late, first of all": Fault(
        says((1, LATE, HELD), (5, LATE, PLAN)), before=0, budget=0.05, tick=0.1, restarts=(0,)
    ),
    "no time for the program": Fault(
        says((1, LATE, PLAN)), budget=1e-6, tick=0.01, target=(0.0, 0.0, 1.0)
    ),
    "narrowed torque": Fault(
        SOLVED, limits=(("low", 0.75), ("high", 0.9)), target=FAR
    ),
    "narrowed rates": Fault(
        SOLVED, limits=(("fall", -0.02), ("rise", 0.01)), target=FAR
    ),
}  # fmt: skip


OF_DOUBLES = ("references from elsewhere",)  # numbers that floats do not have
CASES = [pytest.param(name, "double", id=name) for name in FAULTS] + [
    pytest.param(name, "float", id=f"{name}, float", marks=pytest.mark.slow)
    for name, fault in FAULTS.items()
    if name not in OF_DOUBLES and fault.cap != CAP  # at the cap it matters how feasible a start is
]


@pytest.mark.sampled
@pytest.mark.parametrize("name, precision", CASES)
def test_both_say_and_do_the_same(
    name: str, precision: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    fault, violations = FAULTS[name], []
    both = Both(monkeypatch, fault.cap, fault.budget, precision)
    for _ in range(fault.before):
        assert both.step(Fault(target=NEAR)).solved
    both.narrow(**dict(fault.limits))
    for k, said in enumerate(fault.says):
        step = both.step(fault)
        assert (SINGULAR.get(step.status, step.status), step.source) == said
        assert step.clipped == fault.clips or precision == "float"
        assert bool(both.c.report.restarted) == (k in fault.restarts)
        violations.append(step.violation)
    assert not fault.violation or np.nanmax(violations) >= fault.violation
    both.narrow(**dict.fromkeys(dict(fault.limits)))
    both.goes_home()


def test_limits_that_cross_are_refused_and_change_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    both = Both(monkeypatch)
    both.narrow(high=0.82)
    for wrong in ({"low": np.full(3, 0.9), "high": np.full(3, 0.8)}, {"rise": np.full(3, NONE)}):
        with pytest.raises(InputError, match="set_limits"):
            both.c.set_limits(**wrong)
    for _ in range(6):
        both.step(Fault(target=FAR))
    assert both.u.max() == 0.82
    wide = {"low": np.full(3, -9.0), "high": np.full(3, 9.0)}
    both.c.set_limits(**wide)  # never wider than the scene's
    both.narrow(high=None)
    for _ in range(8):
        both.step(Fault(target=AWAY))
