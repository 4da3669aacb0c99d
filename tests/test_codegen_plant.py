"""The plant in C and the program that runs a path: against IDAS, and against the Python loop."""

from __future__ import annotations

import shutil
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from c_plant import CPlant, compiled_plant
from codegen_line import (
    command,
    controller,
    heavier_plant,
    line,
    make,
    numbers_of,
    on_cmake,
    on_make,
    run,
    scratch,
)

from softmpc.codegen.directory import c_source
from softmpc.codegen.directory_readme import API, directory_readme, macros_of
from softmpc.codegen.plant import plant_files
from softmpc.codegen.reference import overlapping, references_of
from softmpc.compiler import compiler
from softmpc.control.closed_loop import start_at
from softmpc.control.state_map import StateMap
from softmpc.control.track_result import TrackResult
from softmpc.errors import BuildError, InputError
from softmpc.model.model import Model, build
from softmpc.model.scene_file import scene_from_dict
from softmpc.simulation.columns import read_columns
from softmpc.simulation.idas import Idas
from softmpc.statics.equilibrium import find_equilibrium

pytestmark = pytest.mark.skipif(compiler() is None, reason="no C compiler")

Array = np.ndarray
GRAVITY = {"gravity": [0.0, 0.0, 9.81]}
SCENES: dict[str, dict[str, Any]] = {
    "linear drive": {"effects": GRAVITY},
    "no inertia": {"effects": {**GRAVITY, "inertia": False}},
    "cavities and friction": {
        "effects": {**GRAVITY, "cavitation": True},
        "actuation": {"kind": "hydraulic-friction"},
    },
    "pressures": {"effects": GRAVITY, "actuation": {"kind": "pressure"}},
}
STEP = 0.025
AGREES = 1e-7  # m, at the tip; the program's plant is to be within 1e-6


@cache
def plant_of(name: str) -> CPlant:
    """The plant of a scene, compiled; a controller with a slow mode for a drive sees the first."""
    model = build(scene_from_dict(SCENES[name]))
    return compiled_plant(model, slow() if name == "linear drive" else model, scratch())


@cache
def slow() -> Model:
    return build(scene_from_dict({"effects": GRAVITY, "actuation": {"kind": "slow-mode"}}))


def at_rest(model: Model) -> tuple[Array, Array]:
    start = start_at(model, find_equilibrium(model, 1e5 * np.array([2.0, 1, 1, 1.5, 1, 1])))
    return start.x, start.u


# ---------------------------------------------------------------- the plant


@pytest.mark.sampled
@pytest.mark.parametrize("name", SCENES)
def test_the_plant_moves_as_idas_says(name: str) -> None:
    """Another method, at a tight tolerance, under inputs that jump each step."""
    plant, rng = plant_of(name), np.random.default_rng(3)
    model = plant.model
    oracle, n = Idas(model, 1e-10), model.strains
    x, u = at_rest(model)
    plant.init(x)
    worst = moved = 0.0
    for _ in range(6):
        u = u + rng.uniform(-0.2, 0.2, len(u)) * u.max()
        for _ in range(5):
            assert plant.step(u, STEP / 5) == 0
        x = oracle.advance(x, u, STEP)[-1]
        tips = [np.asarray(model.tip(state[:n])).ravel() for state in (x, plant.x)]
        worst = max(worst, float(np.linalg.norm(tips[1] - tips[0])))
        moved = max(moved, float(np.linalg.norm(plant.tips()[-1] - tips[0])))
        np.testing.assert_allclose(plant.x[2 * n :], x[2 * n :], atol=1e-5 * 1e5)
    assert worst < AGREES
    assert moved < AGREES  # the tips that it gives are those of its state


def test_pieces_of_a_step_are_the_step() -> None:
    plant = plant_of("linear drive")
    x, u = at_rest(plant.model)
    u = u + 0.3
    assert plant.init(x).step(u, STEP) == 0
    whole = plant.x
    plant.init(x)
    for _ in range(25):
        assert plant.step(u, STEP / 25) == 0
    scale = plant.model.layout.x.scale
    np.testing.assert_allclose(plant.x / scale, whole / scale, rtol=0, atol=1e-6)


def test_an_input_that_is_no_number_moves_nothing() -> None:
    plant = plant_of("linear drive")
    x, u = at_rest(plant.model)
    plant.init(x)
    for wrong in (np.nan, np.inf):
        assert plant.step(np.where(np.arange(6) == 2, wrong, u), STEP) == -1
        np.testing.assert_array_equal(plant.x, x)
    assert plant.step(u, STEP) == 0
    tips = np.asarray(plant.model.frames(x[: plant.model.strains])[0]).T
    np.testing.assert_allclose(plant.tips(), tips, atol=1e-9)  # at rest it stays


