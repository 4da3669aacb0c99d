"""README.md of a directory with a controller in C: for the one who builds, links or flashes it."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Mapping

import casadi as ca

from softmpc.model.layout import Variables
from softmpc.model.model import Model

__all__ = ["directory_readme", "macros_of"]

WIDTH = 100  # characters of a line
# What is shown, the files that it stands for, and what they are; those that are not there are left
# out.
ABOUT = (
    ("controller.h", r"controller\.h", "the interface: all that a program needs to include"),
    ("sizes.h", r"sizes\.h", "sizes, sample time, tolerances, version and hash of the scene"),
    ("data.*", r"data\..*", "constants of this scene"),
    ("model*", r"model.*", "functions of this scene"),
    ("memory.h", r"memory\.h", "what the controller remembers, `sizeof(smpc_controller)` bytes"),
    ("estimator*", r"estimator.*", "the state from what sensors read"),
    ("pilot*", r"pilot.*", "estimator, supervision and controller in one"),
    ("recorder*", r"recorder.*", "the flight recorder, for `softmpc replay`"),
    ("arm/", r"arm/.*", "equations of the arm in SI, see `arm/arm.h`; the controller needs none"),
    ("monitor*", r"monitor.*", "what a running controller is close to: limits, edge of reach"),
    ("daqp/", r"daqp/.*", "DAQP, the solver of quadratic programs, as its authors wrote it"),
    ("demo/main.c", r"demo/main\.c", "the program `run`: the scene's path on a simulated plant"),
    ("demo/plant*", r"demo/plant.*", "that plant; always in double"),
    ("demo/reference.*", r"demo/reference.*", "that path, as a table"),
    ("board/", r"board/.*", "a program for a Cortex-M7, see `board/README.md`"),
    ("Makefile", r"Makefile", "makes a library and `run`"),
    ("CMakeLists.txt", r"CMakeLists\.txt", "the same"),
)
API = """\
#include "controller.h"

static smpc_controller controller; /* all its memory */
static smpc_real told[SMPC_N * SMPC_NR], x[SMPC_NX], u[SMPC_INPUTS];

void start(void)
{
    smpc_init(&controller);
}

int every_sample(void) /* each SMPC_STEP seconds, with told and x as they are then */
{
    smpc_set_reference(&controller, told);
    smpc_prepare(&controller, u);            /* before x is measured: most of the work */
    return smpc_feedback(&controller, x, u); /* an smpc_status; u is usable whatever it is */
}
"""

PILOT = """\
#include "pilot.h"

static smpc_pilot pilot; /* all its memory: estimator, supervision and the controller */
static smpc_real told[SMPC_N * SMPC_NR], rest[SMPC_NX], holding[SMPC_INPUTS], u[SMPC_INPUTS];

int start(const smpc_real *x, int32_t tick) /* at rest in x under u */
{
    return smpc_pilot_init(&pilot, x, u, tick);
}

