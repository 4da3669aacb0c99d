"""Workspaces on their way: workers, going on, files, pictures, the command; and their geometry."""

from __future__ import annotations

import csv
import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner, Result

from softmpc.cli.main import main
from softmpc.errors import InputError
from softmpc.model.model import Model, build
from softmpc.model.presets import chen2022
from softmpc.model.scene import Scene
from softmpc.statics import workspace
from softmpc.statics.workspace import find_workspace
from softmpc.statics.workspace_result import Workspace
from softmpc.statics.workspace_shell import Shell, clenshaw_curtis
from softmpc.sweeps import sweep
from softmpc.view.workspace import limit_postures_figure, workspace_figure
from softmpc.view.workspace_cut import limit_postures, workspace_cut_figure

ONE = replace(chen2022(), sections=chen2022().sections[:1])
TINY = {"azimuths": 4, "polars": 5, "samples": 100}
SCENE = """
title = "One section"
[manipulator]
sections = 1
"""


@pytest.fixture(scope="module")
def model() -> Model:
    return build(Scene(ONE))


@pytest.fixture(scope="module")
def space(model: Model) -> Workspace:
    return find_workspace(model, executor=1, **TINY).titled("tiny")


def assert_same(one: Workspace, two: Workspace) -> None:
    assert one.summary() | {"wall_s": 0} == two.summary() | {"wall_s": 0}
    for side in ("outer", "inner"):
        for name, value in vars(getattr(one, side)).items():
            assert np.array_equal(value, getattr(getattr(two, side), name), equal_nan=True), name
    for a, b in zip(one.extremes, two.extremes, strict=True):
        assert a.value == b.value and np.array_equal(a.place.q, b.place.q)


# ---------------------------------------------------------------- sweeps


