"""Replays of flight logs: the same bits, decisions of the clock, beginnings in the middle, the command."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import codegen_small as small
import numpy as np
import pytest
from click.testing import CliRunner

from softmpc.cli.main import main
from softmpc.codegen.compiled_controller import CompiledController
from softmpc.codegen.compiled_log import CompiledRecorder, header_of, restore
from softmpc.codegen.flight_format import QP, STATUSES, Limits, Reset, Settings, Snapshot, StepRecord, put_snapshot
from softmpc.codegen.flight_log import FlightLog, read_log
from softmpc.codegen.flight_recorder import record
from softmpc.codegen.flight_writer import FlightWriter
from softmpc.codegen.replay import compare, play
from softmpc.codegen.replay_c import CPlayer, through_qemu
from softmpc.codegen.replay_python import PythonPlayer
from softmpc.codegen.replay_setup import check_problem, scene_of
from softmpc.compiler import compiler
from softmpc.control.baselines import FeedForward
from softmpc.control.costs import StrainRate
from softmpc.control.daqp import QpSolution
from softmpc.control.memory import memory_of, put_back
from softmpc.control.mpc import Mpc
from softmpc.control.tracking import read_track_file, set_up
from softmpc.control.transcription import Transcription
from softmpc.errors import BuildError, InputError
from softmpc.model.model import build
from softmpc.simulation.runge_kutta import RadauIIA

LATE, TIME_LIMIT = STATUSES.index("budget overrun"), QP.index("time limit")
needs_compiler = pytest.mark.skipif(compiler() is None, reason="no C compiler")


class OutOfTime:
    """A solver of quadratic programs that has no time left."""

    max_iterations = 1000

    def solve(self, program: Any, time_limit: Any = None, multipliers: Any = None) -> QpSolution:
        nothing = np.full(len(program.f), np.nan)
        return QpSolution(False, "time limit", nothing, np.zeros(0), 0, 0.0)


def fly(controller: Any, steps: int, before: Callable[[int], Any] = lambda k: None) -> np.ndarray:
    """Inputs of a loop whose target jumps; `before` each step a test may interfere, and gives what is
    added to the state."""
    at, random = small.start(), np.random.default_rng(3)
    plant, x, u = RadauIIA(small.transcription().model, tolerance=1e-5), at.x, at.u
    inputs = []
    for k in range(steps):
        if k % 10 == 0:
            target = small.home() + random.uniform(-1, 1, 3) * [0.1, 0.1, 0.02]
            references = np.tile(target, (small.INTERVALS, 1))
        measured = x if (off := before(k)) is None else x + off
        u = controller.step(measured, u, references).u
        inputs.append(u)
        x = plant.advance(x, u, small.STEP)[-1]
    return np.array(inputs)


@pytest.fixture(scope="module")
def troubled(tmp_path_factory: pytest.TempPathFactory) -> FlightLog:
    """A log of Python's controller with everything in it that can go wrong."""
    path = tmp_path_factory.mktemp("python") / "flight.log"
    mpc = small.controller()
    usual = mpc.solver.qp

    with record(mpc, path, every=10) as recorded:

        def before(k: int) -> Any:
            recorded.budget = 1e-9 if k in (5, 6, 33) else None
            mpc.solver.qp = OutOfTime() if k in (13, 14) else usual
            usual.max_iterations = 1 if k in (23, 24) else 1000
            if k == 28:
                recorded.reset()
            return np.nan if k in (17, 18) else None

        fly(recorded, 40, before)
    usual.max_iterations = 1000
    return read_log(path)


def python(log: FlightLog) -> Any:
    return compare(log, play(log, PythonPlayer(small.controller())))


# ---------------------------------------------------------------- Python


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
    found = python(troubled)
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
    found = python(replace(troubled, events=tuple(events)))
    assert not found.agrees


@pytest.mark.parametrize("number", [10, 20, 30])
def test_a_replay_begins_at_a_snapshot(number: int, troubled: FlightLog) -> None:
    """As in the log of a ring: two steps before it are left out, all after it are the same bits."""
    events = troubled.events
    (at,) = [k for k, e in enumerate(events) if isinstance(e, Snapshot) and e.number == number]
    found = python(replace(troubled, events=events[at - 2 :]))
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
    found = python(replace(troubled, events=(other, *troubled.events[at + 1 :])))
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
    found = python(replace(troubled, events=tuple(events)))
    assert (found.steps, found.left_out, found.same_bits) == (32, 7, 32)