int every_sample(int32_t tick, const smpc_sample *arrived, int count)
{
    return smpc_pilot_step(&pilot, tick, arrived, count, told, rest, holding, u); /* smpc_state */
}
"""


def directory_readme(model: Model, texts: Mapping[str, str], title: str = "") -> str:
    """The text, for a directory with these files and a controller of that model."""
    macros = macros_of(texts["sizes.h"])
    about = (
        f"Written by softmpc {macros['VERSION']}; hash of the scene and the sources: "
        f"`{macros['SCENE_HASH']}`. C99 and libm are all that it needs. It allocates no memory, "
        "opens no file, prints nothing, and has no variable of its own."
    )
    return "\n".join([
        f"# A controller in C: {title or 'of a soft manipulator'}\n",
        _wrapped(about),
        _listing(texts),
        _building(texts, macros),
        f"## Interface\n\n```c\n{API}```\n",
        *_pilot(texts),
        _numbers(model, macros),
        _board(texts),
        _versions(texts, macros),
    ])  # fmt: skip


def _wrapped(text: str) -> str:
    return textwrap.fill(text, WIDTH, break_long_words=False, break_on_hyphens=False) + "\n"


def macros_of(header: str) -> dict[str, str]:
    """Values of the macros SMPC_… of a header, by name without it; text without its quotes."""
    found = re.findall(r'^#define SMPC_(\w+) (".*?"|\S+)', header, re.MULTILINE)
    return {name: value.strip('"') for name, value in found}


def _listing(texts: Mapping[str, str]) -> str:
    rows = [
        f"| `{shown}` | {meaning} |"
        for shown, pattern, meaning in ABOUT
        if any(re.fullmatch(pattern, name) for name in texts)
    ]
    rest = "| the other `.c` and `.h` | the controller itself, the same for all scenes |"
    return "\n".join(["| file | what it is |", "| --- | --- |", *rows, rest]) + "\n"


def _building(texts: Mapping[str, str], macros: Mapping[str, str]) -> str:
    single = (
        "`make float` is refused for this scene; `sizes.h` says why."
        if "#error" in texts["sizes.h"]
        else "`make float` builds the same in float."
    )
    program = (
        "or `cmake -B build && cmake --build build && build/run`. The program runs the path in "
        f"closed loop, a step each {_milliseconds(macros)} ms, prints the tip's error and the time "
        "of the steps, and ends with an exit status other than 0 where a step was not solved. "
        "`--csv FILE` keeps the motion, `--steps N` stops after a part of it. `make test` builds "
        f"and runs it. {single}"
    )
    if "pilot.h" in texts:
        program += (
            " It is told the state and leaves the pilot out, so that what the model lacks is not "
            "made up for: for the tip's error on the rig see `softmpc track SCENE --controller c`."
        )
    return f"## Build it and try it\n\n```sh\nmake\n./run\n```\n\n{_wrapped(program)}"


def _milliseconds(macros: Mapping[str, str]) -> str:
    return f"{1e3 * float(macros['STEP']):g}"


def _pilot(texts: Mapping[str, str]) -> list[str]:
    """What there is for a controller that has readings instead of the state."""
    if "pilot.h" not in texts:
        return []
    about = (
        "Where the state is not known, the pilot estimates it from what sensors read, and falls "
        "back where that fails. `estimator_sizes.h` lists the sensors and what they read, "
        "`pilot.h` says what `rest` and `holding` are. Times are whole milliseconds. `told` has "
        "room for the disturbance, which the pilot fills in; without a pilot it is what is known "
        "of it, or zero. Readings may be late by SMPC_MEMORY milliseconds."
    )
    return [f"## From readings to inputs\n\n```c\n{PILOT}```\n\n{_wrapped(about)}"]


def _numbers(model: Model, macros: Mapping[str, str]) -> str:
    layout, n = model.layout, model.strains
    parts = [
        ("x", 0, "strains", layout.q),
        ("x", n, "their rates", layout.dq),
        ("x", 2 * n, "drive", layout.z),
        ("u", 0, "inputs", layout.u),
    ]
    rows = [
        f"| `{name}[{first}]` on | {what}: {_variables(variables)} |"
        for name, first, what, variables in parts
        if len(variables)
    ]
    ends = (
        "where the step begins" if macros["N"] == "1" else "where the intervals of the horizon end"
    )
    told = (
        f"All are in SI. References are {macros['N']} x {macros['NR']} numbers a step: "
        f"`{macros['REFERENCES']}` for each time {ends}."
    )
    table = "\n".join(["| from | what they are |", "| --- | --- |", *rows])
    return f"## Numbers\n\n{_wrapped(told)}\n{table}\n"


def _variables(variables: Variables) -> str:
    named = zip(variables.names, variables.units, strict=True)
    return ", ".join(f"{name} ({unit})" if unit else name for name, unit in named)


def _board(texts: Mapping[str, str]) -> str:
    example = " `board` has a whole program." if any(n.startswith("board/") for n in texts) else ""
    return "## On a board\n\n" + _wrapped(
        "Compile all `.c` of this directory, not of those below it, with it as include directory "
        "and `-std=c99 -O2`, for float also `-DSMPC_FLOAT -fsingle-precision-constant`, or add it "
        "to a project of CMake (`add_subdirectory`, target `smpc`). Give the controller one static "
        "variable, not a place on the stack. Call it from a timer each `SMPC_STEP` seconds; "
        "nothing in it waits. Where a status is not `SMPC_SOLVED` the input is finite and within "
        "the limits all the same, and `smpc_last` says where it comes from. With `smpc_set_clock` "
        f"a step knows how long it may take.{example}"
    )


def _versions(texts: Mapping[str, str], macros: Mapping[str, str]) -> str:
    lines = [
        f"softmpc {macros['VERSION']}: MIT, see `LICENSE`",
        f"CasADi {ca.CasadiMeta.version()} wrote the functions of the model: such code is not "
        "copyrighted, the few lines that it copies are under MIT-0",
    ]
    if "daqp/LICENSE" in texts:
        version = texts.get("daqp/VERSION", "").strip()
        lines.append(f"DAQP {version}: MIT, see `daqp/LICENSE`")
    return "## Versions and licences\n\n" + "".join(f"- {line}\n" for line in lines)
