"""The deepest stack of a program for Arm: its calls from the machine code, frames of each function.

The frame is what the compiler says (`-fstack-usage`); of a library's functions, which come without,
it is all that their code pushes or takes off the stack pointer, which is never too little. A jump
from one function into another counts as a call.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

__all__ = ["Code", "Deepest", "Function", "read_code", "read_frames"]

_HEADER = re.compile(r"^([0-9a-f]+) <(.+)>:$")
_LINE = re.compile(r"^ +([0-9a-f]+):\t(\S+)(?:\t([^;@]*))?")
_AWAY = re.compile(r"^(?:bx?|blx?)(?:eq|ne|cs|cc|mi|pl|vs|vc|hi|ls|ge|lt|gt|le|al)?(?:\.[nw])?$")
_REGISTERS = re.compile(r"\b([a-z]+)(\d*)(?:-[a-z]+(\d+))?")
PADDING = (("nop", ""), ("nop.w", ""), ("movs", "r0, r0"))
_END = re.compile(r"^(?:b(?:\.[nw])?|bx(?:\.n)?|udf.*|\.word|\.short)$")


@dataclass
class Function:
    """One function of the program."""

    name: str
    first: int  # address
    frame: int | None = 0  # bytes; None where no constant bounds them
    calls: set[int] = field(default_factory=set)  # addresses
    indirect: bool = False  # whether it calls what a pointer points to
    falls: bool = False  # whether it runs on into the function behind it


@dataclass(frozen=True)
class Deepest:
    """The deepest stack from a function on; `bytes` is None where nothing bounds it."""

    bytes: int | None
    path: tuple[str, ...]  # functions from the first to the last
    indirect: tuple[str, ...] = ()  # those on any path that call by pointer: not counted
    why: str = ""  # there is no bound


class Code:
    """All functions of a program, by name and by address.

    `turns` says of a function that calls itself, or those that call it, how often it does at most.
    """

    def __init__(
        self, functions: Iterable[Function], names: dict[str, int], turns: dict[str, int]
    ) -> None:
        self.functions = {f.first: f for f in functions}
        self.names, self.turns = names, turns
        self._after = dict(pairwise(sorted(self.functions)))
        self._found: dict[int, Deepest] = {}
        self._all: dict[int, set[int]] = {}

    def deepest(self, name: str) -> Deepest:
        """The deepest stack when `name` is called, its own frame included."""
        return self._deepest(self.names[name])

    def callers(self, wanted: Callable[[str], bool]) -> list[str]:
        """Names of the functions that call one whose name is wanted, but for the compiler's own."""
        called = {address for name, address in self.names.items() if wanted(name)}
        found = {f.name for f in self.functions.values() if f.calls & called}
        return sorted(name for name in found if not name.startswith("__aeabi_"))

    def _deepest(self, first: int) -> Deepest:
        if first not in self._found:
            ring = [f for f in self._below(first) if first in self._below(f)] or [first]
            below = {call for f in ring for call in self._called(f)} - set(ring)
            deeper = [self._deepest(call) for call in sorted(below)]
            own = self._together([self.functions[f] for f in ring], first)
            why = next((deep.why for deep in (own, *deeper) if deep.why), "")
            indirect = tuple(sorted({name for deep in (own, *deeper) for name in deep.indirect}))
            most = max(deeper, key=lambda deep: deep.bytes or 0, default=Deepest(0, ()))
            depth = None if why else (own.bytes or 0) + (most.bytes or 0)
            path = () if why else own.path + most.path
            self._found[first] = Deepest(depth, path, indirect, why)
        return self._found[first]

    def _together(self, ring: list[Function], first: int) -> Deepest:
        """A function, or several that call each other."""
        names = sorted(f.name for f in ring)
        indirect = tuple(f.name for f in ring if f.indirect)
        loose = [f.name for f in ring if f.frame is None]
        if loose:
            return Deepest(None, (), indirect, f"{loose[0]} takes a stack of no fixed size")
        frames, path = sum(f.frame or 0 for f in ring), (self.functions[first].name,)
        if first not in self._below(first):
            return Deepest(frames, path, indirect)
        turns = next((self.turns[name] for name in names if name in self.turns), 0)
        if not turns:
            return Deepest(None, (), indirect, f"recursion: {', '.join(names)}")
        return Deepest(turns * frames, (f"{turns} x ({', '.join(names)})",), indirect)

    def _called(self, first: int) -> set[int]:
        """First addresses of the functions that it calls, jumps or falls into."""
        here = self.functions[first]
        called = {call for call in here.calls if call in self.functions}
        return called | ({self._after[first]} if here.falls and first in self._after else set())

    def _below(self, first: int) -> set[int]:
        """All that it may reach; itself only where it calls itself."""
        if first not in self._all:
            found, left = set(), self._called(first)
            while left:
                found |= left
                left = {call for f in left for call in self._called(f)} - found
            self._all[first] = found
        return self._all[first]


