"""The state machine of supervision, alone."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from softmpc import InputError
from softmpc.rig.supervision import Condition, State, Supervision, Supervisor

BLIND = Condition(State.FALL_BACK, "no tips for 0.40 s")
QUIET = Condition(State.DEGRADED, "no pressures for 0.10 s")
STEP = 25  # ticks


def run(supervisor: Supervisor, *phases: tuple[float, list[Condition]]) -> list[State]:
    """States at all steps of phases: how long (s), and what is wrong."""
    tick, states = 0, []
    for seconds, conditions in phases:
        for _ in range(round(seconds * 1000 / STEP)):
            states.append(supervisor.update(tick, conditions))
            tick += STEP
    return states


def test_nothing_wrong() -> None:
    supervisor = Supervisor()
    assert set(run(supervisor, (2.0, []))) == {State.NORMAL} and not supervisor.log


def test_worse_at_once_and_better_after_a_while() -> None:
    supervisor = Supervisor(Supervision(recover_after=0.2))
    states = run(supervisor, (0.1, []), (0.1, [QUIET]), (0.1, [QUIET, BLIND]), (0.4, []))
    assert states[:12] == [State.NORMAL] * 4 + [State.DEGRADED] * 4 + [State.FALL_BACK] * 4
    assert states[12:20] == [State.FALL_BACK] * 8 and states[20] == State.NORMAL
    assert [str(one) for one in supervisor.log] == [
        "  0.100 s  normal → degraded: no pressures for 0.10 s",
        "  0.200 s  degraded → fall back: no tips for 0.40 s",
        "  0.500 s  fall back → normal: recovered",
    ]


def test_too_long_in_fall_back_is_a_safe_stop_and_it_resumes() -> None:
    supervisor = Supervisor(Supervision(stop_after=1.0, recover_after=0.2))
    states = run(supervisor, (2.0, [BLIND]), (0.5, []))
    assert states.index(State.SAFE_STOP) == 40 and states[-1] == State.NORMAL
    assert set(states[40:80]) == {State.SAFE_STOP}  # as long as it is blind
    assert "fall-back for 1 s" in supervisor.log[1].cause and BLIND.cause in supervisor.log[1].cause


def test_without_resume_only_reset_leaves_a_safe_stop() -> None:
    supervisor = Supervisor(Supervision(resume=False))
    assert run(supervisor, (2.0, [BLIND]), (5.0, []))[-1] == State.SAFE_STOP
    supervisor.reset()
    assert supervisor.update(0, []) == State.NORMAL


def test_flickering_conditions_do_not_let_it_up() -> None:
    supervisor = Supervisor(Supervision(recover_after=0.2, stop_after=100.0))
    flicker = [(0.1, [BLIND]), (0.1, [])] * 20
    assert set(run(supervisor, *flicker)[1:]) == {State.FALL_BACK}


def test_it_recovers_to_what_conditions_allow() -> None:
    supervisor = Supervisor()
    assert run(supervisor, (0.5, [BLIND]), (0.5, [QUIET]))[-1] == State.DEGRADED
    assert supervisor.log[-1].cause == "only no pressures for 0.10 s"


def test_any_sequence_is_legal() -> None:
    """Random conditions: a state is never better than allowed, each change is logged once."""
    random, supervisor = np.random.default_rng(3), Supervisor()
    tick, before = 0, State.NORMAL
    for _ in range(5000):
        conditions = [one for one in (BLIND, QUIET) if random.random() < 0.2]
        changes = len(supervisor.log)
        state = supervisor.update(tick, conditions)
        assert state >= max((one.state for one in conditions), default=State.NORMAL)
        assert (len(supervisor.log) - changes == 1) == (state != before)
        tick, before = tick + STEP, state
    for one, other in pairwise(supervisor.log):
        assert one.after == other.before and one.time < other.time and other.cause
    allowed = {(a, b) for a in State for b in State if a != b} - {
        (State.NORMAL, State.SAFE_STOP), (State.DEGRADED, State.SAFE_STOP)
    }  # fmt: skip
    assert {(one.before, one.after) for one in supervisor.log} <= allowed


@pytest.mark.parametrize("wrong", [{"blind_after": 0.0}, {"ramp": -1.0}, {"stop_after": np.nan}])
def test_wrong_settings(wrong: dict[str, float]) -> None:
    with pytest.raises(InputError, match=next(iter(wrong))):
        Supervision(**wrong)
