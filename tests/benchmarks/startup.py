"""Time of `import softmpc` and `softmpc --help`: `python -m tests.benchmarks.startup [RUNS]`."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from statistics import median
from time import perf_counter

ROOT = Path(__file__).resolve().parents[2]
HELP = "import sys; sys.argv = ['softmpc', '--help']; from softmpc.cli.main import main; main()"
# What runs, its code, and what it may take in seconds.
CASES: tuple[tuple[str, str, float | None], ...] = (
    ("python -c pass", "pass", None),
    ("import softmpc", "import softmpc", 1.0),
    ("softmpc --help", HELP, 0.5),
)


def seconds(code: str, runs: int) -> float:
    """Median wall time of a fresh interpreter that runs `code`; one more run warms the caches."""
    times = []
    for _ in range(runs + 1):
        start = perf_counter()
        subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=True, capture_output=True)
        times.append(perf_counter() - start)
    return median(times[1:])


def main(runs: int) -> None:
    """Print the table."""
    print(f"median of {runs} runs\n")
    print(f"{'':16} {'seconds':>8} {'ratio':>6}  target")
    bare = None
    for name, code, target in CASES:
        took = seconds(code, runs)
        bare = took if bare is None else bare
        verdict = "" if target is None else f"{target} s: {'met' if took < target else 'MISSED'}"
        print(f"{name:16} {took:8.3f} {took / bare:6.1f}  {verdict}".rstrip())


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 11)