@pytest.mark.slow
def test_workers_do_not_change_the_result(
    model: Model, space: Workspace, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(workspace, "FEW", 10)  # small sweeps too go to processes
    assert_same(find_workspace(model, executor=2, **TINY), space)


@pytest.mark.slow
def test_it_goes_on_from_where_it_was(model: Model, space: Workspace, tmp_path: Path) -> None:
    told: list[float] = []

    def stop(done: float, total: float) -> None:
        assert total == 100
        told.append(done)
        if done > 50:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        find_workspace(model, executor=1, progress=stop, keep=tmp_path, **TINY)
    assert told == sorted(told)
    before = {path.name: path.stat().st_size for path in tmp_path.iterdir()}
    assert "samples.jsonl" in before and "nodes.jsonl" in before
    again: list[float] = []
    found = find_workspace(
        model, executor=1, progress=lambda d, t: again.append(d), keep=tmp_path, **TINY
    )
    assert_same(found, space)
    assert again[-1] <= 100
    assert (tmp_path / "samples.jsonl").stat().st_size == before["samples.jsonl"]
    with pytest.raises(InputError, match="samples"):
        find_workspace(model, executor=1, keep=tmp_path, **TINY | {"samples": 120})


# ---------------------------------------------------------------- files


def test_files(space: Workspace, tmp_path: Path) -> None:
    paths = space.save(tmp_path)
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted(p.name for p in paths)
    again = Workspace.load(tmp_path / "workspace.npz")
    assert_same(again, space)
    assert again.title == "tiny"
    assert again.contains(space.points, 1e-6).all()
    with (tmp_path / "workspace.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 2 * 4 * 5
    for row in rows:
        place = np.array([float(row[f"{axis} [m]"]) for axis in "xyz"])
        assert np.linalg.norm(place) == pytest.approx(float(row["radius [m]"]))
        assert row["flag"] == "1"
    with (tmp_path / "limits.csv").open(encoding="utf-8") as file:
        limits = list(csv.DictReader(file))
    assert len(limits) == 6 + 6
    assert float(limits[0]["value"]) == space.extents[0, 0] == float(limits[0]["x [m]"])


def test_files_of_a_curve(model: Model, tmp_path: Path) -> None:
    space = find_workspace(model, held={1: 0.0, 2: 0.0}, executor=1, **TINY)
    space.save(tmp_path)
    again = Workspace.load(tmp_path)
    assert again.held == {1: 0.0, 2: 0.0} and again.shell is None
    assert np.array_equal(again.points, space.points)
    with (tmp_path / "workspace.csv").open(encoding="utf-8") as file:
        assert {row["surface"] for row in csv.DictReader(file)} == {"sample"}


@pytest.mark.parametrize("content", [b"", b"no zip", None])
def test_files_that_are_none(content: bytes | None, tmp_path: Path) -> None:
    path = tmp_path / "workspace.npz"
    if content is not None:
        path.write_bytes(content)
    for given in (path, tmp_path):  # a folder stands for its file
        with pytest.raises(InputError, match="no such file" if content is None else "not a saved"):
            Workspace.load(given)


# ---------------------------------------------------------------- pictures


def test_pictures(model: Model, space: Workspace) -> None:
    whole = workspace_figure(model, space)
    assert {text.get_text() for text in whole.legends[0].get_texts()} == {
        "outer surface, cut open", "inner surface",
    }  # fmt: skip
    cut = workspace_cut_figure(model, space)
    lines = {line.get_label(): line for line in cut.axes[0].get_lines()}
    side = lines["outer surface"].get_xydata()
    assert side[:, 0].max() == pytest.approx(space.outer.tips[0, :, 0].max(), abs=2e-3)
    assert side[:, 1].max() == pytest.approx(space.extents[2, 1], abs=1e-6)
    assert "posture: largest x" in lines
    postures = limit_postures(space)
    assert list(postures) == ["smallest x", "largest x", "smallest z", "largest z"]
    assert len(limit_postures_figure(model, postures).axes) == 4


@pytest.mark.sampled
@pytest.mark.parametrize("held", [{1: 0.0}, {1: 0.0, 2: 0.0}, {1: 0.0, 2: 0.0, 3: 0.0}])
def test_pictures_without_a_shell(model: Model, held: dict[int, float]) -> None:
    space = find_workspace(model, held=held, executor=1, **TINY)
    whole = workspace_figure(model, space)
    assert len(whole.axes[0].get_lines()[-1].get_data_3d()[0]) == len(space.samples)
    names = {line.get_label() for line in workspace_cut_figure(model, space).axes[0].get_lines()}
    assert "outer surface" not in names


def test_picture_of_a_plane() -> None:
    arm = build(Scene(ONE, strains=("epsilon", "kappa_y")))
    space = find_workspace(arm, executor=1, **TINY)
    names = {line.get_label() for line in workspace_cut_figure(arm, space).axes[0].get_lines()}
    assert {"outer surface", "inner surface"} <= names
    assert workspace_figure(arm, space).axes


# ---------------------------------------------------------------- geometry


def test_clenshaw_curtis_is_exact_for_polynomials() -> None:
    for count in (5, 9, 13):
        nodes, weights = clenshaw_curtis(count)
        assert nodes[[0, -1]] == pytest.approx([0, 1])
        for power in range(count):
            assert weights @ nodes**power == pytest.approx(1 / (power + 1)), (count, power)


def ball(azimuths: np.ndarray, rims: Sequence[float], outer: float, inner: float) -> Shell:
    nodes, _ = clenshaw_curtis(13)
    shape = (len(azimuths), 13)
    return Shell(
        np.eye(3), azimuths, np.tile(rims, (len(azimuths), 1)), nodes,
        np.full(shape, outer), np.full(shape, inner), False,
    )  # fmt: skip


def test_volume_of_a_cap() -> None:
    uneven = np.sort(np.random.default_rng(0).uniform(0, 2 * np.pi, 12))
    for azimuths in (np.arange(8) * np.pi / 4, uneven):
        volume, error = ball(azimuths, (0, 1.2), 2.0, 1.0).volume
        assert volume == pytest.approx(2 * np.pi * (1 - np.cos(1.2)) * 7 / 3, rel=1e-9)
        assert error < 1e-4


def test_distance_outside_a_cap() -> None:
    cap = ball(np.arange(8) * np.pi / 4, (0, np.pi / 2), 2.0, 1.0)
    places = [[0, 0, 1.5], [0, 0, 2.5], [0, 0, 0.25], [1.5, 0, -0.3], [0, -1.2, -0.4], [0, 0, 0]]
    found = cap.outside(np.array(places))
    assert found == pytest.approx([0, 0.5, 0.75, 0.3, 0.4, 1.0])


# ---------------------------------------------------------------- the command


def run(*words: Any) -> Result:
    return CliRunner().invoke(main, [str(word) for word in words])


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    path = tmp_path / "scene.toml"
    path.write_text(SCENE, encoding="utf-8")
    return path


GRID = ("--azimuths", 4, "--polars", 5, "--workers", 1)


@pytest.mark.slow
def test_command(scene: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    done = run("workspace", scene, *GRID, "--check", 50, "--json", "--out", out)
    assert done.exit_code == 0, done.output
    data = json.loads(done.stdout)
    assert data["dimension"] == 3 and data["section"] == 1
    assert data["check"]["outside_mm"] < 1 and data["check"]["unreachable_points"] == 0
    assert data["points"]["outer"] == {
        "confirmed": 20, "beyond": 0, "missing": 0, "all_stable": True,
    }  # fmt: skip
    assert sorted(p.name for p in out.iterdir()) == [
        "limit_postures.png", "limits.csv", "workspace.csv", "workspace.json", "workspace.npz",
        "workspace.png", "workspace_cut.png",
    ]  # fmt: skip
    assert Workspace.load(out / "workspace.npz").volume == data["volume_m3"]


@pytest.mark.slow
def test_command_for_people(scene: Path) -> None:
    done = run("workspace", scene, *GRID, "--hold", "1=0.2", "--hold", "2=0.2")
    assert done.exit_code == 0, done.output
    assert "a curve" in done.stdout and "warning" in done.stdout
    assert "largest radius" in done.stdout and "inf" not in done.stdout


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--section", 3), "sections 1 to 1"),
        (("--azimuths", 5), "even number"),
        (("--polars", 6), "odd number"),
        (("--hold", "7=0.1"), "units 1 to 3"),
        (("--hold", "1=5"), "must be between"),
        (("--hold", "x"), "UNIT=MPA"),
        (("--hold", "1=0.2", "--hold", "1=0.1"), "unit 1 twice, 0.2 and 0.1 MPa"),
    ],
)
def test_command_with_wrong_input(scene: Path, options: tuple[Any, ...], message: str) -> None:
    done = run("workspace", scene, *options)
    assert done.exit_code == 2
    assert message in done.stderr


def test_what_another_search_left_is_told(scene: Path, tmp_path: Path) -> None:
    parts = tmp_path / "out" / "workspace_parts"
    parts.mkdir(parents=True)
    sweep(len, [[1], [2]], executor=1, keep=parts / "samples.jsonl")
    done = run("workspace", scene, *GRID, "--out", tmp_path / "out")
    assert done.exit_code == 2
    assert f"{parts} is what an interrupted search of another scene or with other" in done.stderr
