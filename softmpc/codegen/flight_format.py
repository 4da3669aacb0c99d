"""Records of a flight log as bytes; `docs/replay.md` says what each byte means.

`softmpc/codegen/c/recorder.c` writes the same bytes. Both leave out what follows from the step
before: the input until now where it is the one that was given, and references that have moved on by
one node.
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

__all__ = [
    "MAGIC", "QP", "SOURCES", "STATUSES", "Event", "Header", "Kind", "Limits", "Reset", "Settings",
    "Snapshot", "StepRecord", "frame", "put_header", "put_limits", "put_reset", "put_settings",
    "put_snapshot", "put_step", "qp_code",
]  # fmt: skip

MAGIC = b"\x89SMPC\r\n\x1a"
FORMAT = 1
MARK = b"FR"
FRAME, CRC = struct.Struct("<2sBBI"), struct.Struct("<I")
HEADER = struct.Struct("<HBBIIIId")
STEP = struct.Struct("<IBBBBHHff")
SNAPSHOT = struct.Struct("<IHHIII")
SETTINGS = struct.Struct("<dI")
INPUT_KEPT, CLIPPED = 1, 2
HAS_PLAN, HAS_ACTIVE, HAS_INPUT = 1, 2, 4
UNKNOWN = 0xFFFF  # active rows that nobody counted
NOT_NAMED = 0xFF

STATUSES = ("solved", "iteration cap", "budget overrun", "input not finite", "failed")
SOURCES = ("solution", "shifted plan", "held input")
QP = (
    "not asked", "optimal", "not optimal", "infeasible", "cycling", "iteration limit", "not convex",
    "time limit", "not finite", "singular", "too many rows",
)  # fmt: skip
WRITERS = ("C", "Python")

Array = np.ndarray


class Kind(IntEnum):
    """Kinds of records; others are skipped by readers."""

    HEADER = 1
    RESET = 2
    STEP = 3
    SNAPSHOT = 4
    LIMITS = 5
    SETTINGS = 6
    SAMPLES = 7  # of sensors, kept free for the estimator


@dataclass(frozen=True)
class Header:
    """What a log is of."""

    intervals: int
    states: int
    inputs: int
    references: int  # numbers a node
    step: float  # s
    scene_hash: str  # of the controller's problem
    version: str  # of softmpc
    build: str  # of the controller: the same text promises the same bits
    names: str  # of the references and their sizes, such as "tip[3], rest[34]"
    scene: str = ""  # its file, where that is known
    real_bytes: int = 8  # of a number: 8 double, 4 float
    writer: str = "Python"  # whose controller it is: that in C, or that in Python

    @property
    def real(self) -> np.dtype:
        """Type of the numbers."""
        return np.dtype(f"<f{self.real_bytes}")


@dataclass(frozen=True)
class Reset:
    """The controller forgot everything before step `number`, what a user has set too."""

    number: int


@dataclass(frozen=True)
class StepRecord:
    """What a controller was given in a step and what it did; SI, references (N×nr)."""

    number: int
    x: Array
    u_before: Array
    given: Array
    u: Array
    status: int  # index in STATUSES
    qp: int  # index in QP, or NOT_NAMED
    source: int  # index in SOURCES
    iterations: int = 0
    active: int = UNKNOWN
    kkt: float = float("nan")
    violation: float = float("nan")
    prepare_seconds: float = float("nan")  # without a clock
    feedback_seconds: float = float("nan")
    clipped: bool = False
    whole: bool = True  # whether nothing is missing that the records before would have told


@dataclass(frozen=True)
class Snapshot:
    """What the controller takes from step `number` - 1 into the next: a replay may begin here."""

    number: int
    age: int  # of the plan, in steps
    failures: int  # steps in a row
    violation: float  # of the plan
    u: Array | None  # given last
    plan: Array | None  # scaled: decisions of all intervals, unknowns of stages, states
    expected: Array | None  # the state that the plan expects now, scaled
    active: Array | None  # -1: a constraint at its lower limit, 1: at the upper one


@dataclass(frozen=True)
class Limits:
    """Limits that a user has set: of the input and of its change in a step; None: the scene's."""

    low: Array | None = None
    high: Array | None = None
    fall: Array | None = None
    rise: Array | None = None

    @property
    def each(self) -> tuple[Array | None, ...]:
        """All four in their order."""
        return self.low, self.high, self.fall, self.rise


@dataclass(frozen=True)
class Settings:
    """The time a step may take (s), and iterations of the quadratic program; 0: as built."""

    budget: float = 0.0
    cap: int = 0


Event = Reset | StepRecord | Snapshot | Limits | Settings


