"""What stands beside a controller in C: a program that runs its path, and how to build both."""

from __future__ import annotations

import numpy as np

from softmpc.codegen.directory import c_source
from softmpc.codegen.plant import TOLERANCE, plant_files
from softmpc.codegen.reference import reference_files
from softmpc.control.tracking import Setup

__all__ = ["demonstration"]

COPIED = (
    "Makefile", "CMakeLists.txt", "LICENSE", "demo/main.c", "demo/plant.c", "demo/plant.h",
    "demo/plant_linear.c", "demo/plant_stages.c", "demo/plant_stages.h", "board/README.md",
    "board/board_main.c", "board/linux_main.c", "board/mps2_an500.ld", "board/sections.ld",
    "board/semihosting.c", "board/semihosting.h", "board/startup.c", "board/startup.h",
    "board/steps.c", "board/steps.h", "board/stm32h743.ld",
)  # fmt: skip


def demonstration(
    setup: Setup, references: np.ndarray, title: str = "", tolerance: float = TOLERANCE
) -> dict[str, str]:
    """Files by name: the program in `demo`, its plant and path, how to build it; `board`.

    `references` (K×N×nr) is what the controller is told in each of K steps, see `references_of`;
    `tolerance` that of a step of the plant (m, at the tip).
    """
    return {
        **{name: c_source(name) for name in COPIED},
        **plant_files(setup.plant.model, setup.ocp.model, tolerance),
        **reference_files(setup, references, title),
    }