def test_the_controller_sees_its_own_state() -> None:
    plant = plant_of("linear drive")
    x, u = at_rest(plant.model)
    plant.init(x).step(u + 0.3, STEP)
    found = plant.seen(u + 0.3, len(slow().layout.x))
    n, pressures = 2 * slow().strains, plant.model.drive.C @ plant.x[2 * plant.model.strains :]
    np.testing.assert_array_equal(found[:n], plant.x[:n])
    np.testing.assert_allclose(found, StateMap(plant.model, slow())(plant.x, u + 0.3), rtol=1e-13)
    assert np.abs(found[n:] / pressures - 1).max() < 0.2  # most of the pressure is the slow mode's


def test_plants_that_cannot_be_made() -> None:
    none = {**GRAVITY, "inertia": False, "material_damping": False, "environment_damping": False}
    model = build(scene_from_dict({"effects": none, "actuation": {"kind": "static"}}))
    with pytest.raises(BuildError, match="needs inertia or damping"):
        plant_files(model, model)
    model = line().plant.model
    with pytest.raises(InputError, match=r"tolerance = 0\.5 m"):
        plant_files(model, model, tolerance=0.5)


# ---------------------------------------------------------------- the path


def test_references_are_those_of_the_python_loop() -> None:
    setup = line()
    found = references_of(setup)
    rows, ahead = overlapping(found)
    assert ahead == 1 and len(rows) == len(found) + 7
    for k in (0, 11, len(found) - 1):
        wanted = setup.guide.path.position(setup.ocp.step * (k + 1 + np.arange(8)))
        np.testing.assert_allclose(rows[k : k + 8], wanted, atol=1e-15)


def test_rows_that_disagree_are_written_for_each_step() -> None:
    windows = np.arange(5.0)[:, None, None] + np.arange(3.0)[:, None]  # steps, nodes, references
    assert overlapping(windows)[1] == 1
    windows[2, 1] += 0.1
    rows, ahead = overlapping(windows)
    assert ahead == 3
    np.testing.assert_array_equal(rows, windows.reshape(15, 1))


# ---------------------------------------------------------------- the program


@pytest.fixture(scope="module")
def directory() -> Path:
    folder = controller()
    make(folder)
    return folder


@pytest.fixture(scope="module")
def loop() -> TrackResult:
    return line().run(line().controller)


@on_make
def test_the_program_says_what_the_python_loop_says(
    directory: Path, loop: TrackResult, tmp_path: Path
) -> None:
    code, said = run(directory / "run", "--csv", str(tmp_path / "motion.csv"))
    assert code == 0
    assert said.startswith("30 steps: 30 solved, tip error after 0.1 s: ")
    summary = loop.summary()
    wanted = [summary["rms_error_mm"], summary["max_error_mm"]]
    np.testing.assert_allclose(numbers_of(said), wanted, atol=2e-6)
    table = read_columns(tmp_path / "motion.csv")
    np.testing.assert_allclose(table["t"], loop.time[1:], atol=1e-9)
    for s in (1, 2):
        tips = np.stack([table[f"{axis}_{s}"] for axis in "xyz"], axis=1)
        np.testing.assert_allclose(tips, loop.tips[1:, s - 1], atol=1e-7)
    inputs = np.stack([table[f"u_{j}"] for j in range(1, 7)], axis=1)
    np.testing.assert_allclose(inputs[::25], loop.u, atol=1e-6)


@on_make
def test_options_of_the_program(directory: Path, tmp_path: Path) -> None:
    program = directory / "run"
    code, said = run(program, "--steps", "3")
    assert code == 0 and said.startswith("3 steps: 3 solved, no tip error counts before 0.1 s,")
    for words, complaint in {
        ("--steps", "0"): "not that many steps: 0",
        ("--steps", "31"): "not that many steps: 31",
        ("--steps", "ten"): "not that many steps: ten",
        ("--steps",): "without a value: --steps",
        ("--speed", "2"): "not known: --speed",
        ("--csv", str(tmp_path / "no" / "where.csv")): "cannot be written",
    }.items():
        code, said = run(program, *words)
        assert code == 2 and complaint in said and "usage: run" in said


@on_make
def test_a_step_that_is_not_solved_is_an_exit_status(directory: Path, tmp_path: Path) -> None:
    broken = tmp_path / "broken"
    shutil.copytree(directory, broken)
    source = broken / "demo" / "reference.c"
    text = source.read_text(encoding="utf-8")
    first = "smpc_run_references[111] = {\n    "
    assert first in text
    source.write_text(text.replace(first, f"{first}0.0 / 0.0 + "), encoding="utf-8")
    make(broken)
    code, said = run(broken / "run")
    assert code == 1 and said.startswith("30 steps: 29 solved, 1 input not finite,")


