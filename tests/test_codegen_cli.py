"""`softmpc codegen` and `softmpc track --controller c` as a user calls them."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from softmpc.cli.main import main
from softmpc.compiler import compiler

SCENE = """
schema = 1
title = "A short line"
[model]
segments = 1
[actuation]
kind = "slow-mode"
[track]
path = "line"
start = [0.10, 0.0, 0.57]
end = [0.13, 0.02, 0.57]
lap_time = 1.2
laps = 0.5
smooth_start = 0.3
settle = 0.1
[track.plant]
tolerance = 1e-5
[track.controller]
horizon = 4
"""


@pytest.fixture(autouse=True)
def no_clearance(monkeypatch: pytest.MonkeyPatch) -> None:
    """What the path clears does not matter here, and takes seconds."""
    monkeypatch.setattr("softmpc.control.tracking.find_clearance", lambda *given: given[2](6, 6))


def call(*words: object) -> Result:
    return CliRunner().invoke(main, [str(word) for word in words])


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("scene") / "line.toml"
    path.write_text(SCENE)
    return path


@pytest.mark.slow
@pytest.mark.skipif(compiler() is None, reason="no C compiler")
def test_the_same_run_in_c(scene: Path, tmp_path: Path) -> None:
    """Same loop, same report; and its log replays to the bit."""
    log = tmp_path / "flight.log"
    python = call("track", scene, "--json")
    c = call("track", scene, "--controller", "c", "--record", log, "--json")
    assert python.exit_code == c.exit_code == 0, c.output
    theirs, ours = (json.loads(run.stdout) for run in (python, c))
    assert ours["controller"] == "real-time in C"
    assert theirs.keys() == ours.keys()
    assert ours["rms_error_mm"] == pytest.approx(theirs["rms_error_mm"], rel=1e-6)
    replayed = call("replay", log, "--with", "c", "--json")
    assert replayed.exit_code == 0, replayed.output
    assert not list(tmp_path.glob(".*"))


def test_a_directory_is_written(scene: Path, tmp_path: Path) -> None:
    out = tmp_path / "my controller"
    made = call("codegen", scene, "--out", out, "--iterations", 50, "--max-rows", 12, "--json")
    assert made.exit_code == 0, made.output
    said = json.loads(made.stdout)
    assert (said["inputs"], said["intervals"], said["max_rows"]) == (6, 4, 12)
    sizes = (out / "sizes.h").read_text()
    assert "#define SMPC_QP_ITERATIONS 50" in sizes
    assert f'"{said["scene_hash"]}"' in sizes
    again = call("codegen", scene, "--out", out)  # over itself, with other settings
    assert again.exit_code == 0
    assert f"make -C '{out}' test" in again.stdout
    assert "#define SMPC_QP_ITERATIONS 1000" in (out / "sizes.h").read_text()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["codegen", "SCENE"], "give --out DIR"),
        (["codegen", "none.toml", "--out", "DIR"], "none.toml"),
        (["codegen", "SCENE", "--out", "DIR", "--iterations", "0"], "0 is not in the range"),
        (["codegen", "SCENE", "--out", "DIR", "--controller", "pid"], "'pid' is not one of"),
        (
            ["codegen", "SCENE", "--out", "DIR", "--controller", "lqr", "--max-rows", "3"],
            "--max-rows is for the quadratic program of --controller nmpc; lqr has none",
        ),
        (["codegen", "SCENE", "--out", "FULL"], "not a controller's"),
        (["codegen", "SCENE", "--controller", "lqr", "--out", "FULL"], "not a controller's"),
        (["codegen", "SCENE", "--out", "DIR", "--workspace", "none.npz"], "none.npz"),
        (["track", "SCENE", "--precision", "float"], "--precision float is for --controller c"),
        (["track", "SCENE", "--compare", "--controller", "c"], "--compare runs controllers"),
        (["track", "SCENE", "--record", "FULL/none/x.log"], "x.log"),
        (["track", "SCENE", "--record", "SCENE"], "is no flight log, and a log would replace it"),
        (["track", "SCENE", "--record", "FULL/thesis.tex"], "is no flight log"),
    ],
)
def test_wrong_words(words: list[str], message: str, scene: Path, tmp_path: Path) -> None:
    """One line that says what is wrong; nothing is written, nothing lost."""
    full = tmp_path / "full"
    full.mkdir()
    (full / "thesis.tex").write_text("years of work")
    (full / "none").write_text("a file, no folder")
    places = {"SCENE": str(scene), "DIR": str(tmp_path / "out"), "FULL": str(full)}
    given = [places.get(word, word.replace("FULL", str(full))) for word in words]
    ended = call(*given)
    assert ended.exit_code == 2
    assert message in ended.stderr
    assert (full / "thesis.tex").read_text() == "years of work"


def test_a_baseline_has_a_footprint_too(
    scene: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without the compiler for a board: what it is asked for, and that it is in the answer."""
    monkeypatch.setattr("softmpc.codegen.footprint.footprint", lambda folder: {"of": str(folder)})
    monkeypatch.setattr("softmpc.codegen.footprint.footprint_table", lambda found: "its table")
    words = "codegen", scene, "--out", tmp_path / "c", "--controller", "lqr", "--footprint"
    made = call(*words, "--json")
    assert made.exit_code == 0, made.output
    assert json.loads(made.stdout)["footprint"] == {"of": str(tmp_path / "c")}


