"""The generated controller alone: a C program that gives it recorded states and times each step.

It is built twice, as it is and with a clock around the parts of a step, and once more run under
Valgrind, which counts the instructions of the same steps.
"""

from __future__ import annotations

import re
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tests.benchmarks.c_controller_states import Recorded

__all__ = ["PARTS", "Program", "Timed"]

FIRST = 3  # steps of a round that are not counted: it begins at rest
# Functions of the controller by what they are for, and how they are declared.
PARTS = {
    "linearise": ("smpc_linearise_motion", "smpc_linearise_terms"),
    "condense": ("smpc_condense",),
    "QP": ("smpc_inverse_packed", "smpc_make_program", "smpc_solve_program"),
    "measure": ("smpc_measure",),
}
DECLARED = {
    "smpc_linearise_motion": ("int", "smpc_linear *a, const smpc_moment *b, const smpc_path *d"),
    "smpc_linearise_terms": ("void", "smpc_linear *a, const smpc_moment *b, const smpc_path *d"),
    "smpc_condense": ("int", "smpc_controller *a"),
    "smpc_inverse_packed": ("void", "const real *a, int b, real *d"),
    "smpc_make_program": ("void", "smpc_controller *a, const smpc_path *b"),
    "smpc_solve_program": ("int", "smpc_controller *a, double b"),
    "smpc_measure": ("void", "smpc_measured *a, const smpc_moment *b, const smpc_path *d"),
}
MAIN = r"""
#define _POSIX_C_SOURCE 199309L
#include "parts.h"

#include <stdio.h>
#include <stdlib.h>
#include <time.h>

enum { width = SMPC_NX + 2 * SMPC_INPUTS + SMPC_N * SMPC_NR, parts = PARTS };

static smpc_controller controller;
static double spent[parts + 1];
static int inside;

static double by(clockid_t clock)
{
    struct timespec t;
    clock_gettime(clock, &t);
    return 1e6 * (double)t.tv_sec + 1e-3 * (double)t.tv_nsec;
}

static double now(void)
{
    return by(CLOCK_THREAD_CPUTIME_ID);
}

WRAPPERS
__attribute__((noinline)) void one_step(const double *row, double *u, double *times)
{
    times[0] = now();
    smpc_prepare(&controller, row + SMPC_NX);
    times[1] = now();
    smpc_feedback(&controller, row, u);
    times[2] = now();
}

int main(int count, char **given)
{
    const int rounds = atoi(given[2]), steps = atoi(given[3]);
    FILE *file = fopen(given[1], "rb");
    double *rows = malloc(sizeof(double) * width * (size_t)steps);
    if (count != 4 || !file || !rows) return 1;
    if (fread(rows, sizeof(double) * width, (size_t)steps, file) != (size_t)steps) return 2;
    for (int round = 0; round < rounds; round++) {
        smpc_init(&controller);
        for (int k = 0; k < steps; k++) {
            const double *row = rows + (long)width * k, *known = row + SMPC_NX + SMPC_INPUTS;
            double u[SMPC_INPUTS], t[3], off = 0;
            for (int i = 0; i < parts; i++) spent[i] = 0;
            smpc_set_reference(&controller, known + SMPC_INPUTS);
            const double began = by(CLOCK_MONOTONIC);
            one_step(row, u, t);
            const double wall = by(CLOCK_MONOTONIC) - began;
            for (int i = 0; i < SMPC_INPUTS; i++) off = fmax(off, fabs(u[i] - known[i]));
            const smpc_report *r = smpc_last(&controller);
            printf("%g %g %g %d %d %d %g", t[1] - t[0], t[2] - t[1], wall, r->iterations,
                   r->active, r->status, off);
            for (int i = 0; i < SMPC_INPUTS; i++) printf(" %.17g", u[i]);
            for (int i = 0; i < parts; i++) printf(" %g", spent[i]);
            printf("\n");
        }
    }
    free(rows);
    return fclose(file);
}
"""


@dataclass(frozen=True)
class Timed:
    """Steps (K, those of all rounds): times (µs), and what the controller reports."""

    prepare: np.ndarray
    feedback: np.ndarray
    wall: np.ndarray
    iterations: np.ndarray
    active: np.ndarray
    status: np.ndarray
    off: np.ndarray  # N·m, from the input of the Python controller
    u: np.ndarray  # K×inputs, N·m
    parts: np.ndarray  # K×parts, µs

    @property
    def us(self) -> np.ndarray:
        return np.asarray(self.prepare + self.feedback)