@on_make
@pytest.mark.slow
def test_another_plant_than_the_model_and_float() -> None:
    setup, folder = heavier_plant(), controller(heavier_plant)
    summary = setup.run(setup.controller).summary()
    wanted = np.array([summary["rms_error_mm"], summary["max_error_mm"]])
    assert len(setup.ocp.model.layout.x) < len(setup.start.x) and wanted[0] > 0.1
    make(folder)
    np.testing.assert_allclose(numbers_of(run(folder / "run")[1]), wanted, rtol=1e-4)
    make(folder, "float")
    code, said = run(folder / "run")
    assert code == 0 and numbers_of(said) != pytest.approx(wanted, rel=1e-6)
    np.testing.assert_allclose(numbers_of(said), wanted, rtol=1e-3)
    make(folder, "test")  # in double again: what was built last does not count
    np.testing.assert_allclose(numbers_of(run(folder / "run")[1]), wanted, rtol=1e-4)


@pytest.mark.slow
@on_cmake
def test_cmake_builds_library_and_program(tmp_path: Path) -> None:
    built, folder = tmp_path / "built", controller()
    options = ["-DCMAKE_BUILD_TYPE=Debug", "-DSMPC_WERROR=ON"]
    command("cmake", "-S", str(folder), "-B", str(built), *options)
    command("cmake", "--build", str(built))
    assert "30 solved" in run(built / "run")[1]
    assert "100% tests passed" in command("ctest", "--test-dir", str(built))


@pytest.mark.slow
@pytest.mark.parametrize("compiled_by", ["gcc", "clang"])
def test_the_program_has_no_warnings(compiled_by: str, tmp_path: Path) -> None:
    """Neither have the baselines, whose whole directories `test_codegen_baselines` builds."""
    if shutil.which(compiled_by) is None:
        pytest.skip(f"{compiled_by} not installed")
    folder = controller()
    own = [
        path for path in (folder / "demo").glob("*.c") if not path.name.startswith("plant_model_")
    ]
    assert len(own) == 6
    for precision in ([], ["-DSMPC_FLOAT"]):
        flags = ["-std=c99", "-O2", "-Wall", "-Wextra", "-Wpedantic", "-Werror", *precision]
        for path in own:
            out = str(tmp_path / "one.o")
            command(compiled_by, *flags, f"-I{folder}", "-c", str(path), "-o", out)


@on_make
@pytest.mark.slow
def test_the_loop_is_clean_under_sanitizers(tmp_path: Path) -> None:
    folder = tmp_path / "copy"
    shutil.copytree(controller(), folder, ignore=shutil.ignore_patterns("build"))
    flags = "-O0 -g -fsanitize=address,undefined -fno-sanitize-recover=all"
    command("make", "-C", str(folder), f"CFLAGS={flags}")
    code, said = run(folder / "run")
    assert code == 0, said


# ---------------------------------------------------------------- what lies beside


@on_make
def test_the_interface_of_the_readme_compiles(tmp_path: Path) -> None:
    folder = controller()
    text = (folder / "README.md").read_text(encoding="utf-8")
    assert (
        f"```c\n{API}```" in text and "DAQP" in text and "# A controller in C: Short line" in text
    )
    macros = macros_of((folder / "sizes.h").read_text(encoding="utf-8"))
    assert macros["SCENE_HASH"] in text and f"softmpc {macros['VERSION']}" in text
    source = tmp_path / "api.c"
    source.write_text(API, encoding="utf-8")
    flags = ("-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Werror", f"-I{folder}")
    command("cc", *flags, "-c", str(source), "-o", str(tmp_path / "api.o"))
    assert len(API.splitlines()) <= 18


def test_the_readme_says_what_there_is() -> None:
    folder, model = controller(), line().ocp.model
    texts = {
        str(path.relative_to(folder)): path.read_text(encoding="utf-8")
        for path in folder.rglob("*")
        if path.is_file() and "build" not in path.parts and path.name not in ("run", "libsmpc.a")
    }
    text = directory_readme(model, texts, "Short line")
    assert "`make float` builds the same" in text and "| `daqp/` |" in text
    refused = {**texts, "sizes.h": texts["sizes.h"] + '#error "too few digits"\n'}
    assert "`make float` is refused" in directory_readme(model, refused)
    alone = {name: part for name, part in texts.items() if "/" not in name}
    assert "daqp" not in directory_readme(model, alone)


def test_the_licence_is_the_projects() -> None:
    root = Path(__file__).parents[1] / "LICENSE"
    assert c_source("LICENSE") == root.read_text(encoding="utf-8")
