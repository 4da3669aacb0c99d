"""The file of a study: what is on the disk is there again, and nothing of another study is."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from softmpc import InputError
from softmpc.accuracy.configuration import Task
from softmpc.accuracy.store import Store

TASK = Task({"title": "Arm", "simulate": {"table": "torques.csv", "duration": 1.0}})
RESULTS = {
    "a": {"status": "measured", "error_m": 1 / 3, "list": [1, 2.5, None]},
    "b": {"status": "a reason with ünicode\nand lines"},
    "c": {"status": "measured", "error_m": float("inf")},
}


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A file with results, in a folder that was not there."""
    path = tmp_path / "new" / "measurements.jsonl"
    store = Store(path, TASK)
    for key, result in RESULTS.items():
        store.add(key, result)
    return path


def test_results_come_back_to_the_last_digit(path: Path) -> None:
    store = Store(path, TASK)
    assert store.results == RESULTS
    assert "a" in store and "d" not in store and store["a"]["error_m"] == 1 / 3


def test_a_result_is_on_the_disk_when_it_is_added(path: Path) -> None:
    store = Store(path, TASK)
    store.add("d", {"status": "measured"})
    assert json.loads(path.read_text().splitlines()[-1]) == {"key": "d", "result": store["d"]}


def test_without_a_path_nothing_is_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    store = Store(None, TASK)
    store.add("a", RESULTS["a"])
    assert store["a"] == RESULTS["a"] and not list(tmp_path.iterdir())


def test_cut_off_anywhere_all_whole_lines_are_there(path: Path, tmp_path: Path) -> None:
    """A crash while writing; afterwards it goes on as if nothing had been written of that line."""
    data = path.read_bytes()
    head = data.index(b"\n") + 1
    cut = tmp_path / "cut"
    for length in range(head, len(data), 7):
        cut.write_bytes(data[:length])
        whole = data[:length].count(b"\n") - 1
        store = Store(cut, TASK)
        assert [*store.results] == [*RESULTS][:whole]
        for key, result in RESULTS.items():
            if key not in store:
                store.add(key, result)
        assert cut.read_bytes() == data


@pytest.mark.parametrize(
    ("other", "what"),
    [
        (Task({"title": "Arm"}), "differs in: scene;"),
        (Task(TASK.document, quick=True), "differs in: quick;"),
        (Task({"title": "Leg"}, quick=True), "differs in: scene, quick;"),
    ],
)
def test_another_study_is_refused(path: Path, other: Task, what: str) -> None:
    before = path.read_bytes()
    with pytest.raises(InputError, match=what) as caught:
        Store(path, other)
    assert "--fresh" in str(caught.value) and str(path) in str(caught.value)
    assert path.read_bytes() == before


def test_another_version_is_refused(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("softmpc.__version__", "0.0.0")
    with pytest.raises(InputError, match="differs in: softmpc;"):
        Store(path, TASK)


def test_files_that_the_scene_names_are_part_of_the_study(tmp_path: Path) -> None:
    table, kept = tmp_path / "torques.csv", tmp_path / "kept"
    table.write_text("t,T_1\n0,1\n")
    task = Task(TASK.document, str(tmp_path))
    Store(kept, task).add("a", RESULTS["a"])
    assert "a" in Store(kept, task)
    table.write_text("t,T_1\n0,2\n")
    with pytest.raises(InputError, match="differs in: files;"):
        Store(kept, task)


def test_the_order_of_keys_in_a_scene_is_not(path: Path) -> None:
    turned = {
        key: dict(reversed(value.items())) if isinstance(value, dict) else value
        for key, value in reversed(TASK.document.items())
    }
    assert Store(path, Task(turned)).results == RESULTS


def test_fresh_starts_anew(path: Path) -> None:
    assert Store(path, TASK, fresh=True).results == {}
    assert Store(path, TASK).results == {}
    Store(path, TASK).add("a", RESULTS["a"])
    other = Task({"title": "Leg"})
    assert Store(path, other, fresh=True).results == {}
    assert Store(path, other).results == {}


@pytest.mark.parametrize("text", ["time,tip\n1,2\n", "half a line", "[1]\n", "{}\n", "\n"])
@pytest.mark.parametrize("fresh", [False, True])
def test_a_file_of_something_else_is_refused(text: str, fresh: bool, tmp_path: Path) -> None:
    path = tmp_path / "kept"
    path.write_text(text)
    with pytest.raises(InputError, match="is not the file of a study"):
        Store(path, TASK, fresh)
    assert path.read_text() == text


def test_an_empty_file_is_a_new_one(tmp_path: Path) -> None:
    (tmp_path / "kept").touch()
    Store(tmp_path / "kept", TASK).add("a", RESULTS["a"])
    assert "a" in Store(tmp_path / "kept", TASK)


@pytest.mark.parametrize("line", ["nonsense", "[1]", '{"key": "d"}', "1"])
def test_a_damaged_line_is_named(path: Path, line: str) -> None:
    with path.open("a") as file:
        file.write(f"{line}\n")
    with pytest.raises(InputError, match="line 5 is damaged"):
        Store(path, TASK)


def test_empty_lines_do_not_matter(path: Path) -> None:
    path.write_text(path.read_text().replace("\n", "\n\n"))
    Store(path, TASK).add("d", RESULTS["a"])
    assert [*Store(path, TASK).results] == [*RESULTS, "d"]


def test_where_nothing_can_be_written(tmp_path: Path, path: Path) -> None:
    with pytest.raises(InputError, match="is a folder"):
        Store(tmp_path, TASK)
    with pytest.raises(InputError, match="cannot be written: "):
        Store(path / "below a file", TASK)
    store = Store(path, TASK)
    path.unlink()
    path.mkdir()
    with pytest.raises(InputError, match="cannot be written"):
        store.add("d", RESULTS["a"])
