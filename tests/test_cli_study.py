"""`softmpc study` end to end: answers, files, interrupts, errors."""

from __future__ import annotations

import csv
import json
import os
import signal
import time
from collections import Counter
from pathlib import Path
from typing import Any

import pytest
import study_work
from click.testing import CliRunner, Result
from study_work import SIZES, noted, start

from softmpc.accuracy import alone, study
from softmpc.accuracy.configuration import Task
from softmpc.accuracy.points import Study
from softmpc.accuracy.work import Case, Measure
from softmpc.cli.main import main
from softmpc.view.accuracy import KINDS

SCENE = """
title = "Arm"
[manipulator]
sections = 1
"""
POINTS = 2 + 2 * len(SIZES) + 2
TEXTS = {"study.json", "study.csv", "study.md", "report.html", "measurements.jsonl"}


@pytest.fixture(autouse=True)
def fakes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Families that are quick, and costs in this process."""

    def measured(work: Measure, case: Case) -> dict[str, Any]:
        return work(case)

    study_work.only_fakes(monkeypatch)
    monkeypatch.setattr(alone, "measured_alone", measured)


@pytest.fixture
def no_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """They take longer than all the rest."""
    monkeypatch.setattr("softmpc.view.accuracy.study_figures", lambda *_: {})
    monkeypatch.setattr("softmpc.view.accuracy_report.report_html", lambda *_: "")


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    path = tmp_path / "arm.toml"
    path.write_text(SCENE, encoding="utf-8")
    return path


def softmpc(*words: object) -> Result:
    return CliRunner().invoke(main, ["study", *map(str, words), "--workers", "1"])


def test_json_and_files(scene: Path, tmp_path: Path) -> None:
    out = tmp_path / "new" / "out"
    result = softmpc(scene, "--out", out, "--json")
    assert result.exit_code == 0, result.output
    assert result.stdout.count("\n") == 1
    data = json.loads(result.stdout)
    assert (data["title"], data["status"], data["quick"]) == ("Arm", "finished", False)
    assert json.loads((out / "study.json").read_text(encoding="utf-8")) == data
    assert [fit["order"] for fit in data["families"][0]["fits"]] == pytest.approx([1.0, 2.0])
    found = Study.from_summary(data)
    assert len(found.points) == POINTS and found.summary()["scene"] == data["scene"]
    names = {path.name for path in out.iterdir()}
    pictures = {name for name in names if name.endswith(".png")}
    assert names - pictures == TEXTS
    assert "work-precision-pretended.png" in pictures
    assert all(name.startswith(KINDS) for name in pictures)  # by which old ones are found
    with open(out / "study.csv", newline="", encoding="utf-8") as file:
        assert len([*csv.DictReader(file)]) == POINTS
    report = (out / "report.html").read_text(encoding="utf-8")
    assert "softmpc study arm.toml --out DIR" in report and str(tmp_path) not in report


@pytest.mark.usefixtures("no_pictures")
def test_pictures_of_another_study_do_not_stay(scene: Path, tmp_path: Path) -> None:
    old, own = tmp_path / "changes-motion.png", tmp_path / "arm.png"
    old.touch(), own.touch()
    result = softmpc(scene, "--out", tmp_path, "--axis", "second")
    assert result.exit_code == 0, result.output
    assert own.exists() and not old.exists()


def test_table_for_people_and_nothing_kept(
    scene: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    result = softmpc(scene, "--quick", "--family", "pretended", "--axis", "second")
    assert result.exit_code == 0, result.output
    assert result.stdout.startswith("Arm: what accuracy costs in time (quick study, finished)")
    assert "second 4 *  2.08 mm      40 ± 1 µs   4.00         4,000" in result.stdout
    assert "as theory says  2.00 ± 0.00" in result.stdout
    assert "first" not in result.stdout and "other" not in result.stdout.partition("*: no")[0]
    assert [path.name for path in tmp_path.iterdir()] == ["arm.toml"]


def test_failures_are_told(scene: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    change(monkeypatch, fail=[f"pretended error {identity('first 2')}"])
    result = softmpc(scene)
    assert result.exit_code == 0  # one point is not there, the study is
    assert "not measured:\nfirst 2: does not come to rest" in result.stdout


def test_the_scene_as_given_fails(scene: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    change(monkeypatch, fail=[f"pretended cost {identity('as given')}", "other reference fine"])
    result = softmpc(scene)
    assert result.exit_code == 3
    assert result.stderr.splitlines()[-1] == (
        "error: other: there is no reference 'fine': does not come to rest; "
        "pretended: the scene as given: does not come to rest"
    )


def change(patch: pytest.MonkeyPatch, **keys: Any) -> None:
    """The pretended families see these keys in the scene file."""
    read = study.read_task

    def with_keys(*given: Any) -> Task:
        task = read(*given)
        return Task({**task.document, **keys}, task.folder, task.quick)

    patch.setattr(study, "read_task", with_keys)


def identity(name: str) -> str:
    made = study_work.Pretended().configurations(Task({}))
    return next(one.identity for one in made if one.name == name)


# ---------------------------------------------------------------- interrupted


@pytest.mark.usefixtures("no_pictures")
@pytest.mark.parametrize("number", [0, 1, 5, 12])
def test_ctrl_c_keeps_everything(
    number: int, scene: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The signal comes while a measurement is made."""
    begun: Counter[str] = Counter()
    work, out = study_work._work, tmp_path / "out"

    def interrupted(task: Task, what: str) -> None:
        begun[what] += 1
        if begun.total() == number + 1:
            signal.raise_signal(signal.SIGINT)
        work(task, what)

    monkeypatch.setattr(study_work, "_work", interrupted)
    result = softmpc(scene, "--out", out, "--json")
    assert result.exit_code == 130
    assert "interrupted with " in result.stderr
    assert f" of {POINTS} points; the same command goes on from there" in result.stderr
    assert json.loads(result.stdout)["status"] == "interrupted"
    assert {path.name for path in out.iterdir()} >= TEXTS
    (last,) = [what for i, what in enumerate(begun) if i == number]
    assert softmpc(scene, "--out", out).exit_code == 0
    assert begun == dict.fromkeys(begun, 1) | {last: 2}
    before = begun.total()
    assert softmpc(scene, "--out", out).exit_code == 0 and begun.total() == before


