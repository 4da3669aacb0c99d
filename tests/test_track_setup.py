"""What `softmpc track` says and hears before the run: progress, Ctrl-C, and what is wrong where."""

from __future__ import annotations

import io
import json
import signal
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from softmpc.cli.common import stages
from softmpc.cli.main import main
from softmpc.control.baselines import Regulated
from softmpc.control.compare import compare_file
from softmpc.control.preflight import Finding
from softmpc.control.tracking import _stop_where_infeasible, ready, track_file
from softmpc.errors import BuildError, InputError, SceneError
from softmpc.model.scene_file import check_document
from softmpc.model.tables import Table
from softmpc.rig.rigging import run_rig_file

SCENE = """
title = "Point"
[track]
path = "line"
start = [0.0, 0.0, 0.5]
end = [0.01, 0.0, 0.51]
lap_time = 0.6
laps = 0.5
smooth_start = 0.1
settle = 0.05
[track.controller]
horizon = 2
[track.plant]
tolerance = 1e-5
[rig]
wait = 0.0
"""
NODES, CLEARANCE = 41, 6  # of half a lap, and places that its clearance is of


@pytest.fixture(scope="module", autouse=True)
def _quick_clearance() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("softmpc.control.tracking.find_clearance", lambda *given: given[2](6, 6))
        yield


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "scene.toml"
    path.write_text(SCENE, encoding="utf-8")
    return path


def changed(file: Path, old: str, new: str) -> Path:
    text = file.read_text(encoding="utf-8")
    assert old in text
    file.write_text(text.replace(old, new), encoding="utf-8")
    return file


def interrupt() -> None:
    signal.raise_signal(signal.SIGINT)


# ---------------------------------------------------------------- progress and Ctrl-C


RUNS = {"track": track_file, "rig": run_rig_file, "compare": compare_file}


@pytest.mark.parametrize("name", RUNS)
def test_ctrl_c_before_the_run(file: Path, name: str) -> None:
    """It ends at the next place, not when all is set up."""
    seen = []

    def checking(done: int, total: int) -> None:
        seen.append((done, total))
        if done == 3:
            interrupt()

    with pytest.raises(KeyboardInterrupt):
        RUNS[name](file, None, None, checking)
    assert seen == [(k, NODES + CLEARANCE) for k in (1, 2, 3)]


def test_ctrl_c_in_what_reports_nothing() -> None:
    """And nothing is interrupted inside."""
    done = []

    def make(report: Callable[[int, int], None]) -> str:
        interrupt()
        done.append("all")
        return "made"

    with pytest.raises(KeyboardInterrupt):
        ready(make, None)
    assert done == ["all"]
    assert ready(lambda report: report(1, 1) or "made", None) == "made"


def test_checks_and_run_are_told_apart(file: Path) -> None:
    checks: list[tuple[int, int]] = []
    steps: list[tuple[int, int]] = []
    result = track_file(file, lambda *at: steps.append(at), checking=lambda *at: checks.append(at))
    total = NODES + CLEARANCE
    assert checks == [*((k, total) for k in range(1, NODES + 1)), (total, total)]
    assert steps == [(k, len(result.u)) for k in range(1, len(result.u) + 1)]