def read_code(
    listing: str,
    symbols: dict[str, int],
    frames: dict[str, int | None],
    turns: dict[str, int] | None = None,
) -> Code:
    """The functions of `objdump -d --no-show-raw-insn`; `symbols` has addresses of all names.

    `frames` of those functions that a compiler has measured, None where no constant bounds them;
    `turns` as for `Code`.
    """
    functions: list[Function] = []
    bodies: list[list[tuple[int, str, str]]] = []
    for line in listing.splitlines():
        if header := _HEADER.match(line):
            functions.append(Function(header[2], int(header[1], 16)))
            bodies.append([])
        elif functions and (found := _LINE.match(line)):
            bodies[-1].append((int(found[1], 16), found[2], (found[3] or "").strip()))
    owner = _owners(functions, bodies)
    for function, body in zip(functions, bodies, strict=True):
        _read_body(function, body, owner)
        plain = re.sub(r"\.(?:constprop|isra|part|cold)\b.*", "", function.name)
        measured = frames.get(function.name, frames.get(plain, -1))
        function.frame = function.frame if measured == -1 else measured
    return Code(functions, symbols, turns or {})


def _owners(
    functions: list[Function], bodies: list[list[tuple[int, str, str]]]
) -> dict[int, Function]:
    """The function that each instruction is of."""
    return {
        address: function
        for function, body in zip(functions, bodies, strict=True)
        for address, _, _ in body
    }


def _read_body(
    function: Function, body: list[tuple[int, str, str]], owner: dict[int, Function]
) -> None:
    for _, word, rest in body:
        taken = _taken(word, rest)
        function.frame = None if taken is None or function.frame is None else function.frame + taken
        if word.startswith("blx") or (word.startswith("bx") and rest != "lr"):
            function.indirect |= not rest.startswith("0x") and "<" not in rest
        if word.startswith(("ldr", "mov")) and rest.startswith("pc,") and "[sp" not in rest:
            function.indirect = True
        if (_AWAY.match(word) or word.startswith("cb")) and "<" in rest:
            target = int(rest.split("<")[0].split(",")[-1].strip(), 16)
            there = owner.get(target)
            call = word.startswith(("bl.", "blx")) or word == "bl"
            if there is not None and (there is not function or (call and target == function.first)):
                function.calls.add(there.first)
    code = [(word, rest) for _, word, rest in body if (word, rest) not in PADDING]
    function.falls = bool(code) and not _ends(*code[-1])


def _ends(word: str, rest: str) -> bool:
    """Whether nothing runs on behind that instruction."""
    returns = "pc" in rest and word.startswith(("pop", "ldm", "ldr", "mov"))
    return bool(_END.match(word)) or returns


def _taken(word: str, rest: str) -> int | None:
    """Bytes that an instruction takes of the stack; None where that is no constant."""
    if word.startswith(("push", "stmdb")) and (word.startswith("push") or rest.startswith("sp!")):
        return 4 * _count(rest)
    if word.startswith("vpush") or (word.startswith("vstmdb") and rest.startswith("sp!")):
        return (8 if "{d" in rest else 4) * _count(rest)
    if word.startswith("str") and (found := re.search(r"\[sp, #-(\d+)\]!", rest)):
        return int(found[1])
    if word.startswith("sub") and rest.startswith("sp,"):
        found = re.search(r"#(\d+)$", rest)
        return int(found[1]) if found else None
    if word.startswith("add") and rest.startswith("sp, r"):
        return None
    return 0


def _count(rest: str) -> int:
    """Registers of a list such as {r4, r5, lr} or {d8-d10}."""
    inner = rest[rest.index("{") + 1 : rest.index("}")]
    return sum(
        int(last) - int(first) + 1 if last else 1 for _, first, last in _REGISTERS.findall(inner)
    )


def read_frames(folder: Path) -> dict[str, int | None]:
    """Frames of all `.su` files below a folder; the largest where a name is there twice."""
    found: dict[str, int | None] = {}
    for path in folder.rglob("*.su"):
        for line in path.read_text(encoding="utf-8").splitlines():
            place, size, kind = line.split("\t")
            name = place.rsplit(":", 1)[-1]
            bounded = "static" in kind or "bounded" in kind
            before = found.get(name, 0)
            small = bounded and before is not None
            found[name] = max(int(size), before or 0) if small else None
    return found
