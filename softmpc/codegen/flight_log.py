"""Flight logs read: up to their end, or to where they are damaged."""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from softmpc.codegen import flight_format as form
from softmpc.codegen.flight_format import (
    Event,
    Header,
    Kind,
    Limits,
    Reset,
    Settings,
    Snapshot,
    StepRecord,
)
from softmpc.errors import InputError

__all__ = ["FlightLog", "header_in", "read_log"]

LONGEST = 1 << 24  # bytes of a record: what says more is damaged


@dataclass(frozen=True)
class FlightLog:
    """What a log holds: its records in their order, and what is wrong with it."""

    path: Path
    header: Header
    events: tuple[Event, ...]
    damage: str = ""  # where it ends too early, and why
    skipped: int = 0  # records of kinds that are not known here

    @property
    def steps(self) -> list[StepRecord]:
        """Its steps, in their order."""
        return [one for one in self.events if isinstance(one, StepRecord)]


def read_log(path: str | os.PathLike[str]) -> FlightLog:
    """Read a log up to its end or its first damage, which `damage` names.

    Raises `InputError` where it is no log, of another version, or broken before the first record.
    """
    path = Path(path)
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    if not data.startswith(form.MAGIC):
        raise InputError(f"{path}: is no flight log of softmpc: {_what_it_is(data)}")
    records = _Records(data, len(form.MAGIC))
    header = _header(path, records)
    events, skipped = _events(records, header)
    return FlightLog(path, header, tuple(events), records.damage, skipped)


def header_in(data: bytes) -> Header:
    """The header in the first bytes of a log. Raises `InputError` where there is none."""
    return _header(Path("header"), _Records(data, len(form.MAGIC)))


def _header(path: Path, records: _Records) -> Header:
    kind, payload = records.next() or (None, b"")
    if kind != Kind.HEADER:
        raise InputError(f"{path}: its header is damaged: {records.damage or 'it is missing'}")
    return _get_header(path, payload)


def _what_it_is(data: bytes) -> str:
    if not data:
        return "it is empty"
    if form.MAGIC.startswith(data):
        return "it ends within its first bytes"
    if data[1:5] == form.MAGIC[1:5]:
        return "it was changed on its way, as text (transfer it as binary)"
    return f"it begins with {data[:8]!r}"


@dataclass
class _Records:
    """The records of some bytes, one after the other."""

    data: bytes
    at: int
    damage: str = ""

    def next(self) -> tuple[int, bytes] | None:
        """Kind and payload of the next record; None at the end or at damage."""
        start, left = self.at, len(self.data) - self.at
        if left == 0:
            return None
        if left < form.FRAME.size:
            return self._ended(f"the log is cut off: {left} bytes of a record are left")
        mark, kind, _, length = form.FRAME.unpack_from(self.data, start)
        if mark != form.MARK or length > LONGEST:
            return self._ended("no record begins there")
        end = start + form.FRAME.size + length
        if len(self.data) < end + form.CRC.size:
            whole = end + form.CRC.size - start
            return self._ended(f"the log is cut off: {left} of the {whole} bytes of a record")
        if zlib.crc32(self.data[start:end]) != form.CRC.unpack_from(self.data, end)[0]:
            return self._ended(f"the checksum of a record of {length} bytes is wrong")
        self.at = end + form.CRC.size
        return kind, self.data[start + form.FRAME.size : end]

    def _ended(self, why: str) -> tuple[int, bytes] | None:
        self.damage = f"at byte {self.at}: {why}"
        return None


def _events(records: _Records, header: Header) -> tuple[list[Event], int]:
    """All records up to the first damage, and how many are of unknown kinds."""
    events: list[Event] = []
    skipped = 0
    before: StepRecord | None = None  # what the next step may rely on
    while (found := records.next()) is not None:
        kind, payload = found
        if kind not in _GET:
            skipped += 1
            continue
        try:
            event = _GET[kind](_Payload(payload, header), before)
        except (struct.error, ValueError, IndexError) as error:
            start = records.at - len(payload) - form.FRAME.size - form.CRC.size
            what = Kind(kind).name.lower()
            records.damage = f"at byte {start}: a record of kind {what} does not fit: {error}"
            break
        if isinstance(event, StepRecord):
            before = event
        elif isinstance(event, Reset | Snapshot):
            before = None
        events.append(event)
    return events, skipped


# ---------------------------------------------------------------- records