class Screen(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_stages_share_a_bar(monkeypatch: pytest.MonkeyPatch) -> None:
    screen = Screen()
    monkeypatch.setattr(sys, "stderr", screen)
    with stages("checking", "place") as stage:
        checking, moving = stage("checking", "place"), stage("moving", "step")
        for report, total in ((checking, 2), (moving, 4)):
            for done in range(1, total + 1):
                report(done, total)
    shown = screen.getvalue()
    shown_first, _, then = shown.partition("moving:   0%")
    assert shown_first.startswith("\rchecking: 0place") and "/4" not in shown_first
    assert then.rstrip().split("\r")[-1].startswith("moving: 100%") and "step/s" in then


@pytest.mark.parametrize("words", [(), ("--compare", "--ideal"), ("--ideal",)])
def test_the_command_shows_both(
    file: Path, monkeypatch: pytest.MonkeyPatch, words: tuple[str, ...]
) -> None:
    """Whichever run it is: what is handed over names its stage."""
    names: list[str] = []

    def stage(what: str, unit: str) -> str:
        names.append(f"{what} by {unit}")
        return what

    class Stages:
        def __init__(self, *first: str) -> None:
            assert first == ("checking the path", "place")

        def __enter__(self) -> Any:
            return stage

        def __exit__(self, *_: object) -> None: ...

    def run(path: Path, tracking: str, how: str | None, checking: str, by: object = None) -> None:
        assert checking == "checking the path" and tracking.startswith("tracking")
        raise SceneError("as far as this")

    for place in ("softmpc.cli.track.stages", "softmpc.cli.track_rig.stages"):
        monkeypatch.setattr(place, Stages)
    for place in ("tracking.track_file", "compare.compare_file"):
        monkeypatch.setattr(f"softmpc.control.{place}", run)
    monkeypatch.setattr("softmpc.rig.rigging.run_rig_file", run)
    done = CliRunner().invoke(main, ["track", str(file), *words])
    assert (done.exit_code, done.stderr) == (2, "error: as far as this\n")
    last = "tracking by step" if words else "tracking on the rig by step"
    assert names == ["checking the path by place", last]


def test_an_interrupted_comparison_keeps_what_is_done(
    file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also while a controller is made, which is CasADi's work."""

    def late(self: Regulated, *_: object) -> None:
        interrupt()

    monkeypatch.setattr(Regulated, "__init__", late)
    done = CliRunner().invoke(main, ["track", str(file), "--ideal", "--compare", "--json"])
    assert done.exit_code == 130, done.output
    assert done.stderr.endswith("error: interrupted in the run of feed-forward or after it\n")
    assert list(json.loads(done.stdout)["controllers"]) == ["real-time", "feed-forward"]


# ---------------------------------------------------------------- what is wrong, and where


@pytest.mark.sampled
@pytest.mark.parametrize(
    ("run", "old", "new", "said"),
    [
        (track_file, "0.01, 0.0, 0.51", "0.01, 0.0, 510", r"\[track\]: the path is out of reach:"),
        (compare_file, "0.0, 0.0, 0.5]", "0.0, 0.0, 500]", r"\[track\]: the path is out of reach:"),
        (
            run_rig_file,
            "0.01, 0.0, 0.51",
            "0.01, 0.0, 510",
            r"\[track\]: the path is out of reach:",
        ),
        (run_rig_file, "horizon = 2", "step = 0.0125", r"\[track.controller\] step = 0.0125 s"),
        (
            run_rig_file,
            "wait = 0.0",
            'faults = [{kind = "payload_dropped", start = 0.1, duration = 0.1}]',
            r"\[rig\]: fault 'payload_dropped'",
        ),
        (
            track_file,
            "horizon = 2",
            "scene = {actuation = {kind = 'hydraulic-friction'}, hydraulics = {friction = 9.0}}",
            r"\[track.controller\]: this problem carries the drive 'hydraulic-friction'",
        ),
        (
            track_file,
            "horizon = 2",
            "torque_rate = 0.01",
            r"\[track\]: the path is infeasible:\n  torque rate: t = .*raise torque_rate in",
        ),
    ],
)
def test_errors_name_the_file(
    file: Path, run: Callable[[Path], Any], old: str, new: str, said: str
) -> None:
    with pytest.raises((InputError, BuildError), match=rf"(?s)^{file}: {said}"):
        run(changed(file, old, new))


@pytest.mark.parametrize(
    ("kind", "said"),
    [
        ("torque rate", "raise torque_rate"),
        ("torque rate at speed", "raise torque_rate"),
        ("bandwidth", "raise tip_deviation"),
        ("torque at speed", "torque_max"),
    ],
)
def test_advice_names_what_to_raise(kind: str, said: str) -> None:
    finding = Finding(kind, 0.0, 1.0, (0.1, 0.0, 0.5), 1.0, "N·m/s")
    with pytest.raises(SceneError, match=rf"give it more time \(lap_time\), or .*{said}"):
        _stop_where_infeasible([finding])
    _stop_where_infeasible([])


@pytest.mark.parametrize(
    ("path", "said"),
    [
        (
            "'figure-eight'\ncenter = [0, 0, 0.5]",
            "width: is missing: how wide the eight is, .* in m",
        ),
        ("'circle'\ncenter = [0, 0, 0.5]", "diameter: is missing: that of the circle, a number in"),
        ("'circle'\ndiamter = 0.1", "center: is missing: the middle of the path, a list of 3 val"),
        ("'circle'\ncentre = [0, 0, 0.5]", "center: is missing; is it 'centre', misspelt"),
        ("'line'\nstart = [0, 0, 0.5]", "end: is missing: the place where the line ends, a list"),
        ("'waypoints'", "file: is missing: a CSV file with columns x, y, z in m, a text in quotes"),
    ],
)
def test_missing_keys_are_explained(tmp_path: Path, path: str, said: str) -> None:
    """And no key is suggested that is not alike, such as 'settle' for 'file'."""
    file = tmp_path / "scene.toml"
    file.write_text(f"[track]\npath = {path}\nsettle = 0.1\n", encoding="utf-8")
    with pytest.raises(SceneError, match=rf"scene.toml: \[track\] {said}"):
        track_file(file)


@pytest.mark.parametrize(
    ("key", "said"),
    [
        ("controller", r"\[track.controller\]"),
        ("plant", r"\[track.plant\]"),
        ("sensors", r"\[rig.section_tips\]"),
        ("estimator", r"\[rig.estimator\]"),
        ("faults", r"\[\[rig.faults\]\]"),
    ],
)
def test_tables_in_the_wrong_place(key: str, said: str) -> None:
    with pytest.raises(SceneError, match=rf"^\[{key}\] at the top of the file: write {said}"):
        check_document({"track": {}, key: {}})
    with pytest.raises(SceneError) as caught:  # they are not allowed there either
        check_document({"zzz": {}})
    assert key not in str(caught.value)


def test_meaning_is_said_with_what_is_wanted() -> None:
    table = Table({}, "[x]")
    with pytest.raises(SceneError, match=r"^\[x\] a: is missing: the share, a number$"):
        table.number("a", doc="the share")
    with pytest.raises(SceneError, match=r"^\[x\] b: is missing: a text, one of u, v$"):
        table.string("b", allowed=("u", "v"))
