"""The flight recorder of a compiled controller, driven from Python."""

from __future__ import annotations

import ctypes
from dataclasses import replace
from typing import Any

import numpy as np

from softmpc.codegen.compiled_controller import CompiledController
from softmpc.codegen.flight_format import Header, Snapshot, put_header
from softmpc.codegen.flight_log import header_in
from softmpc.codegen.flight_writer import Closing, LogFile
from softmpc.control.step import Step
from softmpc.errors import BuildError

__all__ = ["CompiledRecorder", "header_of", "restore"]

SINK = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_size_t)
RECORDER_BYTES = 1024  # of a recorder beside its references and inputs


def header_of(controller: CompiledController) -> Header:
    """What the controller's own code writes at the beginning of a log."""
    got = bytearray()
    sink = SINK(lambda _, data, count: got.extend(ctypes.string_at(data, count)))
    _function(controller, "smpc_log_header")(sink, None)
    return header_in(bytes(got))


def restore(controller: CompiledController, snapshot: Snapshot) -> bool:
    """Make it remember what a snapshot says; whether that is of such a controller."""
    pointer = ctypes.POINTER(controller.real)
    names: list[tuple[str, Any]] = [("age", ctypes.c_uint), ("failures", ctypes.c_uint)]
    names += [(name, pointer) for name in ("u", "plan", "expected", "multipliers")]
    names += [("plan_count", ctypes.c_uint32), ("multiplier_count", ctypes.c_uint32)]
    names += [("violation", controller.real)]
    kind = type("Snapshot", (ctypes.Structure,), {"_fields_": names})
    s = snapshot
    arrays = [
        None if part is None else np.ascontiguousarray(part, controller.dtype)
        for part in (s.u, s.plan, s.expected, s.active)
    ]
    given = [None if one is None else one.ctypes.data_as(pointer) for one in arrays]
    counts = [0 if one is None else len(one) for one in (arrays[1], arrays[3])]
    told = kind(s.age, s.failures, *given, *counts, s.violation)
    function = _function(controller, "smpc_restore")
    return int(function(controller._at, ctypes.byref(told))) == 0


class CompiledRecorder(Closing):
    """A controller in C with a recorder in C beside it, which writes a log as it goes.

    It is used as the controller itself is; what it does not know it asks that one.
    """

    def __init__(
        self, controller: CompiledController, file: LogFile, every: int, scene: str
    ) -> None:
        self.controller, self.file, self.every = controller, file, every
        t = controller.transcription
        size = RECORDER_BYTES + 8 * (t.N * t.nr + 8 * t.inputs)
        self._memory = ctypes.create_string_buffer(size)
        self._record = bytearray()
        self._sink = SINK(lambda _, data, count: self._record.extend(ctypes.string_at(data, count)))
        self._steps = 0
        self._u_before: Any = None
        self._usual = self._known = self._settings()
        file.put(put_header(replace(header_of(controller), scene=scene)))
        self._call("smpc_recorder_init", self._sink, None)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.controller, name)

    @property
    def ocp(self) -> Any:
        """The problem."""
        return self.controller.ocp

    @property
    def budget(self) -> float | None:
        """The time (s) that a step may take; None sets none."""
        return self.controller.budget

    @budget.setter
    def budget(self, budget: float | None) -> None:
        self.controller.budget = budget

    def reset(self) -> None:
        """Forget what was before."""
        self.controller.reset()
        self._known = self._usual  # what is still set is written once more
        self._call("smpc_record_reset")

    def set_limits(self, *limits: Any, **named: Any) -> None:
        """See `CompiledController.set_limits`."""
        self.controller.set_limits(*limits, **named)
        self._call("smpc_log_settings", self.controller._at)

    def step(self, x: Any, u_before: Any, given: Any) -> Step:
        """The input for the state x and the references at the coming nodes."""
        self.prepare(given, u_before)
        return self.feedback(x)

    def prepare(self, given: Any, u_before: Any = None) -> None:
        """See `CompiledController.prepare`."""
        if self._settings() != self._known:
            self._known = self._settings()
            self._call("smpc_log_settings", self.controller._at)
        self._u_before = self.controller._last if u_before is None else u_before
        self.controller.prepare(given, u_before)

    def feedback(self, x: Any) -> Step:
        """See `CompiledController.feedback`."""
        step = self.controller.feedback(x)
        numbers = (self.controller._given(part) for part in (self._u_before, x, step.u))
        self._call("smpc_log_step", self.controller._at, *numbers)
        self._steps += 1
        if self._steps % self.every == 0:
            self._call("smpc_log_snapshot", self.controller._at)
        return step

    def close(self) -> None:
        """End the log."""
        self.file.close()

    def _settings(self) -> tuple[float | None, int]:
        """What a user or a fault may change between steps."""
        return self.controller.budget, self.controller.max_iterations

    def _call(self, name: str, *given: Any) -> None:
        """A function of the recorder; whole records go to the file."""
        _function(self.controller, name)(self._memory, *given)
        self.file.put(bytes(self._record))
        self._record.clear()


def _function(controller: CompiledController, name: str) -> Any:
    found = getattr(controller.library, name, None)
    if found is None:
        raise BuildError(
            f"{controller.folder}: has no flight recorder ({name}): generate it with this softmpc"
        )
    return found
