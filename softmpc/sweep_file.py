"""The file of a sweep: a line for what was asked, then one for each finished chunk (JSON lines)."""

from __future__ import annotations

import hashlib
import inspect
import json
import os
import sys
from collections.abc import Sequence
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import partial
from pathlib import Path
from types import BuiltinFunctionType, FunctionType, MethodType
from typing import Any

from softmpc.errors import InputError, errors_in
from softmpc.files import replacing
from softmpc.sweep_chunks import Chunk

__all__ = ["SweepFile", "what_is_asked"]

FORMAT = 1


def what_is_asked(work: Any, cases: Sequence[Any], chunk: int) -> dict[str, Any]:
    """What must be the same for results to be the same; raises `InputError` for what has no text.

    The version of softmpc and the source of the work are part of it, what the work calls is not.
    """
    called = work.func if isinstance(work, partial) else work
    named = called if hasattr(called, "__qualname__") else type(called)
    with errors_in("a sweep with keep"):
        return {
            "softmpc_sweep": FORMAT,
            "softmpc": sys.modules[__package__].__version__,
            "work": f"{named.__module__}.{named.__qualname__}",
            "source of work": _hash(_source(named)),
            "settings": _hash(work),
            "number of cases": len(cases),
            "cases": _hash(cases),
            "chunk": chunk,
        }


def _source(named: Any) -> str | None:
    try:
        return inspect.getsource(named)
    except (OSError, TypeError):  # typed into a session, or written in C
        return None


def _hash(value: Any) -> str:
    try:
        text = json.dumps(value, default=_told, sort_keys=True)
    except (TypeError, ValueError) as error:  # keys of a dict that are no text, circles
        raise InputError(f"cannot be compared with another run: {error}") from None
    return hashlib.sha256(text.encode()).hexdigest()[:32]


def _told(value: Any) -> Any:
    """What JSON does not know, by its parts; pickle would differ from run to run."""
    if hasattr(value, "tolist"):
        return value.tolist()
    if isinstance(value, MethodType):
        return [value.__self__, value.__name__]
    if isinstance(value, type | FunctionType | BuiltinFunctionType):
        return _name(value)
    if isinstance(value, partial):
        return [value.func, value.args, value.keywords]
    if isinstance(value, Enum | Path | complex):
        return str(value)
    if is_dataclass(value):
        return [type(value), {field.name: getattr(value, field.name) for field in fields(value)}]
    raise InputError(
        f"there is no telling whether {value!r} is the same in another run; allowed are plain "
        "data, NumPy arrays, dataclasses of these and top-level functions"
    )


def _name(value: Any) -> str:
    name = f"{value.__module__}.{value.__qualname__}"
    if "<" in name:  # <lambda>, or <locals> that it may depend on
        raise InputError(f"{name} could be anything; work must be at the top level of a module")
    return name


class SweepFile:
    """Results of finished chunks, by chunk number; they outlive the process.

    Raises `InputError` for a file of another sweep, or of something else.
    """

    def __init__(
        self, path: str | os.PathLike[str], asked: dict[str, Any], chunks: Sequence[Chunk]
    ) -> None:
        self.path = Path(path)
        self.results: dict[int, list[Any]] = {}
        if self._is_new():
            with replacing(self.path) as beside:
                beside.write_text(json.dumps(asked) + "\n", encoding="utf-8")
        else:
            with errors_in(self.path):
                self._read(asked, [len(chunk.cases) for chunk in chunks])

    def _is_new(self) -> bool:
        if self.path.is_dir():
            raise InputError(f"{self.path}: is a folder; keep must name a file in it")
        return not self.path.exists() or self.path.stat().st_size == 0

    def _read(self, asked: dict[str, Any], sizes: Sequence[int]) -> None:
        try:
            data = self.path.read_bytes()
        except OSError as error:
            raise InputError(f"cannot be read: {error.strerror or error}") from None
        whole = data.rpartition(b"\n")[0]  # a crash leaves half a line
        lines = whole.splitlines()
        _check_head(lines[0] if lines else b"", asked)
        for number, line in enumerate(lines[1:], 2):
            chunk, results = _finished(line)
            if chunk not in range(len(sizes)) or len(results) != sizes[chunk]:
                raise InputError(f"line {number} is damaged; remove the line, or the file")
            self.results[chunk] = results
        if len(whole) + 1 < len(data):
            os.truncate(self.path, len(whole) + 1)

    def add(self, chunk: Chunk, texts: Sequence[str]) -> None:
        """Write the results of a chunk; they are on the disk when this returns."""
        line = f'{{"chunk": {chunk.number}, "results": [{", ".join(texts)}]}}\n'
        try:
            with self.path.open("a", encoding="utf-8") as file:
                file.write(line)
                file.flush()
                os.fsync(file.fileno())
        except OSError as error:
            raise InputError(f"{self.path}: cannot be written: {error.strerror or error}") from None


def _finished(line: bytes) -> tuple[int, list[Any]]:
    """Number and results of a line, (-1, []) where it is none of ours."""
    try:
        data = json.loads(line)
        return int(data["chunk"]), list(data["results"])
    except (ValueError, KeyError, TypeError):
        return -1, []


def _check_head(line: bytes, asked: dict[str, Any]) -> None:
    """Raise `InputError` unless the first line says what is asked now."""
    try:
        found = dict(json.loads(line))
    except (ValueError, TypeError):
        found = {}
    if "softmpc_sweep" not in found:
        raise InputError("is not the file of a sweep; name another one")
    other = [name for name, value in asked.items() if found.get(name) != value]
    if other:
        raise InputError(
            f"holds another sweep, which differs in: {', '.join(other)}; name another file, or "
            "remove this one to start anew"
        )
