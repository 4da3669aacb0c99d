"""What a model says about itself: a description people can read, and strains without mass."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from softmpc.errors import BuildError

if TYPE_CHECKING:
    from softmpc.model.model import Model

__all__ = ["COUNTED", "describe", "massless_strains", "require_mass"]

# The functions whose instructions are counted.
COUNTED = (
    "residual",
    "residual_jacobian",
    "M",
    "C",
    "N",
    "tau",
    "equations",
    "balance",
    "stiffness",
    "frames",
)


def describe(model: Model) -> str:
    """A few lines: what the scene has, its states and inputs, the size of its functions."""
    scene, layout = model.scene, model.layout
    effects = ", ".join(e.name for e in scene.effects) or "none"
    states = len(layout.x) if model.order == 2 else model.strains + len(layout.z)
    counts = ", ".join(f"{k} {v}" for k, v in model.instructions().items())
    return (
        f"Model of {scene.manipulator.name}: {len(scene.manipulator.sections)} sections × "
        f"{scene.segments} segments, {scene.formulation.name}, {scene.formulation.mass.name}, "
        f"{scene.kinematics.name}\n"
        f"  states   {states}: {model.strains} strains ({', '.join(scene.strains)})"
        f"{', their rates' if model.order == 2 else ''}"
        f"{f', {len(layout.z.names)} of the drive' if layout.z.names else ''}\n"
        f"  inputs   {len(layout.u.names)} × {scene.actuation.input} ({scene.actuation.name})\n"
        f"  effects  {effects}\n"
        f"  instructions  {counts}"
        + (f"\n  without mass  {', '.join(model.massless)}" if model.massless else "")
    )


def massless_strains(model: Model) -> tuple[str, ...]:
    """Names of the strains in whose directions M is singular, straight or bent."""
    if not model.chain.dynamic:
        return ()
    scale = model.layout.q.scale
    generic = np.random.default_rng(1).uniform(-1, 1, model.strains) * scale
    empty = [_null_space(np.asarray(model.M(q)) * np.outer(scale, scale)) for q in (0, generic)]
    heavy = np.abs(np.hstack(empty)).max(axis=1, initial=0.0) > 0.1
    return tuple(n for n, h in zip(model.layout.q.names, heavy, strict=True) if h)


def require_mass(model: Model, what: str) -> None:
    """Raise `BuildError` if `what` cannot run because M is singular or absent."""
    if not model.chain.dynamic:
        raise BuildError(f"{what} needs the effect 'inertia': this scene is quasi-static")
    if model.massless:
        raise BuildError(
            f"{what} needs an invertible M, but these strains have no mass: "
            f"{', '.join(model.massless)}; add the effect 'rotary_inertia', take Gauss mass "
            "instead of lumped, or leave the strains out"
        )


def _null_space(matrix: np.ndarray) -> np.ndarray:
    _, values, vectors = np.linalg.svd(matrix)
    return vectors[values < 1e-11 * values.max()].T
