"""Recorded steps through the compiled controller: on this machine, as an Arm Linux program under
`qemu-arm`, or on the Cortex-M7 board that `qemu-system-arm` emulates.

Each target gets the same bytes, so what they answer can be compared bit by bit.
"""

from __future__ import annotations

import re
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from softmpc.codegen.targets import CORTEX_M7, TARGETS, Target, build
from softmpc.errors import BuildError, InputError, unknown_name

__all__ = ["Answers", "Steps", "read_sizes", "refused_float", "run_program", "run_steps"]

RUN_SECONDS = 600.0
ENDINGS = {66: "it cannot open its files", 70: "the processor met a fault"}
# The emulated clock takes 1 ns an instruction, the board's counter is at 25 MHz.
INSTRUCTIONS_OF_A_TICK = 40
FIGURES = 3  # behind the input in an answer: status, end of the quadratic program, iterations

Array = np.ndarray


@dataclass(frozen=True)
class Steps:
    """What a controller was given in each of `count` steps, SI.

    references (count×N×NR), the input applied until then u_before (count×inputs) and the measured
    state x (count×NX).
    """

    references: Array
    u_before: Array
    x: Array

    def __len__(self) -> int:
        return len(self.x)

    def numbers(self) -> Array:
        """One row a step."""
        count = len(self)
        every = (self.references, self.u_before, self.x)
        parts = [np.reshape(part, (count, np.size(part) // max(count, 1))) for part in every]
        return np.concatenate(parts, axis=1).astype("<f8")


@dataclass(frozen=True)
class Answers:
    """What it answered: u (count×inputs), and status, qp and iterations (count) as in controller.h.

    `told` is what the program says of itself: `controller_bytes` and, on a board, `stack_bytes`
    that were used and the instructions of the steps' two parts, in sum and at most.
    """

    u: Array
    status: Array
    qp: Array
    iterations: Array
    told: dict[str, int]


def run_program(
    target: Target, program: Path, given: bytes = b"", seconds: float = RUN_SECONDS
) -> tuple[bytes, dict[str, int]]:
    """Run what `build` made: what it answers to `given`, and what it says of itself.

    Raises `BuildError` where it does not end well within `seconds`.
    """
    answers, said = _run(target, program, given, seconds)
    return answers, _told(said)


def run_steps(
    directory: str | Path,
    steps: Steps,
    target: str = CORTEX_M7.name,
    precision: str = "double",
    into: str | Path | None = None,
    seconds: float = RUN_SECONDS,
) -> Answers:
    """Compile the controller in `directory` for a target and run it through recorded steps.

    `target` is "host", "arm-linux" or "cortex-m7"; `into` a folder that keeps what was compiled.
    Raises `InputError` for a directory that is none of a controller and for steps of another size,
    `BuildError` where tools are missing or fail, and where the program does not end well within
    `seconds`.
    """
    directory = Path(directory)
    if target not in TARGETS:
        raise InputError(unknown_name("target", target, TARGETS))
    inputs = _fitting(steps, read_sizes(directory))
    with tempfile.TemporaryDirectory(prefix="softmpc-emulate-") as scratch:
        folder = Path(scratch) if into is None else Path(into)
        program = build(directory, TARGETS[target], precision, folder)
        given = steps.numbers().tobytes()
        answers, told = run_program(TARGETS[target], program, given, seconds)
    size = len(steps) * (inputs + FIGURES) * 8
    if len(answers) != size:
        raise BuildError(f"{target}: {len(answers)} bytes of answers, not {size}")
    found = np.frombuffer(answers, "<f8").reshape(len(steps), inputs + FIGURES)
    status, qp, iterations = found[:, inputs:].astype(int).T
    return Answers(found[:, :inputs], status, qp, iterations, told)


def read_sizes(directory: Path) -> dict[str, int]:
    """The whole numbers among the macros of sizes.h, without their prefix `SMPC_`."""
    found = re.findall(r"^#define SMPC_(\w+) (\d+)\b(?!\.)", _sizes(directory), re.MULTILINE)
    return {name: int(value) for name, value in found}


def refused_float(directory: Path) -> str:
    """Why the controller cannot be in float; nothing where it can."""
    found = re.search(r'^#error "(.*)"', _sizes(directory), re.MULTILINE)
    return found[1] if found else ""


def _sizes(directory: Path) -> str:
    try:
        return (directory / "sizes.h").read_text(encoding="utf-8")
    except OSError:
        raise InputError(
            f"{directory}: has no sizes.h; `softmpc codegen` makes a controller's directory"
        ) from None


def _fitting(steps: Steps, sizes: dict[str, int]) -> int:
    """The number of inputs. Raises `InputError` for steps of another size."""
    N, NR, inputs, NX = (sizes[name] for name in ("N", "NR", "INPUTS", "NX"))
    count = len(steps)
    wanted = {"references": (count, N, NR), "u_before": (count, inputs), "x": (count, NX)}
    for name, shape in wanted.items():
        if np.shape(getattr(steps, name)) != shape:
            raise InputError(
                f"{name}: has shape {np.shape(getattr(steps, name))}, this controller takes {shape}"
            )
    return inputs


def _run(target: Target, program: Path, given: bytes, seconds: float) -> tuple[bytes, str]:
    """Answers, and what the program says on its console."""
    board = bool(target.memory_map)  # files of its own; else standard input and output
    source, sink = program.with_name("steps.bin"), program.with_name("answers.bin")
    if board:
        source.write_bytes(given)
        sink.unlink(missing_ok=True)
    try:
        done = subprocess.run(
            [*target.emulator, str(program)], cwd=program.parent, input=None if board else given,
            stdin=subprocess.DEVNULL if board else None, capture_output=True, timeout=seconds,
            check=False,
        )  # fmt: skip
    except OSError as error:
        raise BuildError(f"{target.name}: does not start: {error.strerror}") from None
    except subprocess.TimeoutExpired:
        raise BuildError(f"{target.name}: did not end within {seconds:g} s") from None
    said = done.stderr.decode(errors="replace")
    if done.returncode:
        why = ENDINGS.get(done.returncode, said.strip() or "no message")
        raise BuildError(f"{target.name}: the program ended with {done.returncode}: {why}")
    if not board:
        return done.stdout, said
    return (sink.read_bytes() if sink.is_file() else b""), said


def _told(said: str) -> dict[str, int]:
    """Lines "name value"; ticks of the board as instructions."""
    found = {name: int(value) for name, value in re.findall(r"^(\w+) (\d+)$", said, re.MULTILINE)}
    ticks = [name for name in found if name.endswith("_ticks")]
    instructions = {
        name.replace("ticks", "instructions"): found.pop(name) * INSTRUCTIONS_OF_A_TICK
        for name in ticks
    }
    return found | instructions
