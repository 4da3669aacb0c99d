"""A short name of a controller's problem: logs and generated code of the same one have the same."""

from __future__ import annotations

import hashlib
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from softmpc.control.transcription import Transcription

__all__ = ["problem_hash"]

DIGITS = 16


def problem_hash(t: Transcription, blocks: Any = None) -> str:
    """16 hexadecimal digits of all that the problem is made from; `blocks` are those of the solver.

    Of arrays, which were computed, only the place counts: their last bits differ from machine to
    machine, and what they were computed from is here.
    """
    ocp = t.ocp
    about = (
        ocp.model.scene, ocp.intervals, ocp.step, ocp.grid, ocp.costs, ocp.limits, ocp.disturbance,
        len(t.tableau.c), None if blocks is None else [int(block) for block in blocks],
    )  # fmt: skip
    return hashlib.sha256(_text(about).encode()).hexdigest()[:DIGITS]


def _text(value: Any) -> str:
    """Words for a value, the same on every machine."""
    if isinstance(value, np.ndarray):
        return "array"
    if is_dataclass(value) and not isinstance(value, type):
        parts = (f"{one.name}={_text(getattr(value, one.name))}" for one in fields(value))
        return f"{type(value).__name__}({', '.join(parts)})"
    if isinstance(value, tuple | list):
        return f"[{', '.join(_text(one) for one in value)}]"
    if isinstance(value, float | np.floating):
        return repr(float(value))
    if value is None or isinstance(value, bool | int | str):
        return repr(value)
    return type(value).__name__
