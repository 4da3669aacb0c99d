"""A short line that controllers in C follow, and the directories that are made of it."""

from __future__ import annotations

import atexit
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from softmpc.codegen.baselines import Baseline, generate_baseline
from softmpc.codegen.generate import generate
from softmpc.control import baselines
from softmpc.control.tracking import Setup, read_tracking, set_up
from softmpc.model.presets import chen2022
from softmpc.model.scene import Scene
from softmpc.model.scene_file import scene_to_dict

LINE = {
    "path": "line", "start": [0.1, 0.0, 0.57], "end": [0.13, 0.02, 0.57],
    "lap_time": 1.2, "laps": 0.5, "smooth_start": 0.3, "settle": 0.1,
}  # fmt: skip
PLACES = 2  # of the gains of baselines: each takes a second of work
NOT_OPTIMISED = "CFLAGS=-O0"  # a compiler's time is most of what tests take

on_make = pytest.mark.skipif(
    not (shutil.which("make") and shutil.which("cc")), reason="make or cc not installed"
)
on_cmake = pytest.mark.skipif(not shutil.which("cmake"), reason="cmake not installed")


@cache
def line() -> Setup:
    """The model is the plant."""
    task = read_tracking({**LINE, "controller": {"horizon": 8}}, Path("."))
    return set_up(Scene(chen2022()), task)


@cache
def heavier_plant() -> Setup:
    """The plant has a payload and all modes of the drive, the controller's model neither."""
    scene = Scene(chen2022())
    task = {
        **LINE,
        "controller": {"horizon": 8, "scene": {"actuation": {"kind": "slow-mode"}}},
        "plant": {"scene": {"effects": {"payload": {"mass": 0.02}}}, "method": "radau"},
    }
    return set_up(scene, read_tracking(task, Path("."), scene_to_dict(scene)))


def scratch() -> Path:
    """A folder until the tests end."""
    folder = Path(tempfile.mkdtemp(prefix="codegen-line-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder


@cache
def baseline(kind: str) -> tuple[Path, Baseline]:
    """The directory of a baseline on the line, and the same in Python."""
    folder = scratch() / kind
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(baselines, "PLACES", PLACES)
        return folder, generate_baseline(line(), kind, folder, "Short line")


@cache
def controller(setup: Callable[[], Setup] = line) -> Path:
    """The directory of the predictive controller."""
    folder = scratch() / setup.__name__
    generate(setup(), folder, title="Short line")
    return folder


def make(folder: Path, *words: str) -> str:
    return command("make", "-C", str(folder), NOT_OPTIMISED, *words)


def command(*words: str) -> str:
    """What it prints; it has to end well."""
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout


def run(program: Path, *words: str) -> tuple[int, str]:
    """Exit status and what was said."""
    done = subprocess.run(
        [str(program), *words], capture_output=True, text=True, check=False, timeout=120
    )
    return done.returncode, done.stdout + done.stderr


def numbers_of(line: str) -> np.ndarray:
    """RMS and largest error (mm) of the program's summary."""
    words = line.replace(",", "").split()
    return np.array([float(words[words.index(unit) - 2]) for unit in ("RMS", "at")])
