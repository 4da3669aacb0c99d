"""Sweeps: the same results everywhere, killed workers, interrupts, files of results, options."""

from __future__ import annotations

import json
import multiprocessing
import os
import pickle
import re
import runpy
import signal
import socket
import subprocess
import sys
import time
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor
from pathlib import Path

import click
import numpy as np
import pytest
import sweep_work
from click.testing import CliRunner
from pages import blocks
from sweep_work import Logged, Tips

from softmpc import InputError, Scene, build, chen2022, find_equilibrium
from softmpc.cli.sweep_options import executor_for, sweep_options
from softmpc.errors import SweepError
from softmpc.sweep_chunks import _unpacked, packed
from softmpc.sweeps import sweep, usable_cores

ROOT = Path(__file__).resolve().parents[1]
SCENE = Scene(chen2022())
PRESSURES = [[1e5 * i, 0, 0, 0, 5e4 * i, 0] for i in range(10)]


@pytest.fixture
def log(tmp_path: Path) -> str:
    path = tmp_path / "log"
    path.touch()
    return str(path)


def start(code: str, folder: Path, *arguments: str) -> subprocess.Popen[str]:
    """A script in a process group of its own, as in a terminal."""
    script = folder / "script.py"
    script.write_text(code)
    environment = os.environ | {"PYTHONPATH": f"{ROOT / 'tests'}{os.pathsep}{ROOT}"}
    return subprocess.Popen(
        [sys.executable, "-W", "error", str(script), *arguments], env=environment, text=True,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True, cwd=folder,
    )  # fmt: skip


def wait_until(what: str, condition, seconds: float = 20.0) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, f"waited in vain: {what}"
        time.sleep(0.02)


