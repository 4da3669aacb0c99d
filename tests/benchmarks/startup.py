"""Time of `import softmpc` and `softmpc --help`: `python -m tests.benchmarks.startup [RUNS]`."""

from __future__ import annotations

import subprocess
import sys

from tests.benchmarks.common import ROOT, key, median_seconds

HELP = "import sys; sys.argv = ['softmpc', '--help']; from softmpc.cli.main import main; main()"
# What runs, its code, and what it may take in seconds.
CASES: tuple[tuple[str, str, float | None], ...] = (
    ("python -c pass", "pass", None),
    ("import softmpc", "import softmpc", 1.0),
    ("softmpc --help", HELP, 0.5),
)


def seconds(code: str, runs: int) -> float:
    """Median wall time of a fresh interpreter that runs `code`; one more run warms the caches."""
    command = [sys.executable, "-c", code]

    def run() -> None:
        subprocess.run(command, cwd=ROOT, check=True, capture_output=True)

    run()
    return median_seconds(run, runs)


def measured(runs: int) -> dict[str, float]:
    """Seconds of each case."""
    return {name: seconds(code, runs) for name, code, _ in CASES}


def numbers(quick: bool) -> dict[str, float]:
    """Seconds, and ratios to an interpreter that does nothing."""
    found = measured(5 if quick else 11)
    bare = found[CASES[0][0]]
    return {f"{key(name)}_s": took for name, took in found.items()} | {
        f"{key(name)}_ratio_to_bare": took / bare for name, took in list(found.items())[1:]
    }


def main(runs: int) -> None:
    """Print the table."""
    print(f"median of {runs} runs\n")
    print(f"{'':16} {'seconds':>8} {'ratio':>6}  target")
    found = measured(runs)
    for name, _, target in CASES:
        took, bare = found[name], found[CASES[0][0]]
        verdict = "" if target is None else f"{target} s: {'met' if took < target else 'MISSED'}"
        print(f"{name:16} {took:8.3f} {took / bare:6.1f}  {verdict}".rstrip())


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 11)
