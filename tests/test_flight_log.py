"""Flight logs: what is written is read, by Python and C alike; damage is found and named."""

from __future__ import annotations

import logging
import os
import struct
import zlib
from dataclasses import astuple, replace
from itertools import pairwise
from pathlib import Path

import flights
import numpy as np
import pytest

from softmpc.codegen.flight_format import (
    MAGIC,
    Header,
    Kind,
    Limits,
    Reset,
    Settings,
    Snapshot,
    StepRecord,
    frame,
)
from softmpc.codegen.flight_log import FlightLog, read_log
from softmpc.codegen.flight_writer import FlightWriter
from softmpc.errors import InputError

RECORDS = flights.flight()
needs_compiler = pytest.mark.skipif(not flights.COMPILERS, reason="needs gcc or clang")


def same(a: object, b: object) -> bool:
    """Whether two records say the same, NaN being NaN."""
    pairs = zip(astuple(a), astuple(b), strict=True)
    return type(a) is type(b) and all(_same(*pair) for pair in pairs)


def _same(a: object, b: object) -> bool:
    if a is None or b is None:
        return a is b
    return np.array_equal(np.asarray(a, float), np.asarray(b, float), equal_nan=True)


def expected(records: list) -> list:
    """What a reader gets: after a snapshot what a user has set comes once more."""
    found, settings = [], {}
    for one in records:
        found.append(one)
        if isinstance(one, Snapshot):
            found += settings.values()
        elif isinstance(one, Reset):
            settings = {}
        elif not isinstance(one, StepRecord):
            settings[type(one)] = one
    return found


def log_of(path: Path, data: bytes) -> FlightLog:
    path.write_bytes(data)
    return read_log(path)


@pytest.fixture
def whole(tmp_path: Path) -> bytes:
    return flights.by_python(tmp_path / "whole.log", RECORDS, flights.header())


def ends(data: bytes) -> list[int]:
    """Where records end, found by walking over their lengths."""
    at, found = len(MAGIC), []
    while at < len(data):
        at += 12 + struct.unpack_from("<I", data, at + 4)[0]
        found.append(at)
    return found


# ---------------------------------------------------------------- what is written is read


def test_python_reads_what_python_writes(whole: bytes, tmp_path: Path) -> None:
    log = log_of(tmp_path / "a.log", whole)
    assert log.header == flights.header()
    assert (log.damage, log.skipped) == ("", 0)
    wanted = expected(RECORDS)
    assert len(log.events) == len(wanted)
    assert [one for one, two in zip(log.events, wanted, strict=True) if not same(one, two)] == []
    assert all(step.whole for step in log.steps)


def test_what_follows_from_the_step_before_is_left_out(tmp_path: Path) -> None:
    """A step whose references move on and whose input was given before is shorter by just these."""
    random = np.random.default_rng(0)
    first = flights.step(0, random)
    moved = np.vstack([first.given[1:], random.normal(size=(1, flights.NR))])
    second = replace(first, number=1, given=moved, u_before=first.u)
    third = replace(second, number=2, given=second.given[::-1].copy(), u_before=second.x[:2])
    data = flights.by_python(tmp_path / "a.log", [first, second, third], flights.header())
    at = [0, *ends(data)]
    full, short, again = np.diff(at)[1:]
    assert full - short == 8 * (flights.K + (flights.N - 1) * flights.NR)
    assert again == full
    steps = read_log(tmp_path / "a.log").steps
    assert all(same(a, b) for a, b in zip(steps, [first, second, third], strict=True))


def test_bits_are_kept(tmp_path: Path) -> None:
    """-0, denormals, and what a NaN carries; an input before of -0 is not one of 0."""
    odd = np.array([-0.0, 5e-324, np.inf, np.frombuffer(b"\x01\x02\x03\0\0\0\xf8\x7f")[0]])
    one = replace(flights.step(0, np.random.default_rng(0)), x=odd, u=np.zeros(2))
    two = replace(one, number=1, u_before=np.array([0.0, -0.0]))
    flights.by_python(tmp_path / "a.log", [one, two], flights.header())
    read = read_log(tmp_path / "a.log").steps
    assert read[0].x.tobytes() == odd.tobytes()
    assert read[1].u_before.tobytes() == two.u_before.tobytes()


