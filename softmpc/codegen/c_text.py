"""C text of numbers: arrays, macros, files."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike

__all__ = ["array", "declaration", "define", "guard", "number", "string"]

WIDTH = 96  # characters of a line
REALS = ("smpc_real", "double")


def number(value: float, kind: str = "smpc_real") -> str:
    """A literal that a C compiler reads back as the same double; infinities are the largest."""
    if kind not in REALS:
        return str(int(value))
    if np.isnan(value):
        raise ValueError("a constant of the controller is not a number")
    if np.isinf(value):
        return "SMPC_HUGE" if value > 0 else "-SMPC_HUGE"
    text = repr(float(value))
    return text if any(mark in text for mark in ".e") else f"{text}.0"


def array(name: str, values: ArrayLike, kind: str = "smpc_real") -> str:
    """Definition of a constant array, row by row; an empty one keeps one zero, as C wants it."""
    flat = np.asarray(values).ravel()
    words = [number(value, kind) for value in flat] or ["0"]
    return f"const {kind} {name}[{len(words)}] = {{\n{_wrapped(words)}}};\n"


def declaration(name: str, size: int, kind: str = "smpc_real") -> str:
    """Declaration of the same array, for a header."""
    return f"extern const {kind} {name}[{max(size, 1)}];\n"


def define(name: str, value: object, comment: str = "") -> str:
    """One macro; numbers as C literals, text as a string."""
    if isinstance(value, bool):
        said = str(int(value))
    elif isinstance(value, float):
        said = number(value)
    else:
        said = string(value) if isinstance(value, str) else str(value)
    return f"#define {name} {said}{f' /* {comment} */' if comment else ''}\n"


def string(text: str) -> str:
    """A C string of printable ASCII; whatever else there is becomes a question mark."""
    safe = "".join(c if " " <= c <= "~" else "?" for c in text)
    return '"' + safe.replace("\\", "\\\\").replace('"', '\\"').replace("??", "? ?") + '"'


def guard(file_name: str, body: str) -> str:
    """A header with its include guard."""
    name = "SMPC_" + "".join(c if c.isalnum() else "_" for c in file_name).upper()
    return f"#ifndef {name}\n#define {name}\n\n{body}\n#endif\n"


def _wrapped(words: Iterable[str]) -> str:
    lines, line = [], "   "
    for word in words:
        if len(line) + len(word) + 2 > WIDTH:
            lines.append(line)
            line = "   "
        line += f" {word},"
    return "\n".join([*lines, line]) + "\n"