def test_other_solvers_cannot_become_c(scene: Path, tmp_path: Path) -> None:
    other = tmp_path / "ipopt.toml"
    other.write_text(SCENE + 'solver = "ipopt"\n')
    ended = call("codegen", other, "--out", tmp_path / "out")
    assert ended.exit_code == 2
    assert 'set solver = "real-time"' in ended.stderr


def test_no_compiler(scene: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CC", "/nonexistent/cc")
    ended = call("track", scene, "--controller", "c")
    assert ended.exit_code == 2
    assert "no C compiler (CC is set, but /nonexistent/cc is not found)" in ended.stderr


@pytest.mark.slow
@pytest.mark.skipif(not shutil.which("c++"), reason="no C++ compiler")
def test_headers_are_good_guests(scene: Path, tmp_path: Path) -> None:
    """In C++ and in float: they redefine nothing for those who include them."""
    assert call("codegen", scene, "--out", tmp_path / "c").exit_code == 0
    program = tmp_path / "firmware.cpp"
    program.write_text(
        '#include "controller.h"\n#include "monitor.h"\n#include "log.h"\n#include <cmath>\n'
        "double real(double x) { return std::sqrt(x) + sqrt(x); }\n"
        "double last() { return smpc_nodes[SMPC_N - 1]; }\n"
    )
    command = ["c++", "-DSMPC_FLOAT", "-Wall", "-Wextra", "-Werror", "-fsyntax-only"]
    ended = subprocess.run(
        [*command, f"-I{tmp_path / 'c'}", str(program)], capture_output=True, text=True
    )
    assert ended.returncode == 0, ended.stderr


@pytest.mark.slow
def test_files_of_the_user_are_never_replaced(scene: Path, tmp_path: Path) -> None:
    """Neither beside the controller nor in a folder below it; what building makes is."""
    out = tmp_path / "controller"
    assert call("codegen", scene, "--out", out).exit_code == 0
    (out / "build" / "double").mkdir(parents=True)
    (out / "build" / "double" / "nmpc.o").write_text("")
    (out / "src").mkdir()
    (out / "src" / "firmware.c").write_text("int main(void) { return 0; }")
    refused = call("codegen", scene, "--out", out)
    assert refused.exit_code == 2
    assert "not a controller's (src/firmware.c)" in refused.stderr
    assert (out / "src" / "firmware.c").is_file()
    (out / "src" / "firmware.c").unlink()
    (out / "src").rmdir()
    assert call("codegen", scene, "--out", out).exit_code == 0


def test_what_fails_leaves_no_folder(scene: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert call("codegen", tmp_path / "none.toml", "--out", out).exit_code == 2
    assert not out.exists()


@pytest.mark.slow
def test_the_hash_knows_what_was_asked_for(scene: Path, tmp_path: Path) -> None:
    """Two controllers that act otherwise are two builds."""
    hashes = {
        json.loads(call("codegen", scene, "--out", tmp_path / "c", "--json", *more).stdout)[
            "scene_hash"
        ]
        for more in ((), ("--iterations", 7), ("--max-rows", 9), ())
    }
    assert len(hashes) == 3
