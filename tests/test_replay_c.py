"""Replays of flight logs by the controller in C, and its own recorder."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import codegen_small as small
import numpy as np
import pytest
from flown import LATE, TIME_LIMIT, by_python, fly, fly_in_trouble

from softmpc.codegen.building import build_library
from softmpc.codegen.compiled_controller import CompiledController
from softmpc.codegen.compiled_log import CompiledRecorder, header_of, restore
from softmpc.codegen.flight_format import (
    STATUSES,
    Limits,
    Reset,
    Settings,
    Snapshot,
    StepRecord,
    put_snapshot,
)
from softmpc.codegen.flight_log import FlightLog, read_log
from softmpc.codegen.flight_recorder import record
from softmpc.codegen.replay import compare, play
from softmpc.codegen.replay_c import CPlayer, through_qemu
from softmpc.compiler import compiler
from softmpc.errors import BuildError, InputError

needs_compiler = pytest.mark.skipif(compiler() is None, reason="no C compiler")


@pytest.fixture(scope="module")
def troubled(tmp_path_factory: pytest.TempPathFactory) -> FlightLog:
    return fly_in_trouble(tmp_path_factory.mktemp("python") / "flight.log")


@pytest.fixture(scope="module")
def by_c(tmp_path_factory: pytest.TempPathFactory) -> FlightLog:
    """A log of the controller in C, by its own recorder; its clock jumps now and then."""
    path, now = tmp_path_factory.mktemp("c") / "flight.log", Clock()
    t = small.transcription()
    controller = CompiledController(small.folder(), t, budget=1.0, clock=now)
    with record(controller, path, every=10) as recorded:

        def before(k: int) -> Any:
            now.jump = 2.0 if k in (5, 6, 33) else 0.0
            recorded.qp.max_iterations = 1 if k in (21, 22, 30, 31) else 0
            recorded.budget = None if k in (36, 37) else 1.0
            if k == 22:
                recorded.set_limits(low=np.full(3, 0.1), rise=np.full(3, 0.05))
            if k == 34:
                recorded.reset()
            return np.nan if k in (17, 18) else None

        fly(recorded, 40, before)
    return read_log(path)


class Clock:
    now = jump = 0.0

    def __call__(self) -> float:
        self.now += self.jump
        return self.now


@needs_compiler
def test_c_gives_the_same_bits(by_c: FlightLog) -> None:
    assert by_c.header.writer == "C" and by_c.damage == ""
    assert {type(event) for event in by_c.events} == {StepRecord, Reset, Snapshot, Limits, Settings}
    statuses = [STATUSES[step.status] for step in by_c.steps]
    assert {"solved", "iteration cap", "budget overrun", "input not finite"} == set(statuses)
    timed = [bool(np.isfinite(step.prepare_seconds)) for step in by_c.steps]
    assert [k for k, clock in enumerate(timed) if not clock] == [36, 37]
    found = compare(by_c, play(by_c, CPlayer(small.folder(), small.transcription(), by_c)))
    assert found.same_build and found.agrees
    assert (found.steps, found.same_bits) == (40, 40)


@needs_compiler
@pytest.mark.parametrize("number", [10, 20, 30])
def test_c_begins_at_a_snapshot(number: int, by_c: FlightLog) -> None:
    (at,) = [k for k, e in enumerate(by_c.events) if isinstance(e, Snapshot) and e.number == number]
    log = replace(by_c, events=by_c.events[at - 1 :])
    found = compare(log, play(log, CPlayer(small.folder(), small.transcription(), log)))
    assert (found.left_out, found.same_bits) == (1, 40 - number)
    found = by_python(log)
    assert found.agrees and found.left_out == 1 and found.largest < 1e-10


@needs_compiler
@pytest.mark.parametrize("number", [10, 30])
def test_what_is_restored_in_c_is_what_it_remembers(number: int, by_c: FlightLog) -> None:
    """A snapshot taken right after it has been put back has the same bytes."""
    (given,) = [e for e in by_c.events if isinstance(e, Snapshot) and e.number == number]
    controller = CompiledController(small.folder(), small.transcription())
    assert restore(controller, given)
    file = Kept()
    recorder = CompiledRecorder(controller, file, 40, "")
    recorder._call("smpc_log_snapshot", controller._at)
    (record,) = file.records[2:]
    assert record == put_snapshot(by_c.header, replace(given, number=0))
    assert not restore(controller, replace(given, plan=given.plan[:-1]))


class Kept:
    """Stands in for a file."""

    def __init__(self) -> None:
        self.records: list[bytes] = []

    def put(self, data: bytes) -> None:
        self.records.append(data)


@needs_compiler
def test_python_and_c_replay_each_other(by_c: FlightLog, troubled: FlightLog) -> None:
    """To 1e-10 N·m; a program that was stopped is where they may part, see docs/replay.md."""
    found = by_python(by_c)
    assert not found.same_build and found.agrees and found.largest < 1e-10
    until = [
        k for k, e in enumerate(troubled.events) if isinstance(e, StepRecord) and e.number == 13
    ]
    log = replace(troubled, events=troubled.events[: until[0]])
    found = compare(log, play(log, CPlayer(small.folder(), small.transcription(), log)))
    assert found.agrees and found.steps == 13 and 0 < found.largest < 1e-10


@needs_compiler
def test_a_program_in_c_that_ran_out_of_time_does_so_again(tmp_path: Path) -> None:
    """The clock jumps while the quadratic program is solved; where it needs more iterations than
    DAQP does between two looks at the clock it stops."""
    clock = Clock()
    t = small.transcription()
    controller = CompiledController(small.folder(), t, budget=1.0, clock=clock)
    with record(controller, tmp_path / "a.log") as recorded:
        at = small.start()
        x, u = at.x, at.u
        target = np.tile(small.home() + [0.2, -0.2, 0.05], (small.INTERVALS, 1))
        for k in range(6):
            clock.jump = 0.0
            recorded.prepare(target * (1 if k % 2 else -1), u)
            clock.jump = 2.0 if k in (2, 3) else 0.0
            u = recorded.feedback(x).u
    log = read_log(tmp_path / "a.log")
    assert [step.status for step in log.steps][2:4] == [LATE, LATE]
    assert TIME_LIMIT in [step.qp for step in log.steps]
    found = compare(log, play(log, CPlayer(small.folder(), t, log)))
    assert found.agrees and found.same_bits == 6


@needs_compiler
def test_a_folder_without_a_recorder_is_refused(tmp_path: Path) -> None:
    class Bare:
        library, folder = object(), tmp_path

    with pytest.raises(BuildError, match="has no flight recorder"):
        header_of(Bare())  # type: ignore[arg-type]


@pytest.mark.slow
@pytest.mark.parametrize("cc", [pytest.param(cc, marks=small.needs(cc)) for cc in small.COMPILERS])
def test_the_program_of_the_page_under_sanitizers(cc: str, tmp_path: Path) -> None:
    """The log it gives has the bits of any other build."""
    (tmp_path / "page.c").write_text(source_of_the_page())
    flags = ("-O1", *small.SANITIZERS)
    made = small.program(small.folder(), [tmp_path / "page.c"], tmp_path / "objects", flags, cc=cc)
    (tmp_path / "ring.log").write_bytes(small.run([str(made)]))
    log = read_log(tmp_path / "ring.log")
    found = compare(log, play(log, CPlayer(small.folder(), small.transcription(), log)), 0.0)
    assert found.agrees and found.steps > 40


@pytest.mark.slow
@small.needs("arm-none-eabi-gcc", "qemu-system-arm")
def test_the_board_gives_the_same_bits(by_c: FlightLog) -> None:
    """Up to where the clock decided, and from the reset to where a user set something."""
    found = compare(by_c, through_qemu(by_c, small.folder()), 1e-10)
    assert found.agrees and found.steps == 5 + 2 and found.left_out == 33


def source_of_the_page() -> str:
    page = (Path(__file__).parents[1] / "docs" / "replay.md").read_text(encoding="utf-8")
    (source,) = re.findall(r"```c\n(.*?)```", page, re.DOTALL)
    return source


@needs_compiler
@pytest.mark.parametrize("size", [40000, 6000])
def test_the_program_of_the_page(size: int, tmp_path: Path) -> None:
    """What docs/replay.md says of a board: a log from a ring, replayed from its first snapshot."""
    (tmp_path / "page.c").write_text(source_of_the_page().replace("40000", str(size)))
    library = build_library(small.folder())
    command = [*compiler().command, "-std=c99", "-Wall", "-Wextra", "-Werror",
               f"-I{small.folder()}", str(tmp_path / "page.c"), str(library),
               f"-Wl,-rpath,{library.parent}", "-lm", "-o", str(tmp_path / "page")]  # fmt: skip
    small.run(command)
    printed = small.run([str(tmp_path / "page")])
    (tmp_path / "ring.log").write_bytes(printed)
    log = read_log(tmp_path / "ring.log")
    assert len(printed) < size + 300 and log.damage == ""
    assert log.steps[-1].number == 199 and log.steps[0].number > 0
    player = CPlayer(small.folder(), small.transcription(), log)
    if size == 6000:  # too small for a snapshot and what follows it
        with pytest.raises(InputError, match="nothing to replay by c"):
            compare(log, play(log, player))
        return
    found = compare(log, play(log, player))
    assert found.steps > 40 and found.same_bits == found.steps
    assert found.left_out == len(log.steps) - found.steps > 0
