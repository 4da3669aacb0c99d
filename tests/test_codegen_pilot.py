"""The pilot in C: the same loop as with the one in Python, fault by fault; and it never lets go."""

from __future__ import annotations

import ctypes
import json
import re
import shutil
import subprocess
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from softmpc.cli.main import main
from softmpc.codegen import c_text
from softmpc.codegen.compiled_pilot import CompiledPilot
from softmpc.codegen.estimator_pilot import LOG, files
from softmpc.codegen.generate import generate, generate_controller, generate_file
from softmpc.control.closed_loop import Start
from softmpc.control.tracking import read_track_file
from softmpc.errors import InputError
from softmpc.estimation.sensing import Sample
from softmpc.rig.faults import (
    Absent,
    BudgetOverrun,
    Fault,
    Frozen,
    Jitter,
    NotANumber,
    Scaled,
    Spike,
    Stuck,
)
from softmpc.rig.result import RigResult
from softmpc.rig.rigging import Rig, read_rig_file, rig_up
from softmpc.rig.supervision import State
from tests.c_estimator import COMPILER, OF_FLOAT, STRICT

pytestmark = pytest.mark.skipif(COMPILER is None, reason="needs gcc or clang")
SCENE = """
schema = 1
[effects]
gravity = [0.0, 0.0, 9.81]
[track]
path = "circle"
center = [0.12, 0.0, 0.57]
diameter = 0.06
lap_time = 4.0
laps = 2
settle = 0.5
[track.controller]
horizon = 10
torque_rate = 15.0
back_off = 0.05
[track.plant]
tolerance = 1e-5
scene = {effects = {payload = {mass = 0.1}}}
[rig]
wait = 0.25
seed = 2
command_delay = 0.005
lost_commands = 0.02
[rig.section_tips]
latency = 0.010
dropout = 0.05
[rig.unit_pressures]
[rig.supervision]
blind_after = 0.15
stop_after = 0.4
"""
FAULTS = (
    NotANumber(0.20, 0.15), Frozen(0.50, 0.2, "unit_pressures"), Absent(0.90, 0.8),
    Spike(2.10, 0.3, "section_tips", 0.2), Stuck(2.60, 0.2, (2, 5)), Scaled(2.90, 0.2),
    Jitter(3.20, 0.3), BudgetOverrun(3.60, 0.25),
)  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("pilot")


@pytest.fixture(scope="module")
def rig(folder: Path) -> Rig:
    path = folder / "rig.toml"
    path.write_text(SCENE)
    _, scene, task = read_track_file(path)
    settings = read_rig_file(path)
    assert settings is not None
    return rig_up(scene, task, settings)


@pytest.fixture(scope="module")
def pilot(rig: Rig, folder: Path) -> CompiledPilot:
    generate(rig.setup, folder / "c", demo=False, beside=files(rig.pilot))
    return CompiledPilot(folder / "c", rig.pilot, flags=("-O0",))


def flown(rig: Rig, faults: Sequence[Fault], duration: float) -> RigResult:
    rig.machine.faults = tuple(faults)
    changed = replace(rig, settings=replace(rig.settings, faults=tuple(faults)))
    return changed.run(duration=duration)


def check_same(python: RigResult, c: RigResult, torque: float = 1e-8) -> None:
    """The same states at each step, for the same reasons; inputs and estimates beside."""
    assert np.array_equal(python.state, c.state)
    assert np.abs(python.track.u - c.track.u).max() < torque
    assert np.abs(python.strains - c.strains).max() < torque
    assert [one[:30] for one in python.transitions] == [one[:30] for one in c.transitions]
    assert python.counts == c.counts
    assert np.array_equal(python.innovation_time, c.innovation_time)
    assert np.array_equal(python.accepted, c.accepted)
    assert np.allclose(python.nis, c.nis, rtol=1e-5)


def check_inputs(rig: Rig, u: np.ndarray, start: np.ndarray) -> None:
    """Finite, within the limits of torque and torque rate."""
    guard = rig.setup.controller.guard
    assert np.all(np.isfinite(u)) and np.all(u >= guard.low) and np.all(u <= guard.high)
    change = np.diff(np.vstack([start, u]), axis=0)
    assert np.all(change >= guard.fall - 1e-12) and np.all(change <= guard.rise + 1e-12)


# ---------------------------------------------------------------- in the loop


@pytest.mark.slow
def test_the_same_loop_with_every_fault(rig: Rig, pilot: CompiledPilot) -> None:
    """Eight faults one after the other, a safe stop among what follows."""
    python = flown(rig, FAULTS, 4.4)
    c = flown(replace(rig, pilot=pilot), FAULTS, 4.4)
    check_same(python, c)
    assert set(c.state) == {0, 1, 2, 3}
    said = " | ".join(c.transitions)
    for words in ("no section_tips", "too long in fall-back", "contradict", "budget", "recovered"):
        assert words in said, said
    check_inputs(rig, c.track.u, c.track.u_start)
    assert c.summary()["nis"].keys() == python.summary()["nis"].keys()


