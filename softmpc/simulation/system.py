"""What an implicit method solves at a stage: the arm's residual, with the drive's where needed.

The unknowns y of a stage are the highest derivatives alone, so M is never inverted:

    order 2   y = ddq            rows  r(q, dq, y, P)
    order 1   y = dq             rows  r(q, y, 0, P)         (damped, without inertia)

A linear drive that the arm does not act on is known in closed form and enters as pressures P over
time. Any other drive is solved with the arm: y gets dz/dt, rows get dz/dt - f(z, u, q, dq).

A method whose stages are q_i = q + c_i h dq + h² Σ (A²)_ij y_j (and dq_i, z_i = … + h Σ A_ij y_j)
needs three blocks for its Newton matrix: ∂rows/∂y, and ∂rows/∂ of the first and second integral
of y. Rows and unknowns are scaled; arguments are in SI.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from softmpc.errors import BuildError
from softmpc.model.model import Model
from softmpc.simulation.drive_motion import DriveLaw, DriveMotion
from softmpc.simulation.integrator import Interval

__all__ = ["System", "require_damping"]

WORST_MODES = 1e8  # condition of the drive's eigenvectors up to which closed form is trusted
PASSING = 0.2  # share of its full effect that an error of the drive lasts long enough to have


class System:
    """The equations of one model as a stage of an implicit method sees them.

    Raises `BuildError` where strains have neither mass nor damping.
    """

    def __init__(self, model: Model) -> None:
        self.model, self.order = model, model.order
        if self.order == 2:
            model.require_mass("a simulation")
        else:
            require_damping(model)
        layout, n = model.layout, model.strains
        self.n, self.h = n, len(layout.z)
        self.drive = DriveMotion(model.drive, layout.z.scale) if model.drive_is_linear else None
        if self.drive is not None and self.drive.condition > WORST_MODES:
            self.drive = None
        self.joint = self.drive is None
        self.k = self.h if self.joint else 0  # drive states that are solved with the arm
        self.y_scale = np.concatenate([layout.q.scale, layout.z.scale[: self.k]])
        self.row_scale = np.concatenate([layout.r.scale, layout.z.scale[: self.k]])

    @property
    def size(self) -> int:
        """Number of unknowns of a stage."""
        return self.n + self.k

    @property
    def inputs(self) -> int:
        """Length of w: pressures of the closed form, or inputs of a drive solved with the arm."""
        layout = self.model.layout
        return len(layout.u) if self.joint else len(layout.p)

    # --- the input over an interval --------------------------------------------------------------

    @property
    def coefficients(self) -> int:
        """How many numbers say how w changes over an interval."""
        return 2 * self.inputs if self.drive is None else self.drive.coefficients

    def input(self, coefficients: Any, t: Any) -> Any:
        """w at a time from the start of the interval: linear, or the drive's closed form; MX."""
        if self.drive is not None:
            return self.drive.pressure(coefficients, t)
        return coefficients[: self.inputs] + t * coefficients[self.inputs :]

    def law(self, given: Interval) -> DriveLaw:
        """The drive's motion over an interval, where closed form holds."""
        if self.drive is None:
            raise BuildError("this drive is solved with the arm and has no closed form")
        return self.drive.law(given.z, given.u0, given.u_slope)

    def input_law(self, given: Interval) -> tuple[np.ndarray, np.ndarray]:
        """w at the start of an interval, and the coefficients of `input`."""
        if self.drive is None:
            return given.u0, np.concatenate([given.u0, given.u_slope])
        w = self.drive.pressures(given.z, given.u0)
        return w, self.drive.pressure_coefficients(self.law(given))

    # --- rows and their derivatives ---------------------------------------------------------------

    @cached_property
    def levers(self) -> np.ndarray:
        """How far (m) a unit of each unknown's integral moves the tip at most, about.

        A curvature turns all that is beyond, a stretch shifts it. A drive state of its typical
        size moves the tip by about the arm's length, but its errors die out (within 15 ms for the
        paper's drive) before the arm has gone much of that way: `PASSING`. Less would do but for
        vapour cavities, where a wrong pressure is a wrong volume, and that stays.
        """
        scene = self.model.scene
        each = [s.length / scene.segments for s in scene.manipulator.sections]
        rests = np.repeat(each, scene.segments)
        beyond = np.cumsum(rests[::-1])[::-1]
        kinds = [1.0 if name == "epsilon" else 0.0 for name in scene.strains]
        strains = [
            rest * (kind or far) for rest, far in zip(rests, beyond, strict=True) for kind in kinds
        ]
        drive = PASSING * scene.manipulator.length / self.model.layout.z.scale[: self.k]
        return np.concatenate([strains, drive])

    def _arguments(self) -> dict[str, Any]:
        sizes = {"q": self.n, "dq": self.n, "z": self.k, "y": self.size, "w": self.inputs}
        return {name: ca.MX.sym(name, size) for name, size in sizes.items()}

    def _motion(self, q: Any, dq: Any, z: Any, y: Any, w: Any) -> tuple[Any, Any, Any, Any]:
        """(q, dq, ddq, P) of a stage."""
        pressures = self.model.pressures(z, w) if self.joint else w
        if self.order == 2:
            return q, dq, y[: self.n], pressures
        return q, y[: self.n], ca.DM.zeros(self.n), pressures

    @cached_property
    def rows(self) -> ca.Function:
        """(q, dq, z, y, w) -> scaled rows, zero at a stage."""
        a = self._arguments()
        q, dq, ddq, p = self._motion(**a)
        rows = self.model.residual(q, dq, ddq, p)
        if self.joint:
            rows = ca.vertcat(rows, a["y"][self.n :] - self.model.drive_rate(a["z"], a["w"], q, dq))
        return ca.Function("rows", [*a.values()], [rows / self.row_scale], [*a], ["rows"])

    @cached_property
    def blocks(self) -> ca.Function:
        """(q, dq, z, y, w) -> derivatives of the rows by y, by its first and second integral."""
        a = self._arguments()
        q, dq, ddq, p = self._motion(**a)
        by_q, by_dq, by_ddq, by_p = self.model.residual_jacobian(q, dq, ddq, p)
        by = [by_ddq, by_dq, by_q] if self.order == 2 else [by_dq, by_q, None]
        if self.joint:
            by = self._with_drive(by, by_p, self.model.drive_jacobian(a["z"], a["w"], q, dq))
        by = [ca.MX(self.size, self.size) if b is None else b for b in by]
        scale = ca.DM(np.outer(1 / self.row_scale, self.y_scale))
        scaled = [b * scale for b in by]
        names = ["by_y", "by_first", "by_second"]
        return ca.Function("blocks", [*a.values()], scaled, [*a], names)

    def _with_drive(self, by: list[Any], by_p: Any, slopes: Any) -> list[Any]:
        by_z, f_q, f_dq = slopes
        to_z = by_p @ ca.sparsify(ca.DM(self.model.drive.C))
        eye, none = ca.DM.eye(self.k), ca.DM(self.n, self.k)
        if self.order == 2:
            return [
                ca.blockcat([[by[0], none], [ca.DM(self.k, self.n), eye]]),
                ca.blockcat([[by[1], to_z], [-f_dq, -by_z]]),
                ca.blockcat([[by[2], none], [-f_q, ca.DM(self.k, self.k)]]),
            ]
        return [
            ca.blockcat([[by[0], none], [-f_dq, eye]]),
            ca.blockcat([[by[1], to_z], [-f_q, -by_z]]),
            None,
        ]

    def start(self, q: np.ndarray, dq: np.ndarray, z: np.ndarray, w: np.ndarray) -> np.ndarray:
        """y (size) in SI that solves the rows at a state: they are linear in it."""
        guess = np.zeros(self.size)
        for _ in range(2):  # the second round takes the rounding out
            rows = np.asarray(self.rows(q, dq, z[: self.k], guess, w)).ravel()
            by_y = np.asarray(self.blocks(q, dq, z[: self.k], guess, w)[0])
            guess = guess - self.y_scale * np.linalg.solve(by_y, rows)
        return guess


def require_damping(model: Model) -> None:
    """Raise `BuildError` where a scene without inertia has a strain without damping."""
    if model.order == 0:
        raise BuildError(
            "this method needs inertia or damping, this scene has neither: add an effect, or take "
            "softmpc.simulation.following.Following"
        )
    scale = model.layout.dq.scale
    D = np.asarray(model.residual_jacobian(np.zeros(model.strains), 0, 0, 0)[1])
    if np.linalg.matrix_rank(D * np.outer(scale, scale)) < len(D):
        raise BuildError(
            "without inertia a simulation needs damping in every strain: add the effect "
            "'material_damping', or leave all damping out so that the arm follows at once"
        )
