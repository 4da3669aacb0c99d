"""Flights that the tests of logs share: made-up records, and the recorder of C by ctypes."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np

import softmpc.codegen
from softmpc.codegen.flight_format import (
    Header,
    Limits,
    Reset,
    Settings,
    Snapshot,
    StepRecord,
)
from softmpc.codegen.flight_writer import FlightWriter

SOURCES = Path(softmpc.codegen.__file__).parent / "c"
N, NX, K, NR = 5, 4, 2, 3
BUILD = "test build"
SIZES = f"""
#define SMPC_N {N}
#define SMPC_NX {NX}
#define SMPC_INPUTS {K}
#define SMPC_NR {NR}
#define SMPC_STEP 0.025
#define SMPC_VERSION "0.1.0"
#define SMPC_REFERENCES "tip[3]"
#define SMPC_BUILD "{BUILD}"
"""
PROBLEM = """
#define SMPC_PROBLEM_HASH "0123456789abcdef"
#define SMPC_SCENE "arm.toml"
"""
FLAGS = ("-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Werror", "-O1")
COMPILERS = [name for name in ("gcc", "clang") if shutil.which(name)]


def header(real_bytes: int = 8, writer: str = "C") -> Header:
    return Header(
        N, NX, K, NR, 0.025, "0123456789abcdef", "0.1.0", BUILD, "tip[3]", "arm.toml", real_bytes,
        writer,
    )  # fmt: skip


def step(number: int, random: np.random.Generator, before: StepRecord | None = None) -> StepRecord:
    """Some step; references and input go on from the step `before` in all ways that there are."""
    given = random.normal(size=(N, NR))
    u_before = random.normal(size=K)
    if before is not None and number % 3:
        given = np.vstack([before.given[1:], before.given[-1:] if number % 2 else given[-1:]])
    if before is not None and number % 4:
        u_before = before.u
    x = random.normal(size=NX)
    if number % 5 == 4:
        x[1], given[2, 0] = np.nan, -np.inf
    return StepRecord(
        number, x, u_before, given, random.normal(size=K), number % 5, number % 11, number % 3,
        number, 0xFFFF if number % 2 else number, *random.normal(size=2),
        float(np.float32(1e-3 * number)), float("nan"), clipped=number % 7 == 0,
    )  # fmt: skip


def flight(steps: int = 12, seed: int = 1) -> list:
    """Records of all kinds, for numbers of 8 bytes."""
    random, before = np.random.default_rng(seed), None
    found: list = [Reset(0)]
    for number in range(steps):
        before = step(number, random, before)
        found.append(before)
        if number == 2:
            found += [Limits(low=random.normal(size=K), rise=random.normal(size=K))]
            found += [Settings(0.01, 30)]
        if number % 5 == 4:
            plan, active = random.normal(size=7), random.integers(-1, 2, 9).astype(float)
            expected = random.normal(size=NX)
            found.append(Snapshot(number + 1, 3, 1, 0.25, before.u, plan, expected, active))
        if number == 6:
            found += [Snapshot(7, 0, 2, float("nan"), *4 * [None])]
        if number == 10:
            found += [Reset(11)]
    return found


def by_python(path: Path, records: list, about: Header) -> bytes:
    """The log of these records that Python writes."""
    with FlightWriter(path, about) as writer:
        for one in records:
            name = {Reset: "reset", StepRecord: "step", Snapshot: "snapshot"}.get(
                type(one), type(one).__name__.lower()
            )
            getattr(writer, name)(*([] if isinstance(one, Reset) else [one]))
    return path.read_bytes()


# ---------------------------------------------------------------- the recorder of C

SINK = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_size_t)


class Recorder:
    """recorder.c, compiled alone."""

    def __init__(self, library: ctypes.CDLL, real: type, dtype: type) -> None:
        self.lib, self.real, self.dtype = library, real, dtype
        self.memory = ctypes.create_string_buffer(1 << 14)  # of one smpc_recorder
        self.got = bytearray()
        self.pieces: list[int] = []
        self.sink = SINK(self._take)
        self.ring: ctypes.Array | None = None

    def _take(self, _: object, data: int, count: int) -> None:
        self.pieces.append(count)
        self.got += ctypes.string_at(data, count)

    def header(self) -> None:
        self.lib.smpc_log_header(self.sink, None)

    def begin(self) -> None:
        """Write to Python."""
        self.lib.smpc_recorder_init(self.memory, self.sink, None)

    def begin_ring(self, size: int) -> None:
        """Write to a ring of so many bytes."""
        self.ring, self.kept = ctypes.create_string_buffer(256), ctypes.create_string_buffer(size)
        self.lib.smpc_ring_init(self.ring, self.kept, ctypes.c_size_t(size))
        write = ctypes.cast(self.lib.smpc_ring_write, SINK)
        self.lib.smpc_recorder_init(self.memory, write, self.ring)

    def dump(self) -> bytes:
        """The log that the ring has."""
        self.got = bytearray()
        self.header()
        self.lib.smpc_ring_dump(self.ring, self.sink, None)
        return bytes(self.got)

    def reals(self, values: np.ndarray | None) -> object:
        if values is None:
            return None
        flat = np.ascontiguousarray(values, self.dtype).ravel()
        return (self.real * len(flat)).from_buffer_copy(flat.tobytes())

    def write(self, one: object) -> None:
        if isinstance(one, Reset):
            self.lib.smpc_record_reset(self.memory)
        elif isinstance(one, StepRecord):
            outcome = self._outcome(one)
            parts = (one.given, one.u_before, one.x, one.u)
            given = (self.reals(part) for part in parts)
            self.lib.smpc_record_step(self.memory, *given, ctypes.byref(outcome))
        elif isinstance(one, Limits):
            self.lib.smpc_record_limits(self.memory, *(self.reals(part) for part in one.each))
        elif isinstance(one, Settings):
            budget, cap = ctypes.c_double(one.budget), ctypes.c_uint32(one.cap)
            self.lib.smpc_record_settings(self.memory, budget, cap)
        elif isinstance(one, Snapshot):
            self.lib.smpc_record_snapshot(self.memory, ctypes.byref(self._snapshot(one)))

    def _outcome(self, one: StepRecord) -> ctypes.Structure:
        names = [(name, ctypes.c_int) for name in ("status", "qp", "source", "clipped")]
        names += [(name, ctypes.c_uint) for name in ("iterations", "active")]
        names += [(name, self.real) for name in ("kkt", "violation")]
        names += [(name, ctypes.c_float) for name in ("prepare_seconds", "feedback_seconds")]
        kind = type("Outcome", (ctypes.Structure,), {"_fields_": names})
        return kind(*(getattr(one, name) for name, _ in names))

    def _snapshot(self, one: Snapshot) -> ctypes.Structure:
        pointer = ctypes.POINTER(self.real)
        names = [("age", ctypes.c_uint), ("failures", ctypes.c_uint), ("u", pointer)]
        names += [(name, pointer) for name in ("plan", "expected", "multipliers")]
        names += [("plan_count", ctypes.c_uint32), ("multiplier_count", ctypes.c_uint32)]
        names += [("violation", self.real)]
        kind = type("Snapshot", (ctypes.Structure,), {"_fields_": names})
        rounding = 1e-9  # of multipliers, whose signs do not count
        multipliers = None if one.active is None else 7.0 * one.active + rounding
        parts = (one.u, one.plan, one.expected, multipliers)
        given = [None if a is None else ctypes.cast(self.reals(a), pointer) for a in parts]
        counts = (0 if part is None else len(part) for part in (one.plan, one.active))
        return kind(one.age, one.failures, *given, *counts, one.violation)


@cache
def build(folder: Path, compiler: str, real_bytes: int) -> Callable[[], Recorder]:
    """Compile it in a folder; a function that makes recorders."""
    folder.mkdir()
    (folder / "sizes.h").write_text(SIZES)
    (folder / "problem.h").write_text(PROBLEM)
    names = ("recorder.c", "recorder_bytes.c", "recorder_ring.c")
    files = [str(SOURCES / name) for name in names]
    kind = ["-DSMPC_FLOAT"] if real_bytes == 4 else []
    command = [compiler, *FLAGS, *kind, f"-I{folder}", f"-I{SOURCES}", "-shared", "-fPIC", *files,
               "-o", str(folder / "recorder.so")]  # fmt: skip
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    library = ctypes.CDLL(str(folder / "recorder.so"))
    real, dtype = (ctypes.c_float, np.float32) if real_bytes == 4 else (ctypes.c_double, np.float64)
    return lambda: Recorder(library, real, dtype)
