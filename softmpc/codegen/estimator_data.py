"""The estimator of a scene as C: sizes, constant arrays, and the tips as a function.

All is scaled, as in `softmpc.codegen.data`; readings are in SI. The exact motion of the drive is
worked out in C for the length of each step, from its rates: blocks of states and inputs that have
nothing to do with each other, those that are alike kept once.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field

import numpy as np
from scipy.sparse.csgraph import connected_components

from softmpc.codegen import c_text
from softmpc.codegen.estimator_tips import tip_rows, tips
from softmpc.codegen.model_functions import sources
from softmpc.estimation import estimator as filtering
from softmpc.estimation.arm_step import CONVERGED, ITERATIONS, STAGES
from softmpc.estimation.estimator import Estimator
from softmpc.estimation.plausibility import AWAY, FROZEN_AFTER, SURE
from softmpc.estimation.process import Process
from softmpc.estimation.sensors import TICK
from softmpc.estimation.weighing import ABSURD

__all__ = ["Window", "files"]

Array = np.ndarray


@dataclass(frozen=True)
class Window:
    """What an estimator in C remembers, in ticks: how late a reading may be, and how often the
    controller runs. `late` is beyond the latency of the sensors, a step of it by default."""

    step: int
    late: int | None = None

    def memory(self, estimator: Estimator) -> int:
        """Ticks that it goes back."""
        late = self.step if self.late is None else self.late
        return max(sensor.delay for sensor in estimator.sensors) + late

    def knots(self, estimator: Estimator) -> int:
        """Times of readings and inputs within the memory, the one before it, and one to spare."""
        periods = [self.step, *(sensor.period for sensor in estimator.sensors)]
        return 2 + _most_stops(periods, self.memory(estimator) + 1)

    def samples(self, estimator: Estimator) -> int:
        """Readings of all sensors within the memory and two steps."""
        lasts = self.memory(estimator) + 2 * self.step
        return sum(lasts // sensor.period + 2 for sensor in estimator.sensors)

    def inputs(self, estimator: Estimator) -> int:
        """Inputs that act within the memory, and one before and after it."""
        return self.memory(estimator) // self.step + 4


def _most_stops(periods: Iterable[int], length: int) -> int:
    """Most ticks that are a multiple of a period, within any `length` ticks."""
    periods = sorted(set(periods))
    whole = min(int(np.lcm.reduce(periods)), 100_000) + length
    hits = np.zeros(whole, dtype=int)
    for period in periods:
        hits[::period] = 1
    sums = np.concatenate([[0], np.cumsum(hits)])
    return int((sums[length:] - sums[:-length]).max())


def files(estimator: Estimator, window: Window) -> dict[str, str]:
    """Names and texts of the generated files of an estimator; beside them it needs `sizes.h`,
    `model.c` and the C sources `estimator*.c`, `kalman.c`, `readings.c`, `linear.c`.

    Raises `InputError` where a sensor cannot be written as C.
    """
    data = _Data()
    _add_motion(data, estimator.process)
    _add_readings(data, estimator)
    sizes = _sizes(estimator, window) + "".join(data.sizes)
    header = f'#include "real.h"\n#include "sparse.h"\n\n{"".join(data.declared)}'
    return {
        "estimator_sizes.h": c_text.guard("estimator_sizes.h", f'#include "sizes.h"\n\n{sizes}'),
        "estimator_data.h": c_text.guard("estimator_data.h", header),
        "estimator_data.c": '#include "estimator_data.h"\n\n' + "".join(data.defined),
        **sources("model_sensors", [tips(estimator.model)]),
    }


# ---------------------------------------------------------------- arrays


@dataclass
class _Data:
    """Definitions, declarations and sizes, one after the other."""

    defined: list[str] = field(default_factory=list)
    declared: list[str] = field(default_factory=list)
    sizes: list[str] = field(default_factory=list)

    def array(self, name: str, values: object, kind: str = "smpc_real") -> None:
        flat = np.asarray(values).ravel()
        self.defined.append(c_text.array(f"smpc_filter_{name}", flat, kind))
        self.declared.append(c_text.declaration(f"smpc_filter_{name}", flat.size, kind))

    def sparse(self, name: str, matrix: Array) -> None:
        """A constant matrix by its entries that are not zero."""
        rows, columns = np.nonzero(matrix)
        starts = np.searchsorted(rows, np.arange(len(matrix) + 1))
        parts = [
            c_text.array(f"filter_{name}_{part}", values, kind).replace("const", "static const", 1)
            for part, values, kind in (
                ("start", starts, "int"),
                ("column", columns, "unsigned short"),
                ("value", matrix[rows, columns], "smpc_real"),
            )
        ]
        whole = ", ".join(f"filter_{name}_{part}" for part in ("start", "column", "value"))
        parts.append(f"const smpc_sparse smpc_filter_{name} = {{{whole}}};\n")
        self.defined += parts
        self.declared.append(f"extern const smpc_sparse smpc_filter_{name};\n")

    def size(self, name: str, value: object, comment: str = "") -> None:
        self.sizes.append(c_text.define(name, value, comment))


def _sizes(estimator: Estimator, window: Window) -> str:
    p = estimator.process
    sizes = [len(reading.names) for reading in estimator.readings]
    values: list[tuple[str, object, str]] = [
        ("SMPC_FILTERED", p.size, "numbers that it estimates: state, then disturbance"),
        ("SMPC_FILTER_STAGES", STAGES, "of a step of the arm"),
        ("SMPC_UNKNOWNS", STAGES * p.n, "of a step of the arm"),
        ("SMPC_CAUSES", 3 * p.n + STAGES * len(p.model.layout.p), "of a step of the arm"),
        ("SMPC_SENSORS", len(sizes), ""),
        ("SMPC_READ", sum(sizes), "values that all sensors read"),
        ("SMPC_LARGEST_READING", max(sizes), "values of one sensor"),
        ("SMPC_TIPS", 3 * len(p.model.scene.manipulator.sections), "coordinates of tips"),
        ("SMPC_MEMORY", window.memory(estimator), "ticks that a reading may be late"),
        ("SMPC_STEP_TICKS", window.step, "of the controller"),
        ("SMPC_KNOTS", window.knots(estimator), "times that it can go back to"),
        ("SMPC_SAMPLES", window.samples(estimator), "readings that it remembers"),
        ("SMPC_APPLIED", window.inputs(estimator), "inputs that it remembers"),
        ("SMPC_TICK", TICK, "s"),
        ("SMPC_LONGEST_TICKS", round(filtering.LONGEST / TICK), "of one step of the model"),
        ("SMPC_LOST", filtering.LOST, "ticks until it is the filter that is lost"),
        ("SMPC_DOUBTED", filtering.DOUBTED, "readings too far in a row that contradict it"),
        ("SMPC_CURVATURE", filtering.CURVATURE, ""),
        ("SMPC_BENT_LEAST", filtering.BENT[0], ""),
        ("SMPC_BENT_MOST", filtering.BENT[1], ""),
        ("SMPC_ABSURD", ABSURD, "times the distance of what is likely"),
        ("SMPC_FROZEN_AFTER", FROZEN_AFTER, "equal readings"),
        ("SMPC_AWAY", AWAY, "ticks that readings after a jump are left out"),
        ("SMPC_NEWTON_CONVERGED", CONVERGED, ""),
        ("SMPC_NEWTON_ITERATIONS", ITERATIONS, ""),
    ]
    return "".join(c_text.define(*one) for one in values) + _about(estimator)


def _about(estimator: Estimator) -> str:
    """A comment that says what each sensor reads, for whoever fills in smpc_sample."""
    lines = [
        f" * {i}  {sensor.name}: {len(reading.names)} values ({sensor.unit}), each "
        f"{sensor.period} ticks, {sensor.delay} late: {', '.join(reading.names)}"
        for i, (sensor, reading) in enumerate(
            zip(estimator.sensors, estimator.readings, strict=True)
        )
    ]
    ascii_only = "\n".join(lines).replace("·", " ").encode("ascii", "replace").decode()
    return f"/* Sensors by number, what they read, how often and how late:\n{ascii_only}\n */\n"


# ---------------------------------------------------------------- motion


def _add_motion(data: _Data, p: Process) -> None:
    layout, d = p.model.layout, p.disturbance
    q, dq, a = layout.q.scale, layout.dq.scale, p.arm._scale[: p.n]
    data.array("x_scale", layout.x.scale)
    data.array("u_scale", layout.u.scale)
    data.array("rate_to_strain", dq / q)
    data.array("unknown_to_strain", a / q)
    data.array("unknown_to_rate", a / dq)
    data.array("tableau", p.arm.tableau.A)
    data.array("times", p.arm.tableau.c)
    data.array("intensity", p._intensity)
    data.sparse("force_by_d", d.F / layout.r.scale[:, None])
    offsets = d.G / layout.u.scale[:, None]
    data.sparse("offset_by_d", offsets)
    drive = p.model.drive
    z, pressures = layout.x.scale[2 * p.n :], layout.p.scale[:, None]
    C, D = drive.C * z / pressures, drive.D * layout.u.scale / pressures
    data.sparse("pressure_by_z", C)
    data.sparse("pressure_by_u", D)
    rates = np.hstack([drive.A * z, drive.B * layout.u.scale]) / z[:, None]
    _Blocks(rates, offsets, 2 * p.n).add(data, C, D)


class _Blocks:
    """The drive in blocks of states and inputs that have nothing to do with each other."""

    def __init__(self, rates: Array, offsets: Array, arm: int) -> None:
        nz, k = len(rates), rates.shape[1] - len(rates)
        self.nz, self.first_d = nz, arm + nz
        self.arm, self.offsets = arm, offsets
        square = np.vstack([rates, np.zeros((k, nz + k))])
        _, part = connected_components(square != 0, directed=False)
        self.members = [np.flatnonzero(part == one) for one in dict.fromkeys(part[:nz].tolist())]
        self.of_state = {int(i): b for b, own in enumerate(self.members) for i in own if i < nz}
        self.kinds: dict[bytes, int] = {}
        self.matrices: list[Array] = []
        self.kind_of = [self._kind(square[np.ix_(own, own)]) for own in self.members]

    def _kind(self, matrix: Array) -> int:
        found = self.kinds.setdefault(matrix.tobytes(), len(self.matrices))
        if found == len(self.matrices):
            self.matrices.append(matrix)
        return found

    def columns(self, state: int) -> Iterator[int]:
        """Columns of the augmented state on which a drive state depends after a step, in the
        order in which C works them out; one may come twice."""
        own = self.members[self.of_state[state]]
        yield from (self.arm + int(i) for i in own if i < self.nz)
        for i in own:
            if i >= self.nz:
                yield from self._of_input(int(i) - self.nz)

    def _of_input(self, i: int) -> Iterator[int]:
        return (self.first_d + int(j) for j in np.flatnonzero(self.offsets[i]))

    def add(self, data: _Data, C: Array, D: Array) -> None:
        nz, sizes = self.nz, [len(own) for own in self.members]
        states = [int(np.sum(own < nz)) for own in self.members]
        first = np.cumsum([0, *(matrix.size for matrix in self.matrices)])
        data.size("SMPC_DRIVE_BLOCKS", len(self.members))
        data.size("SMPC_DRIVE_KINDS", len(self.matrices))
        data.size("SMPC_DRIVE_NUMBERS", int(first[-1]), "of one exponential of each kind")
        data.size("SMPC_DRIVE_LARGEST", max(sizes, default=1), "states and inputs of a block")
        data.array("block_start", np.cumsum([0, *sizes]), "int")
        data.array("block_states", states, "int")
        data.array("block_member", np.concatenate([[], *self.members]), "unsigned short")
        data.array("block_kind", self.kind_of, "int")
        data.array("block_of", [self.of_state[i] for i in range(nz)], "int")
        place = [int(np.flatnonzero(self.members[self.of_state[i]] == i)[0]) for i in range(nz)]
        data.array("place_in_block", place, "int")
        data.array("kind_start", first[:-1], "int")
        data.array("kind_size", [len(matrix) for matrix in self.matrices], "int")
        data.array("kind_rates", np.concatenate([[], *(m.ravel() for m in self.matrices)]))
        _add_rows(data, "drive", "SMPC_DRIVE_ENTRIES", [[*self.columns(i)] for i in range(nz)])
        rows = [
            [c for i in np.flatnonzero(by_z) for c in self.columns(int(i))]
            + [c for i in np.flatnonzero(by_u) for c in self._of_input(int(i))]
            for by_z, by_u in zip(C, D, strict=True)
        ]
        _add_rows(data, "pressure", "SMPC_PRESSURE_ENTRIES", rows)


def _add_rows(data: _Data, name: str, size: str, rows: list[list[int]]) -> None:
    """Where the entries of rows are that are worked out in C."""
    data.size(size, sum(map(len, rows)))
    data.array(f"{name}_start", np.cumsum([0, *map(len, rows)]), "int")
    data.array(f"{name}_column", [c for row in rows for c in row], "unsigned short")


# ---------------------------------------------------------------- readings


def _add_readings(data: _Data, estimator: Estimator) -> None:
    p, sensors, readings = estimator.process, estimator.sensors, estimator.readings
    data.array("spread", estimator._spread)
    data.array("read_start", np.cumsum([0, *(len(one.names) for one in readings)]), "int")
    data.array("variances", np.concatenate(estimator._R))
    data.array("gates", estimator._gates)
    linear = [
        np.zeros((len(reading.names), p.size)) if H is None else H
        for H, reading in zip(estimator._linear, readings, strict=True)
    ]
    data.sparse("read_by_s", np.vstack(linear))
    data.sparse("read_by_u", np.vstack([reading.by_u for reading in readings]))
    data.array("read_tip", np.concatenate([tip_rows(one, p.model) for one in sensors]), "int")
    data.array("noisy", _of_each(sensors, lambda one: one.noise > 0), "int")
    data.array("fastest", _of_each(sensors, lambda one: one.fastest * TICK))
    data.array("margin", _of_each(sensors, lambda one: SURE * one.noise))


def _of_each(sensors: Iterable, value: Callable) -> list:
    return [value(sensor) for sensor in sensors]
