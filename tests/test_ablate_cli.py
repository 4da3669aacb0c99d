"""`softmpc ablate` and `simulate --certify` end to end: answers, files, pictures, errors."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result

from softmpc.cli.main import main
from softmpc.model.scene_file import load_scene
from softmpc.study import ablate as study
from softmpc.study.ablate import Ablation, Baseline, Row, ablate_file
from softmpc.study.changes import Change
from softmpc.view.ablation import ablation_figure

SWING = """
title = "Swing"
[manipulator]
sections = 2
[model]
strains = ["epsilon", "kappa_y"]
[actuation]
kind = "static"
[simulate]
duration = 0.1
steps = [{ unit = 1, at = 0.0, torque = 1.0 }]
"""


@pytest.fixture(autouse=True, scope="module")
def _quick() -> Iterator[None]:
    """Each run takes a fraction of a second: compiling it would take longer."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SOFTMPC_COMPILE", "never")
        yield


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("scene") / "swing.toml"
    path.write_text(SWING, encoding="utf-8")
    return path


def softmpc(*words: object) -> Result:
    return CliRunner().invoke(main, [str(word) for word in words])


@dataclass
class Answered:
    """One run of the command, and what it drew."""

    result: Result
    out: Path
    found: Ablation


@pytest.fixture(scope="module")
def answered(scene: Path) -> Answered:
    out, kept = scene.parent / "out", []
    words = ("ablate", scene, "--repeats", 1, "--tolerance", "2mm", "--out", out, "--json")

    def keeping(*args: Any, **options: Any) -> Ablation:
        kept.append(ablate_file(*args, **options))
        return kept[-1]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(study, "ablate_file", keeping)
        return Answered(softmpc(*words), out, kept[0])


def test_json_is_pure(answered: Answered) -> None:
    result, out = answered.result, answered.out
    assert result.exit_code == 0, result.output
    data = json.loads(result.stdout)
    assert result.stdout.count("\n") == 1
    assert (data["title"], data["status"]) == ("Swing", "finished")
    assert json.loads((out / "ablate.json").read_text(encoding="utf-8")) == data
    row = data["rows"][0]
    assert row["change"] == "without inertia (nor coriolis)"
    assert row["max_error_m"] == row["max_errors_by_section_m"][1]
    assert len(row["max_errors_by_section_m"]) == 2


def test_files(answered: Answered) -> None:
    result, out = answered.result, answered.out
    assert {p.name for p in out.iterdir()} == {
        "ablate.json",
        "ablation.csv",
        "ablation.png",
        "proposed.toml",
    }
    lines = (out / "ablation.csv").read_text(encoding="utf-8").splitlines()
    data = json.loads(result.stdout)
    assert len(lines) == 1 + len(data["rows"])
    assert lines[0].startswith("change,kind,slot,status,max_error_m,rms_error_m,max_errors_m_1")
    assert data["proposal"]["within"]
    proposed, given = load_scene(out / "proposed.toml"), load_scene(out.parent / "swing.toml")
    assert set(proposed.effects) <= set(given.effects)
    assert softmpc("simulate", out / "proposed.toml", "--json").exit_code == 0


@pytest.mark.slow
def test_the_proposal_moves_as_long_as_it_was_proved(scene: Path, tmp_path: Path) -> None:
    words = ("--repeats", 1, "--tolerance", "2mm", "--duration", 0.05, "--out", tmp_path)
    assert softmpc("ablate", scene, *words).exit_code == 0
    found = json.loads(softmpc("simulate", tmp_path / "proposed.toml", "--json").stdout)
    assert found["duration_s"] == pytest.approx(0.05)


