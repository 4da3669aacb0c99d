"""What is still to pay after the horizon, near a state of rest: a Riccati terminal cost.

One interval of the transcription is linearised at rest. With the problem's own costs it makes a
linear-quadratic regulator over an endless horizon, whose cost-to-go ½ ξᵀPξ is what a finite horizon
leaves out. Costs of the change of input look back, so ξ = (x - rest, u_before - input at rest).

It holds where no limit is active and the arm is near its target: there the controller with it acts
as the regulator does, which is stable, however short its horizon is.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from softmpc.control.costs import RestAtEnd
from softmpc.control.ocp import Ocp
from softmpc.control.transcription import Transcription
from softmpc.errors import BuildError, InputError

__all__ = ["Regulator", "Terminal", "regulator", "terminal_cost"]

AT_REST = 1e-6  # scaled, by which a state may change in one step and still count as rest
STABLE = 1 - 1e-6  # spectral radius: what drifts is found only to half of the digits
RESIDUAL = 1e-7  # of the Riccati equation, relative
DROPPED = 1e-15  # relative to the largest: eigenvalues of P below it cost nothing

Array = np.ndarray


@dataclass(frozen=True)
class Regulator:
    """v = -K ξ for ξ⁺ = A ξ + B v and cost ½ Σ |C ξ + D v|²; ½ ξᵀPξ is what it costs from ξ."""

    A: Array
    B: Array
    C: Array
    D: Array
    P: Array
    K: Array

    @property
    def closed(self) -> Array:
        """ξ⁺ = (A - B K) ξ."""
        return np.asarray(self.A - self.B @ self.K)

    @property
    def radius(self) -> float:
        """Largest size of an eigenvalue of the closed loop: below 1, it is stable."""
        return float(np.abs(np.linalg.eigvals(self.closed)).max())

    @property
    def factor(self) -> Array:
        """L with LᵀL = P."""
        values, vectors = np.linalg.eigh(self.P)
        kept = values > DROPPED * values[-1]
        return np.asarray(np.sqrt(values[kept])[:, None] * vectors[:, kept].T)


@dataclass(frozen=True)
class Terminal:
    """The regulator at a state of rest, in scaled ξ = (x, u_before)."""

    ocp: Ocp
    x: Array  # at rest (nx), SI
    u: Array  # that holds it (k), SI
    regulator: Regulator

    @property
    def cost(self) -> RestAtEnd:
        """The cost to add to the problem; its references are "rest" and "rest input"."""
        return RestAtEnd(factor=self.regulator.factor)

    @property
    def problem(self) -> Ocp:
        """The problem with this cost at its end, instead of one that it may have had."""
        kept = tuple(cost for cost in self.ocp.costs if not isinstance(cost, RestAtEnd))
        return replace(self.ocp, costs=(*kept, self.cost))

    @property
    def given(self) -> dict[str, Array]:
        """References of the cost at every node, for a target that stays (N×nx and N×k)."""
        N = self.ocp.intervals
        return {"rest": np.tile(self.x, (N, 1)), "rest input": np.tile(self.u, (N, 1))}

    def input(self, x: Array, u_before: Array) -> Array:
        """What the regulator alone would do (k), SI, without any limit."""
        layout = self.ocp.model.layout
        off = ((x - self.x) / layout.x.scale, (u_before - self.u) / layout.u.scale)
        return np.asarray(self.u - layout.u.scale * (self.regulator.K @ np.concatenate(off)))


def terminal_cost(ocp: Ocp, x: Array, u: Array, stages: int = 2) -> Terminal:
    """The terminal cost of a problem for a target at rest in state x under input u (SI).

    Costs at the end and limits of the problem do not enter. Raises `InputError` where x is not at
    rest under u, `BuildError` where no input can stabilise it or the costs leave one free.
    """
    every = tuple(cost for cost in ocp.costs if not cost.at_end)
    if not every:
        raise BuildError("terminal_cost: all costs count at the end alone; add one of every step")
    t = Transcription(Ocp(ocp.model, 1, ocp.step, every, ()), stages)
    x, u = np.asarray(x, float).ravel(), np.asarray(u, float).ravel()
    _check_sizes(t, x, u)
    A, B = _linear_step(t, x / t.x_scale, u / t.u_scale)
    by_before, by_u, by_x = _slopes(t, x / t.x_scale, u / t.u_scale)
    k = len(u)
    wide_A = np.block([[A, np.zeros((t.nx, k))], [np.zeros((k, t.nx + k))]])
    wide_B = np.vstack([B, np.eye(k)])
    C = np.hstack([by_x @ A, by_before])
    return Terminal(ocp, x, u, regulator(wide_A, wide_B, C, by_u + by_x @ B))


def regulator(A: Array, B: Array, C: Array, D: Array) -> Regulator:
    """The linear-quadratic regulator over an endless horizon, see `Regulator`.

    Raises `BuildError` where there is none.
    """
    from scipy.linalg import solve_discrete_are

    R, Q, S = D.T @ D, C.T @ C, C.T @ D
    if np.linalg.matrix_rank(R, hermitian=True) < len(R):
        raise BuildError(
            "terminal cost: the costs leave some input free; add a cost of it, such as Torque() "
            "or TorqueRate()"
        )
    try:
        P = np.asarray(solve_discrete_are(A, B, Q, R, s=S))
    except (np.linalg.LinAlgError, ValueError) as error:
        raise BuildError(f"{_NOT_STABILISABLE} ({error})") from None
    H = R + B.T @ P @ B
    K = np.linalg.solve(H, B.T @ P @ A + S.T)
    found = Regulator(A, B, C, D, (P + P.T) / 2, K)
    off = np.abs(A.T @ P @ A - P + Q - K.T @ H @ K).max()
    if not (found.radius < STABLE and off <= RESIDUAL * max(np.abs(P).max(), 1.0)):
        raise BuildError(f"{_NOT_STABILISABLE} (spectral radius {found.radius:.6f})")
    return found


_NOT_STABILISABLE = (
    "terminal cost: no input stabilises this state of rest, or the costs do not see what drifts; "
    "choose another posture, or add costs such as StrainRate()"
)


def _linear_step(t: Transcription, x: Array, u: Array) -> tuple[Array, Array]:
    """∂x⁺/∂x and ∂x⁺/∂u of one interval at rest, scaled: the stage unknowns are eliminated."""
    defects, J = (np.asarray(part) for part in t.interval(x, u, np.zeros(t.na)))
    off = np.append(defects.ravel()[: t.na], defects.ravel()[t.na :] - x)
    most = float(np.abs(off).max())
    if not most <= AT_REST:
        raise InputError(
            f"terminal_cost: x is not at rest under u, one step changes it by {most:.2g} of its "
            "scale; take both from one equilibrium, such as `start_at(model, posture)`"
        )
    by_xu, by_a = J[:, : t.nx + t.nu], J[:, t.nx + t.nu :]
    solved = np.linalg.solve(by_a[: t.na], by_xu[: t.na])
    after = by_xu[t.na :] - by_a[t.na :] @ solved
    return after[:, : t.nx], after[:, t.nx :]


def _check_sizes(t: Transcription, x: Array, u: Array) -> None:
    if len(x) != t.nx or len(u) != t.nu or not np.all(np.isfinite(np.append(x, u))):
        raise InputError(
            f"terminal_cost: x and u have {len(x)} and {len(u)} numbers; this arm needs {t.nx} and "
            f"{t.nu}, all finite"
        )


def _slopes(t: Transcription, x: Array, u: Array) -> tuple[Array, ...]:
    """Slopes of the residuals of the costs in (u_before, u, x⁺) at rest, scaled."""
    symbols, value = t.objective.symbols, t.objective.residuals
    slopes = [ca.densify(ca.jacobian(value, symbol)) for symbol in symbols[:3]]
    function = ca.Function("slopes", symbols, slopes)
    # Residuals are differences from their references, which the slopes do not depend on.
    return tuple(np.asarray(J) for J in function(u, u, x, np.zeros(t.nr), 1.0))