def alive(process: int) -> bool:
    """Whether it runs; one that has ended and is not fetched yet does not."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


# ---------------------------------------------------------------- the same results


@pytest.fixture(scope="module")
def in_this_process() -> list:
    return sweep(Tips(SCENE), PRESSURES, executor=1, chunk=4)


def test_results_are_those_of_the_work(in_this_process: list) -> None:
    model = build(SCENE)
    expected = [find_equilibrium(model, pressures).tips for pressures in PRESSURES]
    assert np.allclose(in_this_process, expected, rtol=0, atol=1e-8)


@pytest.mark.sampled
@pytest.mark.parametrize("workers", [2, 3, None])
def test_same_results_in_processes(workers: int | None, in_this_process: list) -> None:
    assert sweep(Tips(SCENE), PRESSURES, executor=workers, chunk=4) == in_this_process


def test_same_results_on_other_executors(in_this_process: list) -> None:
    spawn = multiprocessing.get_context("spawn")
    pools: list[Executor] = [ThreadPoolExecutor(3), ProcessPoolExecutor(1, spawn)]
    for pool in pools:
        with pool:
            assert sweep(Tips(SCENE), PRESSURES, executor=pool, chunk=4) == in_this_process


def test_threads_do_not_share_the_work() -> None:
    """What it computes for itself is made without a lock; in a thread it serves all chunks."""
    work = packed(Tips(SCENE), "work")
    mine = _unpacked(work)
    assert _unpacked(work) is mine
    with ThreadPoolExecutor(1) as pool:
        assert pool.submit(_unpacked, work).result() is not mine


@pytest.mark.slow
def test_dask(in_this_process: list, tmp_path: Path) -> None:
    """Same results, what a script defines, a worker killed once, and one killed every time."""
    pytest.importorskip("distributed")
    logs = [tmp_path / "once", tmp_path / "always"]
    for path in logs:
        path.touch()
    command = [sys.executable, str(ROOT / "tests" / "sweep_on_dask.py"), *map(str, logs)]
    environment = os.environ | {"PYTHONPATH": f"{ROOT / 'tests'}{os.pathsep}{ROOT}"}
    done = subprocess.run(
        command, input=json.dumps(PRESSURES), env=environment, capture_output=True, text=True,
        timeout=120, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["tips"] == in_this_process
    assert found["script"] == [1, 2, 3, 4, 5]
    assert found["killed"] == [case**2 for case in range(12)]
    assert Logged(str(logs[0])).begun().count(5) == 2
    blamed = r"cases \d to \d, the first of them \d \(or cases that waited .*\): KilledWorker"
    assert re.match(blamed, found["error"])
    assert Logged(str(logs[1])).begun().count(5) >= 3  # it was the one that killed


def test_results_are_in_the_order_of_the_cases() -> None:
    seen: list[tuple[float, float]] = []
    found = sweep(
        sweep_work.slow_first, range(9), executor=2, chunk=2,
        progress=lambda done, total: seen.append((done, total)),
    )  # fmt: skip
    assert found == list(range(9))
    assert seen[0] == (0, 9) and seen[-1] == (9, 9) and len(seen) == 6
    assert seen == sorted(seen)


@pytest.mark.parametrize("executor", [1, 2])
def test_results_are_told_as_they_arrive(executor: int, tmp_path: Path) -> None:
    """Also those of an earlier sweep; an interrupt in between loses none."""
    arrived: dict[int, int] = {}

    def interrupt(done: float, total: float) -> None:
        if done == 4:
            raise KeyboardInterrupt

    how = {"executor": executor, "chunk": 2, "keep": tmp_path / "kept"}
    with pytest.raises(KeyboardInterrupt):
        sweep(
            sweep_work.slow_first, range(9), **how, progress=interrupt,
            arrived=arrived.__setitem__,
        )  # fmt: skip
    assert len(arrived) == 4 and all(case == result for case, result in arrived.items())
    again: dict[int, int] = {}
    sweep(sweep_work.slow_first, range(9), **how, arrived=again.__setitem__)
    assert list(again)[:4] == sorted(arrived) and again == {i: i for i in range(9)}


def test_results_are_plain() -> None:
    expected = [{"array": [0.0, 1 / 3], "number": 2.0, "pair": [2, None]}]
    for workers in (1, 2):
        assert sweep(sweep_work.plain_types, [2], executor=workers) == expected


@pytest.mark.parametrize("workers", [1, None])
def test_no_cases(workers: int | None, tmp_path: Path) -> None:
    assert sweep(sweep_work.inverse, [], executor=workers, keep=tmp_path / "kept") == []


def test_chunks_depend_on_the_cases_alone(tmp_path: Path) -> None:
    for count, size, workers in ((5, 1, 1), (5, 1, 3), (128, 2, 1), (128, 2, 2), (2100, 32, 1)):
        path = tmp_path / f"{count}-{workers}"
        sweep(abs, range(count), executor=workers, keep=path)
        assert json.loads(path.read_text().splitlines()[0])["chunk"] == size


# ---------------------------------------------------------------- workers


def test_workers_have_one_thread_each(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        monkeypatch.delenv(name, raising=False)  # where nobody says how many
    assert sweep(sweep_work.threads, range(2), executor=1 + 1) == ["11", "11"]
    assert "OMP_NUM_THREADS" not in os.environ


def test_sweeps_in_workers_start_no_processes() -> None:
    assert sweep(sweep_work.sweep_inside, range(2), executor=2) == [True, True]


def test_scenes_travel_without_their_models() -> None:
    work = Tips(SCENE)
    assert pickle.loads(pickle.dumps(SCENE)) == SCENE
    bare = packed(work, "work")
    assert work.model.strains > 0
    assert packed(work, "work") == bare
    assert len(bare) < 10_000


def test_usable_cores() -> None:
    assert usable_cores() in range(1, (os.cpu_count() or 1) + 1)


def test_a_killed_worker_loses_nothing(log: str) -> None:
    work = Logged(log, die_at=9, seconds=0.02)
    assert sweep(work, range(16), executor=2, chunk=2) == [case**2 for case in range(16)]
    begun = work.begun()
    assert begun.count(9) == 2
    assert 16 < len(begun) <= 16 + 3 * 2  # three chunks were sent and not done
    assert len(work.workers()) > 1


def test_a_case_that_always_kills_its_worker_is_named(log: str, tmp_path: Path) -> None:
    work, keep = Logged(log, die_at=5, always=True), tmp_path / "kept"
    with pytest.raises(SweepError, match=r"case 5 \(5\): its worker was killed 3 times"):
        sweep(work, range(8), executor=2, chunk=4, keep=keep)
    assert work.begun().count(5) == 3
    # What did not fail was kept, or was on its way; nothing of the chunk of case 5 was.
    assert '"chunk": 1' not in keep.read_text()


def test_a_given_executor_that_breaks(log: str) -> None:
    with (
        ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool,
        pytest.raises(SweepError, match="executor is broken"),
    ):
        sweep(Logged(log, die_at=2), range(4), executor=pool)


def test_script_without_guard(tmp_path: Path) -> None:
    code = "from softmpc.sweeps import sweep\nprint(sweep(abs, [1, 2], executor=2))\n"
    process = start(code, tmp_path)
    out, error = process.communicate(timeout=60)
    assert out == ""
    assert 'needs `if __name__ == "__main__":`' in error.splitlines()[-1], error
    assert "resource_tracker" not in error


# ---------------------------------------------------------------- errors


@pytest.mark.parametrize("workers", [1, 2])
def test_error_names_the_case(workers: int) -> None:
    with pytest.raises(SweepError, match=r"^case 3 \(0\): ZeroDivisionError: ") as caught:
        sweep(sweep_work.inverse, [3, 2, 1, 0, 1], executor=workers, chunk=2)
    assert "return 1 / case" in caught.value.__notes__[0]
    with pytest.raises(InputError, match=r"^case 1 \(-1\): must not be negative\b"):
        sweep(sweep_work.inverse, [1, -1], executor=workers)
    with pytest.raises(SweepError, match="the result of a case has a object: allowed are"):
        sweep(sweep_work.no_result, [1], executor=workers)


def test_work_that_cannot_be_sent() -> None:
    with pytest.raises(InputError, match=r"work cannot be sent .* executor=1"):
        sweep(lambda case: case, [1], executor=2)
    assert sweep(lambda case: case, [1], executor=1) == [1]
    with pytest.raises(InputError, match=r"case 0 <function .* cannot be sent"):
        sweep(abs, [lambda: 1], executor=2)
    with pytest.raises(InputError, match=r"case 0 .* a worker cannot load this or the work .*Zero"):
        sweep(abs, [sweep_work.NotLoaded()], executor=2)


@pytest.mark.parametrize("executor", [0, -1, True, 1.5, "tcp://host:8786"])
def test_wrong_executor(executor: object) -> None:
    with pytest.raises(InputError, match="must be a number of processes"):
        sweep(abs, [1], executor=executor)  # type: ignore[arg-type]


@pytest.mark.parametrize("chunk", [0, True, 2.0])
def test_wrong_chunk(chunk: object) -> None:
    with pytest.raises(InputError, match="must be a whole number of cases"):
        sweep(abs, [1], executor=1, chunk=chunk)  # type: ignore[arg-type]


# ---------------------------------------------------------------- interrupts

SLOW = """
import sys
from sweep_work import Logged
from softmpc.sweeps import sweep

