"""The estimator in C, compiled and driven as the one in Python is."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from softmpc import Scene, build
from softmpc.codegen import c_text
from softmpc.codegen.estimator_data import Window, files
from softmpc.codegen.model_functions import _stage, sources
from softmpc.control.closed_loop import Start, start_at
from softmpc.estimation.estimator import Estimate, Estimator
from softmpc.estimation.process import Process, ProcessNoise
from softmpc.estimation.sensing import Sample
from softmpc.estimation.sensors import Sensor
from softmpc.model.disturbance import Disturbance
from softmpc.model.model import Model
from softmpc.model.payload import Payload
from softmpc.rig.faults import SensorFault
from softmpc.rig.machine import Link, Machine
from softmpc.simulation.idas import Idas
from softmpc.statics.equilibrium import find_equilibrium

Array = np.ndarray
STEP = 25  # ticks
PRESSURES = [3e5, 1e5, 0, 2e5, 0, 4e5]
C_SOURCES = Path(files.__code__.co_filename).parent / "c"
OWN = (
    "estimator.c", "estimator_drive.c", "estimator_knots.c", "estimator_step.c",
    "estimator_views.c", "kalman.c", "readings.c", "linear.c",
)  # fmt: skip
STRICT = ("-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-Wno-unknown-warning-option")
OF_FLOAT = ("-DSMPC_FLOAT", "-fsingle-precision-constant")
COMPILER = next((name for name in ("gcc", "clang", "cc") if shutil.which(name)), None)
REASONS = (
    "not finite", "frozen", "after a jump", "too late", "twice", "too far", "too early", "no room",
    "no such sensor",
)  # fmt: skip


def sizes_of(model: Model) -> str:
    """As much of `sizes.h` as an estimator needs."""
    layout, n = model.layout, model.strains
    values = {
        "NX": len(layout.x), "INPUTS": len(layout.u), "STRAINS": n, "DRIVE": len(layout.x) - 2 * n,
        "PRESSURES": len(layout.p), "ACCELERATES": int(model.order == 2),
    }  # fmt: skip
    lines = (c_text.define(f"SMPC_{name}", value) for name, value in values.items())
    return c_text.guard("sizes.h", "".join(lines))


def write(folder: Path, estimator: Estimator, window: Window) -> list[Path]:
    """The generated files of an estimator alone; those that are C sources."""
    model = estimator.model
    scale = (model.layout.ddq if model.order == 2 else model.layout.dq).scale
    t = SimpleNamespace(model=model, n=model.strains, x_scale=model.layout.x.scale, a_scale=scale)
    about: Any = SimpleNamespace(t=t)
    found = files(estimator, window) | {"sizes.h": sizes_of(model)}
    found |= sources("model", _stage(about))
    for name, text in found.items():
        (folder / name).write_text(text)
    return [folder / name for name in found if name.endswith(".c")]


def built(folder: Path, sources: Sequence[Path], library: str, *flags: str) -> ctypes.CDLL:
    """A library of these and the estimator's own sources."""
    own = [str(C_SOURCES / name) for name in OWN]
    command = [
        str(COMPILER), "-std=c99", "-O1", *flags, "-shared", "-fPIC", f"-I{folder}",
        f"-I{C_SOURCES}", *own, *map(str, sources), "-o", str(folder / library), "-lm",
    ]  # fmt: skip
    subprocess.run(command, check=True)
    found = ctypes.CDLL(str(folder / library))
    found.smpc_estimator_memory.restype = found.smpc_sample_memory.restype = ctypes.c_ulong
    return found


