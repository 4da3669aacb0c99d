"""Finished measurements on the disk (JSON lines), so that none is done twice."""

from __future__ import annotations

import hashlib
import json
import os
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from softmpc.accuracy.configuration import Task
from softmpc.errors import InputError, errors_in
from softmpc.files import replacing

__all__ = ["Store"]

FORMAT = 1


class Store:
    """Results by key; they outlive the process where there is a path.

    `fresh` starts anew, in place of what an earlier study left there. Raises `InputError` for a
    file of another study, unless it is fresh, and of something else.
    """

    def __init__(
        self, path: str | os.PathLike[str] | None, task: Task, fresh: bool = False
    ) -> None:
        self.path = None if path is None else Path(path)
        self.results: dict[str, Any] = {}
        asked = _asked(task)
        if self.path is None:
            return
        if self.path.is_dir():
            raise InputError(f"{self.path}: is a folder; name a file in it")
        there = self.path.exists() and self.path.stat().st_size > 0
        if there:
            with errors_in(self.path):
                self._read(asked, fresh)
        if fresh or not there:
            with replacing(self.path) as beside:
                beside.write_text(json.dumps(asked) + "\n", encoding="utf-8")

    def __contains__(self, key: str) -> bool:
        return key in self.results

    def __getitem__(self, key: str) -> Any:
        return self.results[key]

    def add(self, key: str, result: Any) -> None:
        """Keep a result; it is on the disk when this returns."""
        self.results[key] = result
        if self.path is None:
            return
        try:
            with self.path.open("a", encoding="utf-8") as file:
                file.write(json.dumps({"key": key, "result": result}) + "\n")
                file.flush()
                os.fsync(file.fileno())
        except OSError as error:
            raise InputError(f"{self.path}: cannot be written: {error.strerror or error}") from None

    def _read(self, asked: dict[str, Any], fresh: bool) -> None:
        assert self.path is not None
        try:
            data = self.path.read_bytes()
        except OSError as error:
            raise InputError(f"cannot be read: {error.strerror or error}") from None
        whole = data.rpartition(b"\n")[0]  # a crash leaves half a line
        head, *lines = whole.splitlines() or [b""]
        _check_head(head, asked, fresh)
        if fresh:
            return
        for number, line in enumerate(lines, 2):
            if not line.strip():
                continue
            try:
                one = json.loads(line)
                self.results[one["key"]] = one["result"]
            except (ValueError, KeyError, TypeError):
                raise InputError(
                    f"line {number} is damaged; remove the line, or the file"
                ) from None
        if len(whole) + 1 < len(data):
            os.truncate(self.path, len(whole) + 1)


def _asked(task: Task) -> dict[str, Any]:
    """What must be the same for results to be the same."""
    told = json.dumps(dict(task.document), sort_keys=True, default=str)
    return {
        "softmpc_study": FORMAT,
        "softmpc": sys.modules["softmpc"].__version__,
        "scene": _hash(told.encode()),
        "files": {name: _hash(path.read_bytes()) for name, path in _files(task).items()},
        "quick": task.quick,
    }


def _hash(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()[:32]


def _files(task: Task) -> dict[str, Path]:
    """The files that the scene names, like its table of inputs."""
    texts = [text for text in _texts(dict(task.document)) if Path(text).suffix]
    paths = {text: Path(task.folder) / text for text in sorted(set(texts))}
    return {name: path for name, path in paths.items() if path.is_file()}


def _texts(value: Any) -> Iterator[str]:
    """All values that are text, in tables and lists too."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, Mapping | list):
        for item in value.values() if isinstance(value, Mapping) else value:
            yield from _texts(item)


def _check_head(line: bytes, asked: dict[str, Any], fresh: bool) -> None:
    try:
        found = dict(json.loads(line))
    except (ValueError, TypeError):
        found = {}
    if "softmpc_study" not in found:
        raise InputError("is not the file of a study; name another one")
    other = [name for name, value in asked.items() if found.get(name) != value]
    if other and not fresh:
        raise InputError(
            f"holds another study, which differs in: {', '.join(other)}; name another folder, or "
            "start anew in this one (fresh, --fresh)"
        )
