"""Least squares with bounds, by IPOPT with the Gauss-Newton Hessian.

Residuals come from Python, so CasADi gets them as callbacks: the cost, its gradient, and JᵀJ in
place of the second derivatives. A place where they cannot be computed has the cost NaN, from which
IPOPT's line search comes back.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from softmpc.errors import SoftmpcError
from softmpc.interrupts import InterruptLater

__all__ = ["Fit", "minimise"]

Residuals = Callable[[np.ndarray], np.ndarray]
SHRINK = 1e-9  # of the largest entry of JᵀJ, added to all its diagonal
AT_BOUND = 0.01  # standard errors from a bound: no more than the search resolves


@dataclass(frozen=True)
class Fit:
    """Where the search ended: x (P), its cost ½ Σ r², and how."""

    status: str  # "converged", "interrupted" or "no convergence: …"
    x: np.ndarray
    cost: float
    iterations: int

    @property
    def converged(self) -> bool:
        return self.status == "converged"


def minimise(
    residuals: Residuals,
    jacobian: Residuals,
    start: np.ndarray,
    bounds: tuple[np.ndarray, np.ndarray],
    tolerance: float = 1e-3,
    most_iterations: int = 60,
) -> Fit:
    """The x within bounds (P each) with the least ½ Σ residuals(x)², from `start`.

    Both functions may raise `SoftmpcError` where they cannot be computed; at the start that is
    passed on. `tolerance` is about the distance from the best x in standard errors, in which the
    search is scaled; an x no further from a bound than it resolves is put there. After Ctrl-C the
    best x so far is returned.
    """
    first = 0.5 * float(np.sum(residuals(start) ** 2))
    size = _errors(jacobian(start))
    search = _Search(residuals, jacobian, size, (first, start))
    with InterruptLater() as interrupt:
        search.interrupt = interrupt
        solver = search.solver(tolerance, most_iterations)
        solved = solver(x0=start / size, lbx=bounds[0] / size, ubx=bounds[1] / size)
    if search.error is not None:
        raise search.error
    stats = solver.stats()
    count = int(stats["iter_count"])
    if interrupt.asked:
        return Fit("interrupted", search.best[1], search.best[0], count)
    if not stats["success"]:
        status = f"no convergence: {stats['return_status']}"
        return Fit(status, search.best[1], search.best[0], count)
    x = np.clip(size * np.asarray(solved["x"]).ravel(), *bounds)
    x = _at_bounds(residuals, jacobian, x, bounds)
    return Fit("converged", x, search.cost(x), count)


def _at_bounds(
    residuals: Residuals, jacobian: Residuals, x: np.ndarray, bounds: tuple[np.ndarray, np.ndarray]
) -> np.ndarray:
    """What is at a bound put there, and the others a last Gauss-Newton step after it."""
    near = AT_BOUND * _errors(jacobian(x))
    low, high = x - bounds[0] < near, bounds[1] - x < near
    put = np.where(low, bounds[0], np.where(high, bounds[1], x))
    free = ~(low | high)
    if np.array_equal(put, x) or not free.any():
        return put
    step = np.linalg.lstsq(jacobian(put)[:, free], -residuals(put), rcond=None)[0]
    moved = put.copy()
    moved[free] = np.clip(put[free] + step, bounds[0][free], bounds[1][free])
    return moved if np.sum(residuals(moved) ** 2) <= np.sum(residuals(put) ** 2) else put


def _errors(J: np.ndarray) -> np.ndarray:
    """Standard error of each x if the others were known (P), at most 1."""
    return 1 / np.maximum(np.linalg.norm(J, axis=0), 1.0)


class _Search:
    """The three callbacks of one search, of y = x / size, and the best x so far."""

    def __init__(
        self,
        residuals: Residuals,
        jacobian: Residuals,
        size: np.ndarray,
        first: tuple[float, np.ndarray],
    ) -> None:
        self.residuals, self.jacobian, self.size, self.best = residuals, jacobian, size, first
        self.error: BaseException | None = None
        self.interrupt: InterruptLater | None = None

    def solver(self, tolerance: float, most_iterations: int) -> ca.Function:
        """The solver; `no_nlp_grad`, for CasADi would differentiate the callbacks."""
        n = len(self.size)
        upper = ca.Sparsity.upper(n)
        one = ca.Sparsity.dense(1, 1)
        column = ca.Sparsity.dense(n, 1)
        none = ca.Sparsity(0, 0)
        cost = _Call("cost", [column, none], [one], lambda y: [self.cost(y * self.size)], self)
        slope = _Call("slope", [column, none], [one, column], self._gradient, self)
        curve = _Call("curve", [column, none, one, none], [upper], self._hessian, self)
        self._kept = (cost, slope, curve)  # CasADi does not keep them
        x = ca.MX.sym("x", n)
        ipopt = {
            "print_level": 0,
            "sb": "yes",
            "tol": tolerance,
            "max_iter": most_iterations,
            "mu_init": 1e-6,  # few bounds matter, and starts are good
            "bound_relax_factor": 0.0,  # no step outside where the scene may not go
            "nlp_scaling_method": "none",  # scaled already
        }
        options: dict[str, Any] = {
            "grad_f": slope,
            "hess_lag": curve,
            "no_nlp_grad": True,
            "ipopt": ipopt,
        }
        options |= {"print_time": False, "error_on_fail": False, "ipopt": ipopt}
        options["show_eval_warnings"] = False  # NaN is meant
        problem: dict[str, Any] = {"x": x, "f": cost(x, ca.DM(0, 0))}
        return ca.nlpsol("calibrate", "ipopt", problem, options)

    def cost(self, x: np.ndarray) -> float:
        """½ Σ r², NaN where it cannot be computed."""
        try:
            value = 0.5 * float(np.sum(self.residuals(x) ** 2))
        except SoftmpcError:
            return float("nan")
        if value < self.best[0]:
            self.best = (value, x.copy())
        return value

    def _gradient(self, y: np.ndarray) -> list[Any]:
        x = y * self.size
        try:
            r, J = self.residuals(x), self.jacobian(x) * self.size
        except SoftmpcError:
            return [float("nan"), ca.DM(0 * self.size + np.nan)]
        return [0.5 * float(r @ r), ca.DM(J.T @ r)]

    def _hessian(self, y: np.ndarray, factor: float) -> list[Any]:
        try:
            J = self.jacobian(y * self.size) * self.size
        except SoftmpcError:
            return [ca.triu(ca.DM(np.outer(y, y) + np.nan))]
        H = J.T @ J
        H += SHRINK * max(H.max(), 1e-30) * np.eye(len(y))
        return [ca.triu(ca.DM(factor * H))]

    def interrupted(self) -> None:
        """Ctrl-C came while the arm moved."""
        if self.interrupt is not None:
            self.interrupt.ask()

    @property
    def over(self) -> bool:
        """Whether the search is to end: NaN everywhere makes IPOPT give up."""
        return self.error is not None or bool(self.interrupt and self.interrupt.asked)


class _Call(ca.Callback):
    """A Python function of x, and of the factor of the cost where there is one."""

    def __init__(
        self,
        name: str,
        takes: list[ca.Sparsity],
        gives: list[ca.Sparsity],
        function: Callable[..., list[Any]],
        search: _Search,
    ) -> None:
        super().__init__()
        self.takes, self.gives, self.function, self.search = takes, gives, function, search
        self.construct(name, {})

    def get_n_in(self) -> int:
        return len(self.takes)

    def get_n_out(self) -> int:
        return len(self.gives)

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        return self.takes[i]

    def get_sparsity_out(self, i: int) -> ca.Sparsity:
        return self.gives[i]

    def eval(self, arguments: Any) -> list[Any]:
        given: list[Any] = [np.asarray(arguments[0]).ravel()]
        given += [float(a) for a in arguments[2:3]]
        if not self.search.over:
            try:
                return self.function(*given)
            except KeyboardInterrupt:
                self.search.interrupted()
            except BaseException as error:  # CasADi would lose it
                self.search.error = error
        return [ca.DM(s, [float("nan")] * s.nnz()) for s in self.gives]
