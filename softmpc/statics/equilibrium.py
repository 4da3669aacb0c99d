"""Forward statics: the posture at given pressures, by continuation from the straight arm.

The path r(q, s P) = (1 - s) r(0, 0) starts at the straight arm for s = 0, which the fictitious
forces on the right hold in equilibrium under any gravity and load, and ends at the posture for
s = 1. Following it keeps to the branch the arm takes; Newton from afar may find another one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from softmpc.errors import InputError
from softmpc.model.model import Model

__all__ = ["Equilibrium", "find_equilibrium", "pressures_from_torques", "refine_equilibrium"]

TOLERANCE = 1e-12  # of the scaled residual
SMALLEST_STEP = 1e-4
ITERATIONS = 12


@dataclass(frozen=True)
class Equilibrium:
    """A posture at rest, SI; `stable` if the tangent stiffness has only positive eigenvalues."""

    status: str  # "converged", "no convergence" or "outside the model's range"
    q: np.ndarray  # strains (n)
    pressures: np.ndarray  # Pa (m)
    tips: np.ndarray  # section tips, base first (S×3), m
    rotations: np.ndarray  # of the section tips (S×3×3)
    residual: float  # largest scaled residual
    smallest_stiffness: float  # eigenvalue of the tangent stiffness in scaled strains, J
    iterations: int

    @property
    def converged(self) -> bool:
        return self.status == "converged"

    @property
    def stable(self) -> bool:
        return self.converged and self.smallest_stiffness > 0


def pressures_from_torques(model: Model, torques: ArrayLike) -> np.ndarray:
    """Unit pressures (Pa) at rest under motor torques (N·m)."""
    if model.scene.actuation.input != "torque":
        raise InputError(
            "this scene's actuation takes pressures, not torques: give pressures, "
            "or set [actuation] kind = 'hydraulic' or 'static'"
        )
    u = _vector("torques", torques, model, "N·m")
    return np.asarray(model.drive.C @ model.drive_rest(u) + model.drive.D @ u)


def find_equilibrium(model: Model, pressures: ArrayLike) -> Equilibrium:
    """The posture at unit pressures in Pa (one a unit), on the branch of the straight arm."""
    p = _vector("pressures", pressures, model, "Pa")
    offset = np.asarray(model.balance(0, 0)).ravel()
    q, done, step, iterations = np.zeros(model.strains), 0.0, 0.5, 0
    while done < 1.0:
        target = min(1.0, done + step)
        guess = q + (target - done) * _slope(model, q, done * p, p, offset)
        solved, used = _newton(model, guess, target * p, (1 - target) * offset)
        iterations += used
        if solved is None or not _in_range(model, solved):
            step /= 2
            if step < SMALLEST_STEP:
                return _result(model, q, done * p, p, iterations)
            continue
        q, done, step = solved, target, step * 1.5
    return _result(model, q, p, p, iterations)


def refine_equilibrium(model: Model, pressures: ArrayLike, guess: ArrayLike) -> Equilibrium:
    """The posture at unit pressures near a known one: Newton from `guess` (n strains)."""
    p = _vector("pressures", pressures, model, "Pa")
    solved, used = _newton(model, np.asarray(guess, float), p, np.zeros(model.strains))
    if solved is None:
        return find_equilibrium(model, p)
    return _result(model, solved, p, p, used)


def _vector(name: str, values: ArrayLike, model: Model, unit: str) -> np.ndarray:
    array = np.asarray(values, dtype=float).ravel()
    count = model.scene.manipulator.units
    if array.shape != (count,):
        raise InputError(
            f"{len(array)} {name} given: this arm has {count} units, give one for each"
        )
    if not np.all(np.isfinite(array)):
        raise InputError(f"{name} = {array.tolist()} {unit}: all must be finite numbers")
    return array


def _slope(model: Model, q: Any, p: Any, dp: Any, offset: Any) -> np.ndarray:
    """dq/ds along the path."""
    K, by_p = (np.asarray(x) for x in model.stiffness(q, p))
    try:
        return -np.linalg.solve(K, by_p @ dp + offset)
    except np.linalg.LinAlgError:
        return np.zeros(model.strains)


def _newton(model: Model, q: np.ndarray, p: Any, held: Any) -> tuple[np.ndarray | None, int]:
    """Solve r(q, p) = held; None if it does not converge quickly."""
    scale, rows = model.layout.q.scale, model.layout.r.scale
    before = np.inf
    for iteration in range(1, ITERATIONS + 1):
        r = (np.asarray(model.balance(q, p)).ravel() - held) / rows
        size = np.abs(r).max()
        if not np.isfinite(size):
            return None, iteration
        if size < TOLERANCE or (size < 1e-9 and size >= before / 4):
            return q, iteration  # at rounding error, Newton no longer gains
        K = np.asarray(model.stiffness(q, p)[0]) * scale / rows[:, None]
        try:
            step = np.linalg.solve(K, -r)
        except np.linalg.LinAlgError:
            return None, iteration
        q = q + scale * step * min(1.0, 2.0 / max(np.abs(step).max(), 1e-300))
        before = size
    return None, ITERATIONS


def _in_range(model: Model, q: np.ndarray) -> bool:
    return bool(np.all(q[_stretches(model)] > -0.95))


def _result(model: Model, q: np.ndarray, reached: Any, p: Any, iterations: int) -> Equilibrium:
    tips, rotations = (np.asarray(x) for x in model.frames(q))
    r = np.abs(np.asarray(model.balance(q, p)).ravel() / model.layout.r.scale).max()
    scale = model.layout.q.scale
    K = np.asarray(model.stiffness(q, reached)[0]) * np.outer(scale, scale)
    status = "converged" if r < 1e-8 else "no convergence"
    if status != "converged" and np.any(q[_stretches(model)] < -0.8):
        status = "outside the model's range"
    return Equilibrium(
        status=status,
        q=q,
        pressures=np.asarray(p),
        tips=tips.T.copy(),
        rotations=np.stack(np.split(rotations, tips.shape[1], axis=1)),
        residual=float(r),
        smallest_stiffness=_smallest(K),
        iterations=iterations,
    )


def _smallest(K: np.ndarray) -> float:
    """Smallest real part of the eigenvalues; nan where numbers of the model overflow."""
    return float(np.linalg.eigvals(K).real.min()) if np.all(np.isfinite(K)) else float("nan")


def _stretches(model: Model) -> list[int]:
    return [i for i, name in enumerate(model.layout.q.names) if name.startswith("epsilon")]