class Program:
    """The controller in `folder` on the states of one scene; `make` is told of `variables`."""

    def __init__(
        self, folder: Path, recorded: Recorded, cc: str, variables: tuple[str, ...]
    ) -> None:
        self.folder, self.cc = folder, cc
        self.states, self.steps = folder / "states.bin", len(recorded.arrays["x"])
        columns = [recorded.arrays[name] for name in ("x", "u_before", "u", "given")]
        np.hstack([c.reshape(self.steps, -1) for c in columns]).tofile(self.states)
        make = ["make", "-s", "-C", str(folder)]
        _do([*make, "clean"])
        _do([*make, "libsmpc.a", f"CC={cc}", *variables])
        self.plain, self.split = self._built("plain"), self._built("split")

    def _built(self, name: str) -> Path:
        """The program; "split" has a clock around each part, which costs a little itself."""
        wrapped = DECLARED if name == "split" else {}
        text = MAIN.replace("PARTS", str(len(PARTS))).replace("WRAPPERS", _wrappers(wrapped))
        source, program = self.folder / f"bench_{name}.txt", self.folder / f"bench_{name}"
        source.write_text(text)
        link = [f"-Wl,--wrap={function}" for function in wrapped]
        own = [self.cc, "-std=c99", "-O2", f"-I{self.folder}", "-x", "c", str(source), "-x", "none"]
        library = str(self.folder / "libsmpc.a")
        _do([*own, *link, "-o", str(program), library, "-lm"])
        return program

    def run(self, rounds: int, split: bool = False) -> Timed:
        """All states, `rounds` times."""
        program = self.split if split else self.plain
        output = _do([str(program), str(self.states), str(rounds), str(self.steps)])
        table = np.array([line.split() for line in output.splitlines()], float)
        table = table.reshape(rounds, self.steps, -1)[:, FIRST:].reshape(-1, table.shape[1])
        split_at = [7, table.shape[1] - len(PARTS)]
        about, u, parts = np.split(table, split_at, axis=1)
        return Timed(*about.T, u=u, parts=parts)

    def instructions(self, steps: int | None = None) -> dict[str, float] | None:
        """Instructions of the first steps (None: of all), whole and by parts (means of a step).

        None without Valgrind.
        """
        steps = steps or self.steps
        if shutil.which("valgrind") is None:
            return None
        out = self.folder / "callgrind.out"
        tool = ["valgrind", "--tool=callgrind", "--toggle-collect=one_step"]
        file = f"--callgrind-out-file={out}"
        _do([*tool, file, str(self.plain), str(self.states), "1", str(steps)])
        table = _do(["callgrind_annotate", "--inclusive=yes", "--threshold=100", str(out)])
        counts = {
            name: int(number.replace(",", "")) / steps
            for number, name in re.findall(r"^ *([\d,]+) .*:(\w+) \[", table, re.MULTILINE)
        }
        parts = {
            part: sum(counts.get(f, 0.0) for f in functions) for part, functions in PARTS.items()
        }
        if not all(parts.values()):  # a part of no instructions has other names by now
            raise SystemExit(f"Valgrind saw none of the functions of a part: {parts}")
        return {"all": counts["one_step"], **parts}


def _wrappers(wrapped: dict[str, tuple[str, str]]) -> str:
    """A clock around each function; a part within another one counts for that one."""
    texts = []
    for function, (kind, declared) in wrapped.items():
        part = next(i for i, functions in enumerate(PARTS.values()) if function in functions)
        names = ", ".join(word.split()[-1].lstrip("*") for word in declared.split(","))
        keep, give = ("int found = ", "    return found;\n") if kind == "int" else ("", "")
        texts.append(
            f"{kind} __real_{function}({declared});\n"
            f"{kind} __wrap_{function}({declared})\n{{\n"
            f"    const double began = now();\n    inside++;\n"
            f"    {keep}__real_{function}({names});\n"
            f"    if (!--inside) spent[{part}] += now() - began;\n{give}}}\n\n"
        )
    return "".join(texts)


def _do(command: list[str]) -> str:
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"{' '.join(command)} failed:\n{done.stdout}{done.stderr}")
    return done.stdout
