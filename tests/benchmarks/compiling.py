"""What compiling costs, and what it saves.

    python -m tests.benchmarks.compiling [--segments 1,2,4] [--flags] [--all]

For the residual of the paper's arm and its Jacobian at 1, 2 and 4 segments a section, and for a
loop of 100 residuals (a function that calls another): instructions (those of called functions
once), seconds to compile, milliseconds to find it in the cache and load it, microseconds a call
(median) in CasADi's virtual machine and compiled, their ratio, and after how many calls compiling
has paid. `--flags` compares flags of the compiler instead; `--all` measures what `auto` leaves in
the virtual machine, too.
"""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import casadi as ca

from softmpc.compiled import LARGEST, c_code, compiled, compiler, instructions
from softmpc.compiler import Compiler
from softmpc.model.model import Model, build
from softmpc.model.presets import chen2022
from softmpc.model.scene import Scene
from tests.benchmarks.common import LeftOut, arguments, key
from tests.benchmarks.instructions import microseconds

CALLS = 100
BASE = ("-ffp-contract=off", "-march=native")
FLAGS = (
    ("-O0", *BASE),
    ("-O1", *BASE),
    ("-O2", *BASE),
    ("-O3", *BASE),
    ("-O1", "-ffp-contract=off"),
    ("-O1", "-march=native"),
    ("-O1", "-fno-math-errno", *BASE),
    ("-O2", "-fno-tree-vectorize", *BASE),
)


def march(model: Model) -> ca.Function:
    """100 explicit steps of ddq ← ddq - r: a loop over a function, as an integrator has it."""
    layout = model.layout
    sizes = {"q": layout.q, "dq": layout.dq, "ddq": layout.ddq, "p": layout.p}
    q, dq, ddq, p = (ca.MX.sym(name, len(variables)) for name, variables in sizes.items())
    step = ca.Function("one", [ddq, q, dq, p], [ddq - 1e-6 * model.residual(q, dq, ddq, p)])
    loop = step.mapaccum("loop", CALLS)
    return ca.Function("march", [q, dq, ddq, p], [loop(ddq, q, dq, p)[:, -1]])


def functions(segments: list[int]) -> Iterator[tuple[int, ca.Function]]:
    for n in segments:
        model = build(Scene(chen2022(), segments=n))
        yield n, model.residual
        yield n, model.residual_jacobian
        yield n, march(model)


def seconds_to_compile(cc: Compiler, code: str, folder: Path) -> float:
    source = folder / "function.c"
    source.write_text(code, encoding="utf-8")
    start = time.perf_counter()
    cc.build(source, folder / "function.so", seconds=600)
    return time.perf_counter() - start


def measured(function: ca.Function) -> dict[str, float]:
    """What compiling a function costs and gives; the second time it is in the cache."""
    start = time.perf_counter()
    compiled(function, "require")
    middle = time.perf_counter()
    fast = compiled(function, "require")
    found = {"compile_s": middle - start, "load_ms": 1e3 * (time.perf_counter() - middle)}
    found |= {"us": microseconds(function), "compiled_us": microseconds(fast)}
    found["time_ratio"] = found["us"] / found["compiled_us"]
    return found


def numbers(quick: bool) -> dict[str, float]:
    """Residual, Jacobian and loop: at one segment in quick mode, else at 1, 2 and 4."""
    if compiler() is None:
        raise LeftOut("needs a C compiler")
    found: dict[str, float] = {}
    with tempfile.TemporaryDirectory() as folder:
        os.environ["SOFTMPC_CACHE"] = folder
        for n, function in functions([1] if quick else [1, 2, 4]):
            name = key(n, "segments" if n > 1 else "segment", function.name())
            found[f"{name}_instructions"] = instructions(function)
            if instructions(function) <= LARGEST:
                found |= {f"{name}_{what}": value for what, value in measured(function).items()}
    return found


def table(segments: list[int], everything: bool) -> None:
    print("segments  function           instructions  compile s  load ms     VM µs  compiled µs"
          "  ratio  pays after calls")  # fmt: skip
    for n, function in functions(segments):
        size = instructions(function)
        line = f"{n:8d}  {function.name():17s} {size:13,d}"
        if size > LARGEST and not everything:
            print(f"{line}  left in the virtual machine, as in use", flush=True)
            continue
        found = measured(function)
        pays = 1e6 * found["compile_s"] / (found["us"] - found["compiled_us"])
        print(f"{line} {found['compile_s']:10.2f} {found['load_ms']:8.1f} {found['us']:9.1f}"
              f" {found['compiled_us']:12.1f} {found['time_ratio']:6.1f} {pays:17,.0f}",
              flush=True)  # fmt: skip


def table_of_flags(cc: Compiler, segments: list[int], folder: Path) -> None:
    print("segments  function           instructions  compile s  compiled µs  flags")
    for n, function in functions(segments):
        code = c_code(function)
        for k, flags in enumerate(FLAGS):
            place = folder / f"{n}-{function.name()}-{k}"
            place.mkdir()
            took = seconds_to_compile(replace(cc, flags=flags), code, place)
            us = microseconds(ca.external(function.name(), str(place / "function.so")))
            print(f"{n:8d}  {function.name():17s} {instructions(function):13,d} {took:10.2f}"
                  f" {us:12.1f}  {' '.join(flags)}", flush=True)  # fmt: skip


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--segments", default="1,2,4", help="of each section")
    parser.add_argument("--flags", action="store_true", help="compare flags of the compiler")
    parser.add_argument("--all", action="store_true", help="functions beyond the limit, too")
    given = parser.parse_args()
    segments = [int(n) for n in given.segments.split(",")]
    cc = compiler()
    if cc is None:
        print("no C compiler")
        return
    print(f"{cc} {' '.join(cc.flags)}")
    with tempfile.TemporaryDirectory() as folder:
        os.environ["SOFTMPC_CACHE"] = folder
        if given.flags:
            table_of_flags(cc, segments, Path(folder))
        else:
            table(segments, given.all)


if __name__ == "__main__":
    main()
