"""What an arm may do at rest: limits of its scene as bounds of pressures and strains, and rows.

Torque and stroke bound the pressures too, for at rest each unit's pressure is a multiple of its
torque, and mostly of its piston's travel. Where the arm acts back on the drive or water cavitates,
the stroke makes rows.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from softmpc.errors import InputError
from softmpc.model.drive_effects import Cavitation, ChamberCoupling, EndStops, find
from softmpc.model.model import Model

__all__ = ["RestLimits", "beyond_limits", "limit_rows", "piston_travel", "rest_limits",
           "torques_at_rest"]  # fmt: skip


@dataclass(frozen=True)
class RestLimits:
    """Bounds of unit pressures (Pa, m) and of strains (SI, n); `held` units are at one pressure."""

    low: np.ndarray
    high: np.ndarray
    q_low: np.ndarray
    q_high: np.ndarray
    held: dict[int, float]  # unit (1, 2, …) -> Pa

    @property
    def range(self) -> np.ndarray:
        """Width of the pressures' ranges (Pa, m)."""
        return np.asarray(self.high - self.low)


def rest_limits(model: Model, held: Mapping[int, float] | None = None) -> RestLimits:
    """Limits of the model's scene; `held` gives the pressure (Pa) of units that are stuck."""
    limits, m = model.scene.manipulator.limits, model.scene.manipulator.units
    low, high = np.full(m, limits.pressure_min), np.full(m, limits.pressure_max)
    if model.scene.actuation.input == "torque":
        gain = np.diag(model.drive.static_gain)
        ends = np.sort(np.outer([limits.torque_min, limits.torque_max], gain), axis=0)
        low, high = np.maximum(low, ends[0]), np.minimum(high, ends[1])
    if len(model.drive.X) and _travels_linearly(model):
        ends = np.outer(_stroke(model), 1 / np.diag(_travel_of_pressure(model)))
        low, high = np.maximum(low, ends[0]), np.minimum(high, ends[1])
    fixed = {int(unit): float(p) for unit, p in (held or {}).items()}
    for unit, pressure in fixed.items():
        _check_held(unit, pressure, low, high)
        low[unit - 1] = high[unit - 1] = pressure
    if np.any(low > high):
        j = int(np.argmax(low - high))
        raise InputError(
            f"unit {j + 1}: its limits of pressure, torque and stroke leave nothing between "
            f"{low[j] / 1e6:.6g} and {high[j] / 1e6:.6g} MPa; see [limits] in the scene file"
        )
    return RestLimits(low, high, *_strain_bounds(model), held=fixed)


def torques_at_rest(model: Model, pressures: Any) -> np.ndarray | None:
    """Motor torques (N·m) that hold unit pressures (Pa); None where pressures are the input.

    Without friction; Coulomb friction f holds the same pressures within ± f/(33)'s ratio of these.
    """
    if model.scene.actuation.input != "torque":
        return None
    return np.linalg.solve(model.drive.static_gain, np.asarray(pressures, float))


def limit_rows(model: Model, q: ca.SX, p: ca.SX) -> tuple[ca.SX, np.ndarray, np.ndarray]:
    """Rows that are no bounds, scaled, between low and high: curvature, and stroke of (q, p)."""
    limits, rows = model.scene.manipulator.limits, []
    low: list[float] = []
    high: list[float] = []
    if limits.curvature_max < LIMITLESS:
        for bends in _bends(model):
            rows.append(ca.sumsqr(q[bends]) / limits.curvature_max**2)
            low.append(-1.0)
            high.append(1.0)
    if len(model.drive.X) and not _travels_linearly(model):
        shortest, longest = np.array(_stroke(model)) / limits.stroke_max
        z = ca.mtimes(ca.DM(model.drive.at_rest(np.linalg.inv(model.drive.static_gain))), p)
        travel = model.piston_places(z, q) / limits.stroke_max
        rows.append(travel)
        low += [shortest] * travel.numel()
        high += [longest] * travel.numel()
    return ca.vertcat(*rows) if rows else ca.SX(0, 1), np.array(low), np.array(high)


