"""Replays of flight logs by Python: the same bits, decisions of the clock, late beginnings."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import codegen_small as small
import numpy as np
import pytest
from flown import LATE, TIME_LIMIT, OutOfTime, by_python, fly, fly_in_trouble

from softmpc.codegen.flight_format import (
    STATUSES,
    Limits,
    Reset,
    Settings,
    Snapshot,
    StepRecord,
)
from softmpc.codegen.flight_log import FlightLog, read_log
from softmpc.codegen.flight_recorder import record
from softmpc.codegen.replay import compare, play
from softmpc.codegen.replay_python import PythonPlayer
from softmpc.control.baselines import FeedForward
from softmpc.control.memory import memory_of, put_back
from softmpc.errors import InputError


@pytest.fixture(scope="module")
def troubled(tmp_path_factory: pytest.TempPathFactory) -> FlightLog:
    return fly_in_trouble(tmp_path_factory.mktemp("python") / "flight.log")


def test_recording_changes_nothing(tmp_path: Path) -> None:
    with record(small.controller(), tmp_path / "a.log") as recorded:
        inputs = fly(recorded, 8)
    assert inputs.tobytes() == fly(small.controller(), 8).tobytes()
    log = read_log(tmp_path / "a.log")
    assert np.array([step.u for step in log.steps]).tobytes() == inputs.tobytes()
    assert log.header.names == "tip[3]" and log.header.step == small.STEP


def test_the_log_has_all_that_can_go_wrong(troubled: FlightLog) -> None:
    """So that the next test means something."""
    assert troubled.damage == "" and len(troubled.steps) == 40
    by_status = {STATUSES[step.status] for step in troubled.steps}
    assert by_status >= {"solved", "iteration cap", "budget overrun", "input not finite"}
    stopped = [step.number for step in troubled.steps if step.qp == TIME_LIMIT]
    late = [step.number for step in troubled.steps if step.status == LATE]
    assert stopped == [13, 14] and late == [5, 6, 13, 14, 33]
    kinds = {type(event) for event in troubled.events}
    assert kinds == {StepRecord, Reset, Snapshot, Settings}


def test_python_gives_the_same_bits(troubled: FlightLog) -> None:
    found = by_python(troubled)
    assert (found.steps, found.left_out, found.same_bits) == (40, 0, 40)
    assert found.same_build and found.tolerance == 0.0
    assert found.agrees and found.largest == 0.0


@pytest.mark.parametrize("kind", ["late", "stopped", "cap", "reset"])
def test_decisions_of_the_log_matter(kind: str, troubled: FlightLog) -> None:
    """A log that does not tell of them is replayed otherwise."""

    def without(event: Any) -> Any:
        if isinstance(event, StepRecord) and event.status == LATE:
            late = kind == "late" and event.qp != TIME_LIMIT
            stopped = kind == "stopped" and event.qp == TIME_LIMIT
            return replace(event, status=0) if late or stopped else event
        if kind == "cap" and isinstance(event, Settings):
            return replace(event, cap=0)
        return event

    events = [without(event) for event in troubled.events]
    if kind == "reset":
        events = [e for e in events if not (isinstance(e, Reset) and e.number == 28)]
    found = by_python(replace(troubled, events=tuple(events)))
    assert not found.agrees


@pytest.mark.parametrize("number", [10, 20, 30])
def test_a_replay_begins_at_a_snapshot(number: int, troubled: FlightLog) -> None:
    """As in the log of a ring: two steps before it are left out, all after it are the same bits."""
    events = troubled.events
    (at,) = [k for k, e in enumerate(events) if isinstance(e, Snapshot) and e.number == number]
    found = by_python(replace(troubled, events=events[at - 2 :]))
    assert (found.left_out, found.steps, found.same_bits) == (2, 40 - number, 40 - number)


@pytest.mark.parametrize(
    "parts",
    [{"plan": None}, {"expected": np.zeros(17)}, {"failures": 3}, {"age": 8}, {"violation": 1.0}],
    ids=lambda parts: next(iter(parts)),
)
def test_all_of_a_snapshot_matters(parts: dict, troubled: FlightLog) -> None:
    """With another number in it the replay is another one."""
    (at,) = [k for k, e in enumerate(troubled.events) if isinstance(e, Snapshot) and e.number == 30]
    other = replace(troubled.events[at], **parts)
    found = by_python(replace(troubled, events=(other, *troubled.events[at + 1 :])))
    assert found.steps == 10 and found.same_bits < 10


def same_memory(a: Any, b: Any) -> None:
    for name in ("plan", "expected", "age", "violation", "u", "active", "failures"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name), err_msg=name)


def test_what_is_put_back_is_remembered(troubled: FlightLog) -> None:
    """Signs of the active set in their places, and a plan that grows older as the first one did."""
    mpc, other = small.controller(), small.controller()
    fly(mpc, 4)
    memory = memory_of(mpc)
    assert memory.active is not None and set(memory.active) == {-1.0, 0.0, 1.0}
    put_back(other, memory)
    same_memory(memory_of(other), memory)
    for one in (mpc, other):  # a failed step leaves them an older plan
        one.solver.qp = OutOfTime()
        one.step(small.start().x, small.TORQUE, np.tile(small.home(), (small.INTERVALS, 1)))
    assert memory_of(other).age == 2 and memory_of(other).failures == 1
    same_memory(memory_of(other), memory_of(mpc))


def test_a_gap_is_waited_out(troubled: FlightLog) -> None:
    """Steps are missing: none until the next snapshot is replayed, then all."""
    events = [e for e in troubled.events if not (isinstance(e, StepRecord) and e.number == 12)]
    found = by_python(replace(troubled, events=tuple(events)))
    assert (found.steps, found.left_out, found.same_bits) == (32, 7, 32)


def test_no_beginning_is_an_error(troubled: FlightLog) -> None:
    events = tuple(event for event in troubled.events if isinstance(event, StepRecord))
    with pytest.raises(InputError, match="has 40 steps and none of them follows a reset or a snap"):
        by_python(replace(troubled, events=events))


def test_memory_of_another_controller_is_refused() -> None:
    mpc = small.controller()
    fly(mpc, 1)
    memory = memory_of(mpc)
    with pytest.raises(InputError, match="plan has 3 numbers; this one needs"):
        put_back(mpc, replace(memory, plan=np.zeros(3)))


def test_limits_of_a_user_hold_in_the_replay(tmp_path: Path) -> None:
    with record(small.controller(), tmp_path / "a.log") as recorded:
        recorded.set_limits(low=np.full(3, 0.7), rise=np.full(3, 0.01))
        fly(recorded, 6)
    log = read_log(tmp_path / "a.log")
    assert np.min([step.u for step in log.steps]) == 0.7
    assert by_python(log).same_bits == 6
    bare = tuple(event for event in log.events if not isinstance(event, Limits))
    assert not by_python(replace(log, events=bare)).agrees


# ---------------------------------------------------------------- compared


@pytest.fixture
def short(troubled: FlightLog) -> FlightLog:
    return replace(troubled, events=troubled.events[:5])


def changed(log: FlightLog, **parts: Any) -> FlightLog:
    """The log with another last step."""
    *events, last = log.events
    return replace(log, events=(*events, replace(last, **parts)))


def test_what_differs_is_found(short: FlightLog) -> None:
    last = short.steps[-1]
    for size, tolerance, differs in ((1e-6, None, 1), (1e-6, 2e-6, 0), (1e-6, 5e-7, 1)):
        log = changed(short, u=last.u + [0, size, 0])
        found = compare(log, play(log, PythonPlayer(small.controller())), tolerance)
        assert len(found.differing) == differs
        assert found.largest == pytest.approx(size, rel=1e-6)
        assert found.same_bits == len(log.steps) - 1
    log = changed(short, u=np.full(3, np.nan))
    assert by_python(log).largest == np.inf
    found = by_python(changed(short, status=4, qp=3, source=1))
    assert found.statuses == (
        (3, "failed, QP infeasible, input from shifted plan", "solved, input from solution"),
    )
    assert not found.agrees and not found.differing


def test_another_build_may_differ_by_rounding(short: FlightLog) -> None:
    log = replace(short, header=replace(short.header, build="elsewhere"))
    found = by_python(changed(log, u=log.steps[-1].u + 0.9e-8))
    assert found.tolerance == 1e-8 and not found.same_build and found.agrees
    assert not by_python(changed(log, u=log.steps[-1].u + 1.1e-8)).agrees


# ---------------------------------------------------------------- what cannot be recorded


def test_wrong_use_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"record\(every=0\): must be 1 step or more"):
        record(small.controller(), tmp_path / "a.log", every=0)
    other = FeedForward.__new__(FeedForward)
    with pytest.raises(InputError, match="FeedForward has no transcribed problem"):
        record(other, tmp_path / "a.log")
