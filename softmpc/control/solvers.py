"""Solvers by name: one interface, see `softmpc.control.solver.Solver`."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from typing import Any

from softmpc.control.fatrop import Fatrop
from softmpc.control.ipopt import Ipopt
from softmpc.control.real_time import RealTime
from softmpc.control.solver import Solver
from softmpc.control.transcription import Transcription
from softmpc.errors import InputError, unknown_name

__all__ = ["CONDENSING", "SOLVERS", "make_solver"]

CONDENSING = ("real-time", "sqp")  # by dense quadratic programs; moves may be shared


def _real_time(
    transcription: Transcription, blocks: Sequence[int] | None = None, mode: str = "auto"
) -> RealTime:
    return RealTime(transcription, 1, blocks=blocks, mode=mode)


def _sqp(
    transcription: Transcription,
    tolerance: float = 1e-6,
    max_iterations: int = 50,
    blocks: Sequence[int] | None = None,
    mode: str = "auto",
) -> RealTime:
    if max_iterations < 2:
        raise InputError(
            f"max_iterations = {max_iterations}: must be 2 or more for 'sqp'; one iteration is "
            "the solver 'real-time'"
        )
    return RealTime(transcription, max_iterations, tolerance, blocks, mode)


SOLVERS: dict[str, Callable[..., Solver]] = {
    "real-time": _real_time,
    "sqp": _sqp,
    "ipopt": Ipopt,
    "fatrop": Fatrop,
}


def make_solver(name: str, transcription: Transcription, **options: Any) -> Solver:
    """A solver of one transcribed problem: "real-time", "sqp", "ipopt" or "fatrop".

    Options are `tolerance` and `max_iterations` (all but "real-time"), `blocks` and `mode`
    ("real-time" and "sqp"), `hessian` ("ipopt"). Raises `InputError` for a name or an option that
    does not exist and `BuildError` where a solver is not installed.
    """
    if name not in SOLVERS:
        raise InputError(unknown_name("solver", name, SOLVERS))
    allowed = [*inspect.signature(SOLVERS[name]).parameters][1:]
    for option in options:
        if option not in allowed:
            raise InputError(unknown_name(f"option of solver {name!r}", option, allowed))
    return SOLVERS[name](transcription, **options)
