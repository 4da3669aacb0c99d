"""Costs and limits of all intervals as numbers: values, and slopes where they are not constant.

Most terms are linear, such as effort, rates and pressures: their slopes are computed once.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from softmpc.compiled import compiled
from softmpc.control.buffered import Buffered

__all__ = ["Terms"]

Array = np.ndarray


class Terms:
    """Rows that depend on (u_before, u, x, given, ratio) of their interval.

    Slopes are those in (u_before, u, x), dense (N×rows×…). `still` bounds the columns of the arm's
    strains and rates: rows without them whose slopes are constant do not change from solve to
    solve, even with the states eliminated; the others are `moving`.
    """

    def __init__(
        self, name: str, value: ca.SX, symbols: Sequence[ca.SX], ratios: Array, arm: int, mode: str
    ) -> None:
        self.name, self.mode, self.ratios = name, mode, np.asarray(ratios)[:, None]
        self.value, self.symbols = ca.densify(value), list(symbols)
        self.rows = value.numel()
        variables = ca.vertcat(*symbols[:3])
        self._J = ca.sparsify(ca.jacobian(self.value, variables))
        every = ca.vertcat(*symbols[:4])
        bent = ca.which_depends(self.value, every, 2, True) if self.rows else []
        self.bent_rows: Any = np.flatnonzero(np.array(bent, dtype=bool))
        self.pattern = pattern = self._pattern(self._J)
        self.bent_columns: Any = np.flatnonzero(pattern[self.bent_rows].any(axis=0))
        first = 2 * symbols[1].numel()
        self.moving: Any = np.asarray(pattern[:, first : first + arm].any(axis=1))
        self.moving[self.bent_rows] = True
        self.of_input: Any = pattern[:, :first].any(axis=1)  # rows in which inputs stand themselves

    @staticmethod
    def _pattern(J: ca.SX) -> Array:
        return np.array(np.asarray(ca.DM(J.sparsity(), 1.0)), dtype=bool)

    @cached_property
    def _values(self) -> Buffered:
        one = ca.Function(self.name, self.symbols, [self.value], {"cse": True})
        return Buffered(compiled(one.map(len(self.ratios)), self.mode))

    @property
    def bent_slopes(self) -> ca.SX:
        """The slopes that are not constant: those of `bent_rows` in `bent_columns`, dense."""
        rows, columns = self.bent_rows.tolist(), self.bent_columns.tolist()
        return ca.densify(self._J[rows, columns])

    @cached_property
    def _slopes(self) -> Buffered:
        """Values and those slopes that are not constant."""
        outputs = [self.value, self.bent_slopes]
        one = ca.Function(f"{self.name}_slopes", self.symbols, outputs, {"cse": True})
        return Buffered(compiled(one.map(len(self.ratios)), self.mode))

    @cached_property
    def constant(self) -> Array:
        """The slopes; those that are not constant are zero."""
        J = ca.densify(self._J)
        J[self.bent_rows.tolist(), :] = 0.0
        function = ca.Function("constant", self.symbols, [J])
        zeros = [np.zeros(symbol.numel()) for symbol in self.symbols[:4]]
        found = [np.asarray(function(*zeros, float(ratio))) for ratio in self.ratios[:, 0]]
        return np.array(found).reshape(len(self.ratios), *J.shape)

    def make(self) -> None:
        """Make the functions now, so that the first solve need not."""
        if self.rows:
            _ = self._values, self.constant
        if len(self.bent_rows):
            _ = self._slopes

    def values(self, u_before: Array, u: Array, x: Array, given: Array) -> Array:
        """Values (N×rows); arguments have one row an interval."""
        if not self.rows:
            return np.zeros((len(self.ratios), 0))
        return self._values(u_before, u, x, given, self.ratios)[0].copy()

    def __call__(self, u_before: Array, u: Array, x: Array, given: Array) -> tuple[Array, Array]:
        """Values (N×rows) and slopes (N×rows×columns)."""
        if not len(self.bent_rows):
            return self.values(u_before, u, x, given), self.constant
        value, slopes = self._slopes(u_before, u, x, given, self.ratios)
        found, shape = self.constant.copy(), (len(self.ratios), len(self.bent_columns), -1)
        found[:, self.bent_rows[:, None], self.bent_columns] = slopes.reshape(shape).swapaxes(1, 2)
        return value.copy(), found
