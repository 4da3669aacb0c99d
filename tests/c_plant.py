"""A plant in C through ctypes, compiled apart from any controller."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from softmpc.codegen.building import build_library
from softmpc.codegen.directory import c_source
from softmpc.codegen.plant import plant_files
from softmpc.model.model import Model

Array = np.ndarray
SHIM = """
#include "demo/plant.h"
unsigned long plant_bytes(void) { return sizeof(smpc_plant); }
"""


class CPlant:
    """A plant in C through ctypes."""

    def __init__(self, library: ctypes.CDLL, model: Model) -> None:
        self.library, self.model = library, model
        library.plant_bytes.restype = ctypes.c_ulong
        library.smpc_plant_state.restype = ctypes.POINTER(ctypes.c_double)
        self.memory = ctypes.create_string_buffer(library.plant_bytes())

    def init(self, x: Array) -> CPlant:
        self.library.smpc_plant_init(self.memory, _pointer(x))
        return self

    def step(self, u: Array, seconds: float) -> int:
        return self.library.smpc_plant_step(self.memory, _pointer(u), ctypes.c_double(seconds))

    @property
    def x(self) -> Array:
        state = self.library.smpc_plant_state(self.memory)
        return np.ctypeslib.as_array(state, (len(self.model.layout.x),)).copy()

    def tips(self) -> Array:
        found = np.zeros((len(self.model.scene.manipulator.sections), 3))
        self.library.smpc_plant_tips(self.memory, _pointer(found))
        return found

    def seen(self, u: Array, size: int) -> Array:
        found = np.zeros(size)
        self.library.smpc_plant_seen(self.memory, _pointer(u), _pointer(found))
        return found


def _pointer(values: Array) -> Any:
    assert values.dtype == float and values.flags.c_contiguous
    pointer = values.ctypes.data_as(ctypes.POINTER(ctypes.c_double))
    pointer.values = values
    return pointer


def compiled_plant(
    plant: Model, seen_by: Model, folder: Path, flags: Sequence[str] = ("-O0",)
) -> CPlant:
    """The plant of a model, built in a folder of its own."""
    texts = {**plant_files(plant, seen_by), "shim.c": SHIM}
    for part in ("plant.c", "plant.h", "plant_linear.c", "plant_stages.c", "plant_stages.h"):
        texts[f"demo/{part}"] = c_source(f"demo/{part}")
    for path, text in texts.items():
        (folder / path).parent.mkdir(exist_ok=True)
        (folder / path).write_text(text, encoding="utf-8")
    for source in (folder / "demo").glob("*.c"):  # the library is of what lies in one folder
        lines = f'#include "demo/{source.name}"\n'
        (folder / f"of_{source.name}").write_text(lines, encoding="utf-8")
    return CPlant(ctypes.CDLL(str(build_library(folder, [*flags, f"-I{folder}"]))), plant)