if __name__ == "__main__":
    log, keep = sys.argv[1:]
    sweep(Logged(log, seconds=0.05), range(40), executor=2, chunk=2, keep=keep)
"""


def test_ctrl_c_keeps_what_is_done(log: str, tmp_path: Path) -> None:
    keep, work = tmp_path / "kept.jsonl", Logged(log, seconds=0.05)
    process = start(SLOW, tmp_path, log, str(keep))
    wait_until("chunks", lambda: keep.exists() and keep.read_text().count("\n") > 3)
    os.killpg(process.pid, signal.SIGINT)  # a terminal tells the workers too
    asked = time.monotonic()
    _, error = process.communicate(timeout=10)
    assert time.monotonic() - asked < 5.0
    assert error.splitlines()[-1] == "KeyboardInterrupt"
    assert error.count("Traceback") == 1  # that of the script, none of a worker
    wait_until("workers to end", lambda: not any(map(alive, work.workers())))
    done = keep.read_text().count('"results"')
    before = len(work.begun())
    assert 3 <= done < 20
    assert sweep(work, range(40), executor=1, chunk=2, keep=keep) == [c**2 for c in range(40)]
    assert len(work.begun()) - before == 40 - 2 * done


def test_workers_end_with_their_parent(log: str, tmp_path: Path) -> None:
    process = start(SLOW, tmp_path, log, str(tmp_path / "kept"))
    wait_until("cases", lambda: len(Logged(log).begun()) > 3)
    process.kill()
    process.communicate(timeout=10)
    wait_until("workers to end", lambda: not any(map(alive, Logged(log).workers())))


def test_ctrl_c_inside_casadi(tmp_path: Path) -> None:
    keep = tmp_path / "kept"
    with pytest.raises(KeyboardInterrupt):
        sweep(sweep_work.interrupted_in_casadi, range(6), executor=1, keep=keep)
    assert keep.read_text().count('"results"') == 3


# ---------------------------------------------------------------- the file


def test_file_goes_on_after_half_a_line(log: str, tmp_path: Path) -> None:
    keep, work = tmp_path / "new" / "kept.jsonl", Logged(log)
    first = sweep(work, range(6), executor=1, chunk=2, keep=keep)
    whole = keep.read_bytes()
    for cut in (3, 20):  # from the last line
        keep.write_bytes(whole[:-cut])
        before = len(work.begun())
        seen: list[float] = []
        again = sweep(
            work, range(6), executor=1, chunk=2, keep=keep,
            progress=lambda done, total, seen=seen: seen.append(done),
        )  # fmt: skip
        assert again == first
        assert work.begun()[before:] == [4, 5] and seen == [4, 6]
        assert keep.read_bytes() == whole


def test_file_of_another_sweep_is_refused(tmp_path: Path) -> None:
    keep, work = tmp_path / "kept", Tips(SCENE)
    sweep(work, PRESSURES[:2], executor=1, keep=keep)
    before = keep.read_bytes()
    heavier = Tips(Scene(chen2022(), segments=2))
    for other, cases, chunk, what in (
        (work, PRESSURES[1:3], None, "differs in: cases"),
        (work, PRESSURES[:3], None, "differs in: number of cases, cases"),
        (work, PRESSURES[:2], 2, "differs in: chunk"),
        (heavier, PRESSURES[:2], None, "differs in: settings"),
        (sweep_work.inverse, PRESSURES[:2], None, "differs in: work, source of work, settings"),
    ):
        with pytest.raises(InputError, match=what):
            sweep(other, cases, executor=1, keep=keep, chunk=chunk)
    assert keep.read_bytes() == before


def test_file_of_work_that_was_edited_is_refused(tmp_path: Path) -> None:
    code, keep = "def work(case):\n    return case + {}\n", tmp_path / "kept"
    for added, refused in ((1, False), (1, False), (20, True)):
        (tmp_path / "edited_work.py").write_text(code.format(added))
        work = runpy.run_path(str(tmp_path / "edited_work.py"), run_name="edited_work")["work"]
        if refused:
            with pytest.raises(InputError, match="differs in: source of work;"):
                sweep(work, [1], executor=1, keep=keep)
        else:
            assert sweep(work, [1], executor=1, keep=keep) == [1 + added]


def test_file_of_something_else_is_refused(tmp_path: Path) -> None:
    keep = tmp_path / "kept"
    with pytest.raises(InputError, match="is a folder; keep must name a file"):
        sweep(abs, [1], executor=1, keep=tmp_path)
    for text in ("time,tip\n1,2\n", "half a line", "[1]\n", "\n"):
        keep.write_text(text)
        with pytest.raises(InputError, match="is not the file of a sweep"):
            sweep(abs, [1], executor=1, keep=keep)
        assert keep.read_text() == text
    keep.write_text("")
    sweep(abs, [-1, 2], executor=1, keep=keep)
    for line in ("nonsense", '{"chunk": 2, "results": [1]}', '{"chunk": 0, "results": []}'):
        keep.write_text(keep.read_text().splitlines()[0] + f"\n{line}\n")
        with pytest.raises(InputError, match="line 2 is damaged"):
            sweep(abs, [-1, 2], executor=1, keep=keep)


def test_file_needs_work_that_can_be_told(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="work must be at the top level"):
        sweep(lambda case: case, [1], executor=1, keep=tmp_path / "kept")
    with pytest.raises(InputError, match="no telling whether <object"):
        sweep(abs, [object()], executor=1, keep=tmp_path / "kept")
    assert not (tmp_path / "kept").exists()


def test_files_keep_every_digit(tmp_path: Path) -> None:
    cases = [3.0, 7.0, 1e-300, float("inf")]
    fresh = sweep(sweep_work.inverse, cases, executor=1, keep=tmp_path / "kept")
    assert sweep(sweep_work.inverse, cases, executor=1, keep=tmp_path / "kept") == fresh
    assert fresh == [1 / case for case in cases]


# ---------------------------------------------------------------- the page


@pytest.mark.slow
def test_example_prints_what_the_page_says(tmp_path: Path) -> None:
    process = start((ROOT / "examples" / "monte_carlo.py").read_text(), tmp_path)
    out, error = process.communicate(timeout=120)
    assert error == ""
    page = (ROOT / "docs" / "sweeps.md").read_text(encoding="utf-8")
    assert next(block.body for block in blocks(page) if block.kind == "text") == out
    assert (tmp_path / "monte_carlo.jsonl").read_text().count('"results"') == 24


# ---------------------------------------------------------------- options of commands


@click.command
@sweep_options
def squares(workers: int | None, dask: str | None) -> None:
    """A command with a sweep."""
    with executor_for(workers, dask) as executor:
        click.echo(f"{executor} {sweep(abs, [-1, 2], executor=executor)}")


def test_options() -> None:
    run = CliRunner().invoke
    assert run(squares, ["--workers", "1"]).output == "1 [1, 2]\n"
    assert run(squares, []).output == "None [1, 2]\n"
    assert "0 is not in the range x>=1" in run(squares, ["--workers", "0"]).output
    wrong = run(squares, ["--workers", "2", "--dask", "tcp://host:8786"]).exception
    assert isinstance(wrong, InputError) and "--workers or --dask" in str(wrong)


def test_dask_is_not_installed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with (
        pytest.raises(InputError, match=r"pip install 'softmpc\[dask\]'"),
        executor_for(None, "tcp://127.0.0.1:8786"),
    ):
        pass


@pytest.mark.sampled
@pytest.mark.parametrize("answers", [False, True])
def test_no_scheduler_answers(answers: bool) -> None:
    """Nobody is there, or somebody who is no scheduler."""
    pytest.importorskip("distributed")
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        if answers:
            other.listen()
        code = (
            "from softmpc.cli.sweep_options import executor_for\n"
            f"with executor_for(None, 'tcp://127.0.0.1:{other.getsockname()[1]}'): pass"
        )
        started = time.monotonic()
        command = [sys.executable, "-c", code]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
        assert time.monotonic() - started < 10.0
    assert "no scheduler answers" in done.stderr.splitlines()[-1]


def test_a_pool_is_loaded_when_used() -> None:
    code = (
        "import sys, softmpc.sweeps, softmpc.cli.sweep_options\n"
        "print([m for m in ('concurrent.futures.process', 'distributed') if m in sys.modules])"
    )
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"