def qp_code(name: str) -> int:
    """Index in QP of how a quadratic program ended, in words; "" is one that was not asked."""
    return QP.index(name or QP[0]) if not name or name in QP else NOT_NAMED


# ---------------------------------------------------------------- bytes


def frame(kind: Kind, payload: bytes) -> bytes:
    """A whole record: mark, kind, length, payload, and the CRC-32 of all that."""
    record = FRAME.pack(MARK, kind, 0, len(payload)) + payload
    return record + CRC.pack(zlib.crc32(record))


def put_header(header: Header) -> bytes:
    """The first bytes of a log."""
    h = header
    fixed = HEADER.pack(
        FORMAT, h.real_bytes, WRITERS.index(h.writer), h.intervals, h.states, h.inputs,
        h.references, h.step,
    )  # fmt: skip
    texts = (h.scene_hash, h.version, h.build, h.names, h.scene)
    return MAGIC + frame(Kind.HEADER, fixed + b"".join(_text(one) for one in texts))


def put_reset(reset: Reset) -> bytes:
    """A record of a controller that has forgotten everything."""
    return frame(Kind.RESET, CRC.pack(reset.number))


def put_step(header: Header, step: StepRecord, before: StepRecord | None) -> bytes:
    """A record of a step; with the step `before` it leaves out what follows from that."""
    real = header.real
    given = _reals(real, step.given).reshape(header.intervals, -1)
    kept = before is not None and _same(real, step.u_before, before.u)
    rows = np.ones(header.intervals, dtype=bool)
    if before is not None:
        last = _reals(real, before.given).reshape(header.intervals, -1)
        moved = np.vstack([last[1:], last[-1:]])
        rows = np.array([a.tobytes() != b.tobytes() for a, b in zip(given, moved, strict=True)])
    flags = (INPUT_KEPT if kept else 0) | (CLIPPED if step.clipped else 0)
    fixed = STEP.pack(
        step.number, step.status, step.qp, step.source, flags, min(step.iterations, UNKNOWN),
        min(step.active, UNKNOWN), step.prepare_seconds, step.feedback_seconds,
    )  # fmt: skip
    parts = [_reals(real, [step.kkt, step.violation])]
    parts += [] if kept else [_reals(real, step.u_before)]
    parts += [_reals(real, step.x), _reals(real, step.u)]
    mask = np.packbits(rows, bitorder="little").tobytes()
    body = b"".join(part.tobytes() for part in parts)
    return frame(Kind.STEP, fixed + body + mask + given[rows].tobytes())


def put_snapshot(header: Header, snapshot: Snapshot) -> bytes:
    """A record of what a controller remembers."""
    s, real = snapshot, header.real
    parts = ((s.plan, HAS_PLAN), (s.active, HAS_ACTIVE), (s.u, HAS_INPUT))
    flags = sum(flag for part, flag in parts if part is not None)
    counts = (0 if part is None else len(part) for part in (s.plan, s.active))
    fixed = SNAPSHOT.pack(s.number, min(s.age, UNKNOWN), min(s.failures, UNKNOWN), flags, *counts)
    numbers = [[s.violation], *(part for part in (s.u, s.plan, s.expected) if part is not None)]
    body = b"".join(_reals(real, part).tobytes() for part in numbers)
    active = b"" if s.active is None else np.asarray(s.active).astype("i1").tobytes()
    return frame(Kind.SNAPSHOT, fixed + body + active)


def put_limits(header: Header, limits: Limits) -> bytes:
    """A record of limits that a user has set."""
    given = [part for part in limits.each if part is not None]
    which = sum(1 << k for k, part in enumerate(limits.each) if part is not None)
    body = b"".join(_reals(header.real, part).tobytes() for part in given)
    return frame(Kind.LIMITS, CRC.pack(which) + body)


def put_settings(settings: Settings) -> bytes:
    """A record of settings."""
    return frame(Kind.SETTINGS, SETTINGS.pack(settings.budget, settings.cap))


def _text(text: str) -> bytes:
    """At most 255 bytes and their number before them."""
    data = text.encode()[:255].decode(errors="ignore").encode()  # no half of a letter
    return bytes([len(data)]) + data


def _reals(real: np.dtype, values: object) -> Array:
    with np.errstate(over="ignore", invalid="ignore"):  # what a float cannot hold is infinite
        return np.ascontiguousarray(np.asarray(values, float).ravel().astype(real))


def _same(real: np.dtype, a: Array, b: Array) -> bool:
    """Whether they are the same bytes: NaN equals NaN then, and 0 is not -0."""
    return _reals(real, a).tobytes() == _reals(real, b).tobytes()