def test_table_for_people(scene: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    chosen = ("without coriolis", "formulation newton-euler")
    all_variants = study.variants
    picked = lambda scene: [c for c in all_variants(scene) if c.name in chosen]  # noqa: E731
    monkeypatch.setattr(study, "variants", picked)
    result = softmpc("ablate", scene, "--repeats", 1, "--duration", 0.05)
    assert result.exit_code == 0
    text = result.stdout
    assert "0.05 s of motion" in text
    assert "numerical floor" in text
    head, row = text.split("\n\n")[1].splitlines()
    assert " ".join(head.split()) == ("change tip max tip RMS max 1 max 2 time instructions states")
    assert row.startswith("without coriolis  ")
    assert len(head) == len(row)
    assert "not run:\nformulation newton-euler: formulation 'newton-euler' needs" in text


def test_interrupt_writes_a_partial_table(
    scene: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made, run = [], Baseline.row

    def row(self: Baseline, change: Change) -> Row:
        if made:
            raise KeyboardInterrupt
        made.append(change.name)
        return run(self, change)

    monkeypatch.setattr(Baseline, "row", row)
    words = ("ablate", scene, "--repeats", 1, "--out", tmp_path, "--tolerance", "1mm", "--json")
    result = softmpc(*words)
    assert result.exit_code == 130
    assert "interrupted after 1 rows" in result.stderr
    data = json.loads(result.stdout)
    assert (data["status"], len(data["rows"]), data["proposal"]) == ("interrupted", 1, None)
    assert len((tmp_path / "ablation.csv").read_text(encoding="utf-8").splitlines()) == 2
    assert not (tmp_path / "proposed.toml").exists()


def test_a_tolerance_below_the_integration_is_no_success(
    scene: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(study, "variants", lambda scene: [])
    result = softmpc("ablate", scene, "--repeats", 1, "--tolerance", "1e-3um")
    assert result.exit_code == 3
    assert "set a smaller tip_tolerance" in result.stderr
    assert "NOT within" in result.stdout


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("missing.toml",), "no such file"),
        (("--tolerance", "1"), "must be a number with its unit"),
        (("--tolerance", "5km"), "must be a number with its unit"),
        (("--tolerance", "100m"), "must be between"),
        (("--repeats", "0"), "0 is not in the range"),
        (("--duration", "-1"), "must be above 0"),
    ],
)
def test_errors(scene: Path, words: tuple[str, ...], message: str) -> None:
    first = () if words[0].endswith(".toml") else (scene,)
    result = softmpc("ablate", *first, *words)
    assert result.exit_code == 2
    assert result.stderr.startswith("error: ") and message in result.stderr
    assert result.stdout == ""


def test_a_scene_without_motion(tmp_path: Path) -> None:
    path = tmp_path / "still.toml"
    path.write_text('title = "Still"\n', encoding="utf-8")
    result = softmpc("ablate", path)
    assert result.exit_code == 2
    assert "has no table [simulate]" in result.stderr


@pytest.mark.slow
def test_a_scene_that_stops(tmp_path: Path) -> None:
    path = tmp_path / "pull.toml"
    pull = SWING.replace("static", "hydraulic").replace("torque = 1.0", "torque = -1.0")
    path.write_text(pull + "\n[limits]\ntorque_min = -3.0\n", encoding="utf-8")
    result = softmpc("ablate", path)
    assert result.exit_code not in (0, 1)
    assert "nothing to compare, for the scene as given does not come to its end" in result.stderr
    assert "below vapour pressure; add the effect 'cavitation'" in result.stderr
    result = softmpc("simulate", path, "--certify")
    assert result.exit_code == 3
    assert "unknown: there is no motion to run again: stopped: P_c_1 fell" in result.stdout
    path.write_text(path.read_text(encoding="utf-8").replace("at = 0.0", "at = 0.05"), "utf-8")
    result = softmpc("simulate", path, "--certify")
    assert result.exit_code == 3
    assert "only what came before is covered: stopped: P_c_1 fell" in result.stdout


# ---------------------------------------------------------------- certify


@pytest.mark.slow
def test_certify(scene: Path, tmp_path: Path) -> None:
    result = softmpc("simulate", scene, "--certify", "--no-animate", "--out", tmp_path)
    assert result.exit_code == 0, result.output
    assert "accuracy " in result.stdout and "not asked" in result.stdout
    note = json.loads((tmp_path / "simulate.json").read_text(encoding="utf-8"))["certificate"]
    assert note["text"] in result.stdout
    assert note["text"].startswith("model error ")
    assert note["windows_s"] == [[0.0, 0.1]]
    assert note["model_error_m"] > note["numerical_error_m"] > 0
    assert "needs the whole drive" in note["skipped"]["tube_inertance"]
    assert "certificate" not in json.loads(softmpc("simulate", scene, "--json").stdout)


def test_interrupted_certify_keeps_the_motion(scene: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*_: Any, **__: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("softmpc.study.certify.motion_of", interrupted)
    result = softmpc("simulate", scene, "--certify", "--json")
    assert result.exit_code == 130
    data = json.loads(result.stdout)
    assert (data["status"], data["certificate"]) == ("finished", None)
    assert "interrupted while certifying" in result.stderr


# ---------------------------------------------------------------- the picture


def test_names_and_values_do_not_overlap(answered: Answered) -> None:
    found = answered.found
    for tolerance in (None, 1e-3):
        made = ablation_figure(found, tolerance)
        made.draw_without_rendering()
        names = [t for t in made.axes[0].get_yticklabels() if t.get_text()]
        shown = sum(row.errors is not None for row in found.rows)
        assert len(names) == shown
        values = [t for axes in made.axes for t in axes.texts]
        boxes = [t.get_window_extent() for t in [*names, *values]]
        assert [pair for pair in combinations(boxes, 2) if pair[0].overlaps(pair[1])] == []
        assert all(made.bbox.contains(*corner) for box in boxes for corner in box.corners())


def test_picture_of_nothing_that_ran(answered: Answered) -> None:
    found = answered.found
    row = Row(found.rows[0].change, "could not be run")
    empty = Ablation(found.title, "interrupted", found.baseline, (row,))
    assert ablation_figure(empty).axes
