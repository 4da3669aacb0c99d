"""Machines that a generated controller is built for and tried on, and what each needs."""

from __future__ import annotations

import re
import shutil
import subprocess
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from softmpc.errors import BuildError, InputError

__all__ = [
    "ARM_LINUX",
    "CORTEX_M7",
    "HOST",
    "PRECISIONS",
    "STARTUP",
    "TARGETS",
    "Target",
    "board_of",
    "build",
    "controller_sources",
    "flags_of",
    "run_tool",
]

_TELLING = re.compile(r"error: (?!ld returned)|undefined reference|overflowed")
PRECISIONS = ("double", "float")
COMPILE_SECONDS = 300.0
COMMON = (
    "-std=c99", "-O2", "-ffp-contract=off", "-fno-math-errno", "-ffunction-sections",
    "-fdata-sections",
)  # fmt: skip
# Constants without a suffix would make arithmetic of floats one of doubles.
SINGLE = ("-DSMPC_FLOAT", "-fsingle-precision-constant")


@dataclass(frozen=True)
class Target:
    """A machine: how to compile for it and how to run what was compiled."""

    name: str
    compiler: str
    flags: dict[str, tuple[str, ...]]  # of each precision
    link: tuple[str, ...]
    program: tuple[str, ...]  # C files in board/ that make a program of the controller
    emulator: tuple[str, ...]  # command that a program's path is put behind
    packages: tuple[str, ...]  # of Debian
    memory_map: str = ""  # linker script in board/, where nothing else says what lies where

    @property
    def missing(self) -> str:
        """What is not installed, and how to get it; nothing where all is."""
        tools = [self.compiler, *self.emulator[:1]]
        absent = [tool for tool in tools if shutil.which(tool) is None]
        if not absent:
            return ""
        packages = " ".join(self.packages)
        return f"{' and '.join(absent)} not found; on Debian: apt install {packages}"


HOST = Target(
    "host", "cc", dict.fromkeys(PRECISIONS, ()), (), ("steps.c", "linux_main.c"), (), ("gcc",)
)
ARM_LINUX = Target(
    "arm-linux",
    "arm-linux-gnueabihf-gcc",
    dict.fromkeys(PRECISIONS, ("-march=armv7-a", "-mfpu=vfpv3-d16")),
    ("-static",),
    ("steps.c", "linux_main.c"),
    ("qemu-arm",),
    ("gcc-arm-linux-gnueabihf", "libc6-dev-armhf-cross", "qemu-user"),
)
STARTUP = ("startup.c", "semihosting.c")  # in board/, of a program for a board
_M7 = ("-mcpu=cortex-m7", "-mthumb", "-mfloat-abi=hard")
CORTEX_M7 = Target(
    "cortex-m7",
    "arm-none-eabi-gcc",
    {"double": (*_M7, "-mfpu=fpv5-d16"), "float": (*_M7, "-mfpu=fpv5-sp-d16")},
    ("-nostartfiles", "-Wl,--fatal-warnings"),
    ("steps.c", "board_main.c", *STARTUP),
    (
        "qemu-system-arm", "-machine", "mps2-an500", "-nographic", "-monitor", "none",
        "-serial", "none", "-icount", "shift=0", "-semihosting-config", "enable=on,target=native",
        "-kernel",
    ),
    ("gcc-arm-none-eabi", "libnewlib-arm-none-eabi", "qemu-system-arm"),
    "mps2_an500.ld",
)  # fmt: skip
TARGETS = {target.name: target for target in (HOST, ARM_LINUX, CORTEX_M7)}


def flags_of(target: Target, precision: str) -> tuple[str, ...]:
    """Flags of the compiler. Raises `InputError` for an unknown precision."""
    if precision not in PRECISIONS:
        raise InputError(f"precision = {precision!r}: must be one of {', '.join(PRECISIONS)}")
    return (*COMMON, *target.flags[precision], *(SINGLE if precision == "float" else ()))


def controller_sources(directory: Path) -> list[Path]:
    """C files of a generated directory but those of programs that use it."""
    found = [path for path in sorted(directory.glob("*.c")) if path.name != "main.c"]
    if not found or not (directory / "controller.h").is_file():
        raise InputError(
            f"{directory}: is no directory of a generated controller; `softmpc codegen` makes one"
        )
    return found


def board_of(directory: Path) -> Path:
    """Its folder of files for boards, or softmpc's own where it has none."""
    own = directory / "board"
    return own if (own / "steps.c").is_file() else Path(__file__).parent / "c" / "board"


def build(
    directory: Path,
    target: Target,
    precision: str,
    into: Path,
    extra: Sequence[str] = (),
    memory_map: str = "",
) -> Path:
    """Compile the controller with the program that runs recorded steps; returns the program.

    Object files and the linker's map lie beside it. `extra` are further flags of the compiler,
    `memory_map` another linker script in board/. Raises `InputError` where `directory` is none of a
    controller, `BuildError` where tools are missing or fail.
    """
    directory, into = directory.resolve(), into.resolve()
    flags = (*flags_of(target, precision), *extra, f"-I{directory}")
    sources, board = controller_sources(directory), board_of(directory)
    sources += [board / name for name in target.program]
    if target.missing:
        raise BuildError(f"{target.name}: {target.missing}")
    into.mkdir(parents=True, exist_ok=True)

    def compile_one(source: Path) -> str:
        part = "board" if source.parent == board else ""
        name = Path(part, source.name).with_suffix(".o")
        (into / name).parent.mkdir(parents=True, exist_ok=True)
        run_tool([target.compiler, *flags, "-c", str(source), "-o", str(name)], into)
        return str(name)

    with ThreadPoolExecutor(2) as threads:
        objects = list(threads.map(compile_one, sources))
    program = into / "steps"
    script = memory_map or target.memory_map
    link = [*target.link, *((f"-L{board}", f"-T{script}") if script else ())]
    link += ["-Wl,--gc-sections", f"-Wl,-Map={program.name}.map"]
    run_tool([target.compiler, *flags, *link, *objects, "-o", str(program), "-lm"], into)
    return program


def run_tool(
    command: Iterable[str], folder: Path | None = None, seconds: float = COMPILE_SECONDS
) -> str:
    """What a command prints. Raises `BuildError` with its complaint where it fails."""
    words = list(command)
    try:
        done = subprocess.run(
            words, cwd=folder, stdin=subprocess.DEVNULL, capture_output=True, text=True,
            errors="replace", timeout=seconds, check=False,
        )  # fmt: skip
    except OSError as error:
        raise BuildError(f"{words[0]} does not start: {error.strerror}") from None
    except subprocess.TimeoutExpired:
        raise BuildError(f"{words[0]} did not end within {seconds:g} s") from None
    if done.returncode:
        complaint = [line.strip() for line in done.stderr.splitlines() if line.strip()]
        errors = [line for line in complaint if _TELLING.search(line)] or complaint[-3:]
        raise BuildError(f"{words[0]} failed: {'; '.join(errors[:3]) or 'no message'}")
    return done.stdout