@needs_compiler
@pytest.mark.parametrize("real_bytes", [8, 4])
@pytest.mark.parametrize("compiler", flights.COMPILERS)
def test_c_writes_the_same_bytes(
    compiler: str, real_bytes: int, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.mktemp("c")
    recorder = flights.build(folder / "build", compiler, real_bytes)()
    recorder.header()
    recorder.begin()
    for one in RECORDS[1:]:  # the first is the reset with which it begins
        recorder.write(one)
    path = folder / "python.log"
    wanted = flights.by_python(path, RECORDS, flights.header(real_bytes))
    assert bytes(recorder.got) == wanted
    read = log_of(folder / "c.log", bytes(recorder.got))
    assert read.header == flights.header(real_bytes)
    assert read.damage == "" and len(read.steps) == 12


def test_other_kinds_of_records_are_skipped(whole: bytes, tmp_path: Path) -> None:
    at = ends(whole)[2]
    more = whole[:at] + frame(Kind.SAMPLES, b"estimator") + whole[at:]
    log = log_of(tmp_path / "a.log", more)
    assert (log.skipped, log.damage) == (1, "")
    assert len(log.steps) == 12 and all(step.whole for step in log.steps)


def test_bytes_are_those_of_the_page(tmp_path: Path) -> None:
    """A log put together by hand, as docs/replay.md has it."""
    header = Header(2, 2, 1, 1, 0.5, "ab", "1", "me", "tip[1]", "", 4)
    numbers = {"prepare_seconds": 0.25, "feedback_seconds": 0.5, "kkt": 1.0, "violation": 2.0}
    first = StepRecord(0, np.array([3.0, 4.0]), np.array([5.0]), np.array([[6.0], [7.0]]),
                       np.array([8.0]), 1, 5, 2, 9, 10, **numbers, clipped=True)  # fmt: skip
    second = replace(first, number=1, u_before=first.u, given=np.array([[7.0], [6.5]]))
    records = [Reset(0), first, second, Limits(high=np.array([11.0])), Settings(0.125, 12)]
    plan = np.arange(1.0, 4.0)
    records += [
        Snapshot(2, 13, 14, 15.0, np.array([16.0]), plan, first.x, np.array([-1.0, 0.0, 1.0]))
    ]
    texts = b"\x02ab" + b"\x011" + b"\x02me" + b"\x06tip[1]" + b"\x00"
    limits, settings = struct.pack("<If", 2, 11), struct.pack("<dI", 0.125, 12)
    wanted = [
        (1, struct.pack("<HBBIIIId", 1, 4, 1, 2, 2, 1, 1, 0.5) + texts),
        (2, struct.pack("<I", 0)),
        (3, struct.pack("<IBBBBHH", 0, 1, 5, 2, 2, 9, 10) + struct.pack("<ff", 0.25, 0.5)
            + struct.pack("<ff f ff f", 1, 2, 5, 3, 4, 8) + b"\x03" + struct.pack("<ff", 6, 7)),
        (3, struct.pack("<IBBBBHH", 1, 1, 5, 2, 3, 9, 10) + struct.pack("<ff", 0.25, 0.5)
            + struct.pack("<ff ff f", 1, 2, 3, 4, 8) + b"\x02" + struct.pack("<f", 6.5)),
        (5, limits), (6, settings),
        (4, struct.pack("<IHHIII", 2, 13, 14, 7, 3, 3)
            + struct.pack("<f f fff ff", 15, 16, 1, 2, 3, 3, 4) + b"\xff\x00\x01"),
        (5, limits), (6, settings),
    ]  # fmt: skip
    data = bytes.fromhex("89534d50430d0a1a")
    for kind, payload in wanted:
        record = b"\x46\x52" + bytes([kind, 0]) + struct.pack("<I", len(payload)) + payload
        data += record + struct.pack("<I", zlib.crc32(record))
    assert flights.by_python(tmp_path / "a.log", records, header) == data


# ---------------------------------------------------------------- cut and damaged


def test_a_log_that_is_cut_off_is_read_up_to_there(whole: bytes, tmp_path: Path) -> None:
    wanted, at = expected(RECORDS), ends(whole)
    near = {end + off for end in at for off in (-1, 0, 1, 7, 8, 9)}
    for count in sorted(near | set(range(at[0], len(whole), 17))):
        if not at[0] <= count <= len(whole):
            continue
        log = log_of(tmp_path / "a.log", whole[:count])
        records = sum(end <= count for end in at) - 1
        assert len(log.events) == records
        assert all(same(*pair) for pair in zip(log.events, wanted[:records], strict=True))
        last = max(end for end in at if end <= count)
        assert log.damage == "" if last == count else log.damage.startswith(f"at byte {last}: ")


def test_a_damaged_log_is_read_up_to_there(whole: bytes, tmp_path: Path) -> None:
    """Whatever bit flips: no record from there on, all before, and a word about it."""
    at = ends(whole)
    for place in range(at[0], len(whole), 7):
        data = bytearray(whole)
        data[place] ^= 1 << place % 8
        log = log_of(tmp_path / "a.log", bytes(data))
        good = sum(end <= place for end in at) - 1
        start = max(end for end in at if end <= place)
        if data[start + 2] != whole[start + 2] or data[start + 3] != whole[start + 3]:
            assert "checksum" in log.damage
        assert len(log.events) == good
        assert log.damage.startswith(f"at byte {start}: ")


def test_a_record_that_does_not_fit_is_damage(whole: bytes, tmp_path: Path) -> None:
    """The checksum is right, and the content is not."""
    step = frame(Kind.STEP, b"\0" * 50)
    log = log_of(tmp_path / "a.log", whole + step)
    assert log.damage == f"at byte {len(whole)}: a record of kind step does not fit: too short"
    assert len(log.steps) == 12
    first = at_step(whole)
    payload = bytearray(first[8:-4])
    payload[4] = 77  # a status
    log = log_of(tmp_path / "a.log", whole + frame(Kind.STEP, bytes(payload)))
    assert log.damage.endswith("a status or a source that nobody knows")
    log = log_of(tmp_path / "a.log", whole + frame(Kind.RESET, b"\0" * 5))
    assert log.damage.endswith("too long")


def test_nonsense_with_a_right_checksum_is_damage_or_a_record(whole: bytes, tmp_path: Path) -> None:
    """Whatever stands in a payload: no error, and all before is read."""
    random = np.random.default_rng(5)
    for kind in range(8):
        for _ in range(40):
            payload = random.bytes(int(random.integers(0, 300)))
            log = log_of(tmp_path / "a.log", whole + frame(kind, payload))  # type: ignore[arg-type]
            assert len(log.steps) >= 12
            read = len(log.events) > len(expected(RECORDS)) or log.skipped == 1
            assert read != bool(log.damage)


def at_step(data: bytes) -> bytes:
    """The first record of a step."""
    start, end = ends(data)[1:3]
    assert data[start + 2] == Kind.STEP
    return data[start:end]


def test_every_prefix_of_the_first_records_is_refused_or_read(whole: bytes, tmp_path: Path) -> None:
    for count in range(ends(whole)[0]):
        with pytest.raises(InputError, match=r"is no flight log|its header is damaged"):
            log_of(tmp_path / "a.log", whole[:count])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda data: b"", "it is empty"),
        (lambda data: b"time,u1\n0,1\n", "it begins with b'time,u1"),
        (lambda data: data.replace(b"\r\n", b"\n"), "changed on its way, as text"),
        (lambda data: data[:20] + b"?" + data[21:], "its header is damaged: at byte 8: the check"),
        (lambda data: MAGIC + frame(Kind.RESET, b"\0" * 4), "its header is damaged: it is missing"),
    ],
)
def test_what_is_no_log_is_refused(change, message: str, whole: bytes, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=message):
        log_of(tmp_path / "a.log", change(whole))


