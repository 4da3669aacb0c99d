"""The program of inverse statics for one kind of targets; their values are its parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from softmpc.statics.program import Extra, RestProgram, RestSolver, Rows
from softmpc.statics.rest_costs import RestCost
from softmpc.statics.targets import Target

__all__ = ["InverseProgram"]

PRICE = 1e8  # of missing by an arm length, against a cost of one
# Starts are equilibria, often near: the barrier can begin low. Saves two of eleven iterations.
BARRIER = {"mu_init": 1e-7}


@dataclass(frozen=True)
class InverseProgram:
    """IPOPT for: the least cost, with what is missed at its price, in equilibrium."""

    solver: RestSolver
    extra: int  # further variables: what is missed, and those of the cost
    cost: ca.Function  # (variables, parameters) -> the cost alone

    @classmethod
    def of(
        cls, program: RestProgram, cost: RestCost, targets: Sequence[Target], angle_length: float
    ) -> InverseProgram:
        """For targets of the kinds of these; one radian counts as `angle_length` (m)."""
        length = program.model.scene.manipulator.length
        terms, symbols, off = cost.terms(program), [], []
        for k, target in enumerate(targets):
            i = target.index(len(program.tips))
            symbols.append(ca.SX.sym(f"target_{k}", len(target.values)))
            missed = target.features(program.tips[i], program.rotations[i]) - symbols[-1]
            off.append(missed * (angle_length if target.turns else 1.0) / length)
        count = sum(part.numel() for part in off)
        miss, free = ca.SX.sym("miss", count), np.full(count, np.inf)
        extra = Extra(
            ca.vertcat(miss, terms.extra.symbol),
            np.concatenate([-free, terms.extra.low]),
            np.concatenate([free, terms.extra.high]),
        )
        rows = Rows(
            ca.vertcat(ca.vertcat(*off) - miss, terms.rows.value),
            np.concatenate([np.zeros(count), terms.rows.low]),
            np.concatenate([np.zeros(count), terms.rows.high]),
        )
        weight = ca.SX.sym("weight")  # of the cost, one but where that pulls off the target
        parameters = ca.vertcat(*symbols, terms.parameters, weight)
        objective = weight * terms.objective + 0.5 * PRICE * ca.sumsqr(miss)
        solver = program.solver(
            objective, extra=extra, rows=rows, parameters=parameters, options=BARRIER
        )
        given = [solver.variables, parameters]
        return cls(solver, len(extra.low), ca.Function("cost", given, [terms.objective]))
