"""The deepest stack of functions, from what gcc says of their frames and calls."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

FLAGS = ("-fcallgraph-info=su",)  # of gcc, from version 10 on; a file .ci beside each object
# DAQP reorders its active constraints by functions that call each other.
REORDERING = ("daqp_pivot_last", "daqp_remove_constraint", "daqp_add_constraint_keep_slack")
RED_ZONE = 128  # bytes below the stack pointer that some processors let a last function use
_NODE = re.compile(r'node: { title: "([^"]+)" label: "[^"]*?(\d+) bytes \(([\w,]+)\)"')
_EDGE = re.compile(r'sourcename: "([^"]+)" targetname: "([^"]+)"')
_FOLDER = re.compile(r'"/[^"]*/(\w+\.c:)')


def frames(objects: Sequence[Path]) -> tuple[dict[str, int], dict[str, set[str]]]:
    """Bytes of the frame of each function, and whom it calls; without the names of files."""
    bytes_: dict[str, int] = {}
    calls: dict[str, set[str]] = {}
    for file in objects:
        text = _FOLDER.sub(r'"\1', file.with_suffix(".ci").read_text())
        for name, size, kind in _NODE.findall(text):
            assert kind in ("static", "dynamic,bounded"), f"{name}: its frame is {kind}"
            bytes_[name] = int(size)
        for caller, called in _EDGE.findall(text):
            calls.setdefault(caller, set()).add(called)
    return bytes_, calls


class Stack:
    """The deepest stack of each function; those of `REORDERING` call each other `turns` times."""

    def __init__(self, objects: Sequence[Path], turns: int) -> None:
        self.sizes, self.calls = frames(objects)
        self.group = {name for name in self.sizes if name.endswith(REORDERING)}
        assert len(self.group) == len(REORDERING)
        self.turns = turns * sum(self.sizes[name] for name in self.group)

    def of(self, name: str) -> int:
        """Bytes; of the C library only what calls push."""
        return self._below(name, ()) + RED_ZONE

    def _below(self, name: str, path: tuple[str, ...]) -> int:
        assert name not in path, f"recursion: {' > '.join(path)} > {name}"
        if name in self.group:
            called = {c for one in self.group for c in self.calls.get(one, ())} - self.group
            frame, path = self.turns, (*path, *self.group)
        else:
            called, frame = self.calls.get(name, set()), self.sizes.get(name, 8)
        return frame + max((self._below(other, (*path, name)) for other in called), default=0)