def test_another_version_is_refused(whole: bytes, tmp_path: Path) -> None:
    data = bytearray(whole)
    data[16] = 2
    start, end = 8, ends(whole)[0] - 4
    data[end : end + 4] = struct.pack("<I", zlib.crc32(data[start:end]))
    with pytest.raises(InputError, match="log of version 2; version 1 is known here"):
        log_of(tmp_path / "a.log", bytes(data))


def test_a_missing_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none\.log: cannot be read: No such file"):
        read_log(tmp_path / "none.log")


# ---------------------------------------------------------------- writing


def test_each_record_is_in_the_file_at_once(tmp_path: Path) -> None:
    writer = FlightWriter(tmp_path / "a.log", flights.header())
    step = flights.step(0, np.random.default_rng(0))
    for count in range(3):
        assert len(read_log(tmp_path / "a.log").steps) == count
        writer.step(step)
    writer.close()
    assert [one.number for one in read_log(tmp_path / "a.log").steps] == [0, 1, 2]


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs /dev/full")
def test_a_full_disk_ends_the_log_and_nothing_else(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING), FlightWriter("/dev/full", flights.header()) as writer:
        writer.step(flights.step(0, np.random.default_rng(0)))
        writer.settings(Settings(0.01))
    assert [record.getMessage() for record in caplog.records] == [
        "/dev/full: the log ends here: No space left on device"
    ]


