"""Which benchmarks there are, by what they are about."""

from __future__ import annotations

import ast
from pathlib import Path

__all__ = ["ABOUT", "HELPERS", "benchmarks", "purpose"]

FOLDER = Path(__file__).parent
# Part of the toolkit -> its benchmarks; a number says what it costs or how good it is.
ABOUT: dict[str, tuple[str, ...]] = {
    "Model": ("instructions", "looping", "compiling", "startup"),
    "Statics and workspace": ("inverse", "workspace"),
    "Simulation": ("simulating", "peer"),
    "Calibration": ("calibrating", "coverage"),
    "Control": (
        "controllers",
        "hessians",
        "peer_mpc",
        "tracking",
        "speeds",
        "cheaper",
        "stability",
    ),
    "Estimation and rig": ("estimation", "mismatch", "faults"),
    "Planning": ("plans", "plan_tracking"),
    "Controllers in C": ("c_controller", "c_plant", "pilot", "fuzz_controller"),
    "The choice": ("choosing",),
}
# Modules of this folder that are no benchmark.
HELPERS = {
    "acados_environment", "acados_model", "acados_peer", "acados_task", "c_controller_bench",
    "c_controller_peers", "c_controller_program", "c_controller_states", "choosing_measures",
    "choosing_scenes", "choosing_truth", "common", "comparing", "listing", "peer_soromox",
    "running", "same_problem", "stored",
}  # fmt: skip


def benchmarks() -> list[str]:
    """All names, in the order in which they run."""
    return [name for names in ABOUT.values() for name in names if has_numbers(name)]


def has_numbers(name: str) -> bool:
    """Whether there is such a module, with the function that makes it a benchmark."""
    if not _file(name).exists():
        return False
    tree = ast.parse(_file(name).read_text(encoding="utf-8"))
    return any(isinstance(f, ast.FunctionDef) and f.name == "numbers" for f in tree.body)


def purpose(name: str) -> str:
    """What a benchmark is for: the first sentence of its module, without its command."""
    text = ast.get_docstring(ast.parse(_file(name).read_text(encoding="utf-8"))) or ""
    return text.partition("\n\n")[0].replace("\n", " ").partition(": `python -m")[0].rstrip(".")


def _file(name: str) -> Path:
    return FOLDER / f"{name}.py"
