"""A tracking problem in files that acados can be given: functions, matrices, recorded states.

The arm is given as its residual, our own Jacobian of it, and a linear drive. acados carries the
drive by the Runge-Kutta method that it uses for the arm; ours is exact. So that both solve the same
problem the drive is replaced by one that Radau IIA of two stages carries from node to node exactly
as ours is: each pole λ by the μ with R(hμ) = exp(hλ), R the method's stability function, and poles
that have faded away by the zero of R. Only pressures within an interval stay a little different.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from softmpc.control.discretise import held_input
from softmpc.control.transcription import Transcription
from softmpc.errors import InputError

__all__ = ["radau_drive", "write_task"]

FADED = 1e-11  # exp(hλ) below which a pole is gone after an interval
KNOWN = {"tip", "torque", "torque rate", "strain rate"}

Array = np.ndarray


def radau_drive(A: Array, B: Array, step: float) -> tuple[Array, Array]:
    """Ã, B̃ of a drive whose steps by Radau IIA of two stages are the exact ones of A, B."""
    poles, vectors = np.linalg.eig(A)
    if np.abs(poles.imag).max() > 1e-9 * np.abs(poles).max():
        raise InputError("the drive has complex poles: this way to acados is for real ones")
    kept = np.exp(step * poles.real)
    # R(z) = (1 + z/3)/(1 - 2z/3 + z²/6) = e:  e/6 z² - (2e + 1)/3 z + e - 1 = 0, the root near 0
    a, b, c = kept / 6, -(2 * kept + 1) / 3, kept - 1
    new = np.where(kept < FADED, -3.0, 2 * c / (-b + np.sqrt(b * b - 4 * a * c)))
    changed = np.real(vectors @ np.diag(new / step) @ np.linalg.inv(vectors))
    return changed, changed @ np.linalg.solve(A, B)


def write_task(t: Transcription, folder: Path) -> None:
    """The files of a problem whose limits are torques and soft pressures."""
    model, ocp = t.model, t.ocp
    limits = {limit.name: limit for limit in ocp.limits}
    costs = {cost.name: cost.deviation for cost in ocp.costs}
    if set(limits) != {"torque", "pressure"} or set(costs) != KNOWN or model.drive.D.any():
        raise InputError("this way to acados knows costs and limits of the default problem alone")
    for name in ("residual", "residual_jacobian", "tip"):
        getattr(model, name).save(str(folder / f"{name}.casadi"))
    drive, layout = model.drive, model.layout
    A, B = radau_drive(drive.A, drive.B, ocp.step)
    phi, gamma = held_input(drive.A, drive.B, ocp.step)
    p, x, u = layout.p.scale, t.x_scale, layout.u.scale
    z = x[2 * t.n :]
    soft = limits["pressure"].soft
    assert soft is not None
    arrays: dict[str, Any] = {
        "N": t.N, "step": ocp.step, "n": t.n,
        "x_scale": x, "u_scale": u, "p_scale": p, "r_scale": layout.r.scale,
        "A": A * z / z[:, None], "B": B * u / z[:, None], "C": drive.C * z / p[:, None],
        "p_by_z": drive.C @ phi * z / p[:, None], "p_by_u": drive.C @ gamma * u / p[:, None],
        "torque": [limits["torque"].low, limits["torque"].high],
        "pressure": [limits["pressure"].low, limits["pressure"].high], "soft": soft,
        "price": t.objective.price[-1], **{f"by {name}": value for name, value in costs.items()},
    }  # fmt: skip
    np.savez(folder / "problem.npz", **arrays)