def test_interrupted_without_out(scene: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(task: Task, what: str) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(study_work, "_work", interrupted)
    result = softmpc(scene)
    assert result.exit_code == 130
    assert f"interrupted with 0 of {POINTS} points; nothing was kept" in result.stderr
    assert f"{POINTS - 2} points that are still to be measured" in result.stdout


def test_interrupted_while_drawing(
    scene: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("softmpc.view.accuracy.study_figures", interrupted)
    result = softmpc(scene, "--out", tmp_path / "out", "--json")
    assert result.exit_code == 130
    assert "interrupted while drawing; the numbers are kept" in result.stderr
    assert json.loads(result.stdout)["status"] == "finished"
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert names == {"study.json", "study.csv", "study.md", "measurements.jsonl"}


@pytest.mark.slow
@pytest.mark.parametrize("part", ["errors", "times"])
def test_ctrl_c_in_a_terminal(part: str, scene: Path, tmp_path: Path) -> None:
    """It reaches all processes of the group; what was finished is not done again."""
    log, out = tmp_path / "log", tmp_path / "out"
    log.touch()
    words = ("command", log, "study", scene, "--family", "pretended", "--out", out)
    kept = out / "measurements.jsonl"
    with start(*words, "--workers", 2) as process:
        enough = 5 if part == "errors" else 2 + 1 + 2 * len(SIZES) + 2
        while not kept.exists() or kept.read_text().count('"key"') < enough:
            time.sleep(0.01)
        os.killpg(process.pid, signal.SIGINT)
        _, error = process.communicate(timeout=60)
    assert process.returncode == 130
    assert error.splitlines()[-1].startswith("error: interrupted with ")
    assert "Traceback" not in error
    time.sleep(0.5)
    finished = kept.read_text().count('"key"')
    done = Counter(one.what for one in noted(log))
    with start(*words, "--workers", 2, "--json") as process:
        answer, error = process.communicate(timeout=200)
    assert process.returncode == 0, error
    assert json.loads(answer)["status"] == "finished"
    everything = Counter(one.what for one in noted(log))
    assert (everything - done).total() == 2 + 2 * (1 + 2 * len(SIZES)) - finished


# ---------------------------------------------------------------- errors


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--family", "rst"), "unknown family: 'rst'; allowed: pretended, other"),
        (("--axis", "secund"), "unknown axis: 'secund'; did you mean 'second'? allowed: first"),
        (("--family", "other", "--axis", "first"), "unknown axis of other: 'first'; "),
        (("--dask", "tcp://127.0.0.1:1"), "give --workers or --dask"),
    ],
)
def test_errors(scene: Path, tmp_path: Path, words: tuple[str, ...], message: str) -> None:
    result = softmpc(scene, *words, "--out", tmp_path / "out")
    assert result.exit_code == 2
    assert result.stderr.startswith("error: ") and message in result.stderr
    assert result.stderr.count("\n") == 1 and result.stdout == ""
    assert not (tmp_path / "out").exists()


def test_a_missing_scene(scene: Path) -> None:
    result = softmpc(scene.with_name("arn.toml"))
    assert result.exit_code == 2
    assert "no such file" in result.stderr and "did you mean 'arm.toml'?" in result.stderr


def test_a_scene_that_is_wrong(scene: Path) -> None:
    scene.write_text(SCENE + "[effekts]\n", encoding="utf-8")
    result = softmpc(scene)
    assert result.exit_code == 2 and f"{scene}: " in result.stderr and "effekts" in result.stderr


@pytest.mark.usefixtures("no_pictures")
def test_a_folder_of_another_study(scene: Path, tmp_path: Path) -> None:
    """It is left alone, unless it is to be started anew."""
    out = tmp_path / "out"
    assert softmpc(scene, "--quick", "--out", out).exit_code == 0
    before = (out / "measurements.jsonl").read_bytes()
    result = softmpc(scene, "--out", out)
    assert result.exit_code == 2 and result.stderr.count("\n") == 1
    assert "holds another study, which differs in: quick; name another folder" in result.stderr
    assert (out / "measurements.jsonl").read_bytes() == before
    assert softmpc(scene, "--out", out, "--fresh").exit_code == 0
    assert json.loads((out / "study.json").read_text())["quick"] is False


@pytest.mark.parametrize("out", ["arm.toml", "arm.toml/below"])
def test_a_folder_that_cannot_be_written(out: str, scene: Path, tmp_path: Path) -> None:
    result = softmpc(scene, "--out", tmp_path / out)
    assert result.exit_code == 2 and result.stderr.count("\n") == 1
    assert "--out" in result.stderr


def test_a_measurements_file_of_something_else(scene: Path, tmp_path: Path) -> None:
    (tmp_path / "measurements.jsonl").write_text("mine\n")
    for more in ((), ("--fresh",)):
        result = softmpc(scene, "--out", tmp_path, *more)
        assert result.exit_code == 2 and "is not the file of a study" in result.stderr
    assert (tmp_path / "measurements.jsonl").read_text() == "mine\n"


def test_help_says_that_nothing_is_kept() -> None:
    text = " ".join(CliRunner().invoke(main, ["study", "--help"]).stdout.split())
    assert "Without --out nothing is kept" in text