class CEstimator:
    """Has the methods of `Estimator` that these tests call."""

    def __init__(self, library: ctypes.CDLL, like: Estimator, real: type = np.float64) -> None:
        self.library, self.like, self.real = library, like, real
        self.size = int(library.smpc_estimator_memory())
        self.memory = ctypes.create_string_buffer(self.size)
        largest = max(len(reading.names) for reading in like.readings)
        kind = [("sensor", "i4"), ("stamp", "i4"), ("value", real, (largest,))]
        self.sample = np.dtype(kind, align=True)
        assert self.sample.itemsize == library.smpc_sample_memory()
        k = len(like.model.layout.u)
        self.input = np.dtype([("tick", "i4"), ("u", real, (k,))], align=True)
        library.smpc_tip_spread.restype = np.ctypeslib.as_ctypes_type(real)

    def _numbers(self, values: Array) -> ctypes.c_void_p:
        self._kept = np.ascontiguousarray(values, self.real)
        return self._kept.ctypes.data_as(ctypes.c_void_p)

    def reset(self, x: Array, u: Array, tick: int = 0) -> int:
        x, u = np.asarray(x, self.real), np.asarray(u, self.real)
        arrays = (one.ctypes.data_as(ctypes.c_void_p) for one in (x, u))
        return int(self.library.smpc_estimator_reset(self.memory, *arrays, tick))

    def applied(self, u: Array, tick: int) -> int:
        return int(self.library.smpc_estimator_applied(self.memory, self._numbers(u), tick))

    def samples(self, samples: Iterable[Sample]) -> Array:
        samples = list(samples)
        found = np.zeros(len(samples), self.sample)
        for row, one in zip(found, samples, strict=True):
            row["sensor"], row["stamp"] = one.sensor, one.stamp
            row["value"][: len(one.value)] = one.value
        return found

    def receive(self, tick: int, samples: Iterable[Sample]) -> None:
        found = self.samples(samples)
        pointer = found.ctypes.data_as(ctypes.c_void_p)
        self.library.smpc_estimator_receive(self.memory, tick, pointer, len(found))

    def estimate(self, tick: int) -> Estimate | int:
        """The estimate, or the trouble."""
        trouble = int(self.library.smpc_estimator_estimate(self.memory, tick))
        return trouble or self._seen(tick, 0)

    def ahead(self, tick: int, inputs: Sequence[tuple[int, Array]] = ()) -> Estimate | int:
        found = np.zeros(len(inputs), self.input)
        for row, (since, u) in zip(found, inputs, strict=True):
            row["tick"], row["u"] = since, u
        pointer = found.ctypes.data_as(ctypes.c_void_p)
        trouble = self.library.smpc_estimator_ahead(self.memory, tick, pointer, len(found))
        return int(trouble) or self._seen(tick, 1)

    def _seen(self, tick: int, ahead: int) -> Estimate:
        p = self.like.process
        sizes = (p.nx, len(p.disturbance), (p.size, p.size))
        x, d, P = (np.zeros(size, self.real) for size in sizes)
        pointers = (one.ctypes.data_as(ctypes.c_void_p) for one in (x, d, P))
        self.library.smpc_estimator_seen(self.memory, ahead, *pointers)
        return Estimate(tick * 1e-3, x, d, P)

    def good(self) -> list[int]:
        """Ticks of the last good readings."""
        count = len(self.like.sensors)
        return [int(self.library.smpc_estimator_good(self.memory, i)) for i in range(count)]

    def reasons(self) -> list[Counter[str]]:
        """Of readings that did not count."""
        left_out = self.library.smpc_estimator_left_out
        return [
            Counter({
                name: count for r, name in enumerate(REASONS)
                if (count := int(left_out(self.memory, i, r)))
            })
            for i in range(len(self.like.sensors))
        ]  # fmt: skip

    def knots(self) -> int:
        """Times that it can go back to now."""
        count, room = 0, (ctypes.c_int * 99)()
        numbers = np.zeros(99, self.real).ctypes.data_as(ctypes.c_void_p)
        while self.library.smpc_estimator_judged(self.memory, count, room, numbers, room):
            count += 1
        return count

    @property
    def contradicted(self) -> int:
        return int(self.library.smpc_estimator_contradicted(self.memory))


# ---------------------------------------------------------------- both, told the same


@dataclass(frozen=True)
class Told:
    """What an estimator hears at a step of the controller, and the input that follows."""

    tick: int
    samples: list[Sample]
    u: np.ndarray


@dataclass(frozen=True)
class Case:
    """An estimator in both languages, and where it begins."""

    python: Estimator
    c: CEstimator
    start: Start
    folder: Path
    sources: list[Path]

    def reset(self) -> None:
        self.python.reset(self.start.x, self.start.u)
        assert self.c.reset(self.start.x, self.start.u) == 0


def estimator_of(model: Model, sensors: Sequence[Sensor]) -> Estimator:
    process = Process(model, Disturbance.of(model.scene), ProcessNoise(), "never")
    return Estimator(process, sensors)


def start_of(model: Model) -> Start:
    return start_at(model, find_equilibrium(model, PRESSURES))


def case_of(folder: Path, scene: Scene, sensors: Sequence[Sensor], window: Window) -> Case:
    model = build(scene)
    estimator = estimator_of(model, sensors)
    sources = write(folder, estimator, window)
    c = CEstimator(built(folder, sources, "double.so", "-O0"), estimator)
    return Case(estimator, c, start_of(model), folder, sources)


def recorded(
    model: Model, sensors: Sequence[Sensor], faults: Sequence[SensorFault], steps: int
) -> list[Told]:
    """Of a plant with a payload that the estimator does not know, swinging."""
    scene = replace(model.scene, effects=(*model.scene.effects, Payload(0.2)))
    plant = build(scene)
    machine, start = Machine({"": Idas(plant, 1e-6)}, sensors, Link(), faults, 5), start_of(plant)
    machine.reset(start.x, start.u)
    found = []
    for k in range(steps):
        u = start.u * (1 + 0.2 * np.sin(0.6 * k + np.arange(len(start.u))))
        found.append(Told(STEP * k, machine.arrived(), u))
        machine.command(u)
        machine.run(STEP)
    return found


def apart(one: Estimate, other: Estimate | int, scale: np.ndarray) -> tuple[float, float]:
    """How far states are apart, scaled, and covariances, as correlations."""
    assert isinstance(other, Estimate), f"trouble {other}"
    deviations = np.sqrt(np.diag(one.P))
    state = max(np.abs((one.x - other.x) / scale).max(), np.abs(one.d - other.d).max(initial=0.0))
    return float(state), float(np.abs((one.P - other.P) / np.outer(deviations, deviations)).max())


def same(case: Case, told: Sequence[Told], ahead: int = 7) -> tuple[float, float]:
    """The largest differences along a record; health and doubts are equal at each step."""
    case.reset()
    python, c, worst = case.python, case.c, (0.0, 0.0)
    scale = python.model.layout.x.scale
    for one in told:
        python.receive(one.samples)
        c.receive(one.tick, one.samples)
        inputs = [(one.tick + 3, one.u)]
        for found, other in (
            (python.estimate(one.tick), c.estimate(one.tick)),
            (python.ahead(one.tick + ahead, inputs), c.ahead(one.tick + ahead, inputs)),
        ):
            worst = tuple(map(max, worst, apart(found, other, scale)))
        assert [health.good for health in python.health] == c.good()
        assert [+health.reasons for health in python.health] == c.reasons()
        assert (python.contradicted or [-(2**31)])[-1] == c.contradicted
        python.applied(one.u, one.tick)
        assert c.applied(one.u, one.tick) == 0
    return worst