@dataclass
class _Payload:
    """Numbers of a payload, one after the other; what is missing raises `ValueError`."""

    data: bytes
    header: Header
    at: int = 0

    def fixed(self, layout: struct.Struct) -> tuple:
        found = layout.unpack_from(self.data, self.at)
        self.at += layout.size
        return found

    def raw(self, count: int) -> bytes:
        found = self.data[self.at : self.at + count]
        if len(found) < count:
            raise ValueError("too short")
        self.at += count
        return found

    def reals(self, count: int) -> np.ndarray:
        data = self.raw(count * self.header.real_bytes)
        return np.frombuffer(data, self.header.real).astype(float)

    def text(self) -> str:
        return self.raw(self.raw(1)[0]).decode()

    def finish(self) -> None:
        if self.at != len(self.data):
            raise ValueError("too long")


def _get_header(path: Path, payload: bytes) -> Header:
    (version,) = struct.unpack_from("<H", payload)
    if version != form.FORMAT:
        raise InputError(
            f"{path}: is a flight log of version {version}; version {form.FORMAT} is known here: "
            "read it with the softmpc that it was made with"
        )
    nothing = Header(1, 1, 1, 0, 1.0, "", "", "", "")
    got = _Payload(payload, nothing)
    _, real_bytes, writer, N, states, inputs, references, step = got.fixed(form.HEADER)
    hashed, softmpc, build, names, scene = (got.text() for _ in range(5))
    if real_bytes not in (4, 8) or writer >= len(form.WRITERS):
        raise InputError(f"{path}: numbers of {real_bytes} bytes, by writer {writer}: not known")
    return Header(
        N, states, inputs, references, step, hashed, softmpc, build, names, scene, real_bytes,
        form.WRITERS[writer],
    )  # fmt: skip


def _get_step(got: _Payload, before: StepRecord | None) -> StepRecord:
    header = got.header
    number, status, qp, source, flags, iterations, active, early, late = got.fixed(form.STEP)
    if status >= len(form.STATUSES) or source >= len(form.SOURCES):
        raise ValueError("a status or a source that nobody knows")
    if before is not None and number != before.number + 1:
        before = None  # steps are missing
    kkt, violation = got.reals(2)
    whole, k = True, header.inputs
    if not flags & form.INPUT_KEPT:
        u_before = got.reals(k)
    else:
        whole = before is not None
        u_before = np.full(k, np.nan) if before is None else before.u
    x, u = got.reals(header.states), got.reals(k)
    mask = np.frombuffer(got.raw((header.intervals + 7) // 8), np.uint8)
    rows = np.unpackbits(mask, bitorder="little")[: header.intervals].astype(bool)
    given = np.full((header.intervals, header.references), np.nan)
    if before is not None:
        given = np.vstack([before.given[1:], before.given[-1:]])
    count = int(rows.sum()), header.references
    given[rows] = got.reals(count[0] * count[1]).reshape(count)
    got.finish()
    whole = whole and (bool(rows.all()) or (before is not None and before.whole))
    return StepRecord(
        number, x, u_before, given, u, status, qp, source, iterations, active, float(kkt),
        float(violation), early, late, bool(flags & form.CLIPPED), whole,
    )  # fmt: skip


def _get_reset(got: _Payload, _: StepRecord | None) -> Reset:
    reset = Reset(*got.fixed(form.CRC))
    got.finish()
    return reset


def _get_snapshot(got: _Payload, _: StepRecord | None) -> Snapshot:
    number, age, failures, flags, plan, active = got.fixed(form.SNAPSHOT)
    violation = float(got.reals(1)[0])
    u = got.reals(got.header.inputs) if flags & form.HAS_INPUT else None
    w = got.reals(plan) if flags & form.HAS_PLAN else None
    expected = None if w is None else got.reals(got.header.states)
    signs = np.frombuffer(got.raw(active), np.int8).astype(float)
    got.finish()
    return Snapshot(
        number, age, failures, violation, u, w, expected,
        signs if flags & form.HAS_ACTIVE else None,
    )  # fmt: skip


def _get_limits(got: _Payload, _: StepRecord | None) -> Limits:
    (which,) = got.fixed(form.CRC)
    found = [got.reals(got.header.inputs) if which >> i & 1 else None for i in range(4)]
    got.finish()
    return Limits(*found)


def _get_settings(got: _Payload, _: StepRecord | None) -> Settings:
    settings = Settings(*got.fixed(form.SETTINGS))
    got.finish()
    return settings


_GET: dict[int, Callable[[_Payload, StepRecord | None], Event]] = {
    Kind.STEP: _get_step,
    Kind.RESET: _get_reset,
    Kind.SNAPSHOT: _get_snapshot,
    Kind.LIMITS: _get_limits,
    Kind.SETTINGS: _get_settings,
}
