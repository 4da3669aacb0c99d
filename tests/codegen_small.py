"""A small controller in C for tests, and programs around it."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from arms import PAPER, arm

from softmpc.codegen import generate
from softmpc.control.closed_loop import Start, start_at
from softmpc.control.costs import StrainRate, TipPosition, Torque, TorqueRate
from softmpc.control.limits import PressureLimit, StrainLimit, TorqueLimit, TorqueRateLimit
from softmpc.control.mpc import Mpc
from softmpc.control.ocp import Ocp
from softmpc.control.real_time import RealTime
from softmpc.control.transcription import Transcription
from softmpc.model.model import build
from softmpc.model.scene import Scene
from softmpc.simulation.runge_kutta import RadauIIA
from softmpc.statics.equilibrium import find_equilibrium, pressures_from_torques

BOARD = Path(generate.__file__).parent / "c" / "board"
REPLAY = BOARD / "steps.c", BOARD / "linux_main.c"  # recorded steps from standard input
FUZZ = (Path(__file__).parent / "codegen_c" / "fuzz.c",)
COMPILERS = ("gcc", "clang")
STRICT = ("-Wall", "-Wextra", "-Wpedantic", "-Werror")
SANITIZERS = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all")
SINGLE = {
    "gcc": ("-DSMPC_FLOAT", "-fsingle-precision-constant"),
    "clang": ("-DSMPC_FLOAT", "-Xclang", "-cl-single-precision-constant"),
}  # fmt: skip
INTERVALS, STEP = 8, 0.025
HIGHEST, RATE, TORQUE = 2.5, 0.4, np.full(3, 0.8)
LIMITS = (
    TorqueLimit(0.0, HIGHEST), TorqueRateLimit(-RATE, RATE), PressureLimit(0.0, 1.2e6),
    StrainLimit(-0.2, 0.4, soft=1e-4),
)  # fmt: skip


def needs(*tools: str) -> pytest.MarkDecorator:
    """Skips where one of these programs is not installed."""
    absent = [tool for tool in tools if shutil.which(tool) is None]
    return pytest.mark.skipif(bool(absent), reason=f"{' and '.join(absent)} not installed")


@cache
def transcription() -> Transcription:
    """One section, hard limits of torque, its rate and pressure, soft ones of stretch."""
    model = build(Scene(arm(PAPER.sections[0])))
    costs = (TipPosition(), Torque(), TorqueRate(), StrainRate())
    return Transcription(Ocp(model, INTERVALS, STEP, costs, LIMITS))


def controller() -> Mpc:
    return Mpc(transcription(), RealTime(transcription(), mode="never"))


@cache
def start() -> Start:
    """At rest under TORQUE."""
    model = transcription().model
    return start_at(model, find_equilibrium(model, pressures_from_torques(model, TORQUE)))


def home() -> np.ndarray:
    """Place of the tip at rest."""
    model = transcription().model
    return np.asarray(model.tip(start().x[: model.strains])).ravel()


@cache
def folder(iterations: int = 1000) -> Path:
    """The generated directory; those of one process share it."""
    made = Path(tempfile.mkdtemp(prefix="codegen-", dir=scratch())) / "controller"
    generate.generate_controller(controller(), made, start=start(), iterations=iterations)
    return made


@cache
def scratch() -> str:
    """Where conftest.py tidies up."""
    os.makedirs(os.environ["SOFTMPC_CACHE"], exist_ok=True)
    return os.environ["SOFTMPC_CACHE"]


def sources(directory: Path) -> list[Path]:
    """C files of the controller, without programs that use it."""
    return sorted(directory.glob("*.c"))


def is_own(source: Path) -> bool:
    """Whether neither CasADi nor the authors of DAQP wrote it."""
    return not source.name.startswith(("model_", "daqp"))


def compile_objects(
    files: Sequence[Path], into: Path, flags: Sequence[str], cc: str = "gcc"
) -> list[Path]:
    """An object file of each."""
    into.mkdir(parents=True, exist_ok=True)
    found = []
    for source in files:
        found.append(into / f"{source.stem}.o")
        place = [f"-I{source.parent}", "-o", str(found[-1])]
        run([cc, "-std=c99", *flags, "-c", str(source), *place])
    return found


def program(
    directory: Path,
    files: Sequence[Path],
    into: Path,
    flags: Sequence[str],
    controller: Sequence[Path] = (),
    cc: str = "gcc",
) -> Path:
    """A program of these files and the controller: its objects, or else its sources."""
    both = list(files) if controller else [*sources(directory), *files]
    objects = [*controller, *compile_objects(both, into, [*flags, f"-I{directory}"], cc)]
    made = into / "program"
    run([cc, *flags, *map(str, objects), "-o", str(made), "-lm"])
    return made


def run(words: Sequence[str], given: bytes | None = None, seconds: float = 300.0) -> bytes:
    """What a command prints; fails with its complaint."""
    done = subprocess.run(words, input=given, capture_output=True, timeout=seconds, check=False)
    said = (done.stdout[-2000:] + done.stderr[-4000:]).decode(errors="replace")
    assert done.returncode == 0, f"{' '.join(words)} ended with {done.returncode}\n{said}"
    return done.stdout


def closed_loop(steps: int, seed: int = 3) -> tuple[np.ndarray, np.ndarray]:
    """Numbers given to the controller in each step (references, u_before, x) and its inputs.

    Targets jump, far enough to reach the limits.
    """
    mpc, at, random = controller(), start(), np.random.default_rng(seed)
    plant, x, u = RadauIIA(transcription().model, tolerance=1e-5), at.x, at.u
    given, answers = [], []
    for k in range(steps):
        if k % 10 == 0:
            target = home() + random.uniform(-1, 1, 3) * [0.1, 0.1, 0.02]
        references = np.tile(target, (INTERVALS, 1))
        given.append(np.concatenate([references.ravel(), u, x]))
        u = mpc.step(x, u, references).u
        answers.append(u)
        x = plant.advance(x, u, STEP)[-1]
    return np.array(given), np.array(answers)
