"""What a generated controller takes of a Cortex-M7: flash, RAM and the deepest stack.

The figures are those of a linked program of `board/`, so that whatever the controller needs of the
C library is in them, and a part of their table each: of `board_main.c`, which runs recorded steps,
and where the scene has a rig of `pilot_main.c`, with estimator and supervision.
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from softmpc.codegen.emulate import read_sizes, refused_float
from softmpc.codegen.stack_bound import read_code, read_frames
from softmpc.codegen.targets import (
    CORTEX_M7,
    PRECISIONS,
    STARTUP,
    board_of,
    build,
    flags_of,
    run_tool,
)
from softmpc.errors import BuildError, InputError, unknown_name

__all__ = ["BUDGETS", "PILOT", "footprint", "footprint_table"]

# Linker scripts in board/ by the name of the chip; its regions are the budget.
BUDGETS = {"STM32H743": "stm32h743.ld"}
REGIONS = {"flash": "FLASH", "ram": "RAM", "stack": "STACK"}
ENTRIES = (
    "smpc_init", "smpc_set_reference", "smpc_prepare", "smpc_feedback", "smpc_pilot_init",
    "smpc_pilot_listen", "smpc_pilot_step",
)  # fmt: skip
PILOT = replace(CORTEX_M7, program=("pilot_main.c", *STARTUP))
ALLOCATORS = ("malloc", "calloc", "realloc", "free", "_malloc_r", "_sbrk", "_sbrk_r", "sbrk")
BOARD, LIBRARY, MODEL, SOLVER, OWN = "board", "C library", "model", "DAQP", "controller"
ESTIMATOR = "estimator and supervision"
ESTIMATES = ("estimator", "kalman", "readings", "pilot", "supervision")  # how its files begin
# DAQP moves a row of its working set by taking it out and in again, which may move the next one; it
# has no bound of its own. Counted is one turn for each row that there may be, one more than
# variables; on 3000 random states with limits at work it took 2 in double and 8 in float.
REORDERING = "daqp_pivot_last"
PREFIX = "arm-none-eabi-"

_SECTION = re.compile(r"^ (\.\S+|COMMON)\s+0x([0-9a-f]+)\s+0x([0-9a-f]+) (.+)$", re.MULTILINE)
_LENGTH = re.compile(r"^\s*(\w+)\s*\(\w+\)\s*:.*LENGTH\s*=\s*(\d+)([KM])", re.MULTILINE)


@dataclass(frozen=True)
class _Program:
    """A linked program and the folder of its object files."""

    path: Path

    def tool(self, name: str, *options: str) -> str:
        return run_tool([PREFIX + name, *options, str(self.path)])

    def sections(self) -> dict[str, int]:
        """Bytes of each kind: what `size` calls text, data and bss."""
        words = self.tool("size").splitlines()[1].split()
        return {"text": int(words[0]), "data": int(words[1]), "bss": int(words[2])}

    def parts(self) -> dict[str, dict[str, int]]:
        """Bytes of code, constants and variables of each part, from the linker's map."""
        text = self.path.with_name(f"{self.path.name}.map").read_text(encoding="utf-8")
        placed = text.partition("Linker script and memory map")[2]
        placed = re.sub(r"^( \.\S+)\n +0x", r"\1 0x", placed, flags=re.MULTILINE)
        found: dict[str, dict[str, int]] = {}
        for section, _, size, origin in _SECTION.findall(placed):
            if kind := _kind(section):
                part = found.setdefault(_part(origin), {"code": 0, "constants": 0, "variables": 0})
                part[kind] += int(size, 16)
        return found

    def symbols(self) -> dict[str, tuple[int, int]]:
        """Address and size of each name."""
        found = {}
        for line in self.tool("nm", "-S").splitlines():
            words = line.split()
            if len(words) >= 3:
                size = int(words[1], 16) if len(words) == 4 else 0
                found[words[-1]] = (int(words[0], 16), size)
        return found


def footprint(
    directory: str | Path, budget: str = "STM32H743", precisions: Sequence[str] = PRECISIONS
) -> dict[str, Any]:
    """What the controller in `directory` takes of a Cortex-M7, in bytes, and whether it fits.

    `directory` is what `softmpc codegen` has written. Of each precision the result has `flash`,
    `ram` (without the stack) and `stack`, each with `bytes`, `budget` and `fits`; the
    `controller`'s own memory; `calls` with the deepest stack of each function; the `parts` of the
    program; the `allocators` of heap memory that are in it; the functions that do arithmetic of
    doubles by software (`software_double`), those that call a pointer (`by_pointer`), and how deep
    functions that call themselves are counted (`nested`). The stack has no `bytes` where nothing
    bounds it, and `why` says what. Where the controller cannot be in float, `refused` says why
    instead. Raises `InputError` for a directory that is none of a controller, `BuildError` where
    tools are missing or fail.
    """
    directory = Path(directory)
    if budget not in BUDGETS:
        raise InputError(unknown_name("budget", budget, BUDGETS))
    regions = _regions(board_of(directory) / BUDGETS[budget])
    found: dict[str, Any] = {"budget": budget, "refused": refused_float(directory)}
    for precision in precisions:
        if precision == "float" and found["refused"]:
            continue
        with tempfile.TemporaryDirectory(prefix="softmpc-footprint-") as scratch:
            found[precision] = _of(directory, precision, Path(scratch), regions)
    found["compiler"] = run_tool([CORTEX_M7.compiler, "--version"]).splitlines()[0]
    return found