def test_no_beginning_is_an_error(troubled: FlightLog) -> None:
    events = tuple(event for event in troubled.events if isinstance(event, StepRecord))
    with pytest.raises(InputError, match="has 40 steps and none of them follows a reset or a snap"):
        python(replace(troubled, events=events))


def test_memory_of_another_controller_is_refused() -> None:
    mpc = small.controller()
    fly(mpc, 1)
    memory = memory_of(mpc)
    with pytest.raises(InputError, match="plan has 3 numbers; this one needs"):
        put_back(mpc, replace(memory, plan=np.zeros(3)))


def test_limits_of_a_user_hold_in_the_replay(tmp_path: Path) -> None:
    """Against limits that Python's controller has in its own guard."""
    low, rise = np.full(3, 0.7), np.full(3, 0.01)
    mpc = small.controller()
    with FlightWriter(tmp_path / "a.log", record_header(tmp_path)) as writer:
        writer.reset()
        writer.limits(Limits(low=low, rise=rise))
        mpc.guard.low, mpc.guard.rise = low, rise
        fly(Written(mpc, writer), 6)
    log = read_log(tmp_path / "a.log")
    assert np.min([step.u for step in log.steps]) == 0.7
    assert python(log).same_bits == 6
    bare = tuple(event for event in log.events if not isinstance(event, Limits))
    assert not python(replace(log, events=bare)).agrees


def record_header(folder: Path) -> Any:
    with record(small.controller(), folder / "header.log"):
        pass
    return read_log(folder / "header.log").header


class Written:
    """Writes its steps without a word about anything else."""

    def __init__(self, mpc: Any, writer: FlightWriter) -> None:
        self.mpc, self.writer = mpc, writer

    def step(self, x: Any, u_before: Any, given: Any) -> Any:
        step = self.mpc.step(x, u_before, given)
        source = ("solution", "shifted plan", "held input").index(step.source)
        self.writer.step(StepRecord(0, x, u_before, given, step.u, 0, 1, source))
        return step


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
    assert python(log).largest == np.inf
    found = python(changed(short, status=4, qp=3, source=1))
    assert found.statuses == (
        (3, "failed, QP infeasible, input from shifted plan", "solved, input from solution"),
    )
    assert not found.agrees and not found.differing


def test_another_build_may_differ_by_rounding(short: FlightLog) -> None:
    log = replace(short, header=replace(short.header, build="elsewhere"))
    found = python(changed(log, u=log.steps[-1].u + 0.9e-8))
    assert found.tolerance == 1e-8 and not found.same_build and found.agrees
    assert not python(changed(log, u=log.steps[-1].u + 1.1e-8)).agrees


# ---------------------------------------------------------------- C


@pytest.fixture(scope="module")
def by_c(tmp_path_factory: pytest.TempPathFactory) -> FlightLog:
    """A log of the controller in C, by its own recorder; its clock jumps now and then."""
    path, now = tmp_path_factory.mktemp("c") / "flight.log", Clock()
    t = small.transcription()
    controller = CompiledController(small.folder(), t, budget=1.0, clock=now)
    with record(controller, path, every=10) as recorded:

        def before(k: int) -> Any:
            now.jump = 2.0 if k in (5, 6, 33) else 0.0
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
    assert {"solved", "budget overrun", "input not finite"} == set(statuses)
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
    found = python(log)
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
    found = python(by_c)
    assert not found.same_build and found.agrees and found.largest < 1e-10
    until = [k for k, e in enumerate(troubled.events) if isinstance(e, StepRecord) and e.number == 13]
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
@small.needs("arm-none-eabi-gcc", "qemu-system-arm")
def test_the_board_gives_the_same_bits(by_c: FlightLog) -> None:
    """Up to the first step in which the clock decided, and from the reset on."""
    found = compare(by_c, through_qemu(by_c, small.folder()), 1e-10)
    assert found.agrees and found.steps == 5 + 6 and found.left_out == 29


# ---------------------------------------------------------------- the command

