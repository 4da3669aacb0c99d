"""The state machine of supervision in C, alone, against the one in Python."""

from __future__ import annotations

import ctypes
import subprocess
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from softmpc.codegen.estimator_pilot import LOG, _first, _silent, _sizes
from softmpc.estimation.sensors import TICK
from softmpc.rig.supervision import Condition, State, Supervision, Supervisor
from tests.c_estimator import C_SOURCES, COMPILER, STRICT

pytestmark = pytest.mark.skipif(COMPILER is None, reason="needs gcc or clang")


class CCondition(ctypes.Structure):
    _fields_ = [(name, ctypes.c_int) for name in ("state", "cause", "detail")]


class CTransition(ctypes.Structure):
    _fields_ = [
        (name, ctypes.c_int) for name in ("tick", "before", "after", "cause", "detail", "too_long")
    ]


def library(folder: Path, settings: Supervision) -> ctypes.CDLL:
    """The state machine with these settings."""
    mpc = SimpleNamespace(ocp=SimpleNamespace(step=0.025))
    pilot: Any = SimpleNamespace(supervisor=Supervisor(settings), mpc=mpc, delay=5)
    (folder / "supervision_sizes.h").write_text(_sizes(pilot))
    source, target = C_SOURCES / "supervision.c", folder / "s.so"
    command = [str(COMPILER), *STRICT, "-shared", "-fPIC", f"-I{folder}", str(source)]
    subprocess.run([*command, "-o", str(target)], check=True)
    found = ctypes.CDLL(str(target))
    found.smpc_supervisor_change.restype = ctypes.POINTER(CTransition)
    return found


@pytest.mark.parametrize(
    "settings",
    [Supervision(), Supervision(resume=False, stop_after=0.3), Supervision(recover_after=0.07)],
)
def test_the_same_states_for_any_conditions(settings: Supervision, tmp_path: Path) -> None:
    """Tick by tick over random conditions, at steps of any length; the same log."""
    c, random = library(tmp_path, settings), np.random.default_rng(3)
    python, memory, tick = Supervisor(settings), ctypes.create_string_buffer(4096), 0
    c.smpc_supervisor_reset(memory, 0)
    for k in range(4000):
        likely = 0.5 if k // 50 % 3 else 0.02
        wrong = [s for s in (1, 2, 1) if random.random() < likely]
        given = (CCondition * 4)(*(CCondition(s, 7 - i, i) for i, s in enumerate(wrong)))
        state = c.smpc_supervisor_update(memory, tick, given, len(wrong))
        conditions = [Condition(State(s), f"cause {7 - i}") for i, s in enumerate(wrong)]
        assert state == python.update(tick, conditions)
        tick += int(random.integers(1, 40))
        if k % 1000 == 999:
            check_logs(python, c, memory)
            python.reset(tick)
            c.smpc_supervisor_reset(memory, tick)


def check_logs(python: Supervisor, c: ctypes.CDLL, memory: Any) -> None:
    """The last changes of state: when, from where to where, why; what was before is forgotten."""
    count = len(python.log)
    assert count >= 2 and c.smpc_supervisor_changes(memory) == count
    for i, one in enumerate(python.log):
        found = c.smpc_supervisor_change(memory, i)
        assert bool(found) == (i >= count - LOG)
        if not found:
            continue
        change = found.contents
        assert change.tick * TICK == one.time
        assert (change.before, change.after) == (one.before, one.after)
        assert bool(change.too_long) == one.cause.startswith("fall-back for")
        assert one.cause.endswith(f"cause {change.cause}" if change.cause else "recovered")
    assert not c.smpc_supervisor_change(memory, count)


def test_times_become_ticks_by_the_same_comparisons() -> None:
    """Also where rounding decides: 60 ticks less 10 are not above 0.05 s in Python."""
    usual, limit = 10 * TICK, 0.05
    assert 60 * TICK - usual <= limit < 61 * TICK - usual and _silent(usual, limit) == 61
    for wanted in (0.001, 0.07, 0.2, 0.3, 1.0, 3599.9):
        found = _first(lambda t, wanted=wanted: t * TICK >= wanted)
        assert found * TICK >= wanted > (found - 1) * TICK
