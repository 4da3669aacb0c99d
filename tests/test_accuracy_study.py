"""Studies: the same table however they are run and interrupted, and times measured alone."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import time
from collections import Counter
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import study_work
from study_work import SIZES, Noted, Pretended, noted, start

from softmpc import InputError
from softmpc.accuracy import alone, study
from softmpc.accuracy.alone import KILLED
from softmpc.accuracy.configuration import Task
from softmpc.accuracy.made_once import made_once
from softmpc.accuracy.orders import fits
from softmpc.accuracy.points import Study
from softmpc.accuracy.study import run_study
from softmpc.accuracy.work import MEASURED, Case, Measure
from softmpc.errors import SweepError

BY_NAME = {one.name: one.identity for one in Pretended().configurations(Task({}))}
DISTINCT = 1 + 2 * len(SIZES)  # configurations of the pretended family


@pytest.fixture(autouse=True)
def fakes(monkeypatch: pytest.MonkeyPatch) -> None:
    study_work.only_fakes(monkeypatch)


@pytest.fixture
def in_this_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Costs too, where it does not matter that they are alone."""

    def measured(work: Measure, case: Case) -> dict[str, Any]:
        return work(case)

    monkeypatch.setattr(alone, "measured_alone", measured)


@pytest.fixture
def log(tmp_path: Path) -> Path:
    path = tmp_path / "log"
    path.touch()
    return path


def run(log: Path, executor: Any = 1, more: dict[str, Any] | None = None, **options: Any) -> Study:
    task = Task({"title": "Arm", "log": str(log), **(more or {})})
    return run_study(task, executor=executor, **options)


def table(found: Study) -> Any:
    """All that was measured; of this family times too are the same every time."""
    return json.loads(json.dumps(found.summary()["families"]))


def done(log: Path) -> Counter[str]:
    return Counter(one.what for one in noted(log))


# ---------------------------------------------------------------- what is measured


@pytest.mark.usefixtures("in_this_process")
def test_points_of_all_families(log: Path) -> None:
    found = run(log)
    assert found.status == "finished"
    assert [family.name for family in found.families] == ["pretended", "other"]
    first = found.family("pretended")
    assert first.as_given is first.points[0] and first.points[0].name == "as given"
    assert first.axes == ["as given", "first", "second"]
    assert first.references == {"coarse": "the coarse one", "fine": "the fine one"}
    assert [point.error_m for point in first.axis("second")] == [
        0.1 * size**2 / 3 for size in (1, 0.5, 0.25)
    ]
    assert {point.status for point in found.points} == {"measured"}
    assert first.points[-1].error == first.axis("second")[0].error
    assert set(done(log).values()) == {1}  # also of what is on two axes
    assert len(done(log)) == 2 * (2 + DISTINCT) - 2 + (2 + 2 * 2)


