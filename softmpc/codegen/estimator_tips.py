"""The places of the tips as C: one function of the scaled strains, with its slope."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from softmpc.codegen.model_functions import Wrapped, in_rows
from softmpc.errors import InputError
from softmpc.estimation.sensors import SectionTips, Sensor
from softmpc.model.model import Model

__all__ = ["tip_rows", "tips"]


def tip_rows(sensor: Sensor, model: Model) -> np.ndarray:
    """For each value of a sensor which coordinate of the tips it is; -1 where it is none.

    Raises `InputError` for a reading that is neither linear nor a tip.
    """
    reading = sensor.reading(model)
    if isinstance(sensor, SectionTips):
        return np.array(sensor.rows(model))
    if reading.of_strains is not None:
        raise InputError(
            f"sensor {sensor.name!r} cannot be written as C: its reading is not linear; "
            "take section_tips, or a sensor that is linear in the state"
        )
    return np.full(len(reading.names), -1)


def tips(model: Model) -> Wrapped:
    """Places of the tips of all sections (3S, m, base frame), and their slopes (3S×n)."""
    looped = model.frames.is_a("MXFunction")
    kind: Any = ca.MX if looped else ca.SX
    q, scale = kind.sym("q", model.strains), ca.DM(model.layout.q.scale)
    found = {
        "places": ca.vec(model.frames(q * scale)[0]),
        "slope": ca.mtimes(model.tip_jacobian(q * scale), ca.diag(scale)),
    }
    comment = "places of the tips of all sections (m, base frame), and their slopes in q"
    return Wrapped("tips", in_rows("casadi_tips", {"q": q}, found), comment)
