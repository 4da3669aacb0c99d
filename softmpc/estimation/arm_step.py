"""One implicit step of the arm and its slopes, from one small CasADi function.

Two stages of Radau IIA in second-order form. The function gives the equations of the stages and
their slopes; LAPACK solves them, some five times faster than CasADi's own sparse solver. The
pressures at the stages are inputs, for the drive is linear and is carried outside, and so is the
form of the step, so that one function serves steps of any length.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, isfinite
from typing import Any

import casadi as ca
import numpy as np

from softmpc.compiled import compiled
from softmpc.control.buffered import Buffered
from softmpc.control.step_form import StepForm
from softmpc.model.model import Model
from softmpc.simulation.tableau import Tableau, radau_iia

__all__ = ["STAGES", "ArmStep", "Length", "Stages"]

Array = np.ndarray
STAGES = 2
CONVERGED = 0.03  # scaled change of the unknowns in the last of quadratically converging iterations
ITERATIONS = 12


@dataclass(frozen=True)
class Length:
    """Steps of one length: form for the function, and (q, dq) at the end from (q, dq) and a."""

    shape: Array  # of_rate, to_strain, to_rate, in one row
    by_start: Array  # 2n×2n
    by_unknowns: Array  # 2n × s·n


@dataclass(frozen=True)
class Stages:
    """A step that was solved: its causes (q, dq, pressures at the stages, force), its unknowns,
    and their slope in the causes. The next ones begin on that slope."""

    causes: Array
    a: Array
    slope: Array


class ArmStep:
    """Steps of one model under pressures at the stages (s·m) and a constant force (n)."""

    def __init__(self, model: Model, mode: str = "auto") -> None:
        from scipy.linalg.lapack import dgesv

        self.model, self._solve = model, dgesv
        self.tableau: Tableau = radau_iia(STAGES)
        self._scale = StepForm.scale(model, STAGES)
        self._equations = Buffered(compiled(_function(model), mode))

    def length(self, seconds: float) -> Length:
        """What belongs to steps of that length."""
        form = StepForm.of(self.model, self.tableau, seconds)
        eye, none = np.eye(self.model.strains), np.zeros((self.model.strains,) * 2)
        start = [[eye, form.of_rate[-1] * eye], [none, form.kept * eye]]
        ends = np.vstack([form.to_strain[-1], form.to_rate[-1]])
        shape = np.concatenate([form.of_rate, form.to_strain.T.ravel(), form.to_rate.T.ravel()])
        return Length(shape, np.block(start), np.kron(ends, eye))

    def solve(self, causes: Array, before: Stages | None, of: Length) -> Stages:
        """Unknowns of a step, by Newton's method from what a step before makes likely.

        Raises `ArithmeticError` where it ends nowhere.
        """
        most = inf
        if before is None:
            a = np.zeros(len(self._scale))
        else:
            a = before.a + before.slope @ (causes - before.causes)
        for _ in range(ITERATIONS):
            by_a, right = self._equations(causes, a, of.shape)
            _, _, found, singular = self._solve(by_a.T, right.T, overwrite_a=1, overwrite_b=1)
            a = a - found[:, 0]
            most = float(np.abs(found[:, 0] / self._scale).max())
            if singular or not isfinite(most):
                break
            if most <= CONVERGED:
                return Stages(causes, a, -found[:, 1:])
        raise ArithmeticError(f"the stages of a step end {most:.3g} of their size apart")


def _function(model: Model) -> ca.Function:
    """(causes, a, shape) -> slope of the stages' equations in a; their values, and their slope in
    the causes beside them; dense."""
    n, m = model.strains, len(model.layout.p)
    causes, a = ca.MX.sym("causes", 3 * n + STAGES * m), ca.MX.sym("a", STAGES * n)
    shape = ca.MX.sym("shape", STAGES + 2 * STAGES**2)
    q, dq, p, f = ca.vertsplit(causes, [0, n, 2 * n, 2 * n + STAGES * m, 3 * n + STAGES * m])
    of_rate, to_strain, to_rate = ca.vertsplit(
        shape, [0, STAGES, STAGES + STAGES**2, STAGES + 2 * STAGES**2]
    )
    to_strain, to_rate = (ca.reshape(x, STAGES, STAGES) for x in (to_strain, to_rate))
    parts, pressures = ca.vertsplit(a, n), ca.vertsplit(p, m)
    accelerates = model.order == 2
    r, by_a, by = [], [], []
    for s in range(STAGES):
        at: list[Any] = [q + sum(to_strain[s, j] * part for j, part in enumerate(parts))]
        at.append(sum(to_rate[s, j] * part for j, part in enumerate(parts)))
        at.append(parts[s] if accelerates else ca.MX.zeros(n))
        if accelerates:
            at[:2] = at[0] + of_rate[s] * dq, at[1] + dq
        K, D, M, P = model.residual_jacobian(*at, pressures[s])
        r.append(model.residual(*at, pressures[s]) - f)
        blocks = [K * to_strain[s, j] + D * to_rate[s, j] for j in range(STAGES)]
        blocks[s] = blocks[s] + (M if accelerates else 0)
        by_a.append(ca.horzcat(*blocks))
        to_p = [P if j == s else ca.MX.zeros(n, m) for j in range(STAGES)]
        by_rate = K * of_rate[s] + D if accelerates else ca.MX.zeros(n, n)
        by.append(ca.horzcat(K, by_rate, *to_p, -ca.MX.eye(n)))
    right = ca.horzcat(ca.vertcat(*r), ca.vertcat(*by))
    outputs = [ca.densify(x) for x in (ca.vertcat(*by_a), right)]
    return ca.Function("arm_stages", [causes, a, shape], outputs)