@pytest.mark.slow
@pytest.mark.parametrize(("name", "seconds"), [("figure_eight_rig", 4.0), ("circle_faults", 8.0)])
def test_the_same_loop_of_the_examples(name: str, seconds: float, tmp_path: Path) -> None:
    """All of its faults."""
    path = Path(f"examples/{name}.toml")
    _, scene, task = read_track_file(path)
    settings = read_rig_file(path)
    assert settings is not None
    faults = settings.faults
    rig = rig_up(scene, task, settings)
    generate_file(path, tmp_path / "c")
    python = flown(rig, faults, seconds)
    c = flown(replace(rig, pilot=CompiledPilot(tmp_path / "c", rig.pilot)), faults, seconds)
    check_same(python, c)
    assert bool(faults) == bool(c.transitions)


@pytest.mark.slow
def test_the_loop_in_single_precision(rig: Rig, folder: Path, pilot: CompiledPilot) -> None:
    """It tracks as well; the memory is half."""
    single = CompiledPilot(folder / "c", rig.pilot, single=True, flags=("-O1",))
    double, found = (flown(replace(rig, pilot=one), (), 4.0) for one in (pilot, single))
    check_inputs(rig, found.track.u, found.track.u_start)
    errors = [one.summary()["rms_error_mm"] for one in (double, found)]
    assert abs(errors[1] - errors[0]) < 0.1 * errors[0]
    sizes = [int(one.library.smpc_pilot_memory()) for one in (pilot, single)]
    assert 0.49 < sizes[1] / sizes[0] < 0.55


@pytest.mark.slow
def test_track_takes_the_pilot_in_c(folder: Path, rig: Rig) -> None:
    """`softmpc track --controller c`, against Python's; with a log the controller alone is in C."""
    path = folder / "short.toml"
    path.write_text(SCENE.replace("laps = 2", "laps = 0.25"))
    found = []
    for more in ((), ("--controller", "c"), ("--controller", "c", "--record", str(folder / "l"))):
        ended = CliRunner().invoke(main, ["track", str(path), "--json", *more])
        assert ended.exit_code == 0, ended.output
        found.append(json.loads(ended.stdout))
    python, c, recorded = found
    assert c["controller"] == recorded["controller"] == "real-time in C"
    assert c["rms_error_mm"] == pytest.approx(python["rms_error_mm"], abs=1e-6)
    assert recorded["rms_error_mm"] == pytest.approx(python["rms_error_mm"], abs=1e-6)
    assert c["nis"] == pytest.approx(python["nis"]) and c["estimate_ms_median"] > 0
    assert (folder / "l").stat().st_size > 1000


# ---------------------------------------------------------------- what goes wrong


def test_nothing_but_usable_inputs_comes_out(rig: Rig, pilot: CompiledPilot) -> None:
    """Whatever readings, references, places of rest and holding inputs it is given."""
    random, start = np.random.default_rng(8), rig.setup.start
    pilot.reset(rig.seen(start.x, start.u), start.u)
    bad = np.array([np.nan, np.inf, -np.inf, 1e300, -1e12, 5e-324, 0.0, 0.3])
    found = []
    for k in range(120):
        tick = 25 * k + int(random.integers(-30, 30)) * (k % 9 == 8)
        told = [
            random.choice(bad, one.shape) if random.random() < 0.2 else one
            for one in pilot._told(25 * k)
        ]
        told = [pilot.mpc._given(one) for one in told]
        stamps = [tick, tick - 10, -(2**31), 2**31 - 1]
        samples = [
            Sample(int(random.integers(2)), int(random.choice(stamps)), 0, random.choice(bad, 6))
            for _ in range(3)
        ]
        u = pilot.mpc._given(np.full(6, np.nan))
        pilot.library.smpc_pilot_step(pilot._at, tick, *pilot._samples(samples), *told, u)
        found.append(u.array.copy())
    check_inputs(rig, np.array(found), start.u)
    assert State.SAFE_STOP in {one.after for one in pilot.supervisor.log}


def test_after_a_long_pause_it_begins_anew(rig: Rig, pilot: CompiledPilot) -> None:
    """The estimator does not move over a gap of more than a second: a fall-back, and back."""
    start = rig.setup.start
    pilot.reset(rig.seen(start.x, start.u), start.u)
    rig.machine.faults = ()
    states = []
    rig.machine.reset(start.x, start.u)
    for k in range(12):
        tick = 25 * k + 2000 * (k > 1)
        samples = [replace(one, stamp=one.stamp + 2000 * (k > 1)) for one in rig.machine.arrived()]
        act = pilot.step(tick, samples if k != 2 else [])
        states.append(act.state)
        rig.machine.command(act.u)
        rig.machine.run(25)
    assert states[:3] == [State.NORMAL, State.NORMAL, State.FALL_BACK]
    assert states[-1] == State.NORMAL
    assert "the estimator failed: too long" in pilot.supervisor.log[0].cause


