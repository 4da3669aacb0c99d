"""A monitor in C for tests, what it watches, and workspaces to measure in."""

from __future__ import annotations

import ctypes
import shutil
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import codegen_small as small
import numpy as np
from arms import PAPER, arm
from codegen_small import SINGLE

from softmpc.codegen.monitor import Observed
from softmpc.codegen.monitor_data import monitor_files
from softmpc.control.step import FAILED, INPUT_NOT_FINITE, ITERATION_CAP, SOLVED, Step
from softmpc.model.actuation import PressureDrive
from softmpc.model.model import Model, build
from softmpc.model.scene import Scene
from softmpc.simulation.validity import LAMINAR
from softmpc.statics.workspace import find_workspace
from softmpc.statics.workspace_result import Surface, Workspace

PROBE = Path(__file__).parent / "codegen_c" / "monitor_probe.c"
GRID = {"azimuths": 6, "polars": 5, "samples": 100}
BACK_OFF = 0.05
TIP, REFERENCE, PRESSURE, BACK_OFF_BIT, _ = (1 << bit for bit in range(5))
NAMES = ("tip_margin", "reference_margin", "pressure_room", "back_off", "reynolds")
STATUSES = ("solved", "iteration cap", "budget overrun", "input not finite", "failed")
QP = ("not asked", "optimal", "not optimal", "infeasible")
AGREE = 1e-10


def model() -> Model:
    return small.transcription().model


@cache
def space() -> Workspace:
    return find_workspace(model(), executor=1, **GRID)


def reshaped(**parts: Any) -> Workspace:
    """The same places under other surfaces."""
    outer, inner = parts.pop("outer"), parts.pop("inner")
    old = space().outer
    assert old is not None
    sides = {
        name: Surface(radii, old.tips, old.pressures, old.q, old.smallest_stiffness, old.flags)
        for name, radii in (("outer", outer), ("inner", inner))
    }
    return replace(space(), **sides, **parts)


@cache
def tilted() -> Workspace:
    """Around another axis that is out of reach, at uneven azimuths, with gaps."""
    random = np.random.default_rng(5)
    frame = np.linalg.qr(random.normal(size=(3, 3)))[0]
    outer = random.uniform(0.3, 0.4, (5, 5))
    inner = random.uniform(0.1, 0.2, (5, 5))
    outer[:, -1] = inner[:, -1] = 0.25
    rims = np.stack([random.uniform(0.3, 0.5, 5), random.uniform(1.5, 2.5, 5)], 1)
    outer[1, 2] = inner[1, 2] = outer[3] = inner[3] = rims[3] = np.nan
    azimuths = np.array([-0.2, 0.9, 2.2, 3.0, 5.1])
    return reshaped(frame=frame, azimuths=azimuths, rims=rims, outer=outer, inner=inner)


@cache
def flat() -> Workspace:
    """Two half-planes."""
    random = np.random.default_rng(6)
    outer, inner = random.uniform(0.3, 0.4, (2, 5)), random.uniform(0.1, 0.2, (2, 5))
    rims, azimuths = np.array([[0.0, 1.1], [0.0, 0.7]]), np.array([0.0, np.pi])
    return reshaped(dimension=2, azimuths=azimuths, rims=rims, outer=outer, inner=inner)


SPACES: dict[str, Callable[[], Workspace | None]] = {
    "an arm": space, "tilted": tilted, "flat": flat, "none": lambda: None
}  # fmt: skip


# ---------------------------------------------------------------- the monitor in C


