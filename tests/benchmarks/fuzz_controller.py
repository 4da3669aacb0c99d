"""Random inputs for a controller in C: each step returns, soon, with an input within its limits.

    python -m tests.benchmarks.fuzz_controller [SCENE] [--steps 1000000] [--seed 1] [--workers 2]
                                               [--float] [--sanitize] [--cc gcc] [--budget 0.1]

Generates the controller of a scene (examples/figure_eight.toml), compiles it with `tests/codegen_c/
fuzz.c`, which says what is drawn and checked, and runs it: as for a release, or with `--sanitize`
under the address and undefined-behaviour sanitizers. Prints how long the compiler takes for the
directory, how large its objects are, the stack of a step, and the longest step. The workers share
the steps, each with a seed of its own. Ends with 1 where a step was wrong or took longer than
`--budget` s of CPU time.
"""

from __future__ import annotations

import argparse
import re
import resource
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from softmpc.codegen.emulate import read_sizes
from softmpc.codegen.generate import generate_file
from tests.benchmarks.common import EXAMPLES, ROOT, LeftOut, arguments
from tests.codegen_stack import FLAGS, Stack

FUZZ = ROOT / "tests" / "codegen_c" / "fuzz.c"
MORE = ("arm", "demo")  # folders that are compiled beside the controller
SINGLE = {
    "gcc": ("-DSMPC_FLOAT", "-fsingle-precision-constant"),
    "clang": ("-DSMPC_FLOAT", "-Xclang", "-cl-single-precision-constant"),
}  # fmt: skip
RELEASE = ("-std=c99", "-O2", "-ffp-contract=off", "-fno-math-errno")
CHECKED = (
    "-std=c99", "-O1", "-g1", "-ffp-contract=off", "-fsanitize=address,undefined",
    "-fno-sanitize-recover=all",
)  # fmt: skip


@dataclass(frozen=True)
class Compiled:
    """A part of the directory: its objects, CPU time (s) of the compiler, bytes of all."""

    objects: list[Path]
    cpu_s: float
    longest: tuple[float, str]  # s, and which file
    bytes: int


@dataclass(frozen=True)
class Fuzz:
    """The program, what compiling the directory took and made, stacks of calls (bytes)."""

    program: Path
    parts: dict[str, Compiled]
    stack: dict[str, int]

    def lines(self) -> Iterator[str]:
        for name, one in self.parts.items():
            yield (
                f"  {name}: {one.cpu_s:.1f} s of CPU time for {len(one.objects)} files "
                f"({one.longest[0]:.1f} s for {one.longest[1]}), {one.bytes / 1024:.0f} KiB"
            )
        if self.stack:
            told = (f"{name} {count} bytes" for name, count in self.stack.items())
            yield f"  stack: {', '.join(told)}"


def compiled(folder: Path, cc: str, flags: Sequence[str], more: Sequence[str]) -> Fuzz:
    """The program of a generated directory, and objects of more folders in it."""
    files = {"controller": sorted(folder.glob("*.c"))}
    files |= {of: sorted((folder / of).glob("*.c")) for of in more}
    parts = {
        name: _objects(folder, some, folder / "fuzz" / name, [cc, *flags])
        for name, some in files.items()
    }
    program, objects = folder / "fuzz" / "program", parts["controller"].objects
    own = [str(FUZZ), *map(str, objects)]
    _run([cc, *flags, f"-I{folder}", *own, "-o", str(program), "-lm"])
    found: dict[str, int] = {}
    if FLAGS[0] in flags:
        stack = Stack(objects, read_sizes(folder)["MOVES"] + 2)
        found = {call: stack.of(call) for call in ("smpc_prepare", "smpc_feedback", "smpc_step")}
    return Fuzz(program, parts, found)


def _objects(folder: Path, files: Sequence[Path], into: Path, words: list[str]) -> Compiled:
    into.mkdir(parents=True)
    made, began, longest = [into / f"{file.stem}.o" for file in files], _children(), (0.0, "")
    for file, there in zip(files, made, strict=True):
        before = _children()
        _run([*words, f"-I{folder}", "-c", str(file), "-o", str(there)])
        longest = max(longest, (_children() - before, file.name))
    took = _children() - began
    rows = _run(["size", *map(str, made)]).splitlines()[1:]
    total = sum(int(row.split()[0]) + int(row.split()[1]) for row in rows)  # code and constants
    return Compiled(made, took, longest, total)


