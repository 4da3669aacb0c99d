"""The Jacobian of long arms: one graph written out against small functions called in loops.

    python -m tests.benchmarks.looping [--written-out N]

For 1 to 16 segments a section of the default scene, whatever the model itself takes: seconds to
build, instructions as in the C code (each function once) and executed in a call, microseconds a
call in CasADi's virtual machine; of the loops also seconds to compile, and microseconds compiled.
The graph is written out up to N segments a section, 8 unless told.
"""

from __future__ import annotations

import argparse
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
from tests.benchmarks.instructions import microseconds

COLUMNS = ("", "build s", "code", "executed", "µs", "compile s", "µs")


def jacobian(segments: int, most_written_out: int) -> tuple[ca.Function, float]:
    """The function, and the seconds it took to build."""
    jacobians.MOST_WRITTEN_OUT = most_written_out
    model = build(Scene(chen2022(), segments=segments))
    began = time.perf_counter()
    function = model.residual_jacobian
    return function, time.perf_counter() - began


def row(function: ca.Function, built: float, compile_it: bool) -> list[str]:
    code, work = f"{instructions(function):,}", f"{executed(function):,}"
    cells = [f"{built:.2f}", code, work, f"{microseconds(function):.0f}"]
    if not compile_it or compiler() is None:
        return [*cells, "-", "-"]
    with tempfile.TemporaryDirectory() as cache:
        os.environ["SOFTMPC_CACHE"] = cache
        began = time.perf_counter()
        fast = compiled(function, "require")
        return [*cells, f"{time.perf_counter() - began:.1f}", f"{microseconds(fast):.0f}"]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--written-out", type=int, default=8, metavar="N")
    largest = parser.parse_args().written_out
    print("segments   " + "".join(f"{name:>12}" for name in COLUMNS))
    for segments in (1, 2, 4, 8, 16):
        kinds = [("written out", 1000, False)] if segments <= largest else []
        for kind, most, compile_it in [*kinds, ("in loops", 0, True)]:
            cells = row(*jacobian(segments, most), compile_it)
            print(f"2 × {segments:<7d}" + "".join(f"{c:>12}" for c in [kind, *cells]), flush=True)


if __name__ == "__main__":
    main()
