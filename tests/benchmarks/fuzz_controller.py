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
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from softmpc.codegen.emulate import read_sizes
from softmpc.codegen.generate import generate_file
from tests.codegen_stack import FLAGS, Stack

ROOT = Path(__file__).parents[2]
FUZZ = ROOT / "tests" / "codegen_c" / "fuzz.c"
SINGLE = {
    "gcc": ("-DSMPC_FLOAT", "-fsingle-precision-constant"),
    "clang": ("-DSMPC_FLOAT", "-Xclang", "-cl-single-precision-constant"),
}  # fmt: skip
RELEASE = ("-std=c99", "-O2", "-ffp-contract=off", "-fno-math-errno")
CHECKED = (
    "-std=c99", "-O1", "-g1", "-ffp-contract=off", "-fsanitize=address,undefined",
    "-fno-sanitize-recover=all",
)  # fmt: skip


def compiled(folder: Path, cc: str, flags: Sequence[str]) -> Path:
    """The program; says what compiling the directory took and made."""
    print(f"{cc} {' '.join(flags)}")
    parts = {"controller": sorted(folder.glob("*.c"))}
    parts |= {of: sorted((folder / of).glob("*.c")) for of in ("arm", "demo")}
    objects = {
        name: _objects(folder, files, folder / "fuzz" / name, [cc, *flags])
        for name, files in parts.items()
    }
    program = folder / "fuzz" / "program"
    own = [str(FUZZ), *map(str, objects["controller"])]
    _run([cc, *flags, f"-I{folder}", *own, "-o", str(program), "-lm"])
    if FLAGS[0] in flags:
        stack = Stack(objects["controller"], read_sizes(folder)["MOVES"] + 2)
        calls = ("smpc_prepare", "smpc_feedback", "smpc_step")
        print("  stack: " + ", ".join(f"{name} {stack.of(name)} bytes" for name in calls))
    return program


def _objects(folder: Path, files: Sequence[Path], into: Path, words: list[str]) -> list[Path]:
    into.mkdir(parents=True)
    made, began, longest = [into / f"{file.stem}.o" for file in files], _children(), (0.0, "")
    for file, there in zip(files, made, strict=True):
        before = _children()
        _run([*words, f"-I{folder}", "-c", str(file), "-o", str(there)])
        longest = max(longest, (_children() - before, file.name))
    took = _children() - began
    rows = _run(["size", *map(str, made)]).splitlines()[1:]
    total = sum(int(row.split()[0]) + int(row.split()[1]) for row in rows)  # code and constants
    print(
        f"  {into.name}: {took:.1f} s of CPU time for {len(files)} files ({longest[0]:.1f} s for "
        f"{longest[1]}), {total / 1024:.0f} KiB"
    )
    return made


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


def main() -> int:
    parser = argparse.ArgumentParser(description="random inputs for a controller in C")
    parser.add_argument("scene", nargs="?", default=str(ROOT / "examples" / "figure_eight.toml"))
    parser.add_argument("--steps", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--cc", choices=SINGLE, default="gcc")
    parser.add_argument("--budget", type=float, default=0.0, help="s of CPU time of a step; 0: any")
    parser.add_argument("--float", action="store_true")
    parser.add_argument("--sanitize", action="store_true")
    args = parser.parse_args()
    flags = [*(CHECKED if args.sanitize else RELEASE), *(SINGLE[args.cc] if args.float else ())]
    flags += FLAGS if args.cc == "gcc" and not args.sanitize else ()
    with tempfile.TemporaryDirectory(prefix="softmpc-fuzz-") as scratch:
        folder = Path(scratch) / "controller"
        generate_file(args.scene, folder)
        program = compiled(folder, args.cc, flags)
        share = -(-args.steps // args.workers)
        with ThreadPoolExecutor(args.workers) as threads:
            seeds = range(args.seed, args.seed + args.workers)
            found = list(threads.map(lambda s: fuzzed(program, share, s, args.budget), seeds))
    counts, longest, seconds = together([said for _, said, _ in found])
    print(f"{share * args.workers} steps, {seconds:.0f} s of CPU time")
    for name, count in counts.items():
        print(f"  {name:<20} {count:>10}")
    print(f"longest step: {longest:.1f} ms of CPU time")
    for code, _, complaint in found:
        if code:
            print(f"ended with {code}: {complaint.strip()[-2000:]}")
    return int(any(code for code, _, _ in found))


if __name__ == "__main__":
    raise SystemExit(main())