def _of(directory: Path, precision: str, scratch: Path, regions: dict[str, int]) -> dict[str, Any]:
    target = PILOT if (directory / "pilot.h").is_file() else CORTEX_M7
    program = _Program(build(directory, target, precision, scratch, ("-fstack-usage",)))
    symbols, sections = program.symbols(), program.sections()
    if "controller" not in symbols:
        raise BuildError(f"{directory}: the program in board/ has no variable `controller`")
    listing = program.tool("objdump", "-d", "--no-show-raw-insn")
    addresses = {name: address for name, (address, _) in symbols.items()}
    turns = {REORDERING: read_sizes(directory).get("MOVES", 0) + 2}
    code = read_code(listing, addresses, read_frames(scratch), turns)
    deepest = {name: code.deepest(name) for name in ENTRIES if name in symbols}
    whole = code.deepest("smpc_reset")
    used = {
        "flash": sections["text"] + sections["data"],
        "ram": sections["data"] + sections["bss"],
        "stack": whole.bytes,
    }
    return {
        "flags": " ".join(flags_of(CORTEX_M7, precision)),
        **{name: _against(bytes_, regions[name]) for name, bytes_ in used.items()},
        "why": whole.why,
        "controller": symbols["controller"][1],
        "calls": {n: {"bytes": d.bytes, "path": list(d.path)} for n, d in deepest.items()},
        "by_pointer": list(whole.indirect),
        "nested": {name: count for name, count in turns.items() if name in symbols},
        "parts": program.parts(),
        "allocators": [name for name in ALLOCATORS if name in symbols],
        "software_double": code.callers(_is_software_double),
    }


def _against(bytes_: int | None, budget: int) -> dict[str, Any]:
    return {"bytes": bytes_, "budget": budget, "fits": bytes_ is not None and bytes_ <= budget}


def _regions(script: Path) -> dict[str, int]:
    """Bytes of the regions of a linker script."""
    text = script.read_text(encoding="utf-8")
    units = {"K": 1024, "M": 1024 * 1024}
    lengths = {name: int(count) * units[unit] for name, count, unit in _LENGTH.findall(text)}
    return {name: lengths[region] for name, region in REGIONS.items()}


def _kind(section: str) -> str:
    """What a section of an object file is for; nothing where it is not in memory."""
    name = section.split(".")[1] if section.startswith(".") else section
    kinds = {"text": "code", "vectors": "code", "ARM": "", "rodata": "constants"}
    return kinds.get(name, "variables" if name in ("data", "bss", "COMMON") else "")


def _part(origin: str) -> str:
    """The part of the program that an object file is of."""
    if ".a(" in origin or origin.startswith("/"):
        return LIBRARY
    if origin.startswith("board/"):
        return BOARD
    if "daqp" in origin:
        return SOLVER
    if origin.startswith(ESTIMATES):
        return ESTIMATOR
    return MODEL if origin.startswith("model") else OWN


def _is_software_double(name: str) -> bool:
    """Whether it is arithmetic of doubles without a unit for them: __aeabi_dmul and the like."""
    return bool(re.fullmatch(r"__aeabi_(d(add|r?sub|mul|div)|c?dcmp\w*)", name))


def footprint_table(found: dict[str, Any]) -> str:
    """The same as text: a column for each precision."""
    columns = [found[p] for p in PRECISIONS if p in found]
    parts = sorted({name for one in columns for name in one["parts"]})

    def row(title: str, cells: list[str]) -> str:
        return f"{title:<30}" + "".join(f"{cell:>22}" for cell in cells)

    lines = [
        f"Cortex-M7 against an {found['budget']}, compiled by {found['compiler']}",
        row("", [p for p in PRECISIONS if p in found]),
        *(
            row(f"{name} of {columns[0][name]['budget'] / 1024:.0f} KiB", _verdicts(columns, name))
            for name in REGIONS
        ),
        row("heap", [", ".join(one["allocators"]) or "none" for one in columns]),
        row("the controller's memory", [_kib(one["controller"]) for one in columns]),
        "code and constants",
        *(row(f"  {part}", [_kib(_stored(one, part)) for one in columns]) for part in parts),
    ]
    for precision in (p for p in PRECISIONS if p in found):
        lines += _notes(precision, found[precision])
    if found["refused"]:
        lines.append(found["refused"])
    return "\n".join(lines) + "\n"


def _verdicts(columns: list[dict[str, Any]], name: str) -> list[str]:
    cells = []
    for one in (column[name] for column in columns):
        verdict = "fits" if one["fits"] else "too much"
        cells.append("no bound" if one["bytes"] is None else f"{_kib(one['bytes'])} {verdict}")
    return cells


def _kib(bytes_: int) -> str:
    return f"{bytes_ / 1024:.1f} KiB"


def _stored(one: dict[str, Any], part: str) -> int:
    here = one["parts"].get(part, {})
    return int(here.get("code", 0) + here.get("constants", 0))


def _notes(precision: str, one: dict[str, Any]) -> list[str]:
    """What a column has no room for."""
    deepest = max(one["calls"].values(), key=lambda call: call["bytes"] or 0)
    notes = [one["why"] or f"deepest call: {' > '.join(deepest['path'])}"]
    for name, count in one["nested"].items():
        notes.append(f"{name} comes to call itself; counted {count} deep, once for each row")
    if one["by_pointer"]:
        notes.append(f"calls by pointer, not in the stack's bound: {', '.join(one['by_pointer'])}")
    if one["software_double"]:
        notes.append(f"arithmetic of doubles in software: {', '.join(one['software_double'])}")
    return [f"{precision}: {note}" for note in notes]
