"""The pilot of a generated directory as a Python object: the whole controller of a rig in the loop.

Estimator, supervision and MPC run in C; Python tells them of readings and of the reference. It has
the methods and attributes of `Pilot` that a loop and its record need.
"""

from __future__ import annotations

import ctypes
import time
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from softmpc.codegen.compiled_controller import CompiledController
from softmpc.codegen.estimator_pilot import files
from softmpc.control.stage import DISTURBANCE
from softmpc.control.step import Step
from softmpc.errors import InputError
from softmpc.estimation.estimator import Estimate, Estimator
from softmpc.estimation.kalman import Innovation
from softmpc.estimation.knots import Health
from softmpc.estimation.sensing import Sample
from softmpc.estimation.sensors import TICK
from softmpc.rig.pilot import Act, Pilot
from softmpc.rig.supervision import State, Transition

__all__ = ["CompiledPilot", "CompiledSupervisor", "Heard"]

Array = np.ndarray
ABOUT_SENSORS = (2, 3)  # causes whose detail is a sensor
TROUBLE = 1  # the cause whose detail is a trouble of the estimator
STATUS = (6, 7)  # causes whose detail is a status of the MPC
REASONS = 9
SAME = ("estimator_data.c", "pilot_data.c", "supervision_sizes.h")  # of one rig, however late


class _Act(ctypes.Structure):
    _fields_ = [(name, ctypes.c_int) for name in ("state", "asked", "status", "trouble")]


class _Transition(ctypes.Structure):
    _fields_ = [("tick", ctypes.c_int32)] + [
        (name, ctypes.c_int) for name in ("before", "after", "cause", "detail", "too_long")
    ]


class CompiledPilot:
    """One pilot in C of the same rig as `like`, which itself is not run.

    Raises `InputError` where the folder has no pilot or that of another rig, and `BuildError` where
    there is no compiler.
    """

    def __init__(
        self, folder: Path, like: Pilot, *, single: bool = False, flags: Sequence[str] = (),
        clock: Callable[[], float] = time.perf_counter,
    ) -> None:  # fmt: skip
        _check_written(Path(folder), like)
        self.like, self.guide, self.delay = like, like.guide, like.delay
        t = like.mpc.transcription
        budget = like.mpc.budget
        self.mpc = CompiledController(folder, t, single=single, flags=flags, clock=clock)
        self.library = self.mpc.library
        _declare(self.library)
        self._memory = ctypes.create_string_buffer(int(self.library.smpc_pilot_memory()) + 64)
        start = ctypes.addressof(self._memory)
        self._at = ctypes.c_void_p(start + -start % 64)
        self.mpc._at = ctypes.c_void_p(self.library.smpc_pilot_controller(self._at))
        self.mpc._budget = budget  # set in its `reset`
        self._clock = ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_void_p)(lambda _: clock())
        self._sample = _sample_type(like.estimator, self.mpc.dtype)
        self.estimator: Any = Heard(self, like.estimator)
        self.supervisor: Any = CompiledSupervisor(self, like.estimator)

    # --- what a loop calls -----------------------------------------------------------------------

    def reset(self, x: Array, u: Array, tick: int = 0) -> None:
        """Begin at a state of the controller's model and an input."""
        given = [self.mpc._given(one) for one in (x, u)]
        if self.library.smpc_pilot_init(self._at, *given, tick):
            raise InputError("CompiledPilot.reset: state and input must be finite numbers")
        self.mpc.reset()
        clock = ctypes.cast(self._clock, ctypes.c_void_p)
        self.library.smpc_pilot_set_clock(self._at, clock, None)
        self.u = np.asarray(u, float).copy()
        self.estimator.seen.clear()

    def listen(self, tick: int, samples: Sequence[Sample]) -> None:
        """Take what has arrived, without an input: the last one is held."""
        self.library.smpc_pilot_listen(self._at, tick, *self._samples(samples))
        self.estimator.note()

    def step(self, tick: int, samples: Sequence[Sample]) -> Act:
        """The input from what has arrived until `tick`."""
        told = [self.mpc._given(one) for one in self._told(tick)]
        arrived = self._samples(samples)
        u = self.mpc._given(np.zeros(len(self.u)))
        began = time.perf_counter()
        state = State(self.library.smpc_pilot_step(self._at, tick, *arrived, *told, u))
        took = time.perf_counter() - began
        self.u = u.array.astype(float)
        self.estimator.note()
        act = self.library.smpc_pilot_last(self._at).contents
        return Act(
            self.u.copy(),
            state,
            self._mpc_step(act, state, took),
            self.estimator.now(tick),
            float(self.library.smpc_pilot_estimate_seconds(self._at)),
            took,
        )

    def _mpc_step(self, act: _Act, state: State, took: float) -> Step:
        if not act.asked:
            return Step(self.u.copy(), str(state), "supervision", 0.0, 0.0)
        self.mpc._u[:] = self.u
        return self.mpc._as_step(0.0, took)

    def _told(self, tick: int) -> tuple[Array, Array, Array]:
        """References, the arm at rest where the reference is, and the input that holds it there."""
        ocp = self.mpc.ocp
        given = dict(self.guide.given((tick + self.delay) * TICK + ocp.nodes))
        if ocp.disturbance is not None:
            given[DISTURBANCE] = np.zeros((ocp.intervals, len(ocp.disturbance)))
        now = tick * TICK
        rest = self.guide.given(np.array([now]))["rest"][0]
        return self.mpc.transcription.references(given), rest, self.guide.holding(now)

    def _samples(self, samples: Sequence[Sample]) -> tuple[Any, int]:
        """As C has them; one of another size is one of numbers that are none."""
        found = np.zeros(max(len(samples), 1), self._sample)
        for row, one in zip(found, samples, strict=False):
            size = len(self.like.estimator.readings[one.sensor].names)
            row["sensor"], row["stamp"], row["value"] = one.sensor, one.stamp, np.nan
            if np.shape(one.value) == (size,):
                row["value"][:size] = one.value
        pointer: Any = found.ctypes.data_as(ctypes.c_void_p)
        pointer.array = found
        return pointer, len(samples)