def row_names(model: Model) -> list[str]:
    """Names of the rows of `limit_rows`."""
    names: list[str] = []
    if model.scene.manipulator.limits.curvature_max < LIMITLESS:
        names += [f"curvature of segment {k}" for k in range(1, len(_bends(model)) + 1)]
    if len(model.drive.X) and not _travels_linearly(model):
        names += [f"stroke of unit {j}" for j in range(1, model.scene.manipulator.units + 1)]
    return names


def piston_travel(model: Model, q: Any, pressures: Any) -> np.ndarray | None:
    """Places of the pistons at rest (m), where the drive has pistons."""
    if not len(model.drive.X):
        return None
    u = torques_at_rest(model, pressures)
    return np.asarray(model.piston_places(model.drive.at_rest(u), q)).ravel()


def beyond_limits(model: Model, q: np.ndarray, pressures: np.ndarray) -> list[str]:
    """What of a posture (strains n, pressures m in Pa) the limits do not allow, a line each."""
    limits = model.scene.manipulator.limits
    slack = 1e-3 * limits.pressure_max
    said = [
        f"pressure of unit {j} is {p / 1e6:.4g} MPa, outside its limits"
        for j, p in enumerate(pressures, 1)
        if not limits.pressure_min - slack <= p <= limits.pressure_max + slack
    ]
    travel = piston_travel(model, q, pressures)
    if travel is not None:
        shortest, longest = _stroke(model)
        if travel.max() > longest or travel.min() < shortest:
            worst = float(travel[np.argmax(np.abs(travel))])
            said.append(f"a piston travels {worst * 1e3:.4g} mm, beyond its stroke")
    said += [
        f"{name} = {value:.4g}, outside the limits of stretch, {limits.stretch_min:g} to "
        f"{limits.stretch_max:g}"
        for name, value in zip(model.layout.q.names, q, strict=True)
        if name.startswith("epsilon") and not limits.stretch_min <= value <= limits.stretch_max
    ]
    said += [
        f"curvature of segment {k} is {np.linalg.norm(q[bends]):.4g} 1/m, more than its limit"
        for k, bends in enumerate(_bends(model), 1)
        if float(np.linalg.norm(q[bends])) > limits.curvature_max
    ]
    return said


LIMITLESS = 1e4  # 1/m, the default of `Limits.curvature_max`


def _travels_linearly(model: Model) -> bool:
    """Whether a piston's travel at rest is a multiple of its unit's pressure."""
    effects = model.scene.effects
    return find(effects, ChamberCoupling) is None and find(effects, Cavitation) is None


def _stroke(model: Model) -> tuple[float, float]:
    """Ends of the pistons' travel (m), from where they are with the arm straight."""
    most, stops = model.scene.manipulator.limits.stroke_max, find(model.scene.effects, EndStops)
    return (-stops.start, most - stops.start) if stops else (-most, most)


def _travel_of_pressure(model: Model) -> np.ndarray:
    """Piston travel (m) over unit pressure at rest."""
    u = np.linalg.inv(model.drive.static_gain)
    return np.asarray(model.drive.X @ model.drive.at_rest(u))


def _check_held(unit: int, pressure: float, low: np.ndarray, high: np.ndarray) -> None:
    if not 1 <= unit <= len(low):
        raise InputError(f"held unit {unit}: this arm has the units 1 to {len(low)}")
    a, b = low[unit - 1], high[unit - 1]
    if not a - 1e-9 * abs(b) <= pressure <= b + 1e-9 * abs(b):
        raise InputError(
            f"held unit {unit} = {pressure / 1e6:.6g} MPa: must be between {a / 1e6:.6g} and "
            f"{b / 1e6:.6g} MPa, see [limits] in the scene file"
        )


def _strain_bounds(model: Model) -> tuple[np.ndarray, np.ndarray]:
    limits, names = model.scene.manipulator.limits, model.layout.q.names
    stretch = np.array([name.startswith("epsilon") for name in names])
    return (
        np.where(stretch, limits.stretch_min, -np.inf),
        np.where(stretch, limits.stretch_max, np.inf),
    )


def _bends(model: Model) -> list[list[int]]:
    """Places of (κx, κy) of each segment among the strains."""
    scene = model.scene
    bends = [i for i, name in enumerate(scene.strains) if name in ("kappa_x", "kappa_y")]
    count = len(scene.strains)
    return [[k + i for i in bends] for k in range(0, model.strains, count) if bends]
