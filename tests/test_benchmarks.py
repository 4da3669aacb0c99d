"""The command that runs all benchmarks, on small ones of our own; nothing here is timed."""

from __future__ import annotations

import ast
import json
import os
import re
import signal
import threading
import time
from dataclasses import replace
from pathlib import Path

import pytest

from softmpc.errors import InputError
from tests.benchmarks import __main__ as command
from tests.benchmarks import comparing, running
from tests.benchmarks.__main__ import FAILED, INTERRUPTED, Bench, conducted
from tests.benchmarks.common import ROOT
from tests.benchmarks.listing import FOLDER, HELPERS, benchmarks, has_numbers, purpose
from tests.benchmarks.running import measured
from tests.benchmarks.stored import DONE, Result, Run, last_stored, load, new_run, save, store

FAKES = {
    "good": "def numbers(quick): return {'step_ms_median': 2.0 if quick else 3, 'n_count': 4.0}",
    "threads": "import os\ndef numbers(quick): return {'n': int(os.environ['OMP_NUM_THREADS'])}",
    "without": "from tests.benchmarks.common import LeftOut\n"
    "def numbers(quick): raise LeftOut('peer is not installed: pip install peer')",
    "failing": "def numbers(quick): raise ValueError('no such arm')",
    "infinite": "def numbers(quick): return {'rms_mm': float('nan'), 'n_count': 1}",
    "leaving": "import sys\ndef numbers(quick): sys.exit('no compiler')",
    "endless": "import os, pathlib, time\ndef numbers(quick):\n"
    "    pathlib.Path(os.environ['TOLD']).write_text(str(os.getpid()))\n    time.sleep(600)",
}


@pytest.fixture
def fakes(tmp_path: Path) -> dict[str, str]:
    """Modules that the process of a benchmark finds; variables for it."""
    for name, text in FAKES.items():
        (tmp_path / f"fake_{name}.py").write_text(text, encoding="utf-8")
    return {"PYTHONPATH": str(tmp_path), "TOLD": str(tmp_path / "told.txt")}


# ---------------------------------------------------------------- what there is


def test_every_module_is_a_benchmark_or_a_helper() -> None:
    there = {path.stem for path in FOLDER.glob("[!_]*.py")}
    assert {name for name in there - HELPERS if not has_numbers(name)} == set()
    assert {name for name in there if has_numbers(name)} == set(benchmarks())
    assert there >= HELPERS and not set(benchmarks()) & HELPERS


@pytest.mark.parametrize("name", benchmarks())
def test_every_benchmark_has_numbers_and_says_what_for(name: str) -> None:
    tree = ast.parse((FOLDER / f"{name}.py").read_text(encoding="utf-8"))
    found = [f for f in tree.body if isinstance(f, ast.FunctionDef) and f.name == "numbers"]
    assert [[a.arg for a in f.args.args] for f in found] == [["quick"]]
    assert ast.get_docstring(found[0]), "says what quick mode leaves out"
    assert 10 < len(purpose(name)) < 120


def test_pages_name_benchmarks_that_there_are() -> None:
    texts = [page.read_text(encoding="utf-8") for page in (ROOT / "docs").glob("*.md")]
    named = {
        name for text in texts for name in re.findall(r"-m tests\.benchmarks\.([a-z]\w*)", text)
    }
    assert {"tracking", "c_controller"} <= named
    assert named - set(benchmarks()) == set()


# ---------------------------------------------------------------- one in its process


def test_numbers_of_a_process(fakes: dict[str, str]) -> None:
    found = measured("fake_good", "quick", fakes)
    assert (found.status, found.numbers) == (DONE, {"step_ms_median": 2, "n_count": 4})
    assert measured("fake_threads", "full", fakes).numbers == {"n": 1}


@pytest.mark.parametrize(
    "name, status",
    [
        ("without", "left out: peer is not installed: pip install peer"),
        ("failing", "failed: ValueError: no such arm"),
        ("infinite", "failed: ValueError: not finite: rms_mm"),
        ("leaving", "failed: no compiler"),
        ("missing", "failed: ModuleNotFoundError: No module named 'fake_missing'"),
    ],
)
def test_status_of_what_does_not_run(name: str, status: str, fakes: dict[str, str]) -> None:
    found = measured(f"fake_{name}", "quick", fakes)
    assert (found.status, found.numbers) == (status, {})