SCENE = """
title = "Short line"
[track]
path = "line"
start = [0.0, 0.0, 0.5]
end = [0.01, 0.0, 0.51]
lap_time = 0.6
laps = 0.5
smooth_start = 0.1
settle = 0.05
[track.controller]
horizon = 4
[track.plant]
tolerance = 1e-5
"""


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A folder with a scene and a log of it; what the path clears does not matter here."""
    folder = tmp_path_factory.mktemp("command")
    (folder / "scene.toml").write_text(SCENE, encoding="utf-8")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("softmpc.control.tracking.find_clearance", lambda *given: given[2](6, 6))
        _, scene, task = read_track_file(folder / "scene.toml")
        setup = set_up(scene, task)
        with record(setup.controller, folder / "flight.log", "scene.toml") as recorded:
            setup.run(recorded)
        yield folder


def softmpc(*words: object) -> Any:
    return CliRunner().invoke(main, ["replay", *map(str, words)])


def test_the_command(place: Path, tmp_path: Path) -> None:
    done = softmpc(place / "flight.log", "--json", "--out", tmp_path / "out")
    assert done.exit_code == 0, done.output
    data = json.loads(done.stdout)
    assert data["agrees"] and data["steps"] == 14 and data["title"] == "Short line"
    (replay,) = data["replays"]
    assert (replay["by"], replay["same_bits"], replay["largest_difference"]) == ("python", 14, 0.0)
    made = {path.name for path in (tmp_path / "out").iterdir()}
    assert made == {"replay.json", "replay.png", "replay.csv"}
    lines = (tmp_path / "out" / "replay.csv").read_text(encoding="utf-8").splitlines()
    assert lines[0] == "step,status,python difference,python status"
    assert lines[1] == "0,solved,0.0,solved" and len(lines) == 15


def test_the_command_finds_what_differs_and_what_is_damaged(place: Path) -> None:
    log = read_log(place / "flight.log")
    with FlightWriter(place / "other.log", log.header) as writer:
        writer.reset()
        for step in log.steps:
            odd = step.number == 7
            writer.step(replace(step, u=step.u + 1e-3 * odd, status=1 if odd else step.status))
    data = (place / "other.log").read_bytes()
    (place / "other.log").write_bytes(data[:-100])
    done = softmpc(place / "other.log")
    assert done.exit_code == 4
    lines = done.stdout.splitlines()
    assert lines[-1] == (
        "python, step 7: iteration cap, input from solution in the log, "
        "solved, input from solution now"
    )
    assert lines[-2].split() == ["python", "13", "0", "12", "0.001", "0", "step", "7", "1"]
    assert any(line.startswith("damage      at byte ") for line in lines)
    assert "error: python: not what" in done.stderr and "13 steps before it are read" in done.stderr
    assert softmpc(place / "other.log", "--tolerance", "0.01").exit_code == 4  # the status


def test_the_wrong_scene_is_refused(place: Path) -> None:
    log = read_log(place / "flight.log")
    assert scene_of(log) == place / "scene.toml"
    _, scene, task = read_track_file(place / "scene.toml")
    settings, model = task.controller, build(scene)
    for change, message in (
        ({}, ""),
        ({"horizon": 3}, "its controller has 4 intervals; that of scene.toml has 3: give the scene"),
        ({"costs": (*settings.costs[:-1], StrainRate(0.2))}, "is of another problem ("),
        ({"blocks": (1, 1, 2)}, "is of another problem ("),
        ({"torque_rate": 50.0}, "is of another problem ("),
    ):
        other = replace(settings, **change)
        t = Transcription(other.problem(model))
        mpc = Mpc(t, other.make_solver(t))
        if not message:
            check_problem(log, "scene.toml", mpc)
            continue
        with pytest.raises(InputError, match=re.escape(message)):
            check_problem(log, "scene.toml", mpc)


def test_a_log_without_its_scene_says_so(place: Path, tmp_path: Path) -> None:
    log = read_log(place / "flight.log")
    copied = tmp_path / "flight.log"
    copied.write_bytes((place / "flight.log").read_bytes())
    done = softmpc(copied)
    assert done.exit_code == 2 and "'scene.toml' is neither here nor beside the log" in done.stderr
    nameless = replace(log, header=replace(log.header, scene=""))
    with pytest.raises(InputError, match=r"names no scene file: give the one it was made with"):
        scene_of(nameless)


def test_an_unknown_controller_is_refused(place: Path) -> None:
    done = softmpc(place / "flight.log", "--with", "python,pyton")
    assert done.exit_code == 2 and "unknown replay: 'pyton'; did you mean 'python'?" in done.stderr


# ---------------------------------------------------------------- what cannot be recorded


def test_wrong_use_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"record\(every=0\): must be 1 step or more"):
        record(small.controller(), tmp_path / "a.log", every=0)
    other = FeedForward.__new__(FeedForward)
    with pytest.raises(InputError, match="FeedForward has no transcribed problem"):
        record(other, tmp_path / "a.log")
