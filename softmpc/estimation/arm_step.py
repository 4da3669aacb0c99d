"""One implicit step of the arm and its slopes as one small CasADi function.

Two stages of Radau IIA in second-order form. The pressures at the stages are inputs, for the drive
is linear and is carried outside, and so is the form of the step, so that one function serves steps
of any length. A fixed number of Newton iterations keeps it free of branches.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from softmpc.compiled import compiled
from softmpc.control.buffered import Buffered
from softmpc.control.step_form import StepForm
from softmpc.model.model import Model
from softmpc.simulation.tableau import Tableau, radau_iia

__all__ = ["ArmStep", "Moved"]

Array = np.ndarray
STAGES = 2
ITERATIONS = 3


@dataclass(frozen=True)
class Moved:
    """Strains and rates after a step, and their slopes in what was before; SI."""

    q: Array
    dq: Array
    a: Array  # unknowns of the stages (s·n)
    by_q: Array  # 2n×n
    by_dq: Array
    by_p: Array  # 2n × s·m, stage after stage
    by_f: Array  # in a constant force on the strains
    change: float  # of the unknowns in the last iteration, scaled: small where it has converged


class ArmStep:
    """Steps of one model; `advance` for the arguments."""

    def __init__(self, model: Model, mode: str = "auto") -> None:
        self.model = model
        self.tableau: Tableau = radau_iia(STAGES)
        self._scale = StepForm.scale(model, STAGES)
        self._step = Buffered(compiled(_function(model), mode))

    def form(self, length: float) -> StepForm:
        """The form of a step of `length` seconds."""
        return StepForm.of(self.model, self.tableau, length)

    def advance(self, q: Array, dq: Array, p: Array, f: Array, a: Array, form: StepForm) -> Moved:
        """Strains after a step of some form under pressures p at its stages (s×m) and force f (n).

        `a` (s·n) is where the iterations begin.
        """
        n = self.model.strains
        shapes = form.of_rate, form.to_strain.T.ravel(), form.to_rate.T.ravel()
        end, unknowns, slopes, change = (
            value.copy() for value in self._step(q, dq, p, f, a, *shapes)
        )
        by_q, by_dq, by_p, by_f = np.split(slopes.T, [n, 2 * n, slopes.shape[0] - n], axis=1)
        end = end.ravel()
        return Moved(
            end[:n], end[n:], unknowns.ravel(), by_q, by_dq, by_p, by_f,
            float(np.abs(change.ravel() / self._scale).max()),
        )  # fmt: skip


def _function(model: Model) -> ca.Function:
    """(q, dq, p, f, a, form) -> end, a, slopes in (q, dq, p, f), last change of a; dense."""
    n, m = model.strains, len(model.layout.p)
    q, dq, f = (ca.MX.sym(name, n) for name in ("q", "dq", "f"))
    p, a = ca.MX.sym("p", m, STAGES), ca.MX.sym("a", STAGES * n)
    shapes: list[Any] = [ca.MX.sym("of_rate", STAGES)]
    shapes += [ca.MX.sym(name, STAGES, STAGES) for name in ("to_strain", "to_rate")]
    step = _Step(model, q, dq, p, f, *shapes)
    now, slopes, change = a, None, None
    for _ in range(ITERATIONS):
        r, by_a, others = step.rows(now)
        found = ca.solve(by_a, ca.horzcat(r, *others), "qr")
        change, slopes = -found[:, 0], -found[:, 1:]
        now = now + change
    end, end_slopes = step.end(now, slopes)
    flat = [ca.reshape(shape, -1, 1) for shape in shapes]
    symbols = [ca.MX.sym(f"flat_{i}", part.numel()) for i, part in enumerate(flat)]
    back = [ca.reshape(symbol, *shape.shape) for symbol, shape in zip(symbols, shapes, strict=True)]
    outputs = [end, now, end_slopes, change]
    outputs = [ca.densify(one) for one in ca.substitute(outputs, shapes, back)]
    return ca.Function("arm_step", [q, dq, p, f, a, *symbols], outputs)


@dataclass(frozen=True)
class _Step:
    """The equations of one step; MX."""

    model: Model
    q: Any
    dq: Any
    p: Any
    f: Any
    of_rate: Any
    to_strain: Any
    to_rate: Any

    @property
    def accelerates(self) -> bool:
        return self.model.order == 2

    def at(self, s: int, a: Any) -> tuple[Any, Any, Any]:
        """q, dq, ddq at stage s."""
        parts = ca.vertsplit(a, self.model.strains)
        q = self.q + sum(self.to_strain[s, j] * part for j, part in enumerate(parts))
        dq = sum(self.to_rate[s, j] * part for j, part in enumerate(parts))
        if not self.accelerates:
            return q, dq, 0 * parts[s]
        return q + self.of_rate[s] * self.dq, self.dq + dq, parts[s]

    def rows(self, a: Any) -> tuple[Any, Any, list[Any]]:
        """Residuals of all stages, their slope in a, and those in q, dq, p and f."""
        n, m, kept = self.model.strains, self.p.shape[0], float(self.accelerates)
        r, by_a, by = [], [], []
        for s in range(STAGES):
            at = *self.at(s, a), self.p[:, s]
            K, D, M, P = self.model.residual_jacobian(*at)
            r.append(self.model.residual(*at) - self.f)
            blocks = [K * self.to_strain[s, j] + D * self.to_rate[s, j] for j in range(STAGES)]
            if self.accelerates:
                blocks[s] = blocks[s] + M
            none = ca.MX.zeros(n, m)
            to_p = [P if j == s else none for j in range(STAGES)]
            by_a.append(ca.horzcat(*blocks))
            by.append(ca.horzcat(K, K * self.of_rate[s] + D * kept, *to_p, -ca.MX.eye(n)))
        return ca.vertcat(*r), ca.densify(ca.vertcat(*by_a)), [ca.densify(ca.vertcat(*by))]

    def end(self, a: Any, slopes: Any) -> tuple[Any, Any]:
        """Strains and rates at the end, the last stage, and their slopes (2n×…)."""
        n, last = self.model.strains, STAGES - 1
        q, dq, _ = self.at(last, a)
        parts = ca.vertsplit(slopes, n)
        to_q = sum(self.to_strain[last, j] * part for j, part in enumerate(parts))
        to_dq = sum(self.to_rate[last, j] * part for j, part in enumerate(parts))
        eye, none = ca.MX.eye(n), ca.MX.zeros(n, slopes.shape[1] - 2 * n)
        kept = float(self.accelerates)
        own_q = ca.horzcat(eye, self.of_rate[last] * eye * kept, none)
        own_dq = ca.horzcat(0 * eye, kept * eye, none)
        return ca.vertcat(q, dq), ca.vertcat(to_q + own_q, to_dq + own_dq)