def test_hanging_one_is_ended(fakes: dict[str, str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(running.LIMIT_S, "quick", 2.0)
    assert measured("fake_endless", "quick", fakes).status == "failed: took longer than 2 s"


@pytest.mark.skipif(not hasattr(os, "killpg"), reason="signals of POSIX")
def test_ctrl_c_ends_the_process(fakes: dict[str, str]) -> None:
    def interrupt() -> None:
        while not Path(fakes["TOLD"]).exists() or not Path(fakes["TOLD"]).read_text():
            time.sleep(0.05)
        os.kill(os.getpid(), signal.SIGINT)

    waiting = threading.Thread(target=interrupt, daemon=True)
    waiting.start()
    with pytest.raises(KeyboardInterrupt):
        measured("fake_endless", "quick", fakes)
    waiting.join()
    with pytest.raises(ProcessLookupError):
        os.kill(int(Path(fakes["TOLD"]).read_text()), 0)


# ---------------------------------------------------------------- a whole run


def bench_of(folder: Path, **results: Result | BaseException) -> tuple[Bench, list[str]]:
    """A bench that knows its results, and a list of what it was asked to measure."""
    asked: list[str] = []

    def measure(name: str, mode: str) -> Result:
        asked.append(name)
        result = results[name]
        if isinstance(result, BaseException):
            raise result
        return result

    return Bench(measure, folder / "unfinished" / "quick.json", folder / "results"), asked


def of(**numbers: float) -> Result:
    return Result(DONE, 1.0, 0.5, 0.9, numbers)


def kept(folder: Path, run: Run, **results: Result) -> Run:
    """A stored run with these results."""
    old = replace(run, date="2026-01-01T00:00:00+00:00", benchmarks=results)
    store(old, folder / "results")
    found = last_stored("quick", folder / "results")
    assert found == old
    return found


def test_stored_and_compared(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = new_run("quick")
    before = kept(tmp_path, run, a=of(step_ms=1.0, x_instructions=100))
    bench, _ = bench_of(tmp_path, a=of(step_ms=1.5, x_instructions=100), b=of(rms_mm=2.0))
    assert conducted(bench, run, ["a", "b"], before, keep=True) == 0
    said = capsys.readouterr().out
    assert "a: step_ms" in said and "1.500  higher" in said
    stored = last_stored("quick", tmp_path / "results")
    assert stored == run and stored.benchmarks["b"].numbers == {"rms_mm": 2.0}
    assert last_stored("full", tmp_path / "results") is None
    newest = max((tmp_path / "results").glob(f"*-quick-{run.fingerprint}.json"))
    assert json.loads(newest.read_text())["machine"]["cores"] >= 1


def test_more_instructions_are_a_fault(tmp_path: Path) -> None:
    run = new_run("quick")
    before = kept(tmp_path, run, a=of(x_instructions=100))
    more, _ = bench_of(tmp_path, a=of(x_instructions=101))
    fewer, _ = bench_of(tmp_path, a=of(x_instructions=99))
    assert conducted(more, run, ["a"], before, keep=False) == FAILED
    assert conducted(fewer, new_run("quick"), ["a"], before, keep=False) == 0


def test_a_failing_one_is_not_the_end(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bench, asked = bench_of(tmp_path, a=Result("failed: no such arm", 1.0), b=of(n_count=1))
    assert conducted(bench, new_run("quick"), ["a", "b"], None, keep=False) == FAILED
    assert asked == ["a", "b"] and "a: failed: no such arm" in capsys.readouterr().out


def test_left_out_is_no_failure(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bench, _ = bench_of(tmp_path, a=Result("left out: no peer", 1.0), b=of(n_count=1))
    assert conducted(bench, new_run("quick"), ["a", "b"], None, keep=False) == 0
    assert "a: left out: no peer" in capsys.readouterr().out


def test_interrupted_and_resumed(tmp_path: Path) -> None:
    results = {"a": of(n_count=1), "b": Result("failed: once", 1.0), "c": KeyboardInterrupt()}
    bench, _ = bench_of(tmp_path, **results)
    run = bench.begin("quick", resume=False)
    assert conducted(bench, run, ["a", "b", "c"], None, keep=True) == INTERRUPTED
    assert not (tmp_path / "results").exists(), "half a run is not stored"
    bench, asked = bench_of(tmp_path, b=of(n_count=2), c=of(n_count=3))
    run = bench.begin("quick", resume=True)
    assert conducted(bench, run, ["a", "b", "c"], None, keep=True) == 0
    assert asked == ["b", "c"], "what is done is not done again, what failed is"
    stored = last_stored("quick", tmp_path / "results")
    assert stored is not None
    assert [one.numbers["n_count"] for one in stored.benchmarks.values()] == [1, 2, 3]


def test_run_of_another_commit_is_not_resumed(tmp_path: Path) -> None:
    bench, _ = bench_of(tmp_path)
    save(replace(new_run("quick"), commit="other"), bench.file)
    with pytest.raises(InputError, match="another commit or machine"):
        bench.begin("quick", resume=True)


@pytest.mark.parametrize("text", ["", "[]", '{"softmpc_benchmarks": 99}', "{"])
def test_no_run(text: str, tmp_path: Path) -> None:
    (tmp_path / "run.json").write_text(text)
    with pytest.raises(InputError, match="no run of the benchmarks"):
        load(tmp_path / "run.json")


# ---------------------------------------------------------------- what a change means


@pytest.mark.parametrize(
    "name, now, same_machine, verdict",
    [
        ("x_instructions", 101, False, "MORE INSTRUCTIONS"),
        ("x_instructions", 99, True, "fewer instructions"),
        ("x_instructions", 100, True, ""),
        ("step_machine_instructions", 101, True, "MORE INSTRUCTIONS"),
        ("step_machine_instructions", 100.05, True, ""),
        ("step_machine_instructions", 150, False, ""),
        ("step_ms_median", 129, True, ""),
        ("step_ms_median", 131, True, "higher"),
        ("step_ms_median", 131, False, ""),
        ("time_ratio_to_do_mpc", 70, True, "lower"),
        ("runs_not_back_within_2_s_count", 102, True, "differs"),
        ("rms_mm", 100.5, True, ""),
        ("rms_mm", 102, False, "differs"),
    ],
)
def test_verdict(name: str, now: float, same_machine: bool, verdict: str) -> None:
    assert comparing.Change(name, now, 100, same_machine).verdict == verdict


def test_new_numbers_and_zeros() -> None:
    rows = comparing.changes(of(a_count=0, b_count=1), of(a_count=0), True)
    assert [(row.verdict, row.ratio) for row in rows] == [("", None), ("new", None)]
    assert comparing.Change("a_count", 1, 0, True).verdict == "differs"
    assert comparing.Change("off_mm", 3e-13, 1e-13, True).verdict == "", "rounding"


def test_other_machine_is_named() -> None:
    run = new_run("quick")
    other = replace(run, fingerprint="0", machine={**run.machine, "cores": 999, "load": 9.0})
    assert comparing.machine_note(run, run) == ""
    note = comparing.machine_note(run, other)
    assert "cores" in note and "(was 999)" in note and "load" not in note


# ---------------------------------------------------------------- the command line


@pytest.mark.parametrize(
    "words, said",
    [
        (["nothing"], "no benchmark nothing; there are instructions"),
        (["--store", "startup"], "--store keeps whole runs"),
        (["--quick", "--full"], "not allowed with"),
    ],
)
def test_wrong_arguments(words: list[str], said: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        command.main(words)
    assert said in capsys.readouterr().err


def test_file_to_compare_with_is_checked_first(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    save(new_run("full"), tmp_path / "full.json")
    assert command.main(["--compare", str(tmp_path / "full.json"), "startup"]) == 2
    assert "is a full run, this is a quick one" in capsys.readouterr().err
    assert command.main(["--compare", str(tmp_path / "none.json"), "startup"]) == 2


def test_list(capsys: pytest.CaptureFixture[str]) -> None:
    assert command.main(["--list"]) == 0
    said = capsys.readouterr().out
    assert all(name in said for name in benchmarks())


def test_help(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="0"):
        command.main(["--help"])
    said = capsys.readouterr().out
    assert "{" not in said, "places in the text are filled in"
