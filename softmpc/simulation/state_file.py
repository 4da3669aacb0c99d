"""A state to start from, out of a saved motion: a simulation (NPZ or CSV) or a plan (NPZ)."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from softmpc.errors import InputError
from softmpc.files import reading_npz
from softmpc.model.model import Model
from softmpc.simulation.result_files import read_csv

__all__ = ["SUFFIXES", "read_state"]

SUFFIXES = (".npz", ".csv")
SLACK = 1e-9  # s

Array = np.ndarray


def read_state(
    path: str | os.PathLike[str], model: Model, at: float | None = None
) -> tuple[Array, Array]:
    """State x (nx) and the input u (k) under which it was reached, SI.

    Of the last sample that is not later than `at` (s; None: the last one). Raises `InputError` for
    a file that is no saved motion, that ends before or begins after that time, and for a motion of
    another arm.
    """
    times, x, u = _motion(Path(path))
    layout = model.layout
    for what, has, needs in (
        ("states", x.shape[1], len(layout.x)),
        ("inputs", u.shape[1], len(layout.u)),
    ):
        if has != needs:
            raise InputError(
                f"{path}: has {has} {what} and the arm of this scene {needs}: give a motion of "
                "the same scene"
            )
    if at is not None and not times[0] - SLACK <= at <= times[-1] + SLACK:
        raise InputError(f"{path}: has the times {times[0]:g} to {times[-1]:g} s, none at {at:g} s")
    k = len(times) - 1 if at is None else int(np.searchsorted(times, at + SLACK)) - 1
    if not (np.all(np.isfinite(x[k])) and np.all(np.isfinite(u[k]))):
        raise InputError(f"{path}: the state at {times[k]:g} s has values that are not finite")
    return x[k], u[k]


def _motion(path: Path) -> tuple[Array, Array, Array]:
    """Times (M), states (M×nx) and inputs (M×k)."""
    if path.suffix == ".csv":
        fields = read_csv(path)
        return fields["time"], np.hstack([fields[n] for n in ("q", "dq", "z")]), fields["u"]
    with reading_npz(path, "simulation or plan", (1, 2)) as (_, arrays):
        if "samples_x" in arrays:
            times, nodes = arrays["samples_t"], arrays["t"]
            held = np.vstack([arrays["u_before"][None], arrays["u"]])
            until = np.searchsorted(nodes, times - SLACK)  # the input that led to the sample
            return times, arrays["samples_x"], held[np.minimum(until, len(held) - 1)]
        x = np.hstack([arrays[name] for name in ("q", "dq", "z")])
        return arrays["time"], x, arrays["u"]
