"""Direct transcription over the residual: an `Ocp` becomes a nonlinear program.

Each interval is one Radau IIA step in second-order form. Its stage accelerations a are unknowns,
the strains and rates at the stages follow from them linearly, and the residual at each stage is a
constraint, so M is never inverted. The hydraulics are linear: exact matrices carry them from node
to node and to the stages, outside the automatic differentiation.

    stage    r(q_s, dq_s, a_s, P_s) = 0
    node     q⁺ = q + h dq + h² Σ (bA)_j a_j,  dq⁺ = dq + h Σ b_j a_j,  z⁺ = Φ z + Γ u

Without inertia the unknowns are the rates at the stages, see `StepForm`.

Variables are scaled. Their order is u_0, a_0, x_1, u_1, a_1, x_2, …, slacks with the inputs; x_0,
the input before and the references are parameters. Small functions are mapped over the horizon,
and the Jacobian and the Gauss-Newton Hessian are put together from their nonzeros.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from softmpc.control.interval import Interval, Scales
from softmpc.control.objective import Objective
from softmpc.control.ocp import Ocp
from softmpc.control.stage import DISTURBANCE
from softmpc.control.step_form import StepForm
from softmpc.errors import BuildError, InputError
from softmpc.model.model import Model
from softmpc.simulation.tableau import Tableau, radau_iia

__all__ = ["NonlinearProgram", "Transcription", "require_linear_drive"]

References = Mapping[str, ArrayLike] | ArrayLike


@dataclass(frozen=True)
class NonlinearProgram:
    """min f(w, p) with low ≤ w ≤ high and low_g ≤ g(w, p) ≤ high_g, all scaled and named."""

    w: ca.MX
    p: ca.MX
    f: ca.MX
    g: ca.MX
    bounds: tuple[np.ndarray, np.ndarray]
    bounds_g: tuple[np.ndarray, np.ndarray]
    names: tuple[str, ...]
    names_g: tuple[str, ...]
    gauss_newton: dict[str, ca.Function]  # grad_f, jac_g and hess_lag, as `nlpsol` takes them


class Transcription:
    """The nonlinear program of an `Ocp`, and the way between its vectors and trajectories."""

    def __init__(self, ocp: Ocp, stages: int = 2) -> None:
        self.ocp = ocp
        self.model = ocp.model
        require_linear_drive(self.model)
        self.tableau: Tableau = radau_iia(stages)
        self.objective = Objective(ocp)
        layout = self.model.layout
        self.n, self.nx, self.inputs = len(layout.q), len(layout.x), len(layout.u)
        self.nu = len(self.objective.u_scale)  # inputs and slacks
        self.na = stages * self.n
        self.nw = self.nu + self.na + self.nx  # variables an interval
        self.N = ocp.intervals
        self.x_scale, self.u_scale = layout.x.scale, self.objective.u_scale
        self.a_scale = StepForm.scale(self.model, stages)
        self.w_scale = np.tile(np.concatenate([self.u_scale, self.a_scale, self.x_scale]), self.N)
        self.nr = sum(self.objective.references.values())  # references a node

    # --- vectors and trajectories -------------------------------------------------------------

    def references(self, given: References) -> np.ndarray:
        """References at the nodes as a matrix (N×nr), by name; an array alone is "tip" (N×3)."""
        named = given if isinstance(given, Mapping) else {"tip": given}
        missing = [name for name in self.objective.references if name not in named]
        if missing:
            raise InputError(
                f"references {', '.join(map(repr, missing))} are missing: this problem needs "
                f"{', '.join(map(repr, self.objective.references))} at each of its {self.N} nodes"
            )
        columns = [
            np.asarray(named[name], float).reshape(self.N, size)
            for name, size in self.objective.references.items()
        ]
        return np.hstack([np.zeros((self.N, 0)), *columns])

    def parameters(self, x: np.ndarray, u_before: np.ndarray, given: References) -> np.ndarray:
        """p from the state now, the input before and the references at the nodes."""
        before, references = self.decisions(u_before), self.references(given)
        return np.concatenate([x / self.x_scale, before, references.ravel()])

    @cached_property
    def disturbance_columns(self) -> slice:
        """Where the references hold the disturbance; an empty slice without one."""
        return self.columns_of(DISTURBANCE)

    def columns_of(self, reference: str) -> slice:
        """Where the references (N×nr) hold that one; an empty slice without it."""
        first = 0
        for name, size in self.objective.references.items():
            if name == reference:
                return slice(first, first + size)
            first += size
        return slice(0, 0)

    def decisions(self, u: np.ndarray) -> np.ndarray:
        """Scaled decisions of an interval (nu) from its input (SI, k): without slack."""
        slacks = np.zeros(self.nu - self.inputs)
        return np.concatenate([u / self.u_scale[: self.inputs], slacks])

    def split(self, w: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Inputs (N×k), stage accelerations (N×s·n) and states (N×nx) in SI."""
        rows = (np.asarray(w).ravel() * self.w_scale).reshape(self.N, self.nw)
        u, a, x = np.split(rows, [self.nu, self.nu + self.na], axis=1)
        return u[:, : self.inputs], a, x

    def resting(self, x: np.ndarray, u: np.ndarray) -> np.ndarray:
        """A first guess: the arm stays where it is, under inputs u (k, or N×k)."""
        still = np.zeros(self.na), x / self.x_scale
        inputs = np.broadcast_to(u, (self.N, self.inputs))
        return np.concatenate([part for one in inputs for part in (self.decisions(one), *still)])

    def shifted(self, vector: np.ndarray, width: int) -> np.ndarray:
        """A stage-wise vector one step later; what was last is repeated.

        On a grid with long intervals the input, the multipliers and the accelerations are those
        that hold a step later, and states lie on lines between the nodes.
        """
        if not self.ocp.grid:
            return np.concatenate([vector[width:], vector[-width:]])
        rows, nodes = vector.reshape(self.N, width), self.ocp.nodes
        starts = np.concatenate([[0.0], nodes[:-1]])
        later = np.searchsorted(nodes, starts + self.ocp.step, side="right")
        found = rows[np.minimum(later, self.N - 1)].copy()
        if width == self.nw:
            first = self.nu + self.na
            at = np.minimum(nodes + self.ocp.step, nodes[-1])
            for column in range(first, width):
                found[:, column] = np.interp(at, nodes, rows[:, column])
        return np.asarray(found.ravel())

    # --- the parts of the program -------------------------------------------------------------

    @cached_property
    def intervals(self) -> tuple[Interval, ...]:
        """The intervals (N); those of one length are one object."""
        scales = Scales(self.x_scale, self.u_scale, self.a_scale)
        kinds = {
            ratio: Interval(
                self.model, self.tableau, scales, ratio * self.ocp.step, self.ocp.disturbance
            )
            for ratio in set(self.ocp.ratios.tolist())
        }
        return tuple(kinds[ratio] for ratio in self.ocp.ratios.tolist())

    @property
    def interval(self) -> ca.Function:
        """The step of the first interval, see `Interval.function`."""
        return self.intervals[0].function

    @cached_property
    def program(self) -> NonlinearProgram:
        """The nonlinear program."""
        from softmpc.control.assembly import assemble

        return assemble(self)

    def variable_bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Bounds of the scaled variables of one interval, (u, a, x)."""
        free = np.full(self.na, np.inf)
        low, high = self.objective.bounds
        return (
            np.concatenate([low[: self.nu], -free, low[self.nu :]]),
            np.concatenate([high[: self.nu], free, high[self.nu :]]),
        )

    def row_bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Bounds of the constraints of one interval: defects are zero, limits as they say."""
        zero, rows = np.zeros(self.na + self.nx), self.objective.rows
        low, high = ([getattr(row, side) for row in rows] for side in ("low", "high"))
        return np.concatenate([zero, low]), np.concatenate([zero, high])

    def variable_names(self) -> list[str]:
        """Names of the variables of one interval."""
        layout = self.model.layout
        stages = range(1, len(self.tableau.c) + 1)
        kind = layout.ddq if self.model.order == 2 else layout.dq
        a = [f"{name} (stage {s})" for s in stages for name in kind.names]
        return [*self.objective.u_names, *a, *layout.x.names]

    def row_names(self) -> list[str]:
        """Names of the constraints of one interval."""
        layout = self.model.layout
        stages = range(1, len(self.tableau.c) + 1)
        residuals = [f"{name} (stage {s})" for s in stages for name in layout.r.names]
        nodes = [f"continuity of {name}" for name in layout.x.names]
        return [*residuals, *nodes, *(row.name for row in self.objective.rows)]


def require_linear_drive(model: Model) -> None:
    if not model.drive_is_linear:
        raise BuildError(
            f"this problem carries the drive {model.scene.actuation.name!r} exactly over each "
            "interval, so it needs a linear one that the arm does not act on: leave out "
            f"{', '.join(model.drive_nonlinear)} in the model of the controller; "
            "the plant may keep them"
        )