def _children() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _run(words: list[str]) -> str:
    done = subprocess.run(words, capture_output=True, text=True)
    if done.returncode:
        sys.exit(f"{' '.join(words)}\n{done.stderr}")
    return done.stdout


def fuzzed(program: Path, steps: int, seed: int, budget: float) -> tuple[int, str, str]:
    done = subprocess.run(
        [str(program), str(steps), str(seed), str(budget)], capture_output=True, text=True
    )
    return done.returncode, done.stdout, done.stderr


def together(said: Sequence[str]) -> tuple[Counter[str], float, float]:
    """Counts of all workers, the longest step (ms) and all CPU time (s)."""
    counts: Counter[str] = Counter()
    for text in said:
        counts.update({n.strip(): int(v) for n, v in re.findall(r"^  (\D+) +(\d+)$", text, re.M)})
    longest = [float(v) for text in said for v in re.findall(r"longest step +([\d.]+) ms", text)]
    seconds = [float(v) for text in said for v in re.findall(r", ([\d.]+) s of CPU", text)]
    return counts, max(longest, default=float("nan")), sum(seconds)


@dataclass(frozen=True)
class Fuzzed:
    """All workers together: what compiling gave, counts, the longest step (ms), complaints."""

    made: Fuzz
    steps: int
    counts: Counter[str]
    longest_ms: float
    cpu_s: float
    complaints: list[tuple[int, str]]


def fuzz(
    scene: str, args: argparse.Namespace, flags: Sequence[str], more: Sequence[str] = MORE
) -> Fuzzed:
    """Generate, compile and run."""
    with tempfile.TemporaryDirectory(prefix="softmpc-fuzz-") as scratch:
        folder = Path(scratch) / "controller"
        generate_file(scene, folder)
        made = compiled(folder, args.cc, flags, more)
        share = -(-args.steps // args.workers)
        with ThreadPoolExecutor(args.workers) as threads:
            seeds = range(args.seed, args.seed + args.workers)
            run = partial(fuzzed, made.program, share, budget=args.budget)
            found = list(threads.map(run, seeds))
    told = together([said for _, said, _ in found])
    bad = [(code, complaint) for code, _, complaint in found if code]
    return Fuzzed(made, share * args.workers, *told, bad)


def numbers(quick: bool) -> dict[str, float]:
    """4,000 steps and the controller alone in quick mode, else 1,000,000 and all folders."""
    if shutil.which("gcc") is None:
        raise LeftOut("needs gcc")
    args = arguments_of(["--steps", "4000" if quick else "1000000"])
    found = fuzz(args.scene, args, (*RELEASE, *FLAGS), () if quick else MORE)
    numbers = {
        "steps_count": float(found.steps),
        "workers_that_failed_count": len(found.complaints),
    }
    numbers |= {"longest_step_cpu_ms": found.longest_ms}
    numbers["step_cpu_us_mean"] = 1e6 * found.cpu_s / found.steps
    numbers |= {f"{call}_stack_bytes": count for call, count in found.made.stack.items()}
    for name, one in found.made.parts.items():
        numbers |= {f"{name}_compile_cpu_s": one.cpu_s, f"{name}_bytes": one.bytes}
    return numbers


def arguments_of(words: Sequence[str] | None) -> argparse.Namespace:
    parser = arguments(__doc__)
    parser.add_argument("scene", nargs="?", default=str(EXAMPLES / "figure_eight.toml"))
    parser.add_argument("--steps", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--cc", choices=SINGLE, default="gcc")
    parser.add_argument("--budget", type=float, default=0.0, help="s of CPU time of a step; 0: any")
    parser.add_argument("--float", action="store_true")
    parser.add_argument("--sanitize", action="store_true")
    return parser.parse_args(words)


def main() -> int:
    args = arguments_of(None)
    flags = [*(CHECKED if args.sanitize else RELEASE), *(SINGLE[args.cc] if args.float else ())]
    flags += FLAGS if args.cc == "gcc" and not args.sanitize else ()
    found = fuzz(args.scene, args, flags)
    print(f"{args.cc} {' '.join(flags)}", *found.made.lines(), sep="\n")
    print(f"{found.steps} steps, {found.cpu_s:.0f} s of CPU time")
    for name, count in found.counts.items():
        print(f"  {name:<20} {count:>10}")
    print(f"longest step: {found.longest_ms:.1f} ms of CPU time")
    for code, complaint in found.complaints:
        print(f"ended with {code}: {complaint.strip()[-2000:]}")
    return int(bool(found.complaints))


if __name__ == "__main__":
    raise SystemExit(main())