class Heard:
    """What the record of a rig asks the estimator for, answered by that in C."""

    def __init__(self, pilot: CompiledPilot, like: Estimator) -> None:
        self.pilot, self.library = pilot, pilot.library
        self.model, self.process, self.sensors = like.model, like.process, like.sensors
        self.readings = like.readings
        self.seen: dict[tuple[int, int], Innovation] = {}

    @property
    def _at(self) -> ctypes.c_void_p:
        return ctypes.c_void_p(self.library.smpc_pilot_estimator(self.pilot._at))

    def now(self, tick: int) -> Estimate:
        """The last estimate."""
        p, given = self.process, self.pilot.mpc._given
        x, d, P = (given(np.zeros(n)) for n in (p.nx, len(p.disturbance), (p.size, p.size)))
        self.library.smpc_estimator_seen(self._at, 0, x, d, P)
        return Estimate(tick * TICK, *(one.array.astype(float) for one in (x, d, P)))

    def note(self) -> None:
        """Take down what became of readings that may still be judged anew."""
        count, tick = len(self.sensors), ctypes.c_int32()
        nis, rejected = self.pilot.mpc._given(np.zeros(count)), (ctypes.c_int * count)()
        i, none = 0, np.zeros(0)
        while self.library.smpc_estimator_judged(self._at, i, ctypes.byref(tick), nis, rejected):
            for sensor, square in enumerate(nis.array):
                if square >= 0:
                    self.seen[tick.value, sensor] = Innovation(
                        sensor, tick.value, none, none, float(square), not rejected[sensor]
                    )
            i += 1

    @property
    def innovations(self) -> list[Innovation]:
        """By their times, of all since the start, without their values."""
        return [self.seen[key] for key in sorted(self.seen)]

    @property
    def health(self) -> list[Health]:
        """Of each sensor, as of the last estimate."""
        found = []
        for i in range(len(self.sensors)):
            counts = (self.library.smpc_estimator_left_out(self._at, i, r) for r in range(REASONS))
            names = (self.library.smpc_reason_name(r).decode() for r in range(REASONS))
            why = Counter({n: k for n, k in zip(names, counts, strict=True) if k})
            found.append(Health(self.library.smpc_estimator_good(self._at, i), why))
        return found


class CompiledSupervisor:
    """The log of the supervision in C: its last changes of state."""

    def __init__(self, pilot: CompiledPilot, like: Estimator) -> None:
        self.pilot, self.library, self.sensors = pilot, pilot.library, like.sensors

    @property
    def log(self) -> list[Transition]:
        at = ctypes.c_void_p(self.library.smpc_pilot_supervisor(self.pilot._at))
        found = []
        for i in range(int(self.library.smpc_supervisor_changes(at))):
            one = self.library.smpc_supervisor_change(at, i)
            if one:
                found.append(self._transition(one.contents))
        return found

    def _transition(self, one: _Transition) -> Transition:
        before, after = State(one.before), State(one.after)
        cause = self._cause(one.cause, one.detail)
        if one.too_long:
            cause = f"too long in fall-back, {cause}"
        elif after < before:
            cause = f"only {cause}" if one.cause else "recovered"
        return Transition(one.tick * TICK, before, after, cause)

    def _cause(self, cause: int, detail: int) -> str:
        if cause in ABOUT_SENSORS:
            return f"no {self.sensors[detail].name}"
        said = self.library.smpc_cause_name(cause).decode()
        if cause == TROUBLE:
            return f"{said}: {self.library.smpc_trouble_name(detail).decode()}"
        if cause in STATUS:
            return f"{said}: {self.library.smpc_status_name(detail).decode()}"
        return str(said)


def _sample_type(estimator: Estimator, real: type) -> np.dtype[Any]:
    """smpc_sample of estimator.h."""
    largest = max(len(reading.names) for reading in estimator.readings)
    return np.dtype([("sensor", "i4"), ("stamp", "i4"), ("value", real, (largest,))], align=True)


def _check_written(folder: Path, like: Pilot) -> None:
    """Raises `InputError` where the folder has no pilot, or that of another rig."""
    if not (folder / "pilot.c").is_file():
        raise InputError(f"{folder}: holds no pilot; a scene with a table [rig] has one")
    texts = files(like)
    for name in SAME:
        if (folder / name).read_text(encoding="utf-8") != texts[name]:
            raise InputError(f"{folder}: {name} is that of another rig; write the folder anew")


def _declare(library: ctypes.CDLL) -> None:
    """Types of what the functions give."""
    for name in ("pilot_memory", "sample_memory"):
        getattr(library, f"smpc_{name}").restype = ctypes.c_ulong
    for name in ("pilot_controller", "pilot_estimator", "pilot_supervisor"):
        getattr(library, f"smpc_{name}").restype = ctypes.c_void_p
    for name in ("reason_name", "cause_name", "trouble_name", "status_name"):
        getattr(library, f"smpc_{name}").restype = ctypes.c_char_p
    library.smpc_pilot_last.restype = ctypes.POINTER(_Act)
    library.smpc_supervisor_change.restype = ctypes.POINTER(_Transition)
    library.smpc_pilot_estimate_seconds.restype = ctypes.c_double