class CMonitor:
    """A monitor in C, compiled without the controller around it."""

    def __init__(self, folder: Path, single: bool = False) -> None:
        self.real: Any = ctypes.c_float if single else ctypes.c_double
        flags = ["-fPIC", "-O1", f"-I{folder}", *(SINGLE["gcc"] if single else ())]
        files = [*folder.glob("*monitor*.c"), folder / "linear.c", PROBE]
        objects = small.compile_objects(files, folder / "objects", flags)
        library = folder / "monitor.so"
        small.run(["gcc", "-shared", *map(str, objects), "-o", str(library), "-lm"])
        self.library = ctypes.CDLL(str(library))
        self.memory = self._type()()
        self.library.smpc_monitor_memory.restype = ctypes.c_ulong
        assert self.library.smpc_monitor_memory() == ctypes.sizeof(self.memory)
        self.library.smpc_monitor_init(ctypes.byref(self.memory))

    def _type(self) -> type[ctypes.Structure]:
        count, tubes = ctypes.c_uint64, self.real * 3
        ints = [(name, ctypes.c_int) for name in ("known", "iterations", "turbulent")]
        fields = [*ints, *((name, self.real) for name in (*NAMES[:4], "largest")), ("each", tubes)]
        observed = type("Observed", (ctypes.Structure,), {"_fields_": fields})
        counts = ("since_solved", "programs", "iterations")
        all_fields = [
            ("last", observed), ("worst", observed), ("steps", count), ("statuses", count * 5),
            *((name, count) for name in counts), ("mean", self.real),
        ]  # fmt: skip
        return type("Monitor", (ctypes.Structure,), {"_fields_": all_fields})

    def update(self, step: Step, x: Any, u: Any, reference: Any) -> None:
        status = STATUSES.index(step.status.split(":")[0])
        report = (ctypes.c_int * 3)(status, QP.index(step.qp), step.iterations)
        given = [self._given(value) for value in (reference, x, u)]
        self.library.probe(ctypes.byref(self.memory), report, *given)

    def margin(self, place: Any) -> float:
        """NaN where it is not known."""
        found = self.real()
        known = self.library.smpc_margin(self._given(place), ctypes.byref(found))
        return float(found.value) if known else float("nan")

    def _given(self, value: Any) -> Any:
        return (self.real * len(value))(*np.asarray(value, float))


def observed(part: Any) -> Observed:
    """What the struct says, as in Python."""
    values = [part.tip_margin, part.reference_margin, part.pressure_room, part.back_off]
    values.append(part.largest)
    known = {
        name: float(value) if part.known & 1 << bit else None
        for bit, (name, value) in enumerate(zip(NAMES, values, strict=True))
    }
    assert part.known < 32
    assert all(value == 0 for value, of in zip(values, known.values(), strict=True) if of is None)
    return Observed(**known, iterations=part.iterations)


def assert_alike(one: Observed, two: Observed, within: float = AGREE) -> None:
    for name in NAMES:
        found, wanted = getattr(one, name), getattr(two, name)
        assert (found is None) == (wanted is None), name
        if wanted is not None:
            full = LAMINAR if name == "reynolds" else 1.0
            assert abs(found - wanted) <= within * max(full, abs(wanted)), name
    assert one.iterations == two.iterations and one.turbulent == two.turbulent


@cache
def pressure_driven() -> Model:
    """The same arm without a drive."""
    return build(Scene(arm(PAPER.sections[0]), actuation=PressureDrive()))


@cache
def texts(name: str, driven: bool, back_off: float) -> dict[str, str]:
    """The monitor's files for one of the workspaces, by name."""
    of = model() if driven else pressure_driven()
    return monitor_files(of, {"tip": 3}, back_off, SPACES[name]())


def directory(into: Path, name: str, driven: bool = True) -> Path:
    """A generated directory with the monitor for one of the workspaces."""
    shutil.copytree(
        small.folder(), into, ignore=lambda _, names: [n for n in names if "monitor" in n]
    )
    for file, text in texts(name, driven, BACK_OFF).items():
        (into / file).write_text(text)
    return into


@cache
def steps() -> list[tuple[Step, np.ndarray, np.ndarray, np.ndarray]]:
    """Steps of a closed loop, then states of all sizes; statuses and iterations at random."""
    random = np.random.default_rng(1)
    given, inputs = small.closed_loop(30)
    layout = model().layout
    size = len(layout.x)
    cases = [(row[-size:], u, row[:3]) for row, u in zip(given, inputs, strict=True)]
    for _ in range(200):
        x = random.normal(size=size) * layout.x.scale * random.uniform(0, 0.7)
        cases.append((x, random.uniform(0, 2, 3), random.normal(size=3) * 0.25))
    found = []
    for x, u, reference in cases:
        status = random.choice([SOLVED] * 3 + [ITERATION_CAP, INPUT_NOT_FINITE, f"{FAILED}: QP"])
        qp = "not asked" if status == INPUT_NOT_FINITE else "optimal"
        iterations = 0 if qp == "not asked" else int(random.integers(1, 100))
        step = Step(u, str(status), "solution", 0.0, 0.0, iterations=iterations, qp=qp)
        found.append((step, x, u, reference))
    return found
