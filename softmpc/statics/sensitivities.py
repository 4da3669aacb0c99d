"""How a posture answers: to a force at the tip, and pressures and torques to a moved target."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from softmpc.model.effects import TipLoad
from softmpc.model.formulations import NewtonEuler
from softmpc.model.model import Model, build
from softmpc.statics.equilibrium import Equilibrium

__all__ = ["Sensitivities", "tip_compliance"]


@dataclass(frozen=True)
class Sensitivities:
    """Derivatives at a solution of the inverse statics, SI.

    `moves` names the ways to move the targets: "x", "y", "z" (m), and "turn_x", … (rad about the
    axes of the base frame), with "_" and the section for sections that are named. Of a target out
    of reach they are the derivatives of the nearest posture, and the columns are dependent then.
    """

    compliance: np.ndarray  # ∂(arm's tip)/∂(force at it) at these pressures (3×3), m/N
    moves: tuple[str, ...]  # k of them
    pressures: np.ndarray  # ∂(unit pressures)/∂(moves) (m×k), Pa/m or Pa/rad
    torques: np.ndarray | None  # likewise (m×k), N or N·m/rad; None where pressures are the input
    strains: np.ndarray  # ∂(strains)/∂(moves) (n×k)


def tip_compliance(model: Model, posture: Equilibrium) -> np.ndarray:
    """∂(tip)/∂(dead force at the tip), 3×3 in m/N, base frame, at fixed unit pressures."""
    K = np.asarray(model.stiffness(posture.q, posture.pressures)[0])
    J = np.asarray(model.tip_jacobian(posture.q))[-3:]
    return np.asarray(J @ np.linalg.solve(K, _of_force(model, posture, J)))


def _of_force(model: Model, posture: Equilibrium, J: np.ndarray) -> np.ndarray:
    """∂τ/∂(force at the tip) (n×3)."""
    if not isinstance(model.scene.formulation, NewtonEuler):
        return J.T
    # Not Jᵀ where only a part of the wrench is handed on; but τ is affine in the load.
    none, *units = _loaded(model)
    q, p = posture.q, posture.pressures
    columns = [np.asarray(none.balance(q, p) - unit.balance(q, p)).ravel() for unit in units]
    return np.stack(columns, axis=1)


@lru_cache(maxsize=4)
def _loaded(model: Model) -> list[Model]:
    """The model without a force at the tip, and with one newton along x, y, z."""
    scene = model.scene
    load = scene.effect(TipLoad) or TipLoad()
    rest = tuple(e for e in scene.effects if not isinstance(e, TipLoad))
    forces = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    return [build(scene.with_(effects=(*rest, replace(load, force=force)))) for force in forces]
