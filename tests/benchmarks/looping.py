"""The Jacobian of long arms: one graph written out against small functions called in loops.

    python -m tests.benchmarks.looping [--written-out N]

For 1 to 16 segments a section of the default scene, whatever the model itself takes: seconds to
build, instructions as in the C code (each function once) and executed in a call, microseconds a
call in CasADi's virtual machine; of the loops also seconds to compile, and microseconds compiled.
The graph is written out up to N segments a section, 8 unless told.
"""

from __future__ import annotations

import os
import tempfile
import time

import casadi as ca

from softmpc.compiled import compiled, instructions
from softmpc.compiler import compiler
from softmpc.model import jacobians
from softmpc.model.counting import executed
from softmpc.model.model import build
from softmpc.model.presets import chen2022
from softmpc.model.scene import Scene
from tests.benchmarks.common import arguments, key
from tests.benchmarks.instructions import microseconds

COLUMNS = ("", "build s", "code", "executed", "µs", "compile s", "µs")
FORMATS = (".2f", ",", ",", ".0f", ".1f", ".0f")
SEGMENTS = (1, 2, 4, 8, 16)


def jacobian(segments: int, most_written_out: int) -> tuple[ca.Function, float]:
    """The function, and the seconds it took to build."""
    jacobians.MOST_WRITTEN_OUT = most_written_out
    model = build(Scene(chen2022(), segments=segments))
    began = time.perf_counter()
    function = model.residual_jacobian
    return function, time.perf_counter() - began


def measured(segments: int, written_out: bool) -> dict[str, float]:
    """What one function costs, by column; the one in loops is compiled too."""
    function, built = jacobian(segments, 1000 if written_out else 0)
    found = {"build_s": built, "code_instructions": instructions(function)}
    found |= {"executed_instructions": executed(function), "us": microseconds(function)}
    if written_out or compiler() is None:
        return found
    with tempfile.TemporaryDirectory() as cache:
        os.environ["SOFTMPC_CACHE"] = cache
        began = time.perf_counter()
        fast = compiled(function, "require")
        found["compile_s"] = time.perf_counter() - began
        return found | {"compiled_us": microseconds(fast)}


def numbers(quick: bool) -> dict[str, float]:
    """Four segments a section in quick mode; else 1 to 16, written out up to 8."""
    found: dict[str, float] = {}
    for segments in (4,) if quick else SEGMENTS:
        kinds = {"written_out": True, "in_loops": False}
        both = {
            kind: measured(segments, out) for kind, out in kinds.items() if not out or segments <= 8
        }
        for kind, each in both.items():
            found |= {f"{key(segments, 'segments', kind)}_{what}": v for what, v in each.items()}
    return found


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--written-out", type=int, default=8, metavar="N")
    largest = parser.parse_args().written_out
    print("segments   " + "".join(f"{name:>12}" for name in COLUMNS))
    for segments in SEGMENTS:
        for written_out in (True, False) if segments <= largest else (False,):
            kind = "written out" if written_out else "in loops"
            cells = line(measured(segments, written_out))
            print(f"2 × {segments:<7d}" + "".join(f"{c:>12}" for c in [kind, *cells]), flush=True)


def line(found: dict[str, float]) -> list[str]:
    """Cells of the table."""
    each = zip(found.values(), FORMATS, strict=False)
    return [format(v, how) for v, how in each] + ["-"] * (len(FORMATS) - len(found))


if __name__ == "__main__":
    main()