def test_what_is_refused(rig: Rig, pilot: CompiledPilot, folder: Path) -> None:
    start = rig.setup.start
    with pytest.raises(InputError, match="finite"):
        pilot.reset(np.nan * start.x, start.u)
    alone = Start(rig.seen(start.x, start.u), start.u)
    generate_controller(rig.setup.controller, folder / "alone", start=alone)
    with pytest.raises(InputError, match="no pilot"):
        CompiledPilot(folder / "alone", rig.pilot)
    usual, rig.pilot.delay = rig.pilot.delay, 17
    with pytest.raises(InputError, match=r"supervision_sizes\.h is that of another rig"):
        CompiledPilot(folder / "c", rig.pilot)
    rig.pilot.delay = usual


def nominal(rig: Rig, pilot: CompiledPilot) -> str:
    """What `fuzz_pilot.c` takes for good: the arm at rest at the start of the path."""
    start, estimator = rig.setup.start, rig.pilot.estimator
    x = rig.seen(start.x, start.u)
    references, _, _ = pilot._told(0)
    read = [reading(x, start.u)[0] for reading in estimator.readings]
    largest = max(map(len, read))
    rows = np.array([np.pad(one, (0, largest - len(one))) for one in read])
    found = "".join(
        c_text.array(f"nominal_{name}", values).replace("const", "static const", 1)
        for name, values in (
            ("x", x), ("u", start.u), ("references", references), ("flat", rows),
            ("noise", [one.noise for one in estimator.sensors]),
        )
    )  # fmt: skip
    return found + (
        f"static const smpc_real (*const nominal_reading)[{largest}] =\n"
        f"    (const smpc_real (*)[{largest}])nominal_flat;\n"
    )


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("gcc") is None, reason="needs gcc")
@pytest.mark.parametrize("single", [False, True])
def test_random_readings_under_sanitizers(
    single: bool, rig: Rig, pilot: CompiledPilot, tmp_path: Path
) -> None:
    """2,500 steps; `fuzz_pilot.c` says what is checked."""
    (tmp_path / "nominal.h").write_text(nominal(rig, pilot))
    program, made = tmp_path / "fuzz", pilot.mpc.folder
    sources = [str(path) for path in made.glob("*.c")]
    checks = ["-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-g"]
    command = ["gcc", "-std=c99", "-O0", *checks, *(OF_FLOAT if single else ()), f"-I{tmp_path}"]
    fuzz = Path(__file__).parent / "codegen_c" / "fuzz_pilot.c"
    subprocess.run(
        [*command, f"-I{made}", str(fuzz), *sources, "-o", str(program), "-lm"], check=True
    )
    ended = subprocess.run([str(program), "2500", "1"], capture_output=True, text=True)
    print(ended.stdout)
    assert not ended.returncode, ended.stderr
    counts = dict(re.findall(r"^  (\D+?):? (\d+)$", ended.stdout, re.MULTILINE))
    for name in ("normal", "degraded", "fall back", "safe stop"):
        assert int(counts[name]) > 50
    assert int(counts["trouble the time is forgotten"]) > 2


# ---------------------------------------------------------------- the C itself


def test_names_of_states_and_causes(pilot: CompiledPilot) -> None:
    library = pilot.library
    library.smpc_state_name.restype = ctypes.c_char_p
    said = [library.smpc_state_name(int(state)).decode() for state in State]
    assert said == [str(state) for state in State]
    causes = [library.smpc_cause_name(i) for i in range(-1, 9)]
    assert causes[0] == causes[-1] == b"unknown" and len(set(causes)) == 9
    assert LOG >= 8


@pytest.mark.skipif(shutil.which("nm") is None, reason="needs nm")
def test_no_memory_is_allocated_and_no_global_changes(pilot: CompiledPilot, tmp_path: Path) -> None:
    for name in ("pilot.c", "supervision.c"):
        target = str(tmp_path / "x.o")
        command = [str(COMPILER), "-std=c99", "-fno-pie", "-c", str(pilot.mpc.folder / name)]
        subprocess.run([*command, "-o", target], check=True)
        lines = subprocess.run(["nm", target], capture_output=True, text=True).stdout.splitlines()
        kinds = [(line.split()[-2], line.split()[-1]) for line in lines]
        elsewhere = {name for kind, name in kinds if kind == "U" and not name.startswith("smpc_")}
        assert elsewhere <= {"memcpy", "memset", "memmove"}
        assert not [name for kind, name in kinds if kind in "bBdDC"]


@pytest.mark.parametrize("name", ["gcc", "clang"])
def test_without_warnings(name: str, pilot: CompiledPilot, tmp_path: Path) -> None:
    if shutil.which(name) is None:
        pytest.skip(f"{name} is not installed")
    for more in ((), ("-DSMPC_FLOAT",)):
        for source in ("pilot.c", "supervision.c", "pilot_data.c"):
            found = subprocess.run(
                [name, *STRICT, *more, "-c", str(pilot.mpc.folder / source), "-o",
                 str(tmp_path / "x.o")],
                capture_output=True, text=True,
            )  # fmt: skip
            assert not found.returncode, found.stderr