def test_a_place_that_cannot_be_written_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written"):
        FlightWriter(tmp_path / "file" / "a.log", flights.header())


# ---------------------------------------------------------------- the ring


@needs_compiler
@pytest.mark.parametrize("size", [100, 500, 700, 1001, 1 << 16])
def test_a_ring_keeps_the_latest_whole_records(
    size: int, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """After every record: the header, and as many of the last records as there is room for."""
    folder = tmp_path_factory.getbasetemp() / "ring"
    recorder = flights.build(folder, flights.COMPILERS[0], 8)()
    recorder.header()
    recorder.begin()
    for one in RECORDS[1:]:
        recorder.write(one)
    whole = bytes(recorder.got)
    at = ends(whole)
    recorder.begin_ring(size)
    lengths = [len(whole[a:b]) for a, b in pairwise(at)]
    assert min(lengths) < 100 < max(lengths)  # the smallest ring has no room for some
    for one in RECORDS[1:]:
        recorder.write(one)
        data = recorder.dump()
        assert data.startswith(whole[: at[0]])
        kept = data[at[0] :]
        assert len(kept) <= size
        log_of(folder / "ring.log", data)
    assert kept == kept_of(whole, at, size)


def kept_of(whole: bytes, at: list[int], size: int) -> bytes:
    """What a ring of so many bytes keeps, record by record."""
    records = [whole[a:b] for a, b in pairwise(at)]
    kept: list[bytes] = []
    for one in records:
        if len(one) > size:
            continue
        while sum(map(len, kept)) + len(one) > size:
            kept.pop(0)
        kept.append(one)
    return b"".join(kept)


@needs_compiler
def test_a_log_from_a_ring_says_which_steps_are_whole(
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    """A step that leaves out what a lost record has told is marked."""
    folder = tmp_path_factory.getbasetemp() / "ring"
    recorder = flights.build(folder, flights.COMPILERS[0], 8)()
    recorder.begin_ring(400)
    random, before = np.random.default_rng(3), None
    for number in (1, 2, 4, 5):  # numbers that the made-up steps go on from
        before = flights.step(number, random, before)
        recorder.write(before)
    steps = log_of(folder / "ring.log", recorder.dump()).steps
    assert 0 < len(steps) < 4
    assert not steps[0].whole and np.isnan(steps[0].given).any()