@pytest.mark.usefixtures("in_this_process")
def test_families_and_axes_by_name(log: Path) -> None:
    found = run(log, families=["pretended"], axes=["second"])
    assert [family.name for family in found.families] == ["pretended"]
    assert found.family("pretended").axes == ["as given", "second"]
    assert done(log)[f"pretended error {BY_NAME['first 2']}"] == 0
    both = run(log, axes=["third"])
    assert both.family("other").axes == ["as given", "third"]
    assert both.family("pretended").points == ()
    assert both.family("pretended").missing == "has none of the axes asked for"
    assert not both.family("pretended").lost


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"families": ["pretendet"]}, "unknown family: 'pretendet'; did you mean 'pretended'"),
        (
            {"axes": ["secnd"]},
            "unknown axis: 'secnd'; did you mean 'second'.* allowed: first, second, third",
        ),
        (
            {"families": ["other"], "axes": ["first"]},
            "unknown axis of other: 'first'; .*allowed: third$",
        ),
        ({"axes": ["as given"]}, "unknown axis: 'as given'"),
        (
            {"families": ["other"], "more": {"refuse": {"other": "the scene has no path"}}},
            "family 'other' cannot be measured: the scene has no path",
        ),
        (
            {"more": {"refuse": {"other": "no path", "pretended": "no motion"}}},
            "nothing of this scene can be measured: pretended: no motion; other: no path",
        ),
    ],
)
def test_wrong_names_leave_nothing_behind(
    log: Path, tmp_path: Path, options: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        run(log, keep=tmp_path / "kept", **options)
    assert not (tmp_path / "kept").exists() and not noted(log)


@pytest.mark.usefixtures("in_this_process")
def test_a_family_that_the_scene_does_not_have(log: Path) -> None:
    found = run(log, more={"refuse": {"other": "the scene has no path"}})
    assert found.family("other").missing == "the scene has no path"
    assert found.family("pretended").points[0].status == "measured"


@pytest.mark.usefixtures("in_this_process")
def test_what_cannot_be_measured_has_a_reason(log: Path) -> None:
    more = {
        "fail": [f"pretended error {BY_NAME['first 2']}"],
        "break": [f"pretended cost {BY_NAME['second 4']}"],
    }
    by_name = {point.name: point for point in run(log, more=more).family("pretended").points}
    assert by_name["first 2"].status == "does not come to rest"
    assert by_name["first 2"].error_m is None and by_name["first 2"].time_s is not None
    assert by_name["second 4"].status == "KeyError: 'a bug'"
    assert sum(point.status == "measured" for point in by_name.values()) == DISTINCT + 1 - 2


@pytest.mark.usefixtures("in_this_process")
def test_a_family_without_its_reference_is_left_out(log: Path) -> None:
    found = run(log, more={"fail": ["pretended reference fine"]})
    lost, other = found.families
    assert lost.points == () and lost.lost
    assert lost.missing == "there is no reference 'fine': does not come to rest"
    assert {point.status for point in other.points} == {"measured"}
    assert not [what for what in done(log) if what.startswith("pretended error")]


# ---------------------------------------------------------------- the same everywhere


@pytest.mark.slow
@pytest.mark.usefixtures("in_this_process")
def test_same_results_in_processes(log: Path) -> None:
    alone = run(log)
    here = {one.process for one in noted(log)}
    again = run(log, 2)
    assert table(again) == table(alone)
    errors = {one.process for one in noted(log) if " error " in one.what}
    assert here == {os.getpid()} and len(errors - here) == 2


@pytest.mark.slow
def test_same_results_on_dask(log: Path, tmp_path: Path) -> None:
    """On a cluster of this machine; times are still measured by this one, alone."""
    pytest.importorskip("distributed")
    with start("dask", log, tmp_path / "kept") as made:
        out, error = made.communicate(timeout=120)
    assert made.returncode == 0, error
    assert json.loads(out) == table(run(tmp_path / "log 2", families=["other"]))
    workers = {one.process for one in noted(log) if " cost " not in one.what}
    times = {one.process for one in noted(log) if " cost " in one.what}
    assert made.pid not in workers | times and not workers & times


# ---------------------------------------------------------------- times alone


@pytest.mark.slow
def test_times_are_measured_alone(log: Path) -> None:
    """One after the other, after all else, in fresh processes that stay on one core."""
    run(log, 2, {"seconds": 0.02}, families=["pretended"], axes=["second"])
    times = [one for one in noted(log) if " cost " in one.what]
    others = [one for one in noted(log) if " cost " not in one.what]
    assert len(times) == 1 + len(SIZES) and len(others) == 2 + 1 + len(SIZES)
    last = max(one.ended for one in others)
    for one in times:
        assert one.began > last
        last = one.ended
    assert len({one.process for one in times}) == len(times)
    assert not {one.process for one in times} & {one.process for one in others}
    if hasattr(os, "sched_setaffinity"):
        assert {one.cores for one in times} == {1}
        assert {one.cores for one in others} == {len(os.sched_getaffinity(0))}
    assert len(os.sched_getaffinity(0)) == others[0].cores


@pytest.mark.sampled
@pytest.mark.parametrize("killed", [None, "second 2"])
def test_quick_times_share_a_process(log: Path, killed: str | None) -> None:
    """Until it is killed: then each of the others has its own."""
    document: dict[str, Any] = {"title": "Arm", "log": str(log), "kill": []}
    if killed:
        document["kill"] = [f"pretended cost {BY_NAME[killed]}"]
    found = run_study(
        Task(document, quick=True), executor=1, families=["pretended"], axes=["second"]
    )
    times = [one for one in noted(log) if " cost " in one.what]
    states = {point.name: point.status for point in found.points}
    if killed is None:
        assert len({one.process for one in times}) == 1
        assert set(states.values()) == {MEASURED}
    else:
        assert len({one.process for one in times}) > 1
        assert states.pop(killed) == KILLED
        assert set(states.values()) == {MEASURED}
    for one, after in pairwise(times):
        assert after.began > one.ended


def test_what_a_shared_process_leaves_is_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    """Results that come at the same time come in any order."""
    cases = [Case("pretended", "cost", str(i)) for i in range(4)]

    def broken(work: Measure, cases: list[Case], arrived: Any, **_: Any) -> None:
        for i in (2, 0):
            arrived(i, {"status": MEASURED, "memory_mib": 1.0})
        raise SweepError("its worker was killed")

    monkeypatch.setattr(alone, "sweep", broken)
    monkeypatch.setattr(alone, "measured_alone", lambda work, case: {"status": "alone"})
    found: dict[str, Any] = {}
    work = Measure(Task({}, quick=True))
    alone.measure_alone(work, cases, lambda case, result: found.update({case.name: result}))
    shared, own = {"status": MEASURED}, {"status": "alone"}
    assert found == {"2": shared, "0": shared, "1": own, "3": own}


def test_what_times_are_compared_with_is_made_once_in_quick_studies() -> None:
    made: list[str] = []

    def ask(document: dict[str, Any], quick: bool = True) -> int:
        def make() -> int:
            made.append(document["title"])
            return len(made)

        return made_once("test", Task(document, quick=quick), make)

    assert [ask({"title": "a"}), ask({"title": "a"}), ask({"title": "b"})] == [1, 1, 2]
    assert [ask({"title": "b"}, quick=False), ask({"title": "b"}, quick=False)] == [3, 4]
    assert made == ["a", "b", "b", "b"]


@pytest.mark.usefixtures("in_this_process")
def test_times_of_another_machine_are_not_used(
    log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = run(log, keep=tmp_path / "kept")
    monkeypatch.setattr(study, "fingerprint", lambda: "another")
    second = run(log, keep=tmp_path / "kept")
    assert table(second) == table(first)
    for what, count in done(log).items():
        assert count == (2 if " cost " in what else 1), what
    monkeypatch.undo()
    monkeypatch.setattr(alone, "measured_alone", None)  # those of this machine are still there
    study_work.only_fakes(monkeypatch)
    assert table(run(log, keep=tmp_path / "kept")) == table(first)


# ---------------------------------------------------------------- interrupted


class Stopped:
    """Ctrl-C when the measurement of that number begins."""

    def __init__(self, number: int) -> None:
        self.number = number
        self.work = study_work._work

    def __call__(self, task: Task, what: str) -> None:
        if self.number == 0:
            raise KeyboardInterrupt
        self.number -= 1
        self.work(task, what)


@pytest.mark.usefixtures("in_this_process")
def test_interrupted_before_any_measurement(
    log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = run(log)
    measurements = len(noted(log))
    for number in range(measurements):
        log.write_text("")
        keep = tmp_path / f"kept {number}"
        with monkeypatch.context() as patch:
            patch.setattr(study_work, "_work", Stopped(number))
            part = run(log, keep=keep)
        assert part.status == "interrupted"
        assert len(part.points) == len(whole.points)
        assert len(noted(log)) == number == keep.read_text().count('"key"')
        known = {point.name for point in part.points if point.status == "measured"}
        assert len(known) < len(whole.points)
        assert table(run(log, keep=keep)) == table(whole)
        assert set(done(log).values()) == {1} and len(noted(log)) == measurements


@pytest.mark.usefixtures("in_this_process")
def test_a_half_line_is_measured_again(log: Path, tmp_path: Path) -> None:
    keep = tmp_path / "kept"
    whole = run(log, keep=keep)
    data = keep.read_bytes()
    lines = data.splitlines(keepends=True)
    for number in (3, len(lines) - 1):
        keep.write_bytes(b"".join(lines[:number]) + lines[number][:-5])
        log.write_text("")
        assert table(run(log, keep=keep)) == table(whole)
        assert len(noted(log)) == len(lines) - number
        assert keep.read_bytes() == data


@pytest.mark.usefixtures("in_this_process")
def test_fresh_measures_all_again(log: Path, tmp_path: Path) -> None:
    run(log, keep=tmp_path / "kept")
    run(log, keep=tmp_path / "kept", fresh=True)
    assert set(done(log).values()) == {2}


@pytest.mark.usefixtures("in_this_process")
def test_progress_goes_on_from_where_it_was(log: Path, tmp_path: Path) -> None:
    run(log, keep=tmp_path / "kept", axes=["first"], families=["pretended"])
    seen: dict[str, list[tuple[float, float]]] = {}

    def stage(what: str) -> study.Progress:
        return lambda *done: seen.setdefault(what, []).append(done)

    run(log, keep=tmp_path / "kept", families=["pretended"], stage=stage)
    assert [*seen] == ["references", "errors", "times"]
    assert seen["references"] == [(2, 2)]
    kept = 1 + len(SIZES) + 1
    assert seen["errors"][0] == (kept, DISTINCT)
    for one in seen.values():
        assert one == sorted(one) and one[-1][0] == one[-1][1] == one[0][1]


def keys(path: Path) -> set[str]:
    """Keys of the whole lines of the file."""
    if not path.exists():
        return set()
    lines = path.read_bytes().rpartition(b"\n")[0].splitlines()[1:]
    return {json.loads(line)["key"] for line in lines}


def killed(process: subprocess.Popen[str], keep: Path, more: int, delay: float) -> bool:
    """Whether it was killed `delay` s after so many more results; it was finished else."""
    before = len(keys(keep))
    while len(keys(keep)) < before + more and process.poll() is None:
        time.sleep(0.01)
    time.sleep(delay)
    if process.poll() is not None:
        return False
    os.kill(process.pid, signal.SIGKILL)  # its workers end by themselves
    process.communicate(timeout=20)
    return True


@pytest.mark.slow
def test_killed_at_any_moment(log: Path, tmp_path: Path) -> None:
    """What was on the disk when it was killed is never measured again."""
    keep, random, kept, before = tmp_path / "kept", np.random.default_rng(9), set[str](), done(log)
    kills = 0
    while True:
        with start("run", log, keep, 2) as process:
            gone = killed(process, keep, int(random.integers(1, 4)), float(random.uniform(0, 0.4)))
            out = "" if gone else process.stdout.read()
        time.sleep(0.5)  # workers look for their parent, and may note what nobody waits for
        assert [what for what in done(log) - before if what in kept] == []
        if not gone:
            break
        kills += 1
        kept, before = {key.partition(" on ")[0] for key in keys(keep)}, done(log)
    assert kills >= 4
    assert json.loads(out) == table(run(tmp_path / "log 2", families=["pretended"]))


@pytest.mark.slow
def test_a_process_that_is_killed_is_the_trouble_of_one_point(log: Path, tmp_path: Path) -> None:
    """Its killer is measured again by the same study, all others are not."""
    killers = [f"other {part} {identity()}" for part in ("error", "cost")]
    options: dict[str, Any] = {"families": ["other"], "keep": tmp_path / "kept"}
    found = run(log, 2, {"kill": killers}, **options)
    given, third = found.family("other").points
    assert given.status == "measured"
    assert third.error["status"] == third.cost["status"] == KILLED == third.status
    assert not [key for key in keys(tmp_path / "kept") if identity() in key]


def identity() -> str:
    """Of the one point of the other family that is not the scene as given."""
    return study_work.Other().configurations(Task({}))[1].identity


def test_summary_is_the_same_study(log: Path, in_this_process: None) -> None:
    found = run(log, more={"fail": [f"pretended error {BY_NAME['first 2']}"]})
    data = json.loads(json.dumps(found.summary()))
    again = Study.from_summary(data)
    assert again.summary() == found.summary()
    assert again.family("pretended").points[1].configuration == found.points[1].configuration
    assert isinstance(noted(log)[0], Noted)


ARM = {
    "title": "One section",
    "manipulator": {"sections": 1},
    "effects": {"gravity": [0.0, 0.0, 9.81]},
    "actuation": {"kind": "static"},
    "simulate": {"duration": 0.2, "steps": [{"unit": 1, "at": 0.0, "torque": 1.0}]},
}


@pytest.mark.slow
def test_the_arm_at_rest_interrupted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The real family: its order is that of theory, and each part is measured once."""
    monkeypatch.undo()
    keep, done = tmp_path / "kept", 0

    def stage(what: str) -> study.Progress:
        def report(now: float, total: float) -> None:
            nonlocal done
            if what == "errors" and now == 2 and not done:
                done = keep.read_text().count('"key"')
                raise KeyboardInterrupt

        return report

    options: dict[str, Any] = {"families": ["rest"], "axes": ["kinematics"], "keep": keep}
    task = Task(ARM, quick=True)
    assert run_study(task, executor=2, stage=stage, **options).status == "interrupted"
    assert done >= 4
    before = keep.read_bytes()
    whole = run_study(task, executor=2, **options)
    assert whole.status == "finished"
    assert {point.status for point in whole.points} == {"measured"}
    assert keep.read_bytes().startswith(before)
    again = run_study(task, executor=1, **options)
    assert again.summary()["families"] == whole.summary()["families"]
    assert len(keys(keep)) == keep.read_text().count('"key"')  # none twice
    by_key = {fit.key: fit for fit in fits(whole.family("rest"))}
    assert by_key["error_m"].order == pytest.approx(2.0, abs=0.2), by_key
