"""The controller of a generated directory as a Python object: software in the loop.

The sources are compiled into a shared library, which is driven through ctypes. What it answers is a
`Step`, as the Python controller's, so that the same closed loop takes either.
"""

from __future__ import annotations

import ctypes
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from softmpc.codegen.building import build_library
from softmpc.control.input_guard import InputGuard
from softmpc.control.step import (
    BUDGET_OVERRUN,
    FAILED,
    INPUT_NOT_FINITE,
    ITERATION_CAP,
    SOLVED,
    Step,
)
from softmpc.control.transcription import References, Transcription
from softmpc.errors import InputError

__all__ = ["CompiledController"]

STATUS = (SOLVED, ITERATION_CAP, BUDGET_OVERRUN, INPUT_NOT_FINITE, FAILED)
SOURCE = ("solution", "shifted plan", "held input")

Array = np.ndarray


def _report_type(real: Any) -> Any:
    """smpc_report of memory.h; the real numbers have the type of the build."""
    ints = ("status", "qp", "source", "iterations", "active", "failures", "clipped", "restarted")
    reals = ("cost", "share", "kkt", "violation")
    fields = [*((name, ctypes.c_int) for name in ints), *((name, real) for name in reals)]
    return type(
        "Report", (ctypes.Structure,), {"_fields_": [*fields, ("seconds", ctypes.c_double)]}
    )


class CompiledController:
    """One controller in C for the problem of a transcription, driven as an `Mpc` is.

    `budget` (s) is measured by `clock`, a function without arguments.
    """

    name = "real-time in C"

    def __init__(
        self,
        folder: Path,
        transcription: Transcription,
        *,
        single: bool = False,
        flags: Sequence[str] = (),
        budget: float | None = None,
        clock: Callable[[], float] = time.perf_counter,
    ) -> None:
        self.transcription, self.ocp, self.folder = transcription, transcription.ocp, Path(folder)
        self.guard = InputGuard(self.ocp)
        self.real: Any = ctypes.c_float if single else ctypes.c_double
        self.dtype: Any = np.float32 if single else np.float64
        self.library = ctypes.CDLL(str(build_library(self.folder, flags, single)))
        self._declare()
        self._memory = ctypes.create_string_buffer(int(self.library.smpc_memory()) + 64)
        start = ctypes.addressof(self._memory)
        self._at = ctypes.c_void_p(start + -start % 64)
        self._clock = ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_void_p)(lambda _: clock())
        self._budget, self._cap = budget, 0
        self._u = np.zeros(transcription.inputs, self.dtype)
        self._asked: float | None = None  # s that preparing took
        self._last: Array | None = None
        self.reset()

    def _declare(self) -> None:
        lib, real = self.library, ctypes.POINTER(self.real)
        self._Report = _report_type(self.real)
        lib.smpc_memory.restype = ctypes.c_ulong
        lib.smpc_last.restype = ctypes.POINTER(self._Report)
        lib.smpc_qp_name.restype = ctypes.c_char_p
        lib.smpc_set_clock.argtypes = [
            ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_double
        ]  # fmt: skip
        for name, count in (("set_reference", 1), ("prepare", 1), ("feedback", 2), ("step", 3)):
            getattr(lib, f"smpc_{name}").argtypes = [ctypes.c_void_p, *[real] * count]
        lib.smpc_set_cap.argtypes = [ctypes.c_void_p, ctypes.c_uint]
        lib.smpc_set_limits.argtypes = [ctypes.c_void_p, *[real] * 4]

    def _given(self, value: Array) -> Any:
        """A pointer to numbers of the build's type, which live as long as it does."""
        array = np.ascontiguousarray(value, self.dtype)
        pointer = array.ctypes.data_as(ctypes.POINTER(self.real))
        pointer.array = array
        return pointer

    # --- the calls of a controller ----------------------------------------------------------------

    def reset(self) -> None:
        """Forget the last plan and input."""
        self.library.smpc_init(self._at)
        self.budget, self.max_iterations = self._budget, self._cap
        self._asked = self._last = None

    @property
    def budget(self) -> float | None:
        """The time (s) that a step may take; None sets none."""
        return self._budget

    @budget.setter
    def budget(self, seconds: float | None) -> None:
        self._budget = seconds
        clock = None if seconds is None else ctypes.cast(self._clock, ctypes.c_void_p)
        self.library.smpc_set_clock(self._at, clock, None, seconds or 0.0)

    @property
    def qp(self) -> CompiledController:
        """What has the attribute `max_iterations`, as the solver of a quadratic program."""
        return self

    @property
    def max_iterations(self) -> int:
        """The most iterations of the quadratic program in a step; 0: as built."""
        return self._cap

    @max_iterations.setter
    def max_iterations(self, cap: int) -> None:
        self._cap = cap
        self.library.smpc_set_cap(self._at, cap)

    def set_limits(
        self, low: Array | None = None, high: Array | None = None, fall: Array | None = None,
        rise: Array | None = None,
    ) -> None:  # fmt: skip
        """Narrower limits of the input and of its change in a step (k each, SI)."""
        given = [None if part is None else self._given(part) for part in (low, high, fall, rise)]
        if self.library.smpc_set_limits(self._at, *given):
            raise InputError("set_limits: each lower limit must be below the upper one, none NaN")

    def step(self, x: Any, u_before: Any, given: References) -> Step:
        """The input for the state x (q, dq, z) and references at the coming nodes."""
        self.prepare(given, u_before)
        return self.feedback(x)

    def prepare(self, given: References, u_before: Any = None) -> None:
        """What needs no measurement; `u_before` is the last input where it is not given."""
        began = time.perf_counter()
        until_now = self._last if u_before is None else u_before
        if until_now is None:
            raise InputError("CompiledController.prepare: the first step needs `u_before`")
        u = self._sized("u_before", until_now, self.transcription.inputs)
        references = self._given(self.transcription.references(given))
        self.library.smpc_set_reference(self._at, references)
        self.library.smpc_prepare(self._at, self._given(u))
        self._asked = time.perf_counter() - began

    def feedback(self, x: Any) -> Step:
        """The input for the state x as measured."""
        began = time.perf_counter()
        if self._asked is None:
            raise InputError("CompiledController.feedback: call `prepare` before each `feedback`")
        prepared, self._asked = self._asked, None
        state = self._given(self._sized("x", x, self.transcription.nx))
        out = self._u.ctypes.data_as(ctypes.POINTER(self.real))
        self.library.smpc_feedback(self._at, state, out)
        self._last = self._u.astype(float)
        return self._as_step(prepared, time.perf_counter() - began)

    def _sized(self, name: str, value: Any, size: int) -> Array:
        value = np.asarray(value, float).ravel()
        if len(value) != size:
            raise InputError(
                f"CompiledController: {name} has {len(value)} numbers; this arm needs {size}"
            )
        return value

    @property
    def report(self) -> Any:
        """smpc_report of the last step, see memory.h."""
        return self.library.smpc_last(self._at).contents

    def _as_step(self, prepared: float, seconds: float) -> Step:
        report, u = self.report, self._u.astype(float)
        qp = self.library.smpc_qp_name(report.qp).decode()
        status = STATUS[report.status]
        return Step(
            u=u,
            status=f"{FAILED}: QP {qp}" if status == FAILED else status,
            source=SOURCE[report.source],
            prepare_seconds=prepared,
            feedback_seconds=seconds,
            iterations=report.iterations,
            cost=float(report.cost),
            kkt=float(report.kkt),
            qp=qp,
            share=float(report.share),
            violation=float(report.violation),
            clipped=bool(report.clipped),
        )
