"""Files of results that are none, or broken: always one clear error, never half a result."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from softmpc.control.track_result import ARRAYS, TrackResult
from softmpc.errors import InputError
from softmpc.files import reading_npz
from softmpc.simulation.result_files import read_npz


def run_of(samples: int = 2000) -> TrackResult:
    """A made-up closed loop of an arm with two units."""
    rng = np.random.default_rng(0)
    steps = samples // 25
    return TrackResult(
        title="Made up", status="finished", settle=1.0,
        time=1e-3 * np.arange(samples), tips=rng.random((samples, 1, 3)),
        reference=rng.random((samples, 3)), q=rng.random((samples, 2)),
        dq=rng.random((samples, 2)), p=rng.random((samples, 2)),
        control_time=0.025 * np.arange(steps), u=rng.random((steps, 2)),
        step_ms=rng.random(steps), iterations=np.ones(steps, int), statuses=["solved"] * steps,
        names=(("a", "b"), ("T_1", "T_2"), ("P_1", "P_2")),
    )  # fmt: skip


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    return run_of().save(tmp_path_factory.mktemp("run"))[0].read_bytes()


def flipped(content: bytes, place: int) -> bytes:
    """With one byte changed."""
    return content[:place] + bytes([content[place] ^ 0xFF]) + content[place + 1 :]


BROKEN: dict[str, Callable[[bytes], bytes]] = {
    "empty": lambda whole: b"",
    "one byte": lambda whole: whole[:1],
    "half": lambda whole: whole[: len(whole) // 2],
    "without its last byte": lambda whole: whole[:-1],
    "text": lambda whole: b"t,x_1\n0,0\n",
    "other bytes": lambda whole: bytes(range(256)) * 40,
}


@pytest.mark.parametrize("read", [TrackResult.load, read_npz])
@pytest.mark.parametrize("how", BROKEN)
def test_broken_files(tmp_path: Path, whole: bytes, how: str, read: Callable) -> None:
    file = tmp_path / "track.npz"
    file.write_bytes(BROKEN[how](whole))
    with pytest.raises(InputError, match=r"track\.npz: is not a saved .*: no NPZ file, or one"):
        read(file)


def test_damage_anywhere_is_found(tmp_path: Path, whole: bytes) -> None:
    """A changed byte in the data is an error; one in what nobody reads changes nothing."""
    file, good, errors = tmp_path / "track.npz", run_of(), 0
    for place in np.random.default_rng(1).integers(0, len(whole), 60):
        file.write_bytes(flipped(whole, int(place)))
        try:
            found = TrackResult.load(file)
        except InputError:
            errors += 1
            continue
        assert all(np.array_equal(getattr(found, n), getattr(good, n)) for n in ARRAYS)
    assert errors > 50


def test_first_schema_is_read(tmp_path: Path, whole: bytes) -> None:
    """It had neither what is followed nor costs; what is missing is unknown, not made up."""
    file = tmp_path / "track.npz"
    file.write_bytes(whole)
    with np.load(file) as content:
        arrays = dict(content)
    about = json.loads(str(arrays.pop("about")))
    first = ("title", "status", "settle", "statuses", "names", "clearance_m")

    def write(schema: int, **more: object) -> None:
        kept = {"schema": schema, **{name: about[name] for name in first}, **more}
        np.savez(file, about=json.dumps(kept), **{name: arrays[name] for name in ARRAYS})

    write(1)
    old = TrackResult.load(file)
    assert np.array_equal(old.u, run_of().u) and old.title == "Made up"
    assert old.followed is None and old.cost is None and old.rest_variation is None
    assert old.summary()["rms_error_mm"] == run_of().summary()["rms_error_mm"]
    assert np.array_equal(old.target, old.reference)
    write(3)
    with pytest.raises(InputError, match="is of another version; 1 and 2 are known here"):
        TrackResult.load(file)
    write(2, surprise=1)
    with pytest.raises(InputError, match=r"is not a saved closed-loop run: .*surprise"):
        TrackResult.load(file)


def test_what_is_missing_is_named(tmp_path: Path) -> None:
    file = tmp_path / "some.npz"
    np.savez(file, about='{"schema": 2}')
    with pytest.raises(InputError, match="is not a saved simulation: it has no 'time'"):
        read_npz(file)
    with pytest.raises(InputError, match="no such file"):
        read_npz(tmp_path / "none.npz")
    with (
        pytest.raises(InputError, match="another version; 1 is known here"),
        reading_npz(file, "x", (1,)),
    ):
        pass
    np.savez(file, time=np.zeros(3))
    with pytest.raises(InputError, match="it has no 'about'"):
        TrackResult.load(file)
